"""The learned detector: an ONNX network that says per column of the upright strip where wall, ceiling and floor meet.

Contract ``columns/1``. Input ``strip``: float32 (1, 4, 128, W), channels R, G, B, mask, each 0 to 1, W a multiple of
16 and at most 240 (a free axis), made by :func:`galoc.detect.strip.upright_strip`. Outputs, float32, with C = W / 2
columns of boundary angles and E = W columns of edges: ``elevation`` (1, 2, C) and ``sigma`` (1, 2, C), rad; the
probabilities ``sure``, ``visible`` and ``in_frame`` (1, 2, C) and ``edge`` (1, 2, E). They mean what
:class:`galoc.detect.columns.Columns` says. Other outputs are not looked at.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.camera import Camera, levelling
from galoc.detect.columns import Columns
from galoc.detect.model import COLUMNS, GRAPH, Model, shipped_model
from galoc.detect.pictures import checked_picture, is_blank
from galoc.detect.strip import (
    BLOCK,
    COLUMN_GROUP,
    MOST_COLUMNS,
    ROWS,
    Strip,
    azimuth_of,
    column_azimuths,
    upright_strip,
)
from galoc.errors import GalocError
from galoc.types import Wireframe

if TYPE_CHECKING:
    from galoc.detect import Detector

INPUT = "strip"
"""Name of the network's input."""
OUTPUTS = ("elevation", "sigma", "sure", "visible", "in_frame", "edge")
"""Names of its outputs."""
SLACK = 1e-3
"""A probability may be this far outside 0 to 1 by rounding; it is clipped."""
_LIMITS = {"elevation": (-math.pi / 2, math.pi / 2), "sigma": (0.0, math.pi)}


class OnnxDetector:
    """A :class:`galoc.detect.Detector` from an ONNX file.

    It can be copied, pickled, sent to other processes and used after a fork.

    Args:
        model: a file that keeps ``columns/1`` or ``graph/1``; None: the one that ships with galoc.
        providers: of onnxruntime, best first.
        threads: that one inference uses.
        sha256: that the file has to have; None: any (the shipped one is always checked).

    Raises:
        GalocError: a file that is missing, damaged, of another kind or not what its contract says; a provider that is
            not there.
    """

    uses_heights = True
    """``detect`` takes what is known of the heights."""

    def __init__(
        self,
        model: str | Path | None = None,
        *,
        providers: Sequence[str] = ("CPUExecutionProvider",),
        threads: int = 1,
        sha256: str | None = None,
    ) -> None:
        if model is None:
            model, shipped = shipped_model()
            sha256 = sha256 or shipped
        self.model = Model(model, providers=providers, threads=threads, sha256=sha256)
        """The open file."""
        self._graph: Detector | None = None
        if self.model.contract == GRAPH:
            self._graph = _graph_detector(self.model)
        else:
            check_signature(self.model)
            for columns in (BLOCK, MOST_COLUMNS):  # a network that cannot run says so here, not at the first frame
                infer(self.model, np.zeros((1, 4, ROWS, columns), np.float32))

    def detect(
        self,
        image: NDArray[np.uint8],
        camera: Camera,
        gravity: tuple[float, float],
        *,
        log_ratio: tuple[float, float] | None = None,
    ) -> Wireframe:
        """Wireframe of one image; empty for a picture of one tone.

        Args:
            image: (H, W, 3) uint8 RGB.
            camera: intrinsics of the image.
            gravity: measured (roll, pitch), rad.
            log_ratio: what is known of log(floor / ceiling height) and its standard deviation; None: nothing.

        Raises:
            GalocError: bad image or gravity, or a network that breaks its contract.
        """
        picture = checked_picture(image, camera)
        levelling(gravity)  # refuses what is no gravity
        if is_blank(picture):
            return Wireframe.empty()
        if self._graph is not None:
            return self._graph.detect(picture, camera, gravity)
        from galoc.detect.decode import decode

        return decode(self.columns(picture, camera, gravity), camera, gravity, log_ratio=log_ratio)

    @property
    def has_columns(self) -> bool:
        """Whether the model says something per column: those that keep ``graph/1`` do not."""
        return self._graph is None

    def columns(self, image: NDArray[np.uint8], camera: Camera, gravity: ArrayLike) -> Columns:
        """What the network says of one image, before any wall is drawn. Arguments and errors as for ``detect``.

        Raises:
            GalocError: also when the model keeps ``graph/1``: it has no columns.
        """
        if self._graph is not None:
            got = f"{self.model.name} with contract {self.model.contract!r}"
            raise GalocError(got, f"one with contract {COLUMNS!r}, for columns", "Call detect instead.")
        strip = upright_strip(checked_picture(image, camera), camera, gravity)
        return columns_of(infer(self.model, network_input(strip)), strip.columns)


