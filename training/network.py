"""The layout network: a strip in, boundary rows, visibility and wall edges per column out.

A small pyramid of convolutions looks at the picture; what it finds is folded over the height into one line of
features, where dilated convolutions reason along the wall. Each boundary is a distribution over the strip's rows:
evidence from the picture times a coarse prior from the line, so that a boundary hidden by a cupboard, or outside the
image, is a broad distribution instead of a wrong number.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from galoc.detect.strip import ROWS, elevation_of

CLASSES = 9
"""Semantic classes of the auxiliary output, :data:`galoc_env.scene.SEMANTIC_NAMES`."""
COARSE = 32
"""Rows of the line's prior."""


@dataclass(frozen=True, slots=True)
class Shape:
    """Channels of the network."""

    stages: tuple[int, int, int, int] = (16, 32, 64, 112)
    """Per stage of the pyramid, at 1/2, 1/4, 1/8 and 1/16."""
    blocks: tuple[int, int, int] = (1, 2, 3)
    """Residual blocks at 1/4, 1/8 and 1/16."""
    lateral: tuple[int, int, int] = (16, 32, 48)
    """On the way back up, at 1/2, 1/4 and 1/8."""
    line: int = 96
    """Of the line of features."""

    @classmethod
    def of(cls, values: dict[str, Any]) -> Shape:
        """From what a checkpoint holds."""
        return cls(tuple(values["stages"]), tuple(values["blocks"]), tuple(values["lateral"]), int(values["line"]))


