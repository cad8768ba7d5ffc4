"""Baked light in small rooms where geometry says what it must be."""

import math

import numpy as np
import pytest
from light_room import HEIGHT, WHITE, Room, texels, window_room

from galoc_env.render._light_kernel import CLOSE
from galoc_env.render._light_pane_kernel import seen_share
from galoc_env.render.facets import Facets
from galoc_env.render.light import AMBIENT, DAYLIGHT, bake
from galoc_env.render.light_world import make_world
from galoc_env.scene.light import Lamp, Sun
from galoc_env.scene.mesh import CEILING, FLOOR, WALL, WINDOW


def test_a_lamp_by_the_formula() -> None:
    """No light comes back from black walls: on floor and walls it is power cos / d^2, as far as the lamp is a point."""
    room = Room()
    parts = room.box(0, 0, 6, 5)
    facets = room.facets()
    lamp = Lamp(2.0, 2.5, 1.8, (1.5, 1.0, 0.5))
    got = bake(facets, [lamp], None, 0.0) - bake(facets, [], None, 0.0)
    for name, normal in (("floor", (0, 0, 1)), ("e", (-1, 0, 0)), ("s", (0, 1, 0))):
        places, numbers = texels(facets, parts[name])
        off = np.array([2.0, 2.5, 1.8]) - places
        d = np.linalg.norm(off, axis=1)
        low = off[:, 2] >= 0  # above the lamp its shade takes some
        expected = (off @ np.array(normal, float) / d / (d**2 + CLOSE**2))[:, None] * lamp.power
        # At the edges light is that of 3 cm inside: up to 3 % of what it is at the smallest distance, 1.8 m.
        np.testing.assert_allclose(got[numbers][low], expected[low], atol=0.012)


def test_a_closed_room_stays_dark() -> None:
    """Next to a bright room, behind walls of 10 cm: nothing but the light that is everywhere."""
    room = Room()
    bright, dark = room.box(0, 0, 4, 4), room.box(4.1, 0, 8, 4)
    facets = room.facets()
    with_lamp = bake(facets, [Lamp(2, 2, 2.1, WHITE), Lamp(3.6, 1.0, 0.5, WHITE)], None, 0.8)
    without = bake(facets, [], None, 0.8)
    for name in dark:
        _, numbers = texels(facets, dark[name])
        np.testing.assert_array_equal(with_lamp[numbers], without[numbers])
        # Light everywhere, sent back and forth without end: 1 / (1 - 0.8) times; in corners less.
        assert (with_lamp[numbers] > 0.5 * AMBIENT).all() and (with_lamp[numbers] < 5.01 * AMBIENT).all()
    assert all(with_lamp[texels(facets, bright[name])[1]].mean() > 0.3 for name in bright)


def test_a_table_casts_a_shadow() -> None:
    room = Room()
    floor = room.box(0, 0, 5, 5)["floor"]
    room.body((1.5, 1.5, 0.70), (2.5, 2.5, 0.74))
    facets = room.facets()
    light = bake(facets, [Lamp(2.5, 2.5, 2.2, WHITE)], None, 0.5)[:, 0]
    places, numbers = texels(facets, floor)
    shade = np.array([2.5, 2.5, 0]) + (np.array([2.0, 2.0, 0]) - [2.5, 2.5, 0]) * 2.2 / (2.2 - 0.72)
    other = 5.0 - shade  # as far from the lamp, on the free side
    here, there = (light[numbers[np.argmin(np.linalg.norm(places[:, :2] - p[:2], axis=1))]] for p in (shade, other))
    assert here < 0.5 * there
    assert here > 0.05  # but other surfaces send light there


