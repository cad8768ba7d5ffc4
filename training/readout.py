"""From the network's distributions to the numbers of contract ``columns/1``."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor, nn

from galoc.detect.strip import COLUMN_GROUP, ROWS, elevation_of
from training.network import LayoutNet

WINDOW = 9
"""Rows on either side of the likeliest one that count as "near there"."""
KNOTS_DEG = (0.15, 0.3, 0.45, 0.6, 0.9, 1.4, 2.2, 3.5, 6.0)
"""Raw spreads between which the calibration is interpolated, degrees."""


class Readout(nn.Module):
    """A network whose outputs are elevation, sigma, sure, visible, in_frame and edge, as galoc.detect.columns has them.

    Args:
        net: the network.
        calibration: (2, len(KNOTS_DEG)) measured spread of the error, degrees, where the distribution's own is that of
            each knot, for lines inside and outside the image; None: the distribution is believed.
        mirror: look at the mirrored strip, too, and take the mean: twice the work, and what the network says of a
            wall no longer depends on which side of a room it is.
    """

    def __init__(self, net: LayoutNet, calibration: np.ndarray | None = None, *, mirror: bool = True) -> None:
        super().__init__()
        self.net, self.mirror = net, mirror
        self.register_buffer("row_elevation", torch.tensor(elevation_of(np.arange(ROWS)), dtype=torch.float32))
        knots = np.radians(np.array(KNOTS_DEG))
        values = np.stack([knots, knots]) if calibration is None else np.radians(np.asarray(calibration, np.float64))
        # Piecewise linear curves as sums of ramps, which every runtime has.
        slope = np.diff(values) / np.diff(knots)
        self.register_buffer("ramp", torch.tensor(np.diff(slope, prepend=0.0), dtype=torch.float32))
        self.register_buffer("knot", torch.tensor(knots[:-1], dtype=torch.float32))
        self.register_buffer("least", torch.tensor(values[:, 0], dtype=torch.float32))

    def forward(self, strip: Tensor) -> tuple[Tensor, ...]:
        """(B, 4, ROWS, W) strips to (B, 2, C) five times and (B, 2, W)."""
        p, visible, edge = self._looked(strip)
        row = torch.arange(ROWS, device=p.device, dtype=torch.float32).reshape(1, 1, ROWS, 1)
        mode = p.argmax(dim=2, keepdim=True).float()
        near = p * ((row - mode).abs() <= WINDOW).float()
        sure = near.sum(2)
        weight = near / sure.unsqueeze(2)
        angle = self.row_elevation.reshape(1, 1, ROWS, 1)
        # The mean of a narrow neighbourhood: a second hump, or a long tail, must not pull the first.
        core = p * ((row - mode).abs() <= 2.0).float()
        elevation = (core * angle).sum(2) / core.sum(2)
        spread = 1.2533 * (weight * (angle - elevation.unsqueeze(2)).abs()).sum(2)
        mask = strip[:, 3]
        batch, _, columns = mask.shape
        inside = mask.reshape(batch, ROWS, columns // COLUMN_GROUP, COLUMN_GROUP).mean(3).unsqueeze(1)
        in_frame = (p * inside).sum(2)
        return elevation, self._calibrated(spread, in_frame), sure, visible, in_frame, edge

    def _looked(self, strip: Tensor) -> tuple[Tensor, ...]:
        """Probabilities: boundary (B, 2, ROWS, C), visible (B, 2, C), edge (B, 2, W)."""
        if not self.mirror:
            boundary, visible, edge, _ = self.net(strip)
            return torch.softmax(boundary, dim=2), torch.sigmoid(visible), torch.sigmoid(edge)
        boundary, visible, edge, _ = self.net(torch.cat([strip, strip.flip(3)], 0))
        parts = torch.softmax(boundary, dim=2), torch.sigmoid(visible), torch.sigmoid(edge)
        count = strip.shape[0]
        return tuple(0.5 * (part[:count] + part[count:].flip(part.dim() - 1)) for part in parts)

    def _calibrated(self, spread: Tensor, in_frame: Tensor) -> Tensor:
        above = (spread.unsqueeze(-1) - self.knot).clamp(min=0.0)
        inside, outside = (self.least[i] + (above * self.ramp[i]).sum(-1) for i in (0, 1))
        return (in_frame * inside + (1.0 - in_frame) * outside).clamp(min=2e-4)


NAMES = ("elevation", "sigma", "sure", "visible", "in_frame", "edge")
"""Outputs in order."""
