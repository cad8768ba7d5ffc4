"""Measures a checkpoint on homes that training never sees: ``python -m training.evaluate --out runs/training``."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro

from galoc.detect.strip import COLUMN_GROUP, elevation_of
from galoc.formats.atomic import write_atomic
from galoc.metrics import roc_auc
from training.loss import inputs
from training.readout import KNOTS_DEG, NAMES, Readout
from training.stream import TRAIN_HOMES, Frames, furnished, photograph
from training.trainer import CHECKPOINT, load_average
from training.views import WIDTHS

BLIND_SHARE = 0.04
"""A frame whose visible boundaries cover less of its columns is blind."""
FAR_DEG = 12.0
"""An error beyond this is another line, which `sure` is about, not `sigma`."""
EDGE_NEAR_DEG = 1.5
"""A found edge is right within this."""
PEAK = 0.35
"""Least probability of a found edge."""


@dataclass(frozen=True, slots=True)
class Options:
    """Measure the averaged network of a checkpoint."""

    out: Path = Path("runs/training")
    """Folder of the training run."""
    frames: int = 1500
    """Validation frames; made once, kept in the folder."""


def validation(folder: Path, count: int) -> dict[int, Frames]:
    """Labelled frames of validation homes (train split, behind the training homes), by width."""
    paths = {width: folder / f"validation-{count}-w{width}.npz" for width in WIDTHS}
    if all(path.exists() for path in paths.values()):
        return {width: Frames.load(path) for width, path in paths.items()}
    found: dict[int, list[Frames]] = {width: [] for width in WIDTHS}
    home = 0
    while sum(map(len, found.values())) < count:
        rng = np.random.default_rng([home, 77])
        for width, frame in photograph(furnished(TRAIN_HOMES + home, rng), rng, 4, 6):
            found[width].append(frame)
        home += 1
    frames = {width: Frames.joined(parts) for width, parts in found.items()}
    for width, path in paths.items():
        frames[width].save(path)
    return frames


@torch.no_grad()
def read(readout: Readout, frames: Frames, batch: int = 32) -> dict[str, np.ndarray]:
    """Outputs by name for all frames."""
    parts = []
    for k in range(0, len(frames), batch):
        rows = np.arange(k, min(k + batch, len(frames)))
        parts.append([out.numpy() for out in readout(inputs(frames.pick(rows)))])
    return {name: np.concatenate([p[i] for p in parts]) for i, name in enumerate(NAMES)}


@dataclass(frozen=True, slots=True, eq=False)
class Residuals:
    """All boundary columns of the validation frames, flat."""

    error_deg: np.ndarray
    sigma_deg: np.ndarray
    sure: np.ndarray
    seen: np.ndarray
    in_frame: np.ndarray
    """As the network says."""

    @classmethod
    def of(cls, read_by_width: dict[int, dict[str, np.ndarray]], frames: dict[int, Frames]) -> Residuals:
        """From outputs and labels."""
        parts: list[list[np.ndarray]] = []
        for width, out in read_by_width.items():
            truth = elevation_of(frames[width].row.astype(np.float64))
            ok = np.isfinite(truth)
            error = np.degrees(out["elevation"] - truth)
            sigma = np.degrees(out["sigma"])
            parts.append([a[ok] for a in (error, sigma, out["sure"], frames[width].seen, out["in_frame"])])
        return cls(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def boundary_metrics(r: Residuals) -> dict[str, Any]:
    """Errors and the calibration of sigma."""
    size = np.abs(r.error_deg)
    found: dict[str, Any] = {}
    for name, seen in (("visible", r.seen == 2), ("hidden", r.seen == 1), ("outside", r.seen == 0)):
        found[f"{name}_median_deg"], found[f"{name}_p90_deg"] = np.quantile(size[seen], (0.5, 0.9)).tolist()
        found[f"{name}_two_sigma"] = float(np.mean(size[seen] < 2.0 * r.sigma_deg[seen]))
        sure = seen & (r.sure > 0.9)
        found[f"{name}_sure_share"] = float(np.mean(r.sure[seen] > 0.9))
        found[f"{name}_sure_two_sigma"] = float(np.mean(size[sure] < 2.0 * r.sigma_deg[sure]))
    return found


def fitted_calibration(r: Residuals) -> np.ndarray:
    """(2, K) measured spread at each knot of the raw one, inside and outside: 95 % of errors are within twice of it."""
    size = np.abs(r.error_deg)
    edges = np.sqrt(np.array(KNOTS_DEG)[1:] * np.array(KNOTS_DEG)[:-1])
    which = np.digitize(r.sigma_deg, edges)
    curves = []
    for use in ((r.in_frame > 0.5) & (r.sure > 0.8) & (size < FAR_DEG), (r.in_frame <= 0.5) & (r.sure > 0.3)):
        held = [size[use & (which == k)] for k in range(len(KNOTS_DEG))]
        # Where hardly anything was measured, what the network says has to do.
        values = [np.quantile(h, 0.95) / 2.0 if len(h) > 50 else k for h, k in zip(held, KNOTS_DEG, strict=True)]
        curves.append(np.maximum.accumulate(np.maximum(values, 0.1)))
    return np.array(curves)


def edge_metrics(edge: dict[int, np.ndarray], frames: dict[int, Frames]) -> dict[str, float]:
    """Precision and recall of wall edges of either kind, by peaks alone (no decoder)."""
    hits, found_count, wanted_count, wanted_hit = 0, 0, 0, 0
    for width, probability in edge.items():
        for k in range(len(frames[width])):
            p = probability[k].max(axis=0)
            peak = (p > PEAK) & (p >= np.roll(p, 1)) & (p > np.roll(p, -1))
            found = np.flatnonzero(peak)
            truth = frames[width].edges[k]
            truth = truth[np.isfinite(truth[:, 0])]
            seen = truth[truth[:, 2] > 0.3, 0].astype(np.float64)
            everything = truth[:, 0].astype(np.float64)
            near = EDGE_NEAR_DEG * COLUMN_GROUP
            hits += sum(bool(np.any(np.abs(everything - f) < near)) for f in found)
            found_count += len(found)
            alone = [e for e in seen if np.sum(np.abs(everything - e) < 4.0 * COLUMN_GROUP) == 1]
            alone = [e for e in alone if 2 < e < width - 3]
            wanted_count += len(alone)
            wanted_hit += sum(bool(np.any(np.abs(found - e) < near)) for e in alone)
    return {"edge_precision": hits / max(found_count, 1), "edge_recall_isolated": wanted_hit / max(wanted_count, 1)}


def measure(readout: Readout, frames: dict[int, Frames]) -> tuple[dict[str, Any], Residuals]:
    """All metrics of a network, and the residuals behind them."""
    outputs = {width: read(readout, part) for width, part in frames.items()}
    residuals = Residuals.of(outputs, frames)
    shown = boundary_metrics(residuals)
    inside = np.concatenate([((o["in_frame"] > 0.5) == (frames[w].seen > 0)).ravel() for w, o in outputs.items()])
    shown["in_frame_right"] = float(inside.mean())
    shown |= edge_metrics({width: out["edge"] for width, out in outputs.items()}, frames)
    score = np.concatenate([o["visible"].max(axis=1).mean(axis=1) for o in outputs.values()])
    share = np.concatenate([(f.seen == 2).any(axis=1).mean(axis=1) for f in frames.values()])
    shown["blind_auc"] = roc_auc(score, share > BLIND_SHARE)
    shown["blind_share"] = float(np.mean(share <= BLIND_SHARE))
    return shown, residuals


def main(options: Options) -> None:
    """Print the metrics of the latest checkpoint, calibrated."""
    torch.set_num_threads(1)
    frames = validation(options.out, options.frames)
    net, facts = load_average(options.out / CHECKPOINT)
    _, residuals = measure(Readout(net), frames)
    calibration = fitted_calibration(residuals)
    shown, _ = measure(Readout(net, calibration), frames)
    shown |= {"frames_trained": facts["frames"], "calibration_deg": calibration.round(3).tolist()}
    for name, value in shown.items():
        print(f"{name:<28}{value if not isinstance(value, float) else round(value, 4)}")
    write_atomic(options.out / "metrics.json", json.dumps(shown, indent=1).encode())


if __name__ == "__main__":
    main(tyro.cli(Options))