def test_a_symmetric_room_has_symmetric_light() -> None:
    """Four walls alike, the lamp in the middle: a quarter turn changes as much as the scatter of the rays."""
    room = Room()
    parts = room.box(0, 0, 4, 4)
    facets = room.facets()
    light = bake(facets, [Lamp(2, 2, 2.1, WHITE)], None, 0.7)[:, 0]
    walls = [light[texels(facets, parts[name])[1]] for name in "wesn"]
    means = np.array([wall.mean() for wall in walls])
    np.testing.assert_allclose(means, means.mean(), rtol=0.02)
    places, numbers = texels(facets, parts["floor"])
    there = np.array([np.argmin(np.abs(places - (4 - p[0], 4 - p[1], 0)).sum(axis=1)) for p in places])
    np.testing.assert_allclose(light[numbers], light[numbers][there], rtol=0.08)


def turned(facets: Facets, instance: int) -> np.ndarray:
    """Normal of an instance's first facet."""
    return facets.plane[np.flatnonzero(facets.instance == instance)[0], :3]


def test_faces_of_the_test_room_look_inside() -> None:
    room, parts, pane = window_room()
    facets = room.facets()
    for name, n in {
        "floor": (0, 0, 1),
        "ceiling": (0, 0, -1),
        "e": (-1, 0, 0),
        "s": (0, 1, 0),
        "n": (0, -1, 0),
    }.items():
        np.testing.assert_allclose(turned(facets, parts[name]), n, atol=1e-6)
    np.testing.assert_allclose(turned(facets, pane), (1, 0, 0), atol=1e-6)


def test_the_sun_lies_where_geometry_says() -> None:
    """The patch on the floor is the pane, moved along the sun's rays; inside it the light grows by power sin(h)."""
    room, parts, _ = window_room()
    facets = room.facets()
    sun = Sun(math.radians(200.0), math.radians(40.0), (2.0, 1.8, 1.5))
    got = bake(facets, [], sun, 0.0) - bake(facets, [], None, 0.0)
    places, numbers = texels(facets, parts["floor"])
    towards = np.array([math.cos(sun.bearing), math.sin(sun.bearing)]) / math.tan(sun.elevation)
    # Up along the ray to x = 0.
    z = -places[:, 0] / towards[0]
    y = places[:, 1] + towards[1] * z
    off = np.maximum(np.abs(y - 2.0) - 0.6, np.abs(z - 1.5) - 0.6)  # < 0: through the pane
    inside, outside = numbers[off < -0.25], numbers[off > 0.25]
    assert len(inside) > 4 and len(outside) > 100
    np.testing.assert_allclose(got[inside], np.tile(np.multiply(sun.power, math.sin(sun.elevation)), (len(inside), 1)),
                               rtol=1e-4)  # fmt: skip
    np.testing.assert_allclose(got[outside], 0.0, atol=1e-6)


def test_no_sun_through_walls() -> None:
    room = Room()
    room.box(0, 0, 4, 4)
    facets = room.facets()
    sun = Sun(0.5, 0.5, (3.0, 3.0, 3.0))
    np.testing.assert_array_equal(bake(facets, [], sun, 0.5), bake(facets, [], None, 0.5))


def test_a_window_by_the_formula() -> None:
    """Opposite the window, black walls: its brightness times area cos cos / (pi d^2)."""
    room, parts, pane = window_room()
    facets = room.facets()
    got = bake(facets, [], None, 0.0)
    places, numbers = texels(facets, parts["e"])
    middle = np.argmin(np.linalg.norm(places - (5, 2, 1.5), axis=1))
    expected = np.array(DAYLIGHT) * 1.44 / (math.pi * 25 + 0.36)
    # Rays that meet walls within 1 m dim the light that is everywhere; at 5 m none does.
    np.testing.assert_allclose(got[numbers[middle]] - AMBIENT, expected, rtol=0.08)
    near = got[texels(facets, parts["floor"])[1]][:, 0]
    x = texels(facets, parts["floor"])[0][:, 0]
    assert near[(x > 0.5) & (x < 1.5)].mean() > 2 * near[x > 4].mean()
    assert (got[texels(facets, pane)[1]] == 0).all()  # what shines is not lit


