"""graph/1: true wireframes turned into graphs come back; bad graphs are refused or give fewer walls."""

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from galoc import Camera, Floorplan, GalocError, Wireframe
from galoc.camera import azimuth
from galoc.detect.graph import GraphDetector, wireframe_from_graph
from galoc.types import BORDER, CORNER, OCCLUSION
from galoc_env.homes import generate
from galoc_env.truth import visible_wireframe

CAMERA = Camera.from_hfov(640, 480, 108)
TYPED = ("corner", "occlusion", "border", "none")
UNTYPED = ("invalid", "false", "proper")
Gravity = tuple[float, float]


@dataclass(frozen=True)
class Graph:
    """A graph whose junctions' classes are indices of TYPED."""

    junctions: np.ndarray
    classes: np.ndarray
    edges: np.ndarray

    def scores(self, names: tuple[str, ...], sure: float = 0.9) -> np.ndarray:
        """Probabilities of the classes, by either list of names."""
        index = self.classes if names == TYPED else np.array([2, 2, 1, 0])[self.classes]
        scores = np.full((len(index), len(names)), (1.0 - sure) / (len(names) - 1))
        scores[np.arange(len(index)), index] = sure
        return scores


def graph_of(w: Wireframe) -> Graph:
    """Junctions and edges of a true wireframe; lines and verticals that leave the image end on its border."""
    points: list[np.ndarray] = []
    classes: list[int] = []
    edges: list[tuple[int, int]] = []

    def node(pixel: np.ndarray, kind: int) -> int:
        points.append(pixel)
        classes.append(kind)
        return len(points) - 1

    rows = ((w.ceiling, w.ceiling_true, w.ceiling_cut), (w.floor, w.floor_true, w.floor_cut))
    nodes = {}
    for i in np.flatnonzero(w.kind != BORDER):
        for row, (pixels, seen, _) in enumerate(rows):
            nodes[int(i), row] = node(pixels[i], int(w.kind[i]) if seen[i] else BORDER)
        edges.append((nodes[int(i), 0], nodes[int(i), 1]))
    for m, ends in enumerate(w.walls):
        for row, (_, seen, cut) in enumerate(rows):
            assert cut is not None
            line = []
            for side, i in enumerate(ends):
                if np.isfinite(cut[m, side, 0]):
                    line.append(node(cut[m, side], BORDER))
                elif seen[i] and w.kind[i] != BORDER:
                    line.append(nodes[int(i), row])
            if len(line) == 2:
                edges.append((line[0], line[1]))
    return Graph(np.array(points).reshape(-1, 2), np.array(classes, int), np.array(edges, int).reshape(-1, 2))


def shuffled(graph: Graph, rng: np.random.Generator) -> Graph:
    order = rng.permutation(len(graph.junctions))
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    edges = place[graph.edges][rng.permutation(len(graph.edges))]
    edges = np.where(rng.random(len(edges))[:, None] < 0.5, edges, edges[:, ::-1])
    return Graph(graph.junctions[order], graph.classes[order], edges)


