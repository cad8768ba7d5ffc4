"""Baked light of whole scenes: odd ones and large ones, and how it is kept."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from light_room import WHITE, Room, texels, window_room

from galoc import Camera, Floorplan
from galoc.errors import CacheWarning
from galoc_env.homes import generate
from galoc_env.render import light as light_module
from galoc_env.render import make_renderer
from galoc_env.render._light_kernel import CLOSE
from galoc_env.render._light_ray_kernel import trace
from galoc_env.render.facets import build_facets
from galoc_env.render.light import AMBIENT, bake, linear, lit
from galoc_env.render.light_surfaces import make_surfaces
from galoc_env.render.light_world import make_world
from galoc_env.scene import build_scene
from galoc_env.scene.light import Lamp
from galoc_env.scene.mesh import WALL


def test_the_first_facet_of_random_rays(rng: np.random.Generator) -> None:
    """The grid finds what a look at every facet finds."""
    facets = build_facets(build_scene(generate(2), furniture=0.6, seed=2))
    world = make_world(facets)
    low, high = facets.vertices.min(axis=0), facets.vertices.max(axis=0)
    n, d = facets.plane[:, :3].astype(float), facets.plane[:, 3].astype(float)
    hit = 0
    for _ in range(200):
        o, ray = rng.uniform(low, high), rng.normal(size=3)
        ray /= np.linalg.norm(ray)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (d - n @ o) / (n @ ray)
        best = np.inf
        for i in np.flatnonzero((t > 1e-6) & (t < 100)):
            q = facets.vertices[facets.first[i] : facets.first[i + 1]].astype(float)
            inside = np.cross(np.roll(q, -1, axis=0) - q, o + t[i] * ray - q) @ n[i]
            best = min(best, t[i]) if (inside >= 0).all() else best
        f, got = trace(world.rays, o[0], o[1], o[2], ray[0], ray[1], ray[2], 1e3, False)
        assert (f < 0) == np.isinf(best)
        if f >= 0:
            hit += 1
            assert got == pytest.approx(best, abs=2e-4)  # m: rays past edges may meet the one or the other face
    assert hit > 100


def test_homes_are_bright_and_the_same_every_time() -> None:
    scene = build_scene(generate(1), furniture=0.4, seed=1)
    facets = build_facets(scene)
    first, second = (bake(facets, scene.lamps, scene.sun, 0.6) for _ in range(2))
    assert first.tobytes() == second.tobytes()
    assert first.shape == (facets.light_first[-1], 3) and np.isfinite(first).all() and first.min() >= 0
    facet = np.repeat(np.arange(len(facets.plane)), np.diff(facets.light_first))
    walls = first[(facets.semantic[facet] == WALL)].mean(axis=1)
    assert 0.3 < np.median(walls[walls > 0]) < 1.0
    assert (first[facets.glow[facet] > 0] == 0).all()


def test_light_is_kept_in_memory_and_on_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GALOC_CACHE", str(tmp_path))
    scene = build_scene(generate(2), furniture=0.0, seed=2)
    light_module._recent.clear()
    _, light = lit(scene)
    assert lit(scene)[1] is light
    assert len(list(tmp_path.glob("*.galoc"))) == 1
    light_module._recent.clear()
    with monkeypatch.context() as patch:
        patch.setattr(light_module, "bake", lambda *_: pytest.fail("computed again"))
        again = lit(scene)[1]
    assert again.tobytes() == light.tobytes() and not again.flags.writeable
    dull = dataclasses.replace(scene, lamps=scene.lamps[:-1])
    assert lit(dull)[1].tobytes() != light.tobytes()
    monkeypatch.setenv("GALOC_CACHE", "off")
    light_module._recent.clear()
    assert lit(scene)[1].tobytes() == light.tobytes()


def test_a_bake_that_is_broken_off_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GALOC_CACHE", str(tmp_path))
    scene = window_room()[0].scene()
    light_module._recent.clear()

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(light_module, "bake", stop)
        with pytest.raises(KeyboardInterrupt):
            lit(scene)
    assert not list(tmp_path.glob("*.galoc")) and not light_module._recent
    facets, light = lit(scene)
    assert len(light) == facets.light_first[-1] and len(list(tmp_path.glob("*.galoc"))) == 1


def test_a_cache_folder_that_cannot_be_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Light is the same, with a warning."""
    scene = window_room()[0].scene()
    monkeypatch.setenv("GALOC_CACHE", "off")
    light_module._recent.clear()
    _, expected = lit(scene)
    (tmp_path / "file").touch()
    monkeypatch.setenv("GALOC_CACHE", str(tmp_path / "file" / "folder"))
    light_module._recent.clear()
    with pytest.warns(CacheWarning, match="GALOC_CACHE"):
        assert lit(scene)[1].tobytes() == expected.tobytes()


