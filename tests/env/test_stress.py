"""The stress tests of gauge solvers: true views, paired noise, resumption, user solvers, honest verdicts."""

import csv
import json
import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from galoc import GalocError
from galoc.gauge import solve_points
from galoc.pairs import solve_pairs
from galoc_env import stress, stress_claims
from galoc_env.cli import main
from galoc_env.stress_observe import observe
from galoc_env.stress_scenes import MIN_COVERAGE, Condition, scenes
from galoc_env.stress_scores import built_in, interval, ratio_interval, ray_error, rays_of, score, share, summary

BASE = Condition()
EXACT = replace(BASE, sigma_px=0.0, tilt_deg=0.0)
TINY = ["stress", "--frames", "6", "--sweeps", "sigma"]


@pytest.mark.parametrize("true_tilt_deg", [0.0, 6.0])
def test_scenes_are_true_views(true_tilt_deg):
    condition = replace(BASE, true_tilt_deg=true_tilt_deg)
    for scene in scenes(condition, 12, 0):
        camera = condition.camera
        assert len(scene.points) >= 3
        assert camera.contains(scene.ceiling).all() and camera.contains(scene.floor).all()
        # Exact pixels and gravity: every corner comes back at its height and place, to 1e-9 m.
        for pixels, y in ((scene.ceiling, -scene.heights[0]), (scene.floor, scene.heights[1])):
            rays = camera.rays_level(pixels, scene.gravity)
            at = rays * (y / rays[:, 1])[:, None]
            np.testing.assert_allclose(at[:, [0, 2]], scene.points, atol=1e-9)
        azimuth = np.arctan2(*scene.points.T)
        assert (np.diff(azimuth) > -1e-9).all()  # left to right
        known = np.isfinite(scene.ranges)
        if true_tilt_deg == 0.0:
            assert known.mean() > MIN_COVERAGE - 0.03  # one ray per degree counts a wall's ends coarsely
        assert scene.ranges[known].min() > 0.3


def test_scenes_have_the_pairs_and_homes_asked_for():
    assert {len(s.points) for s in scenes(replace(BASE, pairs=5), 5, 1)} == {5}
    assert {s.kind for s in scenes(replace(BASE, kind="free"), 5, 1)} == {"free"}
    views = scenes(BASE, 9, 3)
    assert len({s.plan for s in views}) >= 3 and {s.kind for s in views} == {"rectilinear", "atlanta", "free"}
    again = scenes.__globals__["_scenes"].__wrapped__(BASE.kind, 108.0, 1.4, 0.0, None, 9, 3)
    assert all(np.array_equal(a.ceiling, b.ceiling) for a, b in zip(views, again, strict=True))


def test_impossible_views_are_refused(monkeypatch):
    monkeypatch.setattr("galoc_env.stress_scenes.PLANS_PER_FRAME", 1)
    with pytest.raises(GalocError, match="50 pairs"):
        scenes(replace(BASE, pairs=50), 4, 0)
    for wrong in ({"kind": "round"}, {"missed_share": 1.5}, {"sigma_px": -1.0}, {"camera_height_m": 3.0}):
        with pytest.raises(GalocError):
            replace(BASE, **wrong)


@pytest.mark.parametrize("name", ["paper", "paper-fixed", "tls", "ml"])
def test_exact_observations_are_solved_exactly(name):
    scores = score(EXACT, 10, 0, built_in((name,)))[name]
    # 1e-4: "ml" has weak priors on the heights and on depths, the others are exact to rounding.
    assert np.nanmax(scores.ray_error) < (1e-4 if name == "ml" else 1e-8)
    assert not scores.failed.any() and np.all(scores.recovered > 0.99)


def test_noise_is_paired_and_factors_do_what_they_say():
    scene = scenes(BASE, 12, 0)[5]
    n = len(scene.points)
    clean, low, high = (observe(scene, replace(BASE, sigma_px=s), 5, 0) for s in (0.0, 2.0, 4.0))
    np.testing.assert_allclose(high.ceiling - clean.ceiling, 2.0 * (low.ceiling - clean.ceiling), atol=1e-9)
    np.testing.assert_array_equal(low.gravity, high.gravity)
    one = observe(scene, replace(EXACT, wrong_junctions=1), 5, 0)
    shift = np.hypot(*np.concatenate([one.ceiling - scene.ceiling, one.floor - scene.floor]).T)
    moved = shift[shift > 1e-9]
    assert len(moved) == 1 and 30.0 <= moved[0] <= 80.0 and one.wrong.sum() == 1
    half = observe(scene, replace(EXACT, one_sided_share=1.0), 5, 0)
    whole = half.ceiling_seen & half.floor_seen
    assert whole.sum() == 2 and (half.ceiling_seen | half.floor_seen).all() and len(whole) == n
    np.testing.assert_array_equal(half.ceiling[~half.ceiling_seen, 1], -0.5)


