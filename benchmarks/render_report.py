"""Tables and figure of the render benchmark."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from render_rounds import told

Row = dict[str, Any]
COLOURS = {
    "raster fast": "#1d3a66", "raster default": "#3d6fb4", "raster best": "#9dbbe0", "gl": "#5a9e6f",
    "pyrender": "#8f6bb3", "MiniWorld FourRooms": "#c8553d", "MiniWorld Maze": "#e0a08f",
}  # fmt: skip
OUTPUTS = {"all": "RGB + depth + ids", "rgb": "RGB"}


def report(result: Row) -> str:
    """Rates by CPU and wall time, then the bars."""
    sizes = list(dict.fromkeys(tuple(r["size"]) for r in result["rows"]))
    names = [f"{w}x{h}" for w, h in sizes]
    lines = []
    for clock, words in (("cpu", "CPU second, all threads"), ("wall", "wall second")):
        head = f"{'frames per ' + words:<42}"
        lines += ["", head + "".join(f"{n:>24}" for n in names)]
        keys = list(dict.fromkeys((r["name"], r["outputs"]) for r in result["rows"]))
        for name, outputs in keys:
            rates = {
                tuple(r["size"]): r["rate"] for r in result["rows"] if (r["name"], r["outputs"]) == (name, outputs)
            }
            cells = [told(rates[s][clock] if rates.get(s) else None) for s in sizes]
            lines.append(f"{name:<22}{OUTPUTS[outputs]:<20}" + "".join(f"{c:>24}" for c in cells))
    lines += ["", "median (least-largest) of the rounds"]
    lines += [f"not measured: {reason}" for reason in result["missing"]]
    if result["bars"]:
        lines += [
            "",
            f"{'times faster':<40}{'outputs':<20}{'size':<9}{'asked':>7}{'by CPU time':>20}{'by wall time':>20}",
        ]
    for bar in result["bars"]:
        size = f"{bar['size'][0]}x{bar['size'][1]}"
        pair = f"{bar['name']} / {bar['other']}"
        found = bar["ratio"]
        cells = ("-", "-", "not measured") if found is None else (
            told(found["cpu"], 1), told(found["wall"], 1), "met" if bar["met"] else "NOT MET"
        )  # fmt: skip
        asked = f"{bar['least']:g}"
        lines.append(
            f"{pair:<40}{OUTPUTS[bar['outputs']]:<20}{size:<9}{asked:>7}{cells[0]:>20}{cells[1]:>20}  {cells[2]}"
        )
    return "\n".join(lines)


def figure(result: Row, shown: dict[str, Any]) -> bytes:
    """Rates over picture size, and one view as each contestant draws it."""
    from matplotlib.figure import Figure

    page = Figure(figsize=(17.0, 5.4), layout="constrained")
    left, right = page.subfigures(1, 2, width_ratios=(1.0, 1.75))
    axes = left.subplots()
    for name, outputs in dict.fromkeys((r["name"], r["outputs"]) for r in result["rows"]):
        rows = [r for r in result["rows"] if (r["name"], r["outputs"]) == (name, outputs) and r["rate"]]
        if rows:
            pixels = [r["size"][0] * r["size"][1] for r in rows]
            middle, low, high = np.array([r["rate"]["cpu"] for r in rows]).T
            bar = np.abs(np.array([low, high]) - middle)
            style = {"ls": "-" if outputs == "all" else "--", "marker": "o", "ms": 4, "lw": 1.4}
            label = f"{name}, {OUTPUTS[outputs]}"
            axes.errorbar(pixels, middle, bar, color=COLOURS[name], label=label, capsize=2, **style)
    ticks = sorted({tuple(r["size"]) for r in result["rows"]})
    axes.set(xscale="log", yscale="log", ylabel="frames per CPU second, all threads", xlabel="picture size / px")
    axes.set_xticks([w * h for w, h in ticks], [f"{w}x{h}" for w, h in ticks])
    axes.set_xticks([], minor=True)
    axes.grid(True, alpha=0.25, lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        left.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=7, frameon=False)
    if shown:
        columns = min(4, len(shown))
        panels = np.atleast_1d(right.subplots(-(-len(shown) // columns), columns)).ravel()
        for panel in panels:
            panel.axis("off")
        for panel, (name, rgb) in zip(panels, shown.items(), strict=False):
            panel.imshow(rgb)
            panel.set_title(name, fontsize=9)
    out = io.BytesIO()
    page.savefig(out, dpi=110)
    return out.getvalue()