def cosine_rays(n: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, 3) directions about n, as many as the light of each counts."""
    rays = rng.normal(size=(count, 3))
    rays = rays / np.linalg.norm(rays, axis=1, keepdims=True) + n
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def test_the_share_of_a_pane_by_rays(rng: np.random.Generator) -> None:
    """Places at random, from a centimetre before the pane on, turned at random: as many rays meet it as it says."""
    room, _, pane = window_room()
    facets = room.facets()
    g = int(np.flatnonzero(facets.instance == pane)[0])
    world = make_world(facets).rays
    seen = 0
    for distance in (0.01, 0.03, 0.1, 0.3, 1.0, 3.0):
        for _ in range(4):
            p = np.array([distance, *rng.uniform((1.3, 0.8), (2.7, 2.2))]) - facets.origin
            n = rng.normal(size=3)
            n /= np.linalg.norm(n)
            rays = cosine_rays(n, 20_000, rng)
            with np.errstate(divide="ignore", over="ignore"):
                t = -distance / rays[:, 0]
            hit = p + facets.origin + t[:, None] * rays
            inside = (t > 0) & (np.abs(hit[:, 1] - 2.0) < 0.6) & (np.abs(hit[:, 2] - 1.5) < 0.6)
            got = seen_share(world, g, p, n)
            assert got == pytest.approx(inside.mean(), abs=0.015)  # four times the scatter of 20 000 rays
            seen += got > 0.05
    assert seen > 8


@pytest.mark.parametrize("gap", [0.0, 0.03])
def test_bars_of_a_window_are_lit_from_their_sides(gap: float) -> None:
    """A strip 3 cm wide at right angles to a pane sees 30 cm of it, or as much as lies before the next strip."""
    room, _, _ = window_room()
    bar = room.sheet((0.001, 1.7, 0.9), (0.03, 0, 0), (0, 0, 1.2), WINDOW)
    if gap:
        room.sheet((0.001, 1.7 - gap, 0.9), (0, 0, 1.2), (0.03, 0, 0), WINDOW)
    facets = room.facets()
    np.testing.assert_allclose(turned(facets, bar), (0, -1, 0), atol=1e-6)
    got = bake(facets, [], None, 0.0)[texels(facets, bar)[1]][:, 0].mean() / DAYLIGHT[0]
    wide, high = gap or 0.3, 0.016
    expected = (1 - high / math.hypot(high, wide)) / 2  # of a pane without end
    # At the ends it is half of that, and they count for much in a lattice of three points.
    assert 0.65 * expected < got < 1.1 * expected


def test_light_comes_back_in_the_colour_of_walls() -> None:
    room = Room()
    parts = room.box(0, 0, 4, 4)
    facets = room.facets()
    lamp = [Lamp(2, 2, 2.1, WHITE)]
    sent = np.full((len(facets.plane), 3), 0.6)
    sent[facets.instance == parts["w"]] = (0.8, 0.1, 0.1)
    light = bake(facets, lamp, None, sent)
    places, numbers = texels(facets, parts["floor"])
    hue = light[numbers, 0] / light[numbers, 2]
    assert hue[places[:, 0] < 0.5].mean() > 1.05 * hue[places[:, 0] > 3.5].mean() > 1.05
    black, grey, white = (bake(facets, lamp, None, a).mean() for a in (0.0, 0.5, 0.8))
    assert 1.3 * black < grey and 1.2 * grey < white


def test_pieces_of_a_floor_show_no_joint() -> None:
    """A floor of two instances: just beside the joint both have the same light, to 2 percent."""
    whole, split = Room(), Room()
    floor = whole.box(0, 0, 4, 4)["floor"]
    halves = [split.sheet((x, 0, 0), (w, 0, 0), (0, 4, 0), FLOOR) for x, w in ((0, 1.7), (1.7, 2.3))]
    split.sheet((0, 4, HEIGHT), (4, 0, 0), (0, -4, 0), CEILING)
    for o, r in (((0, 0, 0), (0, 4, 0)), ((4, 4, 0), (0, -4, 0)), ((4, 0, 0), (-4, 0, 0)), ((0, 4, 0), (4, 0, 0))):
        split.sheet(o, r, (0, 0, HEIGHT), WALL)
    facets = split.facets()
    light = bake(facets, [Lamp(1, 1, 2.1, WHITE)], None, 0.7)
    edge = []
    for instance in halves:
        places, numbers = texels(facets, instance)
        at = np.abs(places[:, 0] - 1.7) < 1e-4
        edge.append(light[numbers[at]][np.argsort(places[at, 1])])
    assert len(edge[0]) == len(edge[1]) > 10
    # The lamp's own light is taken 3 cm to each side of the joint.
    np.testing.assert_allclose(edge[0], edge[1], rtol=0.03)
    one = whole.facets()
    assert bake(one, [Lamp(1, 1, 2.1, WHITE)], None, 0.7)[texels(one, floor)[1]].mean() == pytest.approx(
        np.concatenate([light[texels(facets, h)[1]] for h in halves]).mean(), rel=0.05
    )


def test_a_floor_that_runs_through_a_door() -> None:
    """Soft light of one floor is not mixed across the wall that stands on it."""
    room = Room()
    floor = room.box(0, 0, 8, 4)["floor"]
    room.sheet((4, 0, 0), (0, 3, 0), (0, 0, HEIGHT), WALL, both=True)
    facets = room.facets()
    light = bake(facets, [Lamp(2, 1, 2.1, WHITE)], None, 0.5)[:, 0]
    places, numbers = texels(facets, floor)
    beside = (places[:, 1] < 2.0) & (np.abs(places[:, 0] - 4.0) < 0.35)
    bright, dark = (light[numbers[beside & side]] for side in (places[:, 0] < 4.0, places[:, 0] > 4.0))
    assert len(bright) > 5 and len(dark) > 5
    assert dark.max() < 0.4 * bright.min()


def test_a_frame_behind_its_picture() -> None:
    """All of the frame's texels are covered, but its edge shows: it is as bright as the picture, to 10 percent."""
    room = Room()
    room.box(0, 0, 4, 4)
    frame = room.sheet((0.005, 1.5, 1.2), (0, 0.6, 0), (0, 0, 0.4))
    picture = room.sheet((0.010, 1.515, 1.215), (0, 0.57, 0), (0, 0, 0.37))
    facets = room.facets()
    light = bake(facets, [Lamp(2, 2, 2.1, WHITE)], None, 0.6)
    around, within = (light[texels(facets, instance)[1]].mean() for instance in (frame, picture))
    assert around == pytest.approx(within, rel=0.1)