def test_overlooked_corners_merge_their_walls():
    for i, scene in enumerate(scenes(BASE, 12, 0)):
        seen = observe(scene, replace(EXACT, missed_share=1.0), i, 0)
        dropped = len(scene.points) - len(seen.ceiling)
        assert len(seen.walls) == len(scene.walls) - dropped and len(seen.ceiling) >= 2
        assert seen.walls.max() < len(seen.ceiling)
        joined = np.intersect1d(seen.walls[:, 0], seen.walls[:, 1])
        assert len(joined) == 0 or len(seen.ceiling) == 2  # nothing between two walls is left to overlook
        assert set(seen.ceiling[seen.walls[:, 0], 0]) <= set(scene.ceiling[scene.walls[:, 0], 0])


def test_scores_agree_with_a_direct_computation():
    scores = score(BASE, 8, 0, built_in(("ml",)))["ml"]
    for i, scene in enumerate(scenes(BASE, 8, 0)):
        seen = observe(scene, BASE, i, 0)
        own = solve_pairs(seen.ceiling[None], seen.floor[None], BASE.camera, seen.gravity[None], sigma_px=5.0)
        a, b = own.points[0][seen.walls[:, 0]], own.points[0][seen.walls[:, 1]]
        ratio = []
        for azimuth, truth in zip(scene.azimuths, scene.ranges, strict=True):
            d = np.array([math.sin(azimuth), math.cos(azimuth)])
            hits = []
            for p, q in zip(a, b, strict=True):
                t, u = np.linalg.solve(np.stack([d, p - q], axis=1), p)
                if -1e-12 <= u <= 1.0 + 1e-12 and t > 0.0:
                    hits.append(t)
            if hits and np.isfinite(truth):
                ratio.append(min(hits) / truth)
        ratio = np.array(ratio) / np.median(ratio)
        assert scores.ray_error[i] == pytest.approx(np.mean(np.abs(ratio - 1.0)), abs=1e-3)
    numbers = summary(scores)
    assert numbers["views"] == 8 and numbers["tilt_error_deg"] < numbers["imu_error_deg"]


def test_nothing_recovered_is_a_failure():
    def blind(ceiling, floor, camera, gravity, **_):
        return np.full(ceiling.shape, np.nan)

    def behind(ceiling, floor, camera, gravity, **told):
        return -solve_pairs(ceiling, floor, camera, gravity, **told).points

    for solver in (blind, behind):
        numbers = summary(score(BASE, 5, 0, {"bad": solver})["bad"])
        assert numbers["failure"] == 1.0 and numbers["recovered"] == 0.0 and math.isnan(numbers["ray_error"])
    assert math.isnan(ray_error(np.full(109, np.nan), scenes(BASE, 5, 0)[0].ranges))


def test_intervals_resample_homes_not_views():
    values, homes = np.repeat([0.0, 1.0], 50), np.repeat([0, 1], 50)
    assert interval(values, homes) == (0.5, 0.0, 1.0)
    value, low, high = interval(values, np.arange(100))
    assert value == 0.5 and 0.38 < low < 0.45 and 0.55 < high < 0.62  # 1.96 sqrt(0.25 / 100) = 0.098
    assert ratio_interval(2.0 * values + 2.0, values + 1.0, homes) == (2.0, 2.0, 2.0)
    assert all(math.isnan(v) for v in interval(np.full(3, np.nan), np.arange(3)))
    assert share(np.zeros(50, bool))[2] > 0.05


def test_command_writes_everything(tmp_path, capsys):
    main(["stress", "--quick", "--frames", "6", "--sweeps", "sigma", "kind", "claims", "--out", str(tmp_path / "a b")])
    folder = tmp_path / "a b"
    names = ["conditions.csv", "stress.json", "stress.png", "verdicts.md"]
    assert sorted(p.name for p in folder.iterdir()) == names
    rows = list(csv.DictReader((folder / "conditions.csv").read_text().splitlines()))
    assert len(rows) == 4 * 6 and {r["solver"] for r in rows} == {"paper", "paper-fixed", "tls", "ml"}
    result = json.loads((folder / "stress.json").read_text(), parse_constant=lambda name: pytest.fail(name))
    assert [c["name"] for c in result["claims"]] == list(stress_claims.CLAIMS)
    assert float(rows[0]["ray_error"]) == result["rows"][0]["ray_error"]
    page = cv2.imread(str(folder / "stress.png"))
    assert page.shape[1] > 1000 and page.std() > 20.0
    said = capsys.readouterr().out
    assert "pi-periodic" in said and "grid" not in said
    assert (folder / "verdicts.md").read_text().count("\n") == 2 + len(stress_claims.CLAIMS)


