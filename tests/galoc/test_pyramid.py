"""The pyramid of profile boxes and its lattice: containment, nesting, coverage."""

import math
import re

import numpy as np
import pytest
from numba import njit
from shapely import MultiLineString, Polygon, contains_xy, distance, points

from galoc import Floorplan, GalocError
from galoc._box_code import LOG_STEP, from_float_code, from_log_code
from galoc._plane_kernel import LINEAR
from galoc._pyramid_kernel import LEAVES, PHASE_BINS, PHASES, ROW, SIDE
from galoc.fine import LEAF_X, LEAF_Y, FineGrid, LeafProfiles
from galoc.profiles import CLEARANCE, Caster
from galoc.pyramid import BOX, Level, Pyramid, build_pyramid

L_SHAPE = [(0.0, 0.0), (4.0, 0.0), (4.0, 2.5), (2.2, 2.5), (2.2, 4.5), (0.0, 4.5)]
SLANTED = [(-2.37, -1.1), (1.93, -0.4), (2.6, 1.7), (0.3, 2.9), (-2.0, 2.1)]


def walls_of(corners: list[tuple[float, float]]) -> list[list[float]]:
    return [[*a, *b] for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]


def room(name: str) -> Floorplan:
    if name == "two rooms":  # a door, a thin partition and a free-standing stub
        walls = walls_of([(0.0, 0.0), (5.0, 0.0), (5.0, 3.5), (0.0, 3.5)])
        walls += [[2.51, 0.0, 2.51, 1.3], [2.51, 2.2, 2.51, 3.5], [3.6, 1.6, 4.1, 2.0]]
        return Floorplan.from_segments(walls, name=name)
    return Floorplan.from_segments(walls_of({"L": L_SHAPE, "slanted": SLANTED}[name]), name=name)


OUTLINES = {"L": L_SHAPE, "slanted": SLANTED, "two rooms": [(0.0, 0.0), (5.0, 0.0), (5.0, 3.5), (0.0, 3.5)]}
PLANS = tuple(OUTLINES)


def clearance(plan: Floorplan, places: np.ndarray) -> np.ndarray:
    """(P,) distance to the nearest wall, m; negative outside the room."""
    walls = MultiLineString(plan.segments.reshape(-1, 2, 2).tolist())
    return np.where(contains_xy(Polygon(OUTLINES[plan.name]), places), 1.0, -1.0) * distance(walls, points(places))


@njit
def decoded(codes, log):  # type: ignore[no-untyped-def]
    """The (C, 2, 8, 64) codes of some boxes as numbers."""
    out = np.empty(codes.shape, np.float32)
    for i in range(codes.size):
        code = codes.flat[i]
        out.flat[i] = from_log_code(code) if log else from_float_code(code)
    return out


def bounds(level: Level, log: bool) -> np.ndarray:
    """(C, 2, 360) least and greatest of each bin."""
    flat = np.ascontiguousarray(level.boxes)
    numbers = decoded(flat, log)[..., :PHASE_BINS]
    return np.ascontiguousarray(numbers.transpose(0, 1, 3, 2)).reshape(len(flat), 2, 360)


def cell_of_leaves(pyramid: Pyramid, k: int) -> np.ndarray:
    """(64 B,) the cell of level k that each leaf lies in, by the lists of children."""
    owner = np.arange(len(pyramid.levels[k].boxes))
    for level in pyramid.levels[k:]:
        owner = np.repeat(owner, np.diff(level.first))
    return owner