def test_the_foot_of_a_body_is_no_black_spot() -> None:
    """A texel inside a table leg takes the light of those around it."""
    room = Room()
    floor = room.box(0, 0, 4, 4)["floor"]
    room.body((1.46, 1.46, 0.0), (1.54, 1.54, 0.7))
    facets = room.facets()
    light = bake(facets, [Lamp(2, 2, 2.1, WHITE)], None, 0.6)[:, 0]
    places, numbers = texels(facets, floor)
    near = np.linalg.norm(places[:, :2] - 1.5, axis=1) < 0.35
    assert light[numbers[near]].min() > 0.35 * light[numbers].max()


def test_what_stands_on_a_floor_darkens_it() -> None:
    """On the side of a cupboard that the lamp shines on: a little beside it, not at all from half a metre on."""
    light = []
    for stands in (False, True):
        room = Room()
        floor = room.box(0, 0, 4, 4)["floor"]
        if stands:
            room.body((0.0, 1.0, 0.0), (0.5, 3.0, 2.0))
        facets = room.facets()
        places, numbers = texels(facets, floor)
        light.append(bake(facets, [Lamp(3, 2, 2.2, WHITE)], None, 0.0)[numbers][:, 0] - AMBIENT)
    before = np.abs(places[:, 1] - 2.0) < 0.7
    near, far = (before & (np.abs(places[:, 0] - x) < 0.09) for x in (0.6, 1.2))
    assert near.sum() > 4 and far.sum() > 4
    ratio = light[1] / light[0]
    assert 0.6 < ratio[near].min() and ratio[near].max() < 0.95
    np.testing.assert_allclose(ratio[far], 1.0, atol=0.02)  # rays look for what is near, and dim the light everywhere
