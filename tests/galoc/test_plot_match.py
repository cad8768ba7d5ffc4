"""Pictures of a search: the values land where they belong, bad input is refused by name."""

from pathlib import Path

import numpy as np
import pytest

from galoc import Floorplan, GalocError
from galoc.plot_match import BEST, TRUTH, draw_heat_map, save_match_figure

ROOM = Floorplan.from_segments(np.array([[0, 0, 4, 0], [4, 0, 4, 3], [4, 3, 0, 3], [0, 3, 0, 0]], float))
XY = np.stack(np.meshgrid(np.arange(0.25, 4.0, 0.1), np.arange(0.25, 2.8, 0.1)), axis=-1).reshape(-1, 2)
SCORES = -np.hypot(*(XY - [3.05, 0.95]).T)


def test_every_value_lies_at_its_position() -> None:
    from matplotlib.figure import Figure

    image = draw_heat_map(Figure().add_subplot(), ROOM, XY, SCORES)
    x0, x1, y0, y1 = image.get_extent()
    shown = np.ma.filled(image.get_array(), np.nan)
    rows, columns = shown.shape
    assert (x1 - x0) / columns == pytest.approx(0.1) and (y1 - y0) / rows == pytest.approx(0.1)
    row, column = np.unravel_index(np.nanargmax(shown), shown.shape)
    assert x0 + (column + 0.5) * 0.1 == pytest.approx(3.05) and y0 + (row + 0.5) * 0.1 == pytest.approx(0.95)
    assert np.mean(np.isfinite(shown)) == pytest.approx(0.5, abs=0.01)  # the better half


def test_poses_and_truth_are_marked() -> None:
    from matplotlib.figure import Figure

    ax = Figure().add_subplot()
    draw_heat_map(ax, ROOM, XY, SCORES, [(3.0, 1.0, 0.5), (1.0, 2.0, -2.0)], (3.05, 0.95, 0.4))
    rings = [line for line in ax.lines if line.get_marker() == "o"]
    assert [line.get_markeredgecolor() for line in rings] == [BEST, BEST, TRUTH]
    assert [line.get_markerfacecolor() for line in rings] == [BEST, "none", "none"]
    np.testing.assert_allclose(np.ravel([line.get_xydata() for line in rings]), [3.0, 1.0, 1.0, 2.0, 3.05, 0.95])


def test_figure_is_written_whole_or_refused(tmp_path: Path) -> None:
    done = save_match_figure(ROOM, XY, SCORES, tmp_path / "with space.png", poses=[(3.0, 1.0, 0.5)])
    assert done.read_bytes().startswith(b"\x89PNG")
    one = save_match_figure(ROOM, XY[:1], SCORES[:1], tmp_path / "one.png")  # a single position has no step of its own
    assert one.stat().st_size > 1000
    for where, xy, scores, words in (
        (tmp_path / "map.jpg", XY, SCORES, "ends in .png"),
        (tmp_path / "map.png", XY, SCORES[:-1], "Matcher.heat_map"),
        (tmp_path / "map.png", XY[:0], SCORES[:0], "Matcher.heat_map"),
        (tmp_path / "nowhere" / "map.png", XY, SCORES, "writable"),
    ):
        with pytest.raises(GalocError, match=words):
            save_match_figure(ROOM, xy, scores, where)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["one.png", "with space.png"]
