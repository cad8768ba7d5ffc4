"""Table and figure of the environment benchmark."""

from __future__ import annotations

import io
from typing import Any

from render_rounds import told

Row = dict[str, Any]
COLOURS = {
    "single": "#1d3a66", "single, fast": "#7f7f7f", "gymnasium sync": "#5a9e6f", "gymnasium async": "#8f6bb3",
    "our batch": "#3d6fb4", "our batch, threads": "#9dbbe0", "MiniWorld Maze": "#c8553d",
}  # fmt: skip


def report(result: Row) -> str:
    """Rates, then ratios."""
    lines = ["", f"{'steps per second':<30}{'size':>9}{'lanes':>7}{'of CPU, all threads':>24}{'of wall':>24}"]
    for row in result["rows"]:
        width, height, lanes = row["case"]
        cells = [told(row["rate"][c] if row["rate"] else None) for c in ("cpu", "wall")]
        lines.append(f"{row['name']:<30}{f'{width}x{height}':>9}{lanes:>7}" + "".join(f"{c:>24}" for c in cells))
    lines += ["", "median (least-largest) of the rounds"]
    lines += [f"not measured: {reason}" for reason in result["missing"]]
    if result["ratios"]:
        lines += ["", f"{'times faster':<56}{'size':>9}{'lanes':>7}{'by CPU time':>20}{'by wall time':>20}"]
    for row in result["ratios"]:
        width, height, lanes = row["case"]
        cells = [told(row["ratio"][c], 1) for c in ("cpu", "wall")]
        pair = f"{row['name']} / {row['other']}"
        lines.append(f"{pair:<56}{f'{width}x{height}':>9}{lanes:>7}" + "".join(f"{c:>20}" for c in cells))
    lines += ["", f"{'asked':<56}{'size':>9}{'lanes':>7}{'at least':>20}{'by CPU time':>20}"]
    for row in result["bars"]:
        width, height, lanes = row["case"]
        cells = ["-", "not measured"] if row["ratio"] is None else [
            told(row["ratio"]["cpu"], 1), "met" if row["met"] else "NOT MET"
        ]  # fmt: skip
        pair = f"{row['name']} / {row['other']}"
        lines.append(f"{pair:<56}{f'{width}x{height}':>9}{lanes:>7}{row['least']:>20g}{cells[0]:>20}  {cells[1]}")
    return "\n".join(lines)


def figure(result: Row) -> bytes:
    """Single environments by picture size, vectors by lanes."""
    from matplotlib.figure import Figure

    page = Figure(figsize=(11.0, 4.6), layout="constrained")
    sizes, lanes = page.subplots(1, 2, sharey=True)
    vectors = result["settings"]["vector_size"]
    for name in dict.fromkeys(r["name"] for r in result["rows"]):
        rows = [r for r in result["rows"] if r["name"] == name and r["rate"]]
        plain = name.partition(" + ")[0]
        single = plain in ("single", "single, fast", "MiniWorld Maze")
        axes = sizes if single else lanes
        x = [r["case"][0] * r["case"][1] if single else r["case"][2] for r in rows]
        style = {"color": COLOURS[plain], "ls": "--" if plain != name else "-", "marker": "o", "ms": 4}
        if rows:
            axes.plot(x, [r["rate"]["wall"][0] for r in rows], label=name, **style)
    shapes = sorted({tuple(r["case"][:2]) for r in result["rows"]})
    sizes.set_xscale("log")
    sizes.set_xticks([w * h for w, h in shapes], [f"{w}x{h}" for w, h in shapes])
    sizes.set_xticks([], minor=True)
    sizes.set(yscale="log", xlabel="picture size / px", ylabel="steps per second, wall time", title="one environment")
    counts = sorted({r["case"][2] for r in result["rows"]})
    lanes.set_xscale("log")
    lanes.set_xticks(counts, [str(n) for n in counts])
    lanes.set_xticks([], minor=True)
    lanes.set(xlabel="lanes", title=f"vectors, {vectors}, all lanes together")
    for axes in (sizes, lanes):
        axes.grid(True, alpha=0.25, lw=0.6)
        axes.spines[["top", "right"]].set_visible(False)
        if axes.get_legend_handles_labels()[0]:
            axes.legend(fontsize=8, frameon=False)
    out = io.BytesIO()
    page.savefig(out, dpi=110)
    return out.getvalue()
