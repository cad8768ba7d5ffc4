"""The `galoc plan` command and its drawing."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from galoc import Floorplan, GalocError
from galoc.cli import main
from galoc.plan_facts import plan_facts, room_count
from galoc.plot import FREE, WALL, WINDOW, draw_plan, save_plan_figure


def colour(name: str) -> NDArray[np.int64]:
    return np.array([int(name[i : i + 2], 16) for i in (1, 3, 5)])


def share(picture: NDArray[np.uint8], name: str) -> float:
    """Share of pixels of a colour."""
    return float(np.mean(np.abs(picture[..., :3].astype(int) - colour(name)).max(axis=-1) <= 6))


def test_prints_facts_and_draws(tmp_path: Path, monkeypatch, capsys) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.chdir(tmp_path)
    assert main(["plan", "apartment"]) == 0
    out = capsys.readouterr().out
    for words in ("apartment", "11.48 m x 7.68 m", "doors           7", "windows         7", "2.55 m", "100 %"):
        assert words in out
    assert [p.name for p in tmp_path.iterdir()] == ["apartment.plan.png"]


def test_writes_where_it_is_told(tmp_path: Path, capsys) -> None:  # type: ignore[no-untyped-def]
    picture, saved = tmp_path / "a.png", tmp_path / "b.json"
    assert main(["plan", "corridor", "--out", str(picture), "--save", str(saved), "--ceiling-height", "2.75"]) == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert Floorplan.load(saved).ceiling_height == 2.75
    assert {p.name for p in tmp_path.iterdir()} == {"a.png", "b.json"}


def test_bad_input_is_one_message_and_exit_code_2(tmp_path: Path, capsys) -> None:  # type: ignore[no-untyped-def]
    missing = tmp_path / "missing.json"
    assert main(["plan", str(missing)]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert "does not exist" in captured.err
    assert "Traceback" not in captured.err
    assert main(["plan", "apartment", "--out", str(tmp_path / "no" / "x.png")]) == 2
    assert main(["plan", "apartment", "--out", str(tmp_path / "x.pdf")]) == 2
    assert list(tmp_path.iterdir()) == []


def test_unknown_commands_exit_with_2() -> None:
    with pytest.raises(SystemExit) as stop:
        main(["fly"])
    assert stop.value.code == 2


def test_command_runs_without_a_display(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "galoc.cli", "plan", "apartment", "--out", str(tmp_path / "p.png")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env={"PATH": ""}, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""


def test_drawing_shows_walls_free_space_and_windows_in_proportion(tmp_path: Path) -> None:
    from imageio.v3 import imread

    plan = Floorplan.load("apartment")
    picture = imread(save_plan_figure(plan, tmp_path / "p.png"))
    free, wall = share(picture, FREE), share(picture, WALL)
    x_min, y_min, x_max, y_max = plan.bounds
    wall_area = (x_max - x_min) * (y_max - y_min) - plan.free_space(0.02).area
    wall_area -= sum(o.width * o.thickness for o in plan.openings if o.kind == "window")  # painted over the wall
    # door leaves lie on the floor, and outlines have a width: a pixel along 125 m of wall is 2 % of the floor
    assert free / wall == pytest.approx(plan.free_space(0.02).area / wall_area, rel=0.1)
    assert share(picture, WINDOW) > 1e-4


def test_drawing_stays_in_the_plan_frame() -> None:
    from matplotlib.figure import Figure

    plan = Floorplan.load("gallery")
    ax = Figure().add_subplot()
    draw_plan(ax, plan)
    x_min, y_min, x_max, y_max = plan.bounds
    assert ax.get_xlim()[0] < x_min < x_max < ax.get_xlim()[1]
    assert ax.get_ylim()[0] < y_min < y_max < ax.get_ylim()[1]
    assert ax.get_aspect() == 1.0


@pytest.mark.parametrize("name", ["amrl_maps/NSH1", "wrld_westport/westport-house-floor-1", "utexas_gdc/gdc_1s"])
def test_published_plans_are_drawn(shared_plans: Path, tmp_path: Path, name: str) -> None:
    plan = Floorplan.load(shared_plans / f"{name}.json")
    assert save_plan_figure(plan, tmp_path / "p.png").stat().st_size > 10_000


def test_odd_names_and_thin_plans_are_drawn(tmp_path: Path) -> None:
    walls = [[0, 0, 40, 0], [40, 0, 40, 0.9], [40, 0.9, 0, 0.9], [0, 0.9, 0, 0]]
    save_plan_figure(Floorplan.from_segments(walls, name="$x_1 & co$"), tmp_path / "p.png")
    with pytest.raises(GalocError):
        save_plan_figure(Floorplan.from_segments(walls), tmp_path / "none" / "p.png")


@pytest.mark.parametrize(
    ("name", "rooms"), [("apartment", 7), ("house", 12), ("office", 16), ("corridor", 22), ("gallery", 7)]
)
def test_rooms_of_shipped_plans(name: str, rooms: int) -> None:
    assert room_count(Floorplan.load(name)) == rooms


def test_facts_of_a_known_plan() -> None:
    walls = [[0, 0, 9, 0], [9, 0, 9, 4], [9, 4, 0, 4], [0, 4, 0, 0], [6, 0, 6, 1.6], [6, 2.4, 6, 4]]
    facts = plan_facts(Floorplan.from_segments(walls))
    assert (facts.width, facts.depth, facts.segments) == (9.0, 4.0, 6)
    assert facts.wall_length == pytest.approx(29.2)
    assert facts.rooms == 2  # the door is 0.8 m wide
    assert facts.manhattan_share == pytest.approx(1.0)