def test_killed_run_goes_on_where_it_was(tmp_path):
    main([*TINY, "--out", str(tmp_path / "whole")])
    whole = json.loads((tmp_path / "whole" / "stress.json").read_text())
    plan = stress.Plan.make(("sigma",), 6, 0, None, False)
    done = plan.work(0, plan.solvers())
    done["solvers"]["ml"]["ray_error"] = 0.777
    folder = tmp_path / "killed"
    folder.mkdir()
    torn = json.dumps(plan.job()) + "\n" + json.dumps(done, default=float).replace("NaN", "null") + '\n{"seed": 1, "so'
    (folder / "partial.jsonl").write_text(torn)
    main([*TINY, "--out", str(folder)])
    second = json.loads((folder / "stress.json").read_text())
    taken = [r for r in second["rows"] if r["sigma_px"] == 1.0 and r["solver"] == "ml"]
    assert taken[0]["ray_error"] == 0.777  # not computed again
    rest = [[r for r in x["rows"] if r["sigma_px"] != 1.0] for x in (whole, second)]
    for a, b in zip(*rest, strict=True):
        a.pop("ms_per_solve"), b.pop("ms_per_solve")
        assert a == b
    assert not (folder / "partial.jsonl").exists()


SOLVER = """
import numpy as np
def flat(ceiling, floor, camera, gravity, *, sigma_px=None, imu_sigma_rad=0.0, ceiling_seen=None, floor_seen=None):
    rays = np.stack([camera.rays_level(c, g) for c, g in zip(ceiling, gravity)])
    return rays[..., [0, 2]] / -rays[..., 1:2]
def short(ceiling, floor, camera, gravity, **told):
    return np.zeros((len(ceiling), 2))
number = 3
"""


def test_user_solver_joins_the_shipped_ones(tmp_path, monkeypatch, capsys):
    (tmp_path / "mine.py").write_text(SOLVER)
    monkeypatch.chdir(tmp_path)
    for spec in ("mine.py:flat", f"{tmp_path}/mine.py:flat"):
        main([*TINY, "--quick", "--solver", spec, "--out", str(tmp_path / "out")])
        rows = json.loads((tmp_path / "out" / "stress.json").read_text())["rows"]
        own = [r for r in rows if r["solver"] == "flat"]
        assert len(own) == 3 and all(0.0 < r["ray_error"] < 0.5 for r in own)
        assert own[0]["within_2_sigma"] is None  # it gives no covariance
    with pytest.raises(SystemExit, match="2"):
        main([*TINY, "--solver", "mine.py:short", "--out", str(tmp_path / "out")])
    assert "shape" in capsys.readouterr().err


def test_edited_solver_does_not_resume(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    jobs = []
    for text in (SOLVER, SOLVER + "# edited\n"):
        (tmp_path / "mine.py").write_text(text)
        jobs.append(stress.Plan.make((), 6, 0, "mine.py:flat", True).job())
    assert jobs[0] != jobs[1]


@pytest.mark.parametrize(
    "wrong",
    [
        ["--frames", "1"],
        ["--jobs", "0"],
        ["--seed", "-1"],
        ["--sweeps", "noise"],
        ["--solver", "nothing"],
        ["--solver", "no.such.module:f"],
        ["--solver", "math:nothing"],
        ["--solver", "math:pi"],
        ["--solver", "nofile.py:f"],
    ],
)
def test_bad_options_are_refused_before_anything_is_written(wrong, tmp_path, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(["stress", "--out", str(tmp_path / "out"), *wrong])
    assert "expected" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_two_processes_give_the_same_numbers(tmp_path):
    plan = stress.Plan.make(("kind",), 4, 0, None, True)
    alone, spread = ({r["seed"]: r for r in stress.run_tasks(plan, range(plan.tasks), jobs)} for jobs in (1, 2))
    for task, result in alone.items():
        for name, numbers in result["solvers"].items():
            assert numbers["ray_error"] == spread[task]["solvers"][name]["ray_error"]


def test_verdicts_follow_the_numbers():
    """What is provably so must come out so, on any views (docs/geometry.md)."""
    verdicts = {name: stress_claims.judge(name, 40, 5)["verdict"] for name in ("identified", "periodic", "gamma")}
    assert verdicts == {"identified": "does not hold", "periodic": "holds", "gamma": "holds"}
    landscape = stress_claims.landscape(12, 0)
    exact, noisy = np.array(landscape["exact"]), np.array(landscape["noisy"])
    assert exact.max() < 1e-9 < noisy.min()
    np.testing.assert_allclose(noisy[:360], noisy[360:], rtol=1e-9)


def test_points_of_the_paper_are_those_of_the_gauge():
    """Scores of "paper" are scores of galoc.gauge and nothing in between."""
    scores = score(BASE, 6, 0, built_in(("paper",)))["paper"]
    for i, scene in enumerate(scenes(BASE, 6, 0)):
        seen = observe(scene, BASE, i, 0)
        p, q = (BASE.camera.rays_level(x, seen.gravity)[None] for x in (seen.ceiling, seen.floor))
        points = solve_points(p, q)[0][0]
        own = ray_error(rays_of(points, seen.walls, scene.azimuths)[0], scene.ranges)
        # 1e-6: theta_hat is refined to 1e-7 rad, and the rays differ in their last digit.
        assert scores.ray_error[i] == pytest.approx(own, rel=1e-6)