def inside_range(values: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest of ``width`` consecutive bins from each on, around the circle."""
    turned = np.stack([np.roll(values, -t, axis=-1) for t in range(width)])
    return turned.min(axis=0), turned.max(axis=0)


@pytest.fixture(scope="module")
def built() -> dict[tuple[str, bool], tuple[Pyramid, np.ndarray]]:
    """Pyramids at 0.02 m with the profiles of all their leaves."""
    out = {}
    for name in PLANS:
        plan = room(name)
        for log in (False, True):
            pyramid = build_pyramid(plan, 0.02, log=log)
            leaves = np.arange(LEAVES * len(pyramid.mask))
            out[name, log] = pyramid, Caster(plan)(pyramid.grid.positions(leaves))
    return out


CASES = [(name, log) for name in PLANS for log in (False, True)]


@pytest.mark.parametrize(("name", "log"), CASES)
def test_every_clear_leaf_lies_in_its_boxes_on_every_level(name: str, log: bool, built: dict) -> None:
    pyramid, profiles = built[name, log]
    clear = pyramid.leaves()
    away = clearance(room(name), pyramid.grid.positions(np.arange(len(profiles))))
    assert clear.size == pyramid.positions and np.all(pyramid.is_clear(clear))
    assert np.all(pyramid.is_clear(np.flatnonzero(away > CLEARANCE + 1e-6)))
    # Only whole degrees are looked along: 1 - cos(0.5 deg) past a wall, more past the end of one.
    assert np.all(profiles[clear].min(axis=1) >= np.float32(CLEARANCE)) and np.all(away[clear] > 0.05)
    seen = np.log(profiles[clear].astype(np.float64)) if log else profiles[clear].astype(np.float64)
    for k, level in enumerate(pyramid.levels):
        box = bounds(level, log)[cell_of_leaves(pyramid, k)[clear]]
        low, high = inside_range(seen, level.width)
        assert np.all(box[:, 0] <= low) and np.all(high <= box[:, 1])


@pytest.mark.parametrize(("name", "log"), CASES)
def test_boxes_are_no_larger_than_their_leaves_need(name: str, log: bool, built: dict) -> None:
    pyramid, profiles = built[name, log]
    clear = pyramid.is_clear(np.arange(len(profiles)))
    seen = np.log(profiles.astype(np.float64)) if log else profiles.astype(np.float64)
    for k, level in enumerate(pyramid.levels):
        owner, box = cell_of_leaves(pyramid, k), bounds(level, log)
        for cell in range(0, len(level.boxes), 7):
            own = seen[(owner == cell) & clear]
            if len(own) == 0:
                continue
            low, high = inside_range(own, level.width)
            slack = 1.1 * LOG_STEP if log else 2.0**-12 * high.max(axis=0)  # one step of the code
            assert np.all(low.min(axis=0) - box[cell, 0] <= slack)
            assert np.all(box[cell, 1] - high.max(axis=0) <= slack)


@pytest.mark.parametrize("name", PLANS)
def test_cells_without_a_clear_leaf_hold_nothing(name: str, built: dict) -> None:
    pyramid, _ = built[name, False]
    empty = 0
    for k, level in enumerate(pyramid.levels):
        clear = np.zeros(len(level.boxes), bool)
        clear[cell_of_leaves(pyramid, k)[pyramid.leaves()]] = True
        box = bounds(level, False)
        assert np.all(box[~clear, 0] > box[~clear, 1])
        assert np.all(box[clear, 0] <= box[clear, 1])
        empty += int(np.count_nonzero(~clear))
    assert empty  # some lie along the walls


@pytest.mark.parametrize("name", PLANS)
def test_linear_bins_are_where_a_plane_gives_the_range(name: str, built: dict) -> None:
    pyramid, profiles = built[name, False]
    marked = np.unpackbits(pyramid.linear, axis=1, bitorder="little").astype(bool)
    assert built[name, True][0].linear is None and marked.shape == (len(pyramid.mask), 360)
    blocks = profiles.reshape(-1, LEAVES, 360).astype(np.float64)
    clear = pyramid.is_clear(np.arange(len(profiles))).reshape(-1, LEAVES)
    first, right, up = (blocks[:, np.flatnonzero((LEAF_X == x) & (LEAF_Y == y))] for x, y in ((0, 0), (7, 0), (0, 7)))
    x, y = LEAF_X[:, None], LEAF_Y[:, None]
    planes = first + x * (right - first) / 7.0 + y * (up - first) / 7.0
    off = np.max(np.abs(planes - blocks) / blocks * clear[..., None], axis=1)
    assert np.all(off[marked] <= LINEAR * (1 + 1e-9)) and np.all(off[~marked] >= LINEAR * (1 - 1e-9))
    assert np.mean(marked[clear.any(axis=1)]) > 0.5  # most bins see one wall from all of a block


def test_vectors_may_be_read_across_the_end_of_the_circle(built: dict) -> None:
    pyramid, _ = built["L", False]
    for level in pyramid.levels:
        assert level.boxes.shape[1:] == (2, PHASES, ROW)
        repeated = slice(PHASE_BINS, 60)  # 16 bins from the last one on
        assert np.array_equal(level.boxes[..., repeated], level.boxes[..., : 60 - PHASE_BINS])


@pytest.mark.parametrize(("name", "log"), CASES)
def test_levels_nest_and_keep_every_leaf_once(name: str, log: bool, built: dict) -> None:
    pyramid, _ = built[name, log]
    widths = [level.width for level in pyramid.levels]
    assert widths == ([8, 4, 2, 1] if log else [8, 4, 2])
    box = [bounds(level, log) for level in pyramid.levels]
    for k, level in enumerate(pyramid.levels):
        below = len(pyramid.levels[k + 1].boxes) if k + 1 < len(pyramid.levels) else LEAVES * len(pyramid.mask)
        assert level.first[0] == 0 and level.first[-1] == below and np.all(np.diff(level.first) > 0)
        if level.first_block is not None:
            assert level.first_block[-1] == len(pyramid.mask)
            assert np.array_equal(np.repeat(np.arange(len(level.boxes)), np.diff(level.first_block)), (
                cell_of_leaves(pyramid, k)[::LEAVES]
            ))  # fmt: skip
        # Leaves of one cell lie in one square of the lattice, and no two cells share a square.
        side = math.isqrt(level.leaves)
        squares = pyramid.grid.cells(np.arange(below if k == len(pyramid.levels) - 1 else LEAVES * len(pyramid.mask)))
        pairs = np.unique(np.column_stack([cell_of_leaves(pyramid, k), squares // side]), axis=0)
        assert len(pairs) == len(level.boxes) == len(np.unique(pairs[:, 1:], axis=0))
        if k:
            above = np.repeat(np.arange(len(box[k - 1])), np.diff(pyramid.levels[k - 1].first))
            filled = box[k][:, 0, 0] <= box[k][:, 1, 0]
            for turn in range(widths[k - 1] // widths[k]):
                child = np.roll(box[k], -turn * widths[k], axis=-1)
                outer = box[k - 1][above]
                assert np.all((outer[:, 0] <= child[:, 0])[filled]) and np.all((child[:, 1] <= outer[:, 1])[filled])


@pytest.mark.parametrize(
    ("name", "resolution"),
    [("slanted", 0.01), *((name, step) for name in PLANS for step in (0.02, 0.03)), ("L", 0.05), ("two rooms", 0.1)],
)
def test_blocks_hold_every_place_with_the_clearance_of_a_camera(name: str, resolution: float) -> None:
    plan = room(name)
    grid = FineGrid.of(plan, resolution)
    x0, y0, x1, y1 = (round(v / resolution) for v in plan.bounds)
    cells = np.stack(np.meshgrid(np.arange(x0 - 3, x1 + 3), np.arange(y0 - 3, y1 + 3)), axis=-1).reshape(-1, 2)
    places = (cells + 0.5) * resolution
    clear = clearance(plan, places) > CLEARANCE + 1e-6
    leaves = grid.find(cells)
    assert np.count_nonzero(clear & (leaves < 0)) == 0
    found = leaves[clear]
    assert len(np.unique(found)) == np.count_nonzero(clear)
    np.testing.assert_allclose(grid.positions(found), places[clear], atol=1e-9)


def test_find_inverts_cells_and_knows_what_is_outside(built: dict) -> None:
    grid = built["L", False][0].grid
    leaves = np.arange(LEAVES * len(grid.blocks))
    cells = grid.cells(leaves)
    assert len(np.unique(cells, axis=0)) == len(leaves)
    assert np.array_equal(grid.find(cells), leaves)
    np.testing.assert_allclose(grid.positions(leaves), (cells + 0.5) * 0.02, atol=1e-12)
    far = np.array([[10_000, 0], [-10_000, 5], [0, 10_000], [3, -10_000]])
    assert np.all(grid.find(far) == -1)
    low, high = cells.min(axis=0) - SIDE, cells.max(axis=0) + SIDE
    every = np.stack(np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1])), axis=-1).reshape(-1, 2)
    assert np.count_nonzero(grid.find(every) >= 0) == len(leaves)  # and nothing else, such as cells left of the index


def test_leaves_and_blocks_are_in_morton_order(built: dict) -> None:
    def morton(x: int, y: int) -> int:
        return sum((x >> k & 1) << 2 * k | (y >> k & 1) << 2 * k + 1 for k in range(20))

    assert [morton(int(x), int(y)) for x, y in zip(LEAF_X, LEAF_Y, strict=True)] == list(range(LEAVES))
    grid = built["slanted", False][0].grid
    codes = [morton(*(int(v) for v in block - grid.corner)) for block in grid.blocks]
    assert np.all(np.diff(codes) > 0)


def test_seeds_are_clear_leaves_with_their_profiles(built: dict) -> None:
    pyramid, profiles = built["two rooms", False]
    seeds = pyramid.seeds[pyramid.seeds >= 0]
    assert np.all(pyramid.is_clear(seeds)) and len(np.unique(seeds)) == len(seeds)
    assert np.array_equal(pyramid.seed_profiles[pyramid.seeds >= 0], profiles[seeds])
    # 16 leaves apart: every clear leaf has a seed in its own 16 x 16 cell, at most 0.46 m away.
    clear = pyramid.grid.positions(pyramid.leaves())
    near = np.min(np.linalg.norm(clear[::50, None] - pyramid.grid.positions(seeds), axis=2), axis=1)
    assert near.max() <= 16 * 0.02 * math.sqrt(2)


def test_lowest_level_is_left_out_of_large_pyramids(built: dict) -> None:
    full = built["L", True][0]
    counts = [len(level.boxes) for level in full.levels]
    small = build_pyramid(room("L"), 0.02, log=True, limit=sum(counts) * BOX - 1)
    assert len(full.levels) == 4 and len(small.levels) == 3
    assert [level.width for level in small.levels] == [8, 4, 2]
    assert np.array_equal(np.diff(small.levels[-1].first), np.full(counts[-2], LEAVES))
    for a, b in zip(small.levels, full.levels[:-1], strict=True):
        assert np.array_equal(a.boxes, b.boxes)
    assert np.array_equal(small.mask, full.mask) and np.array_equal(small.seeds, full.seeds)


def test_pyramid_of_many_parts_is_that_of_one(monkeypatch: pytest.MonkeyPatch, tmp_path, built: dict) -> None:  # type: ignore[no-untyped-def]
    whole = built["two rooms", True][0]
    monkeypatch.setenv("GALOC_CACHE", str(tmp_path))  # not from the cache
    monkeypatch.setattr("galoc.pyramid.CHUNK", 20)
    parts = build_pyramid(room("two rooms"), 0.02, log=True)
    for a, b in zip(parts.levels, whole.levels, strict=True):
        assert np.array_equal(a.boxes[..., :60], b.boxes[..., :60])
    assert np.array_equal(parts.mask, whole.mask) and np.array_equal(parts.seeds, whole.seeds)
    assert np.array_equal(parts.seed_profiles, whole.seed_profiles)


def test_bad_plans_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    shaft = Floorplan.from_segments(walls_of([(0.0, 0.0), (0.6, 0.0), (0.6, 0.6), (0.0, 0.6)]))
    with pytest.raises(GalocError, match="without free space"):
        FineGrid.of(shaft, 0.02)
    monkeypatch.setattr("galoc.freespace.MAX_CELLS", 2_000)  # so that the free space of a small plan is coarsened
    with pytest.raises(GalocError, match="exact search"):
        FineGrid.of(room("L"), 0.01)


def test_lattices_that_would_not_fit_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """The cure names a resolution that does fit."""
    plan, blocks = room("L"), len(FineGrid.of(room("L"), 0.02).blocks)
    monkeypatch.setattr("galoc.fine.MOST_BLOCKS", blocks // 2)
    with pytest.raises(GalocError, match=r"0\.02 m apart") as refused:
        FineGrid.of(plan, 0.02)
    coarser = float(re.search(r"resolution of ([0-9.]+) m", refused.value.cure)[1])  # type: ignore[index]
    assert 0.02 < coarser <= 0.04
    assert len(FineGrid.of(plan, coarser).blocks) <= blocks // 2


class TestLeafProfiles:
    def test_profiles_are_those_of_the_caster_whatever_was_evicted(self, built: dict, rng: np.random.Generator) -> None:
        pyramid, profiles = built["L", False]
        few = LeafProfiles(pyramid.grid, Caster(room("L")), limit_bytes=0)
        assert few.capacity == 64 < len(pyramid.mask)
        for _ in range(30):
            block = rng.choice(len(pyramid.mask), rng.integers(1, 65), replace=False)
            leaves = rng.choice(block, 200) * LEAVES + rng.integers(0, LEAVES, 200)
            assert np.array_equal(few.rows[few.fetch(leaves)], profiles[leaves])
        with pytest.raises(ValueError, match="fit"):
            few.fetch(np.arange(65) * LEAVES)

    def test_batches_cover_each_leaf_once(self, built: dict, rng: np.random.Generator) -> None:
        pyramid, profiles = built["L", False]
        few = LeafProfiles(pyramid.grid, Caster(room("L")), limit_bytes=0)
        leaves = rng.integers(0, LEAVES * len(pyramid.mask), 5000)
        times = np.zeros(len(leaves), int)
        for which, rows in few.batches(leaves):
            times[which] += 1
            assert np.array_equal(few.rows[rows], profiles[leaves[which]])
        assert np.all(times == 1)
        assert list(few.batches(np.zeros(0, np.int64)))[0][0].size == 0

    def test_most_recently_used_blocks_stay(self, built: dict) -> None:
        pyramid, _ = built["L", False]
        few = LeafProfiles(pyramid.grid, Caster(room("L")), limit_bytes=0)
        few.fetch(np.arange(64) * LEAVES)
        few.fetch(np.arange(10) * LEAVES)
        few.fetch(np.arange(64, 64 + 54) * LEAVES)
        assert np.all(few._slot[:10] >= 0) and not np.any(few._slot[10:64] >= 0)
        assert few.share == 64 / len(pyramid.mask)

    def test_single_profiles_can_be_looked_at_without_keeping_them(self, built: dict, rng: np.random.Generator) -> None:
        pyramid, profiles = built["L", False]
        few = LeafProfiles(pyramid.grid, Caster(room("L")), limit_bytes=0)
        few.fetch(np.arange(30) * LEAVES)
        before = few._slot.copy()
        leaves = rng.integers(0, LEAVES * len(pyramid.mask), 500)
        assert np.array_equal(few.look(leaves), profiles[leaves])
        assert np.array_equal(few._slot, before)
