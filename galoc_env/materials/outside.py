"""The outdoors as a photograph through a window shows it, out of focus: garden, street, or view over trees."""

from __future__ import annotations

import numpy as np

from galoc_env.materials.noise import SIZE, Canvas, Field, blend, paint, ramp

_TAU = 2 * np.pi


def outdoors(c: Canvas) -> Field:
    """Sky above trees and lawn, above houses across a street, or above a far edge of trees. Row 0 is the top.

    3 m high: from the floor to above a window; the horizon is at the height of eyes.
    """
    kind, up = int(c.rng.integers(4)), 1.0 - c.y
    image, dull = _sky(c)
    horizon = c.uniform(0.40, 0.50)
    if kind < 2:
        image = _trees(c, image, horizon + c.uniform(0.02, 0.1), 0.5 + 0.3 * dull, 0.03)
        image = _lawn(c, image, up, horizon - c.uniform(0.0, 0.06))
        image = _trees(c, image, c.uniform(0.25, 0.52), 0.0, c.uniform(0.05, 0.12))
    elif kind == 2:
        image = _houses(c, image, up, horizon)
        image = _trees(c, image, c.uniform(0.15, 0.36), 0.1, 0.06)
    else:
        image = _trees(c, image, horizon + c.uniform(-0.06, 0.02), 0.75, 0.02)
        image = _trees(c, image, horizon - c.uniform(0.06, 0.16), 0.2, 0.06)
    return _blurred(image)


def _sky(c: Canvas) -> tuple[Field, float]:
    """Blue with clouds, paler towards the horizon, or overcast; and how dull it is, 0 or 1."""
    high = np.clip((1.0 - c.y - 0.35) / 0.65, 0.0, 1.0)[..., None]
    dull = float(c.rng.uniform() < 0.4)
    zenith, low = ((150, 178, 214), (226, 233, 240)) if not dull else ((214, 219, 226), (232, 233, 234))
    image = np.asarray(low + high * (np.array(zenith, np.float32) - low), np.float32)
    cloud = 0.8 * c.noise("cloud") + 0.25 * c.noise("soft")
    if dull:
        return np.asarray(image + (7.0 * cloud)[..., None], np.float32), dull
    share = c.uniform(0.2, 0.9) * ramp(cloud - c.uniform(-0.4, 0.8), 0.9)
    return blend(image, paint((246, 247, 249), 5.0 * c.noise("soft")), share), dull


def _trees(c: Canvas, image: Field, top: float, haze: float, rough: float) -> Field:
    """A belt of foliage up to about ``top``, lit from above, with gaps at its edge; ``haze`` fades it, 0 to 1."""
    crowns = np.abs(np.sin(_TAU * (int(c.rng.integers(2, 5)) * c.x + c.uniform(0, 1)) / 2))
    line = top + rough * (1.2 * crowns + 0.5 * c.noise("cloud")[:1] + 0.25 * c.noise("soft")) - 0.6 * rough
    depth = line - (1.0 - c.y)
    clumps = 0.6 * c.noise("soft") + 0.5 * c.noise("mid") + 0.3 * c.noise("fine")
    light = 0.75 + 0.5 * np.exp(-np.maximum(depth, 0.0) / 0.05) + 0.28 * np.tanh(clumps)
    green = c.pick((88, 112, 62), (74, 98, 58), (104, 116, 66), (116, 110, 74))
    leaf = light[..., None] * green
    leaf = blend(leaf, (196, 208, 220), np.full((SIZE, SIZE), haze))
    return blend(image, leaf, ramp(depth - 0.012 * c.noise("mid") * (depth < 0.05), 0.012))


def _lawn(c: Canvas, image: Field, up: Field, edge: float) -> Field:
    """Grass up to ``edge``, paler far away, with shadows across."""
    tone = 18.0 * ramp(up - edge + 0.2, 0.2) + 9.0 * c.noise("fine") + 9.0 * c.noise("soft")
    return blend(image, paint(c.pick((118, 138, 76), (132, 142, 88)), tone, (0.9, 1.0, 0.6)), ramp(edge - up, 0.015))


def _houses(c: Canvas, image: Field, up: Field, horizon: float) -> Field:
    """Fronts in plaster or brick below roofs, with dark windows in pale frames, behind a street and a pavement."""
    count = int(c.rng.integers(2, 4))
    house, within = c.steps(count)
    base = np.array([c.pick((196, 188, 174), (168, 112, 90), (206, 204, 198), (184, 172, 140)) for _ in range(count)])
    eaves = (horizon + c.rng.uniform(0.18, 0.5, count))[house]
    roof = np.array([c.pick((124, 84, 70), (96, 94, 98)) for _ in range(count)])[house]
    peak = eaves + 0.12 * np.minimum(1.0, 4.0 * np.minimum(within, 1 - within))
    image = blend(
        image, np.broadcast_to(roof, (SIZE, SIZE, 3)) + (6 * c.noise("fine"))[..., None], ramp(peak - up, 0.01)
    )
    front = base[house] + (7.0 * c.noise("soft") + 4.0 * c.noise("fine"))[..., None]
    front *= np.where(np.minimum(within, 1 - within) < 0.015, 0.7, 1.0)[None, :, None]
    columns, rows = int(c.rng.integers(2, 5)), c.uniform(4.5, 6.5)
    across, level = np.abs((within * columns) % 1.0 - 0.5), np.abs(((up - horizon) * rows) % 1.0 - 0.5)
    frame, hole = (across < 0.27) & (level < 0.33), (across < 0.22) & (level < 0.28)
    front = np.where(frame[..., None], np.float32(214.0), front)
    pane = paint((78, 88, 98), 16.0 * c.noise("soft") + 30.0 * ramp(up - horizon, 0.4))
    bar = (across < 0.02) & hole
    front = np.where((hole & ~bar)[..., None], pane, front)
    image = blend(image, front, ramp(eaves - up, 0.006))
    street = paint((136, 136, 138), 30.0 * ramp(0.2 - np.abs(up - horizon + 0.2), 0.2) + 5.0 * c.noise("fine"))
    return blend(image, street, ramp(horizon - 0.06 - up, 0.008))


def _blurred(image: Field) -> Field:
    """As a lens shows it that looks at the room: a small blur, over the left and right edge too."""
    for step in (1, 2):
        image = 0.5 * image + 0.25 * (np.roll(image, step, 1) + np.roll(image, -step, 1))
    for step in (1, 2):
        padded = np.pad(image, ((step, step), (0, 0), (0, 0)), mode="edge")
        image = 0.5 * image + 0.25 * (padded[: -2 * step] + padded[2 * step :])
    return np.asarray(image, np.float32)