def _graph_detector(model: Model) -> Detector:
    from galoc.detect.graph import GraphDetector

    try:
        return GraphDetector(model, model.metadata)
    except GalocError as error:
        raise GalocError(f"{model.name} with {error.got}", error.expected, error.cure) from error


def network_input(strip: Strip) -> NDArray[np.float32]:
    """(1, 4, ROWS, W) float32, 0 to 1: channels R, G, B and mask of a strip."""
    planes = np.empty((1, 4, ROWS, strip.columns), np.float32)
    np.multiply(strip.rgb.transpose(2, 0, 1), np.float32(1.0 / 255.0), out=planes[0, :3])
    planes[0, 3] = strip.mask
    return planes


def infer(model: Model, strip: NDArray[np.float32]) -> dict[str, NDArray[np.float64]]:
    """Outputs by name, (2, C) or (2, E), checked and with probabilities clipped.

    Args:
        model: keeps ``columns/1``.
        strip: (1, 4, ROWS, W).

    Raises:
        GalocError: an output of another shape, not finite or out of range.
    """
    width = strip.shape[3]
    found = {}
    for name, part in zip(OUTPUTS, model.run(OUTPUTS, {INPUT: strip}), strict=True):
        wanted = (1, 2, width if name == "edge" else width // COLUMN_GROUP)
        if part.shape != wanted:
            got = f"output {name!r} of {model.name} with shape {part.shape} for a strip of {width} columns"
            raise GalocError(got, f"shape {wanted}, as contract {COLUMNS} says", "Export the network again.")
        low, high = _LIMITS.get(name, (-SLACK, 1.0 + SLACK))
        # Positively phrased: NaN is in no range.
        if not (np.all(part >= low) and np.all(part <= high)) or (name == "sigma" and not np.all(part > 0.0)):
            with np.errstate(invalid="ignore"):
                got = f"output {name!r} of {model.name} with values from {part.min():.3g} to {part.max():.3g}"
            unit = " rad" if name in _LIMITS else ""
            raise GalocError(got, f"{low:.3g} to {high:.3g}{unit}", "Check the network's last layer and the export.")
        values = part[0].astype(np.float64)
        found[name] = values if name in _LIMITS else np.clip(values, 0.0, 1.0)
    return found


def columns_of(outputs: dict[str, NDArray[np.float64]], width: int) -> Columns:
    """Columns of the outputs for a strip of so many columns."""
    return Columns(azimuths=column_azimuths(width), edge_azimuths=azimuth_of(np.arange(width), width), **outputs)


def check_signature(model: Model) -> None:
    """Refuse a file whose declared inputs and outputs are not those of ``columns/1``.

    Raises:
        GalocError: a name, type or fixed size that differs.
    """
    cure = f"Export a network that keeps contract {COLUMNS}."
    inputs = model.get_inputs()
    if [node.name for node in inputs] != [INPUT]:
        raise GalocError(f"{model.name} with inputs {[node.name for node in inputs]}", f"one input {INPUT!r}", cure)
    outputs = {node.name: node for node in model.get_outputs()}
    missing = [name for name in OUTPUTS if name not in outputs]
    if missing:
        raise GalocError(f"{model.name} without outputs {missing}", f"outputs {list(OUTPUTS)}", cure)
    wanted = {INPUT: (inputs[0], (1, 4, ROWS, None))} | {name: (outputs[name], (1, 2, None)) for name in OUTPUTS}
    for name, (node, sizes) in wanted.items():
        if node.type != "tensor(float)":
            raise GalocError(f"{name!r} of {model.name} of type {node.type}", "tensor(float), 32 bits", cure)
        if not _agrees(node.shape, sizes):
            shape = ", ".join("free" if size is None else str(size) for size in sizes)
            raise GalocError(f"{name!r} of {model.name} with shape {node.shape}", f"({shape})", cure)


def _agrees(declared: Sequence[int | str | None], wanted: Sequence[int | None]) -> bool:
    """Whether a declared shape allows the wanted one; where a free axis is wanted, a fixed size does not."""
    if not declared:  # onnxruntime could not tell; the trial run will
        return True
    if len(declared) != len(wanted):
        return False
    pairs = zip(declared, wanted, strict=True)
    return all(not isinstance(size, int) or (want is not None and size == want) for size, want in pairs)