def test_only_so_many_scenes_stay_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(light_module, "_RECENT", 2)
    scene = window_room()[0].scene()
    for k in range(4):
        lit(dataclasses.replace(scene, lamps=(Lamp(1.0 + k / 2, 2, 2, WHITE),)))
    assert len(light_module._recent) == 2


def test_under_the_open_sky() -> None:
    """Without a ceiling what faces the void is lit like anything else: one face and a lamp before it."""
    room = Room()
    face = room.sheet((0, 0, 0), (1, 0, 0), (0, 1, 0))
    facets = room.facets()
    light = bake(facets, [Lamp(0.5, 0.5, 2.0, WHITE)], None)
    assert facets.instance.tolist() == [face] and light.min() > 0.9 / (4.0 + 0.5 + CLOSE**2)


def test_points_of_a_scene_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few points for a room of 12 m: light is still much the same, 20 percent on average over its floor."""
    room = Room()
    floor = room.box(0, 0, 12, 12)["floor"]
    facets = room.facets()
    fine = bake(facets, [Lamp(6, 6, 2.1, WHITE)], None, 0.7)
    monkeypatch.setattr("galoc_env.render.light_surfaces.MOST", 300)
    world = make_world(facets)
    at = make_surfaces(facets, world, np.ones(len(facets.plane), bool))
    assert 150 < len(at.points) <= 300
    coarse = bake(facets, [Lamp(6, 6, 2.1, WHITE)], None, 0.7)
    _, numbers = texels(facets, floor)
    assert coarse[numbers].mean() == pytest.approx(fine[numbers].mean(), rel=0.2)


def test_a_plan_without_rooms_has_no_black_walls() -> None:
    """Two walls at a corner under a ceiling, and the void all round: there is still the light that is everywhere."""
    plan = Floorplan.from_segments(np.array([[0, 0, 4, 0], [4, 0, 4, 3]], float), ceiling_height=2.5)
    scene = build_scene(plan, furniture=0.0, seed=0)
    facets = build_facets(scene)
    light = bake(facets, scene.lamps, scene.sun)
    tall = (facets.semantic == WALL) & (np.abs(facets.plane[:, 2]) < 0.1) & (np.diff(facets.light_first) > 30)
    means = [light[facets.light_first[i] : facets.light_first[i + 1]].mean() for i in np.flatnonzero(tall)]
    assert len(means) >= 4 and min(means) > 0.3 * AMBIENT


def test_linear_light() -> None:
    c = np.linspace(0, 1, 101)
    exact = np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(linear(c), exact, atol=0.005)


def test_a_scene_without_faces() -> None:
    assert bake(Room().facets(), [Lamp(0, 0, 2, WHITE)], None).shape == (0, 3)


@pytest.mark.parametrize(
    "corners",
    [
        [(0, 0), (4, 0), (1, 3)],
        [(0, 0), (4, 0), (0, 4)],
        [(0, 0), (3.46, 2.0), (1.96, 4.6), (-1.5, 2.6)],
        [(2.5 * np.cos(a), 2.5 * np.sin(a)) for a in np.linspace(0.1, 0.1 + 2 * np.pi, 7, endpoint=False)],
    ],
    ids=["acute", "right triangle", "turned", "heptagon"],
)
def test_no_wall_of_a_room_is_taken_for_hidden(corners: list[tuple[float, float]]) -> None:
    """Walls at any angle, and one with a gap in it to look out of, get light from the lamp."""
    walls = [[*a, *b] for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]
    gap = [*walls[1:], [*walls[0][:2], *(0.6 * np.array(walls[0][:2]) + 0.4 * np.array(walls[0][2:]))]]
    for segments in (walls, gap):
        plan = Floorplan.from_segments(np.array(segments, float), 2.5)
        scene = build_scene(plan, furniture=0.0, seed=1)
        middle = np.mean(corners, axis=0)
        renderer = make_renderer("raster", scene, Camera.from_hfov(64, 48, 100), quality="fast")
        for heading in np.linspace(0.0, 2 * np.pi, 8, endpoint=False):
            frame = renderer.render((*middle, heading), 1.3, (0.0, 0.0))
            wall = frame.semantic == WALL
            assert not wall.any() or np.median(frame.rgb[wall].max(axis=-1)) > 20
            assert np.mean(frame.rgb[wall].max(axis=-1) < 8) < 0.01
