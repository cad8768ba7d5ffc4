"""Detectors that return a graph: junctions and edges, from which the host finds the walls.

Contract ``graph/1``. Input ``image``: float32 (1, 3, H, W), R, G, B from 0 to 1; where the file fixes H and W the
picture is resized to that. Outputs: ``junctions`` (N, 2), column and row in px of the input, pixel centres at integers;
``junction_scores`` (N, C), probabilities of the classes that the file's metadata names, separated by commas, under
``galoc.classes``; ``edges`` (M, 2), indices of junctions, or ``lines`` (M, 4), column and row of both ends;
``edge_scores`` (M,). Optional metadata ``galoc.threshold``: what junctions and edges need, 0 to 1.

Classes: "corner", "occlusion" and "proper" (either of them) are seen wall ends; "border" or "false" are where an edge
leaves the image; "invalid" or "none" are dropped. Every wall brings its own vertical edges.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from galoc.camera import Camera, azimuth
from galoc.detect.cycles import EDGE_PX, FREE, Cycles, Line, Pairs
from galoc.detect.pictures import checked_picture
from galoc.errors import GalocError
from galoc.types import Wireframe

Array = NDArray[np.float64]

SEEN = ("corner", "occlusion", "proper")
CUT = ("border", "false")
NOTHING = ("invalid", "none")
THRESHOLD = 0.5
"""Junctions and edges below this probability are dropped."""
SNAP_SHARE = 1.0 / 64.0
"""A line's end belongs to the nearest junction within this share of the image width (10 of 640 px)."""
VERTICAL_SLOPE = math.tan(math.radians(8.0))
"""An edge that crosses the horizon and leans less than this against gravity is vertical; another one is dropped."""
SHORT_SLOPE = math.tan(math.radians(2.0))
"""The same for an edge that begins at the image border and does not reach the horizon."""


def wireframe_from_graph(
    junctions: ArrayLike,
    scores: ArrayLike,
    edges: ArrayLike,
    edge_scores: ArrayLike,
    camera: Camera,
    gravity: tuple[float, float],
    *,
    class_names: Sequence[str],
    threshold: float = THRESHOLD,
) -> Wireframe:
    """Walls of a graph.

    Edges along gravity are verticals, the others above the horizon ceiling lines, below it floor lines. Those along
    the image border are left out. A junction without its vertical still makes no pair.

    Args:
        junctions: (N, 2) px.
        scores: (N, C) probability of each class.
        edges: (M, 2) indices of junctions, or (M, 4) px of both ends, which snap to junctions.
        edge_scores: (M,) probabilities.
        camera: intrinsics.
        gravity: measured (roll, pitch), rad.
        class_names: C names of ``SEEN``, ``CUT`` and ``NOTHING``.
        threshold: least probability of a junction (of its best class) and of an edge.

    Raises:
        GalocError: shapes that do not agree, indices or values out of range, an unknown class.
    """
    graph = _checked(junctions, scores, edges, edge_scores, class_names, threshold)
    classes = np.array(class_names, dtype=object)[graph.scores.argmax(axis=1)] if len(graph.junctions) else np.array([])
    sure = graph.scores.max(axis=1, initial=0.0) >= threshold
    keep = np.array([name not in NOTHING for name in classes], bool) & sure
    ends = _snapped(graph, keep, SNAP_SHARE * camera.width)
    good = (graph.edge_scores >= threshold) & (ends >= 0).all(axis=1) & (ends[:, 0] != ends[:, 1])
    good &= keep[ends].all(axis=1)
    view = _View(graph.junctions, classes, camera, gravity)
    pairs, pair_of, lines = view.sorted_edges(ends[good], graph.edge_scores[good])
    return Cycles(pairs, view.lines(lines, pair_of), camera).wireframe()


@dataclass(frozen=True, slots=True, eq=False)
class _Graph:
    junctions: Array
    scores: Array
    edges: Array
    edge_scores: Array