def views(count: int = 240) -> list[tuple[Wireframe, Gravity]]:
    rng = np.random.default_rng(0)
    plans = [generate(seed, split="test") for seed in (1, 2, 3)] + [Floorplan.load(n) for n in ("apartment", "office")]
    found = []
    for plan in plans:
        free = plan.free_space(0.25).positions(0.4)
        for _ in range(count // len(plans)):
            pose = np.array([*free[rng.integers(len(free))], rng.uniform(-np.pi, np.pi)])
            tilt = rng.uniform(-0.15, 0.15, 2)
            gravity = (float(tilt[0]), float(tilt[1]))
            found.append((visible_wireframe(plan, CAMERA, pose, float(rng.uniform(1.0, 1.6)), gravity), gravity))
    return found


VIEWS = views()


def tells(w: Wireframe, gravity: Gravity) -> bool:
    """Whether a graph says which walls there are.

    A vertical of which neither junction is seen says nothing of what is beside it where it stands on another one's
    plumb line, cuts off a corner of the image or has a wall on one side only (beyond it is a sliver, or nothing).
    """
    inner = w.kind != BORDER
    blank = ~(w.ceiling_true | w.floor_true) & inner
    stands = azimuth(CAMERA.rays_level(np.stack([w.ceiling, w.floor]), gravity)).mean(axis=0)
    for i in np.flatnonzero(blank):
        u = np.array([w.ceiling[i, 0], w.floor[i, 0]])
        alone = np.count_nonzero(np.abs(stands - stands[i])[inner] < np.radians(0.7)) == 1
        sides = np.count_nonzero(w.walls == i)
        if not alone or sides < 2 or u.min() < 0.0 or u.max() > CAMERA.width - 1.0:
            return False
    return bool(inner.any())


TELLING = [(w, gravity) for w, gravity in VIEWS if len(w) and tells(w, gravity)]


def found_in(graph: Graph, gravity: Gravity, names: tuple[str, ...] = TYPED) -> Wireframe:
    scores, sure = graph.scores(names), np.full(len(graph.edges), 0.8)
    return wireframe_from_graph(
        graph.junctions, scores, graph.edges, sure, CAMERA, gravity, class_names=names, threshold=0.5
    )


def ordered(w: Wireframe) -> Wireframe:
    """The same with the pairs in the order in which the walls name them."""
    order = list(dict.fromkeys(w.walls.ravel().tolist()))
    place = np.full(len(w), -1)
    place[order] = np.arange(len(order))
    return replace(
        w,
        ceiling=w.ceiling[order],
        floor=w.floor[order],
        ceiling_true=w.ceiling_true[order],
        floor_true=w.floor_true[order],
        kind=w.kind[order],
        walls=place[w.walls],
    )


def differences(truth: Wireframe, found: Wireframe, kinds: bool = True) -> list[str]:
    a, b = ordered(truth), ordered(found)
    if a.walls.shape != b.walls.shape or not np.array_equal(a.walls, b.walls):
        return [f"walls {a.walls.tolist()} became {b.walls.tolist()}"]
    wrong = []
    for name in ("ceiling", "floor"):
        seen = getattr(a, f"{name}_true")
        if not np.array_equal(seen, getattr(b, f"{name}_true")):
            wrong.append(f"{name}_true")
        # The pixels are copied, not computed: 1e-6 px leaves room for nothing else.
        if np.abs(getattr(a, name) - getattr(b, name))[seen].max(initial=0.0) > 1e-6:
            wrong.append(name)
        if not np.array_equal(getattr(a, f"{name}_cut"), getattr(b, f"{name}_cut"), equal_nan=True):
            wrong.append(f"{name}_cut")
    known = (a.ceiling_true | a.floor_true | (a.kind == BORDER)) if kinds else a.kind == BORDER
    if not np.array_equal(a.kind[known], b.kind[known]):
        wrong.append("kind")
    return wrong


def test_most_views_tell() -> None:
    assert len(TELLING) > 0.7 * len(VIEWS)
    assert sum(len(w.walls) for w, _ in TELLING) > 800


def test_true_wireframes_come_back() -> None:
    rng = np.random.default_rng(1)
    for number, (w, gravity) in enumerate(TELLING):
        assert differences(w, found_in(shuffled(graph_of(w), rng), gravity)) == [], number


def with_false_junctions(graph: Graph, rng: np.random.Generator) -> tuple[Graph, np.ndarray]:
    """20 more junctions anywhere, tied to each other and to true ones; and which junctions are true."""
    n = len(graph.junctions)
    points = rng.uniform([0, 0], [CAMERA.width, CAMERA.height], (20, 2))
    edges = np.stack([rng.integers(n, n + 20, 30), rng.integers(0, n + 20, 30)], axis=1)
    edges = edges[edges[:, 0] != edges[:, 1]]
    more = Graph(
        np.vstack([graph.junctions, points]),
        np.concatenate([graph.classes, rng.integers(0, 2, 20)]),
        np.vstack([graph.edges, edges]),
    )
    return more, np.arange(n + 20) < n


def test_improbable_junctions_and_edges_change_nothing() -> None:
    rng = np.random.default_rng(2)
    for w, gravity in TELLING[:60]:
        graph, true = with_false_junctions(graph_of(w), rng)
        scores = np.where(true[:, None], graph.scores(TYPED), graph.scores(TYPED, sure=0.4))
        sure = np.full(len(graph.edges), 0.8)
        found = wireframe_from_graph(
            graph.junctions, scores, graph.edges, sure, CAMERA, gravity, class_names=TYPED, threshold=0.5
        )
        assert differences(w, found) == []
        # The same with junctions that are probable and edges that are not.
        edge_true = true[graph.edges].all(axis=1)
        found = wireframe_from_graph(
            graph.junctions,
            graph.scores(TYPED),
            graph.edges,
            np.where(edge_true, 0.8, 0.3),
            CAMERA,
            gravity,
            class_names=TYPED,
            threshold=0.5,
        )
        assert differences(w, found) == []


def test_classes_without_occlusions_give_the_same_walls() -> None:
    rng, right, count = np.random.default_rng(3), 0, 0
    for w, gravity in TELLING:
        found = found_in(shuffled(graph_of(w), rng), gravity, UNTYPED)
        assert differences(w, found, kinds=False) == []
        a, b = ordered(w), ordered(found)
        shown = (a.ceiling_true | a.floor_true) & (a.kind != BORDER)
        right += np.count_nonzero(a.kind[shown] == b.kind[shown])
        count += np.count_nonzero(shown)
        assert set(b.kind[shown]) <= {CORNER, OCCLUSION}
    # An occlusion whose nearer wall is too narrow to be one of the truth's looks like a corner: some 4 %.
    assert right > 0.9 * count


def test_lines_snap_to_junctions() -> None:
    rng, same = np.random.default_rng(4), 0
    chosen = TELLING[:80]
    for w, gravity in chosen:
        graph = graph_of(w)
        lines = graph.junctions[graph.edges].reshape(-1, 4) + rng.uniform(-0.2, 0.2, (len(graph.edges), 4))
        found = wireframe_from_graph(
            graph.junctions,
            graph.scores(TYPED),
            lines,
            np.full(len(lines), 0.8),
            CAMERA,
            gravity,
            class_names=TYPED,
            threshold=0.5,
        )
        same += differences(w, found) == []
    # Where two junctions lie within 0.6 px of each other a line may take the wrong one.
    assert same > 0.9 * len(chosen)


def test_noise_of_a_pixel_rarely_changes_the_walls() -> None:
    rng, same = np.random.default_rng(5), 0
    for w, gravity in TELLING:
        graph = graph_of(w)
        inside = (graph.classes != BORDER)[:, None]
        noisy = replace(graph, junctions=graph.junctions + inside * rng.normal(0.0, 1.0, graph.junctions.shape))
        same += np.array_equal(ordered(w).walls, ordered(found_in(noisy, gravity)).walls)
    # Walls a few px wide may turn over; most views have none.
    assert same > 0.75 * len(TELLING)


def test_random_graphs_give_sound_wireframes() -> None:
    rng, walls = np.random.default_rng(6), 0
    names = (*TYPED, "proper")
    for trial in range(300):
        n, m = rng.integers(1, 25), rng.integers(0, 60)
        points = rng.uniform(-50, [690, 530], (n, 2))
        if trial % 2:  # many on few plumb lines
            points[:, 0] = rng.choice(np.linspace(-0.5, 639.5, 6), n)
        tilt = rng.uniform(-0.7, 0.7, 2) * (trial % 3)
        w = wireframe_from_graph(
            points,
            rng.dirichlet(np.full(5, 0.1), n),
            rng.integers(0, n, (m, 2)),
            rng.random(m),
            CAMERA,
            (float(tilt[0]), float(tilt[1])),
            class_names=names,
            threshold=0.3,
        )
        assert set(w.walls.ravel().tolist()) == set(range(len(w)))  # no pair without a wall
        for side in (0, 1):  # and none with two on one side
            assert len(set(w.walls[:, side].tolist())) == len(w.walls)
        walls += len(w.walls)
    assert walls > 50


def test_an_empty_graph_is_an_empty_wireframe() -> None:
    found = wireframe_from_graph([], [], [], [], CAMERA, (0.0, 0.0), class_names=TYPED)
    assert len(found) == 0
    lone = wireframe_from_graph([[5, 5]], [[1, 0, 0, 0]], [], [], CAMERA, (0.0, 0.0), class_names=TYPED)
    assert len(lone) == 0


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"class_names": ("corner", "chair", "border", "none")}, "chair"),
        ({"class_names": ("corner", "border")}, "junction_scores"),
        ({"class_names": ()}, "classes"),
        ({"threshold": 2.0}, "threshold"),
        ({"threshold": float("nan")}, "threshold"),
        ({"junctions": [[1, 2, 3]] * 4}, "junctions"),
        ({"junctions": [[1, np.nan]] * 4}, "junctions"),
        ({"junctions": "abc"}, "junctions"),
        ({"scores": [[3.0, 0, 0, 0]] * 4}, "junction_scores"),
        ({"edges": [[0, 4]] * 2}, "edges"),
        ({"edges": [[0, 0.5]] * 2}, "edges"),
        ({"edges": [[0, 1, 2]] * 2}, "edges"),
        ({"edge_scores": [0.5]}, "edge_scores"),
        ({"edge_scores": [0.5, -3.0]}, "edge_scores"),
        ({"gravity": (0.0, 2.0)}, "gravity"),
    ],
)
def test_bad_graphs_are_refused(change: dict[str, Any], part: str) -> None:
    good: dict[str, Any] = {
        "junctions": [[100, 100], [100, 300], [500, 100], [500, 300]],
        "scores": [[0.9, 0.1, 0.0, 0.0]] * 4,
        "edges": [[0, 1], [2, 3]],
        "edge_scores": [0.9, 0.9],
        "camera": CAMERA,
        "gravity": (0.0, 0.0),
        "class_names": TYPED,
        "threshold": 0.5,
    }
    wireframe_from_graph(**good)
    with pytest.raises(GalocError, match=part):
        wireframe_from_graph(**(good | change))