def _conv(inside: int, outside: int, size: int = 3, stride: int = 1) -> nn.Sequential:
    conv = nn.Conv2d(inside, outside, size, stride, size // 2, bias=False)
    return nn.Sequential(conv, nn.BatchNorm2d(outside), nn.ReLU(inplace=True))


class _Residual(nn.Module):
    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = _conv(channels, channels)
        self.second = nn.Sequential(nn.Conv2d(channels, channels, 3, 1, 1, bias=False), nn.BatchNorm2d(channels))

    def forward(self, x: Tensor) -> Tensor:
        return functional.relu(x + self.second(self.first(x)))


class _LineResidual(nn.Module):
    def __init__(self, channels: int, dilation: int) -> None:
        super().__init__()
        self.first = nn.Conv1d(channels, channels, 3, 1, dilation, dilation=dilation, bias=False)
        self.second = nn.Conv1d(channels, channels, 3, 1, 1, bias=False)
        self.norms = nn.ModuleList([nn.BatchNorm1d(channels), nn.BatchNorm1d(channels)])

    def forward(self, x: Tensor) -> Tensor:
        y = functional.relu(self.norms[0](self.first(x)))
        return functional.relu(x + self.norms[1](self.second(y)))


class _Fold(nn.Module):
    """(B, C, h, w) to (B, out, w): one weight per row, so that the line knows how high a thing was seen."""

    def __init__(self, channels: int, height: int, outside: int, squeeze: int | None = None) -> None:
        super().__init__()
        self.squeeze = _conv(channels, squeeze, 1) if squeeze else nn.Identity()
        self.fold = nn.Conv2d(squeeze or channels, outside, (height, 1), bias=False)
        self.norm = nn.BatchNorm1d(outside)

    def forward(self, x: Tensor) -> Tensor:
        return self.norm(self.fold(self.squeeze(x)).squeeze(2))


def _double(x: Tensor) -> Tensor:
    """Twice as many columns, and rows where there are any."""
    return functional.interpolate(x, scale_factor=2.0, mode="nearest")


class LayoutNet(nn.Module):
    """(B, 4, ROWS, W) strips, channels RGB and mask, values 0 to 1; W a multiple of 16.

    Returns:
        boundary (B, 2, ROWS, W/2) logits over rows; visible (B, 2, W/2) logits; edge (B, 2, W) logits of corner and
        occlusion; semantic (B, CLASSES, ROWS/2, W/2) logits.
    """

    def __init__(self, shape: Shape | None = None) -> None:
        super().__init__()
        shape = shape or Shape()
        a, b, c, d = shape.stages
        p, q, r = shape.lateral
        line = shape.line
        self.stage1 = _conv(5, a, 5, 2)
        self.stage2 = nn.Sequential(_conv(a, b, 3, 2), *(_Residual(b) for _ in range(shape.blocks[0])))
        self.stage3 = nn.Sequential(_conv(b, c, 3, 2), *(_Residual(c) for _ in range(shape.blocks[1])))
        self.stage4 = nn.Sequential(_conv(c, d, 3, 2), *(_Residual(d) for _ in range(shape.blocks[2])))
        self.down3, self.side3, self.up3 = nn.Conv2d(d, r, 1), nn.Conv2d(c, r, 1), _conv(r, r)
        self.down2, self.side2, self.up2 = nn.Conv2d(r, q, 1), nn.Conv2d(b, q, 1), _conv(q, q)
        self.down1, self.side1, self.up1 = nn.Conv2d(q, p, 1), nn.Conv2d(a, p, 1), _conv(p, p)
        self.fold4, self.fold3 = _Fold(d, ROWS // 16, line), _Fold(r, ROWS // 8, line)
        self.fold2, self.fold1 = _Fold(q, ROWS // 4, line, 16), _Fold(p, ROWS // 2, line, 8)
        self.line4 = _LineResidual(line, 1)
        self.line3 = nn.Sequential(*(_LineResidual(line, k) for k in (1, 2, 4, 1)))
        self.line2 = nn.Sequential(*(_LineResidual(line, k) for k in (1, 2, 4, 8, 1)))
        self.line1 = _LineResidual(line, 1)
        self.head = nn.Conv1d(line, 2 * COARSE + 2 + 4, 3, 1, 1)
        self.heat = nn.Sequential(_conv(p, p), nn.Conv2d(p, 4, 1))
        self.classes = nn.Conv2d(p, CLASSES, 1)
        self.register_buffer("height_of_row", torch.tensor(elevation_of(np.arange(ROWS)), dtype=torch.float32))
        self.register_buffer("refine", torch.tensor(_interpolation(), dtype=torch.float32))

    def forward(self, strip: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """See the class."""
        x1 = self.stage1(self._normalised(strip))
        x2 = self.stage2(x1)
        x3 = self.stage3(x2)
        x4 = self.stage4(x3)
        f3 = self.up3(_double(self.down3(x4)) + self.side3(x3))
        f2 = self.up2(_double(self.down2(f3)) + self.side2(x2))
        f1 = self.up1(_double(self.down1(f2)) + self.side1(x1))
        y = self.line4(functional.relu(self.fold4(x4)))
        y = self.line3(functional.relu(self.fold3(f3) + _double(y)))
        y = self.line2(functional.relu(self.fold2(f2) + _double(y)))
        y = self.line1(functional.relu(self.fold1(f1) + _double(y)))
        out = self.head(y)
        batch, _, columns = out.shape
        prior = out[:, : 2 * COARSE].reshape(batch, 2, COARSE, columns)
        prior = torch.matmul(self.refine, prior)
        heat = self.heat(f1).reshape(batch, 2, 2, ROWS // 2, columns).transpose(2, 3).reshape(batch, 2, ROWS, columns)
        edge = out[:, 2 * COARSE + 2 :].reshape(batch, 2, 2, columns).transpose(2, 3).reshape(batch, 2, 2 * columns)
        return heat + prior, out[:, 2 * COARSE : 2 * COARSE + 2], edge, self.classes(f1)

    def _normalised(self, strip: Tensor) -> Tensor:
        """Each picture to mean 0 and spread 1 over what the image covers: exposure says nothing of walls."""
        rgb, mask = strip[:, :3], strip[:, 3:]
        count = mask.sum((2, 3), keepdim=True).clamp(min=1.0)
        mean = (rgb * mask).sum((1, 2, 3), keepdim=True) / (3.0 * count)
        centred = (rgb - mean) * mask
        spread = ((centred * centred).sum((1, 2, 3), keepdim=True) / (3.0 * count) + 1e-3).sqrt()
        height = self.height_of_row.reshape(1, 1, ROWS, 1) + torch.zeros_like(mask)
        return torch.cat([centred / spread, mask, height], 1)


def _interpolation() -> np.ndarray:
    """(ROWS, COARSE) linear interpolation from coarse rows to rows, constant beyond the outermost."""
    at = np.clip((np.arange(ROWS) + 0.5) * COARSE / ROWS - 0.5, 0.0, COARSE - 1.0)
    return np.clip(1.0 - np.abs(at[:, None] - np.arange(COARSE)), 0.0, None)
