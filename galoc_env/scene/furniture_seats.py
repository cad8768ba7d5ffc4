"""Sofas, armchairs and chairs."""

from __future__ import annotations

import math

import numpy as np

from galoc_env.furniture import Furniture
from galoc_env.scene.furniture_palette import BLACK, GREY, Look, Skin, skin
from galoc_env.scene.solids import SolidPainter


def legs(paint: SolidPainter, made: Skin, half: tuple[float, float], top: float, thick: float) -> None:
    """Four square legs inside a rectangle (half length, half width), a little thinner at the floor."""
    a, b = half
    for x in (-a, a - thick):
        for y in (-b, b - thick):
            slim = 0.2 * thick
            paint.frustum(
                made[0], (x, y, 0), (x + thick, y + thick, top), (0, 0), 0.85 * made[1], hide="Z", foot=(slim, slim)
            )


def sofa(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """Sofa or armchair: base, arms, seat cushions, leaning back cushions, now and then loose ones."""
    cloth, feet = look.cloth(), look.timber()
    arm, rise, soft = look.between(0.12, 0.2), look.between(0.54, 0.64), look.between(0.03, 0.06)
    back, low = look.between(0.16, 0.2), look.between(0.07, 0.14)
    slim = look.chance(0.3)
    a, b = item.length / 2, item.width / 2
    legs(paint, feet, (a - 0.05, b - 0.05), low, 0.045)
    open_left, open_right = item.detail == "left", item.detail == "right"
    left, right = b - (0.01 if open_left else arm), -b + (0.01 if open_right else arm)
    paint.box(cloth[0], (-a + 0.02, -b + 0.01, low), (a - 0.04, b - 0.01, 0.27), 0.86 * cloth[1], hide="Z")
    paint.cushion(cloth[0], (-a, right, 0.27), (-a + back, left, item.height - 0.08), soft, 0.96 * cloth[1])
    tall = 0.36 if slim else rise
    if not open_right:
        paint.cushion(cloth[0], (-a, -b, low + 0.02), (a - 0.02, -b + arm, tall), soft, cloth[1])
    if not open_left:
        paint.cushion(cloth[0], (-a, b - arm, low + 0.02), (a - 0.02, b, tall), soft, cloth[1])
    _cushions(paint, item, look, cloth, (right, left, -a + back, a))


def _cushions(
    paint: SolidPainter, item: Furniture, look: Look, cloth: Skin, inside: tuple[float, float, float, float]
) -> None:
    """Seats side by side between y0 and y1, from the back at x0 to the front at x1."""
    y0, y1, x0, x1 = inside
    seats = max(1, round((y1 - y0) / look.between(0.6, 0.95)))
    each = (y1 - y0) / seats
    rise = item.height - 0.02 - 0.43
    for k in range(seats):
        y = y0 + k * each
        paint.cushion(cloth[0], (x0, y + 0.005, 0.27), (x1, y + each - 0.005, 0.45), 0.045, 0.98 * cloth[1])
        leaning = paint.at((x0 + 0.09, 0, 0.44), tilt=0.22)
        leaning.cushion(cloth[0], (-0.06, y + 0.015, 0.0), (0.08, y + each - 0.015, rise), 0.06, 0.94 * cloth[1])
    for k in range(int(look.rng.integers(0, 3)) if item.kind != "armchair" else int(look.chance(0.3))):
        other = look.cloth()
        y = (y1 - 0.24) if k == 0 else (y0 + 0.24)
        loose = paint.at((x0 + 0.26, y, 0.45), tilt=look.between(0.3, 0.5), turn=look.between(-0.25, 0.25))
        pillow(loose, other, (0.4, 0.4), 0.13)


def pillow(paint: SolidPainter, made: Skin, size: tuple[float, float], thick: float) -> None:
    """An upright pillow, its middle at x = y = 0, standing on z = 0: width, height, thickness, m."""
    w, h = size[0] / 2, size[1]
    rim = [(-w, 0.0), (-0.5 * w, 0.03), (0.5 * w, 0.03), (w, 0.0)]
    rim += [(w, h), (0.5 * w, h - 0.03), (-0.5 * w, h - 0.03), (-w, h)]
    core = [(x * w, z * h) for x, z in ((-0.6, 0.25), (-0.3, 0.18), (0.3, 0.18), (0.6, 0.25))]
    core += [(x, h - z) for x, z in core[::-1]]
    rings = [np.column_stack([np.full(8, x), flat]) for x, flat in ((-thick / 2, core), (0.0, rim), (thick / 2, core))]
    paint.loft(made[0], rings, made[1], low=True)


def chaise(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """The long end of a corner sofa; its sofa is on its left or right."""
    cloth, feet = look.cloth(), look.timber()
    arm, rise, soft = look.between(0.12, 0.2), look.between(0.54, 0.64), look.between(0.03, 0.06)
    back, low = look.between(0.16, 0.2), look.between(0.07, 0.14)
    a, b = item.length / 2, item.width / 2
    legs(paint, feet, (a - 0.05, b - 0.05), low, 0.045)
    right, left = -b, b
    if item.detail == "left":
        right += arm
        paint.cushion(cloth[0], (-a, -b, low + 0.02), (0.1 * a, right, rise), soft, cloth[1])
    else:
        left -= arm
        paint.cushion(cloth[0], (-a, left, low + 0.02), (0.1 * a, b, rise), soft, cloth[1])
    inset = np.array([0.01, 0.0] if item.detail == "left" else [0.0, 0.01])
    paint.box(cloth[0], (-a + 0.02, inset[0] - b, low), (a - 0.04, b - inset[1], 0.27), 0.86 * cloth[1], hide="Z")
    paint.cushion(cloth[0], (-a, right, 0.27), (-a + back, left, item.height - 0.08), soft, 0.96 * cloth[1])
    y0, y1 = right + 0.005, left - 0.005
    paint.cushion(cloth[0], (-a + back, y0, 0.27), (a, y1, 0.45), 0.045, 0.98 * cloth[1])
    leaning = paint.at((-a + back + 0.09, 0, 0.44), tilt=0.22)
    leaning.cushion(cloth[0], (-0.06, y0, 0.0), (0.08, y1, item.height - 0.45), 0.06, 0.94 * cloth[1])


def pouf(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """A round or square footstool."""
    cloth = look.cloth()
    r, top = min(item.length, item.width) / 2, item.height
    if look.chance(0.5):
        profile = ((0.8 * r, 0), (r, 0.3 * top), (r, 0.75 * top), (0.8 * r, top))
        paint.lathe(cloth[0], (0, 0), profile, cloth[1], sides=12)
    else:
        legs(paint, look.timber(), (r - 0.03, r - 0.03), 0.1, 0.04)
        paint.cushion(cloth[0], (-r, -r, 0.1), (r, r, top), 0.04, cloth[1], both=True)


def chair(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """One of four designs; all of a table are alike."""
    design = int(look.rng.integers(4))
    (_wooden_chair, _shell_chair, _padded_chair, _slat_chair)[design](paint, item, look)


def _wooden_chair(paint: SolidPainter, item: Furniture, look: Look) -> None:
    made = look.front(0.1, 0.15)
    a, b, seat = item.length / 2, item.width / 2, 0.46
    legs(paint, made, (a - 0.01, b - 0.01), seat - 0.03, 0.04)
    top = look.cloth() if look.chance(0.5) else made
    paint.cushion(top[0], (-a + 0.02, 0.004 - b, seat - 0.03), (a, b - 0.004, seat + 0.01), 0.015, top[1], both=True)
    back = paint.at((-a + 0.055, 0, seat), tilt=0.06)
    high = item.height - seat
    back.box(made[0], [(-0.03, -b, -0.03), (-0.03, b - 0.035, -0.03)], [(0, -b + 0.035, high), (0, b, high)], made[1])
    for z in (0.45 * high, 0.8 * high):
        back.box(made[0], (-0.025, -b + 0.035, z), (-0.005, b - 0.035, z + 0.2 * high), made[1], hide="yY")


def _slat_chair(paint: SolidPainter, item: Furniture, look: Look) -> None:
    made = look.timber()
    a, b, seat = item.length / 2, item.width / 2, 0.45
    for x, y in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        paint.tube(
            made[0],
            (x * (a - 0.02), y * (b - 0.02), 0),
            (x * (a - 0.07), y * (b - 0.07), seat),
            (0.014, 0.02),
            made[1],
            ends=False,
        )
    outline = [
        (-a + 0.02, -0.75 * b),
        (a - 0.05, -b),
        (a, -0.8 * b),
        (a, 0.8 * b),
        (a - 0.05, b),
        (-a + 0.02, 0.75 * b),
    ]
    paint.extrusion(made[0], outline, (seat - 0.02, seat + 0.02), made[1])
    back = paint.at((-a + 0.08, 0, seat), tilt=0.14)
    high = (item.height - seat) / math.cos(0.14)
    for y in np.linspace(-0.7 * b, 0.7 * b, 5):
        back.tube(made[0], (0, y, 0), (0, 1.15 * y, high - 0.07), (0.009, 0.009), made[1], sides=4, ends=False)
    back.box(made[0], (-0.012, -0.85 * b, high - 0.08), (0.012, 0.85 * b, high - 0.01), made[1])


def _shell_chair(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """A plastic shell on splayed legs."""
    shell, feet = look.front(0.2, 0.4), look.timber() if look.chance(0.6) else look.metal()
    a, b, seat = item.length / 2, item.width / 2, 0.45
    for x, y in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        paint.tube(
            feet[0],
            (x * (a - 0.02), y * (b - 0.02), 0),
            (0.45 * x * a, 0.5 * y * b, seat - 0.02),
            (0.011, 0.017),
            feet[1],
            ends=False,
        )
    paint.cushion(shell[0], (-0.75 * a, -0.95 * b, seat - 0.03), (a, 0.95 * b, seat + 0.01), 0.018, shell[1], both=True)
    back = paint.at((-0.75 * a, 0, seat - 0.01), tilt=0.12)
    w, h = 0.95 * b, (item.height - seat) / math.cos(0.12)
    face = [(0.0, -w, 0), (0.0, w, 0), (0.0, w, 0.6 * h), (0.0, 0.6 * w, h), (0.0, -0.6 * w, h), (0.0, -w, 0.6 * h)]
    back.loft(shell[0], [np.array(face) - (0.012, 0, 0), np.array(face) + (0.012, 0, 0)], shell[1], low=True)


def _padded_chair(paint: SolidPainter, item: Furniture, look: Look) -> None:
    cloth, feet = look.cloth(), look.metal() if look.chance(0.5) else look.timber()
    a, b, seat = item.length / 2, item.width / 2, 0.47
    legs(paint, feet, (a - 0.02, b - 0.02), seat - 0.09, 0.03)
    paint.cushion(cloth[0], (-a + 0.03, -b, seat - 0.1), (a, b, seat), 0.03, cloth[1], both=True)
    back = paint.at((-a + 0.09, 0, seat - 0.08), tilt=0.1)
    back.cushion(cloth[0], (-0.05, -b + 0.01, 0), (0.02, b - 0.01, item.height - seat + 0.06), 0.03, 0.97 * cloth[1])


def office_chair(paint: SolidPainter, item: Furniture, look: Look) -> None:
    """Five spokes on castors, a column, seat, back and often arms."""
    cloth = skin("fabric", look.between(0.2, 0.45)) if look.chance(0.6) else look.cloth()
    frame = ("lacquer", BLACK + look.between(0.0, 0.1)) if look.chance(0.7) else ("lacquer", np.full(3, 0.9))
    a, b, seat = item.length / 2, item.width / 2, 0.47
    r = min(a, b) - 0.03
    for k in range(5):
        c, s = math.cos(1.2566 * k), math.sin(1.2566 * k)
        paint.tube(frame[0], (0, 0, 0.1), (r * c, r * s, 0.07), (0.03, 0.018), frame[1], sides=4)
        x, y = (r - 0.015) * c, (r - 0.015) * s
        paint.box("lacquer", (x - 0.025, y - 0.025, 0), (x + 0.025, y + 0.025, 0.055), BLACK, hide="Z")
    paint.tube(frame[0], (0, 0, 0.1), (0, 0, seat - 0.06), (0.035, 0.025), GREY, sides=6, ends=False)
    paint.cushion(
        cloth[0], (-a + 0.08, -0.9 * b, seat - 0.07), (a - 0.02, 0.9 * b, seat + 0.02), 0.035, cloth[1], both=True
    )
    high = item.height - seat
    back = paint.at((-a + 0.1, 0, seat), tilt=0.08)
    back.box(frame[0], (-0.035, -0.035, -0.04), (-0.012, 0.035, 0.3 * high), frame[1])
    back.cushion(cloth[0], (-0.02, -0.8 * b, 0.15 * high), (0.05, 0.8 * b, high), 0.035, cloth[1], both=True)
    if look.chance(0.6):
        for y in (-b, b - 0.05):
            paint.box(frame[0], (-0.12, y, seat + 0.2), (0.15, y + 0.05, seat + 0.23), frame[1])
            paint.box(frame[0], (-0.03, y + 0.01, seat - 0.05), (0.02, y + 0.04, seat + 0.2), frame[1], hide="zZ")