class FakeSession:
    """What onnxruntime's session looks like, with fixed answers."""

    def __init__(self, answers: dict[str, Any], shape: list[Any], name: str = "image") -> None:
        self.answers, self.shape, self.name = answers, shape, name
        self.fed: Any = None

    def get_inputs(self) -> list[SimpleNamespace]:
        return [SimpleNamespace(name=self.name, shape=self.shape)]

    def get_outputs(self) -> list[SimpleNamespace]:
        return [SimpleNamespace(name=name) for name in self.answers]

    def run(self, names: list[str], feeds: dict[str, np.ndarray]) -> list[Any]:
        self.fed = feeds[self.name]
        return [self.answers[name] for name in names]


def answers_for(w: Wireframe, scale: float, lines: bool = False) -> dict[str, Any]:
    graph = graph_of(w)
    junctions = ((graph.junctions + 0.5) * scale - 0.5).astype(np.float32)
    edges = {"lines": junctions[graph.edges].reshape(-1, 4)} if lines else {"edges": graph.edges}
    scores = {"junction_scores": graph.scores(TYPED), "edge_scores": np.full(len(graph.edges), 0.9, np.float32)}
    return {"junctions": junctions, **scores, **edges}


METADATA = {"galoc.contract": "graph/1", "galoc.classes": "corner, occlusion, border, none", "galoc.threshold": "0.6"}
IMAGE = np.random.default_rng(0).integers(0, 256, (480, 640, 3)).astype(np.uint8)