def _checked(
    junctions: ArrayLike,
    scores: ArrayLike,
    edges: ArrayLike,
    edge_scores: ArrayLike,
    class_names: Sequence[str],
    threshold: float,
) -> _Graph:
    known = (*SEEN, *CUT, *NOTHING)
    unknown = [name for name in class_names if name not in known]
    if unknown or len(class_names) == 0 or isinstance(class_names, str):
        raise GalocError(f"junction classes {class_names!r}", f"names out of {known}", "Fix the metadata.")
    if not 0.0 <= threshold <= 1.0:
        raise GalocError(f"threshold {threshold!r}", "a probability, 0 to 1", "Fix it.")
    parts = {"junctions": junctions, "junction_scores": scores, "edges": edges, "edge_scores": edge_scores}
    arrays = {name: _numbers(name, value) for name, value in parts.items()}
    n, m, c = len(arrays["junctions"]), len(arrays["edges"]), len(class_names)
    widths = {"junctions": (2,), "junction_scores": (c,), "edges": (2, 4), "edge_scores": ()}
    for name, array in arrays.items():
        count = n if name.startswith("junction") else m
        if array.size == 0 and count == 0:
            array = arrays[name] = np.zeros((0, *widths[name][:1]))
        if (
            len(array) != count
            or array.ndim != (2 if widths[name] else 1)
            or (widths[name] and array.shape[1] not in widths[name])
        ):
            expected = f"({count}{''.join(f', {w}' for w in widths[name][:1])}) for {n} junctions and {m} edges"
            raise GalocError(f"{name} with shape {array.shape}", expected, "Check the detector's outputs.")
    for name in ("junction_scores", "edge_scores"):
        if arrays[name].size and not (arrays[name].min() >= -1e-3 and arrays[name].max() <= 1.0 + 1e-3):
            raise GalocError(f"{name} beyond 0 to 1", "probabilities", "Apply softmax or sigmoid in the model.")
    pairs = arrays["edges"]
    if pairs.shape[1] == 2 and pairs.size and not (pairs.min() >= 0 and pairs.max() < n and np.all(pairs % 1 == 0)):
        raise GalocError("edges with other indices", f"whole numbers, 0 to {n - 1}", "Check the detector's outputs.")
    return _Graph(arrays["junctions"], arrays["junction_scores"], pairs, arrays["edge_scores"])


def _numbers(name: str, value: ArrayLike) -> Array:
    try:
        array = np.asarray(value, np.float64)
    except (TypeError, ValueError):
        array = np.array(np.nan)
    if array.ndim == 0 or not np.all(np.isfinite(array)):
        raise GalocError(f"{name} that holds other things than finite numbers", "plain numbers", "Drop such rows.")
    return array


def _snapped(graph: _Graph, keep: NDArray[np.bool_], radius_px: float) -> NDArray[np.int64]:
    """(M, 2) junction at each edge's ends; -1 for none."""
    if graph.edges.shape[1] == 2:
        return graph.edges.astype(np.int64)
    places = np.flatnonzero(keep)
    points = graph.edges.reshape(-1, 2)
    if len(places) == 0 or len(points) == 0:
        return np.full((len(graph.edges), 2), -1)
    gap = np.linalg.norm(points[:, None] - graph.junctions[None, places], axis=2)
    nearest = gap.argmin(axis=1)
    near = gap[np.arange(len(points)), nearest] <= radius_px
    return np.where(near, places[nearest], -1).reshape(-1, 2)


class _View:
    """Junctions as seen from a level camera."""

    def __init__(
        self, junctions: Array, classes: NDArray[np.object_], camera: Camera, gravity: tuple[float, float]
    ) -> None:
        self._pixels, self._camera = junctions, camera
        rays = camera.rays_level(junctions, gravity)
        self._ahead = rays[:, 2] > 1e-6
        self._azimuth = azimuth(rays)
        self._slope = -rays[:, 1] / np.maximum(np.hypot(rays[:, 0], rays[:, 2]), 1e-9)
        self._elevation = np.arctan(self._slope)
        self._seen = np.array([name in SEEN for name in classes], bool)
        self._occluded = np.array([name == "occlusion" for name in classes], bool)
        self._typed = np.array([name in ("occlusion", "corner") for name in classes], bool)

    def sorted_edges(
        self, ends: NDArray[np.int64], scores: Array
    ) -> tuple[Pairs, dict[int, int], list[tuple[int, int, float]]]:
        """Verticals as pairs, the pair of each seen junction, and the other edges that may be wall lines."""
        verticals: list[tuple[float, int, int]] = []
        lines: list[tuple[int, int, float]] = []
        for (a, b), score in zip(ends.tolist(), scores.tolist(), strict=True):
            top, bottom = (a, b) if self._elevation[a] >= self._elevation[b] else (b, a)
            if not (self._ahead[a] and self._ahead[b]) or self._along_border(a, b):
                continue
            crosses = self._elevation[top] > 0.0 > self._elevation[bottom]
            if self._is_vertical(top, bottom, crosses):
                verticals.append((score, top, bottom))
            elif not crosses:
                lines.append((a, b, score))
        return *self._pairs(verticals), lines

    def _is_vertical(self, top: int, bottom: int, crosses: bool) -> bool:
        rise = self._elevation[top] - self._elevation[bottom]
        flat = math.cos(0.5 * (self._elevation[top] + self._elevation[bottom]))
        lean = abs(self._azimuth[top] - self._azimuth[bottom]) * flat
        if crosses:
            return bool(lean < VERTICAL_SLOPE * rise)
        towards_horizon = bottom if self._elevation[bottom] > 0.0 else top
        return bool(not self._seen[towards_horizon] and lean < SHORT_SLOPE * rise)

    def _along_border(self, a: int, b: int) -> bool:
        """What the image border closes a cut cycle with; a seen junction is no part of that."""
        if self._seen[a] or self._seen[b]:
            return False
        high = np.array([self._camera.width - 0.5, self._camera.height - 0.5])
        both = self._pixels[[a, b]]
        return bool(np.any(np.all(both < -0.5 + EDGE_PX, axis=0) | np.all(both > high - EDGE_PX, axis=0)))

    def _pairs(self, verticals: list[tuple[float, int, int]]) -> tuple[Pairs, dict[int, int]]:
        """A seen junction keeps its most probable vertical only."""
        taken: set[int] = set()
        chosen: list[tuple[int, int]] = []
        for _, top, bottom in sorted(verticals, key=lambda v: (-v[0], v[1], v[2])):
            own = {j for j in (top, bottom) if self._seen[j]}
            if not own & taken and (top, bottom) not in chosen:
                taken |= own
                chosen.append((top, bottom))
        ends = np.array(chosen, np.int64).reshape(-1, 2)
        middle = self._azimuth[ends].mean(axis=1)
        order = np.argsort(middle, kind="stable")
        ends = ends[order]
        pair_of = {int(j): k for k, pair in enumerate(ends) for j in pair if self._seen[j]}
        typed, occluded = (np.asarray(flag[ends].any(axis=1)) for flag in (self._typed, self._occluded))
        return (
            Pairs(self._pixels[ends], self._seen[ends], middle[order], self._slope[ends], occluded, typed),
            pair_of,
        )

    def lines(self, edges: list[tuple[int, int, float]], pair_of: Mapping[int, int]) -> list[Line]:
        """Ceiling and floor lines, each end at a pair or cut by the image border; others are dropped."""
        found = []
        for a, b, score in edges:
            left, right = (a, b) if self._azimuth[a] <= self._azimuth[b] else (b, a)
            ends = tuple(pair_of.get(j, FREE) for j in (left, right))
            if any(end == FREE and self._seen[j] for end, j in zip(ends, (left, right), strict=True)):
                continue
            row = 0 if self._elevation[a] + self._elevation[b] > 0.0 else 1
            span = float(self._azimuth[left]), float(self._azimuth[right])
            found.append(Line(row, (ends[0], ends[1]), span, self._pixels[[left, right]], score))
        return found


