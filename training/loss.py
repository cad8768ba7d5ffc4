"""Targets and losses of the layout network."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from galoc.detect.strip import ROWS
from training.stream import Frames

WEIGHTS = {"boundary": 1.0, "visible": 1.0, "edge": 4.0, "semantic": 0.5}
"""Of the parts of the loss."""
SEEN_WEIGHT = (0.25, 0.6, 1.0)
"""Of a column's boundary: outside the image, hidden, visible."""
EDGE_SD = 0.8
"""Width of the bump that a wall edge is in its target, columns."""
EDGE_GAIN = 5.0
"""How much more a column with an edge counts."""


@dataclass(frozen=True, slots=True)
class Targets:
    """Of a batch, as tensors; names as in :class:`training.stream.Frames`."""

    row: Tensor
    """(B, 2, C)."""
    seen: Tensor
    """(B, 2, C) int64."""
    edge: Tensor
    """(B, 2, W) 0 to 1."""
    semantic: Tensor
    """(B, ROWS / 2, C) int64."""


def inputs(frames: Frames) -> Tensor:
    """(B, 4, ROWS, W) network input of strips."""
    columns = frames.rgb.shape[2]
    mask = np.unpackbits(frames.mask, axis=2)[:, :, :columns, None]
    both = np.concatenate([frames.rgb, mask * np.uint8(255)], axis=3)
    return torch.from_numpy(both).permute(0, 3, 1, 2).float().mul_(1.0 / 255.0)


def targets(frames: Frames) -> Targets:
    """What the network should say of strips."""
    columns = frames.rgb.shape[2]
    edges = frames.edges.astype(np.float32)
    at = np.arange(columns, dtype=np.float32)
    bump = np.zeros((len(frames), 2, columns), np.float32)
    for kind in (0, 1):
        column = np.where(edges[..., 1] == kind, edges[..., 0], -1e3)
        bump[:, kind] = np.exp(-0.5 * ((at[None, None] - column[..., None]) / EDGE_SD) ** 2).max(axis=1)
    return Targets(
        torch.from_numpy(frames.row.astype(np.float32)),
        torch.from_numpy(frames.seen.astype(np.int64)),
        torch.from_numpy(np.nan_to_num(bump)),
        torch.from_numpy(frames.semantic.astype(np.int64)),
    )


def losses(output: tuple[Tensor, ...], wanted: Targets) -> dict[str, Tensor]:
    """Parts of the loss, and the boundary error of visible columns, rows (median, not differentiable)."""
    boundary, visible, edge, semantic = (part.float() for part in output)
    known = torch.isfinite(wanted.row)
    row = torch.nan_to_num(wanted.row, nan=0.0).clamp(0.0, ROWS - 1.0)
    low = row.floor().clamp(max=ROWS - 2.0)
    share = row - low
    log_p = functional.log_softmax(boundary, dim=2)
    index = low.long().unsqueeze(2)
    below = log_p.gather(2, index).squeeze(2)
    above = log_p.gather(2, index + 1).squeeze(2)
    weight = torch.tensor(SEEN_WEIGHT, device=row.device)[wanted.seen] * known
    fit = -((1.0 - share) * below + share * above)
    saw = (wanted.seen == 2).float()
    edge_loss = functional.binary_cross_entropy_with_logits(edge, wanted.edge, reduction="none")
    pixels = functional.cross_entropy(semantic, wanted.semantic, reduction="none")
    drawn = (wanted.semantic > 0).float()
    with torch.no_grad():
        off = (boundary.argmax(2) - row).abs()[(wanted.seen == 2) & known]
    return {
        "boundary": (fit * weight).sum() / weight.sum().clamp(min=1.0),
        "visible": functional.binary_cross_entropy_with_logits(visible, saw),
        "edge": (edge_loss * (1.0 + EDGE_GAIN * wanted.edge)).mean(),
        "semantic": (pixels * drawn).sum() / drawn.sum().clamp(min=1.0),
        "rows_off": off.median() if off.numel() else torch.zeros(()),
    }


def total(parts: dict[str, Tensor]) -> Tensor:
    """The loss."""
    return torch.stack([weight * parts[name] for name, weight in WEIGHTS.items()]).sum()