@pytest.mark.parametrize(("shape", "scale"), [([1, 3, "H", "W"], 1.0), ([1, 3, 240, 320], 0.5)])
@pytest.mark.parametrize("lines", [False, True])
def test_a_session_is_fed_and_read_in_its_own_pixels(shape: list[Any], scale: float, lines: bool) -> None:
    w, gravity = TELLING[0]
    session = FakeSession(answers_for(w, scale, lines), shape)
    found = ordered(GraphDetector(session, METADATA).detect(IMAGE, CAMERA, gravity))
    assert session.fed.dtype == np.float32 and session.fed.shape == (1, 3, 480 * scale, 640 * scale)
    assert 0.0 <= session.fed.min() < 0.2 and 0.8 < session.fed.max() <= 1.0
    truth = ordered(w)
    np.testing.assert_array_equal(found.walls, truth.walls)
    seen = truth.ceiling_true
    # float32 has 24 bits: 640 px to 4e-5 px.
    np.testing.assert_allclose(found.ceiling[seen], truth.ceiling[seen], atol=1e-3)


def test_sessions_of_another_contract_are_refused() -> None:
    w, gravity = TELLING[0]
    answers, shape = answers_for(w, 1.0), [1, 3, "H", "W"]
    without = {name: value for name, value in answers.items() if name != "edges"}
    with pytest.raises(GalocError, match="lines"):
        GraphDetector(FakeSession(without, shape), METADATA)
    with pytest.raises(GalocError, match="image"):
        GraphDetector(FakeSession(answers, shape, "strip"), METADATA)
    with pytest.raises(GalocError, match="classes"):
        GraphDetector(FakeSession(answers, shape), {})
    with pytest.raises(GalocError, match="threshold"):
        GraphDetector(FakeSession(answers, shape), METADATA | {"galoc.threshold": "high"})
    wrong = GraphDetector(FakeSession(answers | {"junctions": np.zeros((3, 3))}, shape), METADATA)
    with pytest.raises(GalocError, match="junctions"):
        wrong.detect(IMAGE, CAMERA, gravity)
    with pytest.raises(GalocError, match="image"):
        wrong.detect(IMAGE[:100], CAMERA, gravity)