def _scaled(name: str, pixels: ArrayLike, scale: tuple[float, ...]) -> Array:
    """Pixels (count, len(scale)) of the network's input as pixels of the image."""
    array = _numbers(name, pixels)
    if array.ndim != 2 or array.shape[1] != len(scale):
        raise GalocError(f"{name} with shape {array.shape}", f"(count, {len(scale)})", "Check the detector's outputs.")
    return (array + 0.5) * np.array(scale) - 0.5


class GraphDetector:
    """A :class:`galoc.detect.Detector` from an open onnxruntime session that keeps ``graph/1``.

    Args:
        session: has ``get_inputs``, ``get_outputs`` and ``run``.
        metadata: the file's own, by key.

    Raises:
        GalocError: inputs, outputs or metadata that are not those of the contract.
    """

    def __init__(self, session: Any, metadata: Mapping[str, str]) -> None:
        inputs, outputs = session.get_inputs(), [node.name for node in session.get_outputs()]
        if [node.name for node in inputs] != ["image"] or len(inputs[0].shape) != 4:
            raise GalocError(f"inputs {[node.name for node in inputs]}", "one, image (1, 3, H, W)", "Export again.")
        self._edges = "edges" if "edges" in outputs else "lines"
        self._names = ["junctions", "junction_scores", self._edges, "edge_scores"]
        missing = [name for name in self._names if name not in outputs]
        if missing:
            raise GalocError(f"outputs {outputs} without {missing}", f"{self._names}", "Export again.")
        self._classes = [name.strip() for name in metadata.get("galoc.classes", "").split(",")]
        try:
            self._threshold = float(metadata.get("galoc.threshold", THRESHOLD))
        except ValueError as error:
            got = f"galoc.threshold {metadata['galoc.threshold']!r}"
            raise GalocError(got, "a probability, 0 to 1", "Fix the metadata.") from error
        _checked([], [], [], [], self._classes, self._threshold)
        self._session, self._size = session, inputs[0].shape[2:]

    def detect(self, image: NDArray[np.uint8], camera: Camera, gravity: tuple[float, float]) -> Wireframe:
        """Wireframe of one image; empty when no wall is found.

        Raises:
            GalocError: bad image, or outputs that break the contract.
        """
        import cv2

        picture = checked_picture(image, camera)
        height, width = (
            size if isinstance(size, int) else own for size, own in zip(self._size, picture.shape[:2], strict=True)
        )
        if (height, width) != picture.shape[:2]:
            picture = np.asarray(cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA), np.uint8)
        tensor = (picture.transpose(2, 0, 1)[None] / np.float32(255.0)).astype(np.float32)
        junctions, scores, edges, edge_scores = self._session.run(self._names, {"image": tensor})
        scale = (camera.width / width, camera.height / height)
        junctions = _scaled("junctions", junctions, scale)
        edges = _scaled("lines", edges, scale * 2) if self._edges == "lines" else _numbers("edges", edges)
        return wireframe_from_graph(
            junctions, scores, edges, edge_scores, camera, gravity, class_names=self._classes, threshold=self._threshold
        )
