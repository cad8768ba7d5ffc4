"""Regenerate the shipped floorplans: `python assets/make_plans.py` rewrites assets/plans/*.json.

Every plan is drawn by hand below, in metres: rooms meet at wall centrelines, doors and windows are given by their
centres. Entrance doors are shut, so they are wall to a camera and not drawn as openings.
"""

from __future__ import annotations

import math
from pathlib import Path

from galoc import Floorplan
from galoc_env.wall_builder import Shell, door, rectangle, window

PLANS = Path(__file__).resolve().parent / "plans"


def apartment() -> Floorplan:
    """Seven rooms on 75 m2, no two alike."""
    rooms = [
        [(0.0, 0.0), (5.2, 0.0), (5.2, 3.3), (4.2, 3.3), (4.2, 4.3), (0.0, 4.3)],  # living room
        rectangle(0.0, 4.3, 3.3, 7.4),  # kitchen
        [(3.3, 4.3), (4.2, 4.3), (4.2, 3.3), (8.1, 3.3), (8.1, 4.6), (5.3, 4.6), (5.3, 7.4), (3.3, 7.4)],  # hall
        rectangle(5.2, 0.0, 8.1, 3.3),  # small bedroom
        rectangle(8.1, 0.0, 11.2, 4.6),  # bedroom
        rectangle(5.3, 4.6, 7.0, 7.4),  # bath
        rectangle(7.0, 4.6, 11.2, 7.4),  # study
    ]
    solids = [rectangle(2.7, 6.8, 3.3, 7.4), rectangle(10.5, 3.8, 11.2, 4.6), rectangle(0.0, 0.9, 0.45, 1.5)]
    holes = [
        door(4.2, 3.8, 0.85),
        door(1.9, 4.3, 1.6),
        door(3.3, 5.6, 0.8),
        door(6.4, 3.3, 0.8),
        door(8.1, 3.95, 0.9),
        door(6.1, 4.6, 0.8),
        door(7.55, 4.6, 0.8),
        window(2.6, 0.0, 2.4, 0.5, 2.2),
        window(0.0, 2.8, 1.5, 0.8, 2.2),
        window(0.0, 5.8, 1.2, 1.05, 2.1),
        window(6.6, 0.0, 1.4, 0.9, 2.1),
        window(11.2, 2.2, 1.8, 0.7, 2.2),
        window(9.2, 7.4, 1.6, 0.9, 2.1),
        window(6.15, 7.4, 0.6, 1.4, 2.1),
    ]
    return Shell.from_rooms(rooms, 0.12, 0.2, solids).build(holes, 2.55, "apartment", "Three-room apartment.")


def house() -> Floorplan:
    """One-storey house, L-shaped, with a bay window."""
    bay = [(0.0, 4.0), (-0.9, 3.4), (-0.9, 1.8), (0.0, 1.2)]
    rooms = [
        [(0.0, 0.0), (7.0, 0.0), (7.0, 5.2), (0.0, 5.2), *bay],  # living room
        rectangle(0.0, 5.2, 5.0, 9.6),  # kitchen
        [(5.0, 5.2), (7.0, 5.2), (7.0, 3.6), (14.5, 3.6), (14.5, 5.2), (9.0, 5.2), (9.0, 9.6), (5.0, 9.6)],  # hall
        rectangle(7.0, 0.0, 11.2, 3.6),  # bedrooms
        rectangle(11.2, 0.0, 14.5, 3.6),
        rectangle(9.0, 5.2, 11.4, 8.0),  # bath
        rectangle(11.4, 5.2, 14.5, 8.0),  # utility room
        rectangle(14.5, 0.0, 20.0, 4.6),  # main bedroom
        rectangle(14.5, 4.6, 20.0, 8.0),  # studio
        rectangle(5.4, 9.6, 9.0, 11.8),  # shower room
        rectangle(5.4, 11.8, 9.0, 15.0),  # study
        rectangle(0.0, 9.6, 5.4, 15.0),  # family room
    ]
    solids = [
        rectangle(6.4, 2.0, 7.0, 3.2),  # chimney
        rectangle(19.3, 7.3, 20.0, 8.0),
        rectangle(0.0, 14.4, 1.3, 15.0),
        rectangle(2.3, 7.2, 2.65, 7.55),  # pillar
    ]
    holes = [
        door(6.0, 5.2, 1.5, 2.2),
        door(5.0, 7.9, 0.9),
        door(8.2, 3.6, 0.85),
        door(12.9, 3.6, 0.85),
        door(10.3, 5.2, 0.8),
        door(12.4, 5.2, 0.8),
        door(14.5, 4.1, 0.8),
        door(16.0, 4.6, 0.9),
        door(7.9, 9.6, 0.8),
        door(5.4, 13.4, 0.9),
        door(2.6, 9.6, 1.8, 2.2),
        window(-0.9, 2.6, 1.2, 0.5, 2.2),
        window(3.4, 0.0, 2.8, 0.4, 2.2),
        window(0.0, 7.4, 1.6, 1.05, 2.1),
        window(9.2, 0.0, 1.6, 0.9, 2.1),
        window(12.8, 0.0, 1.4, 0.9, 2.1),
        window(17.4, 0.0, 2.0, 0.7, 2.2),
        window(20.0, 2.6, 1.4, 0.9, 2.1),
        window(20.0, 6.0, 1.8, 0.9, 2.1),
        window(10.2, 8.0, 0.6, 1.4, 2.1),
        window(13.2, 8.0, 0.9, 1.2, 2.1),
        window(9.0, 13.5, 1.6, 0.9, 2.1),
        window(3.2, 15.0, 2.2, 0.5, 2.2),
        window(0.0, 12.0, 1.8, 0.8, 2.1),
    ]
    return Shell.from_rooms(rooms, 0.12, 0.2, solids).build(holes, 2.7, "house", "L-shaped one-storey house.")


def office() -> Floorplan:
    """Open-plan area, corridor, cellular offices and a conference wing."""
    cuts = [0.0, 3.6, 7.2, 11.4, 14.4, 19.0]
    lounge = [(16.0, 5.5), (22.5, 5.5), (22.5, 4.8), (26.0, 4.8), (26.0, 9.0), (16.0, 9.0)]
    rooms = [
        rectangle(0.0, 0.0, 16.0, 9.0),  # open plan
        rectangle(0.0, 9.0, 30.0, 11.0),  # corridor
        rectangle(16.0, 0.0, 22.5, 5.5),  # meeting room
        rectangle(22.5, 0.0, 26.0, 4.8),
        rectangle(26.0, 0.0, 30.0, 4.8),
        rectangle(26.0, 4.8, 30.0, 9.0),
        lounge,
        *(rectangle(a, 11.0, b, 16.0) for a, b in zip(cuts, cuts[1:], strict=False)),
        rectangle(19.0, 11.0, 21.2, 20.0),  # side corridor
        rectangle(21.2, 11.0, 24.6, 14.6),
        rectangle(24.6, 11.0, 30.0, 15.2),
        [(21.2, 14.6), (24.6, 14.6), (24.6, 15.2), (30.0, 15.2), (30.0, 20.0), (21.2, 20.0)],  # conference
    ]
    pillars = [rectangle(x - 0.2, y - 0.2, x + 0.2, y + 0.2) for x, y in ((4.0, 4.5), (8.0, 4.5), (12.0, 4.5))]
    solids = [
        *pillars,
        rectangle(0.0, 0.0, 1.1, 0.7),
        rectangle(15.2, 3.0, 16.0, 4.2),
        rectangle(26.6, 19.2, 28.4, 20.0),
    ]
    holes = [
        door(3.0, 9.0, 1.8, 2.4),
        door(11.5, 9.0, 2.2, 2.4),
        door(20.5, 9.0, 2.4, 2.4),
        door(18.0, 5.5, 0.9),
        door(24.9, 4.8, 0.9),
        door(26.0, 7.2, 0.9),
        door(28.8, 4.8, 0.9),
        *(door(x, 11.0, 0.9) for x in (0.8, 6.4, 8.2, 13.5, 15.4)),
        door(20.1, 11.0, 1.6, 2.4),
        door(22.2, 11.0, 0.9),
        door(26.2, 11.0, 0.9),
        door(21.2, 17.6, 1.4, 2.2),
        *(window(x, 0.0, 2.4, 0.8, 2.4) for x in (3.0, 6.4, 9.8, 13.2, 19.2, 24.2, 28.0)),
        *(window(x, 16.0, 1.8, 0.8, 2.4) for x in (1.8, 5.4, 9.3, 12.9, 16.7)),
        *(window(0.0, y, 2.2, 0.8, 2.4) for y in (3.2, 6.6)),
        *(window(30.0, y, 1.8, 0.8, 2.4) for y in (2.4, 7.0, 13.2, 17.6)),
        window(24.0, 20.0, 2.4, 0.8, 2.4),
        window(20.1, 20.0, 1.4, 0.5, 2.4),
    ]
    return Shell.from_rooms(rooms, 0.12, 0.2, solids).build(holes, 2.9, "office", "Office floor.")


def corridor() -> Floorplan:
    """Double-loaded corridor; rooms of different widths, a niche and a lounge break its symmetry."""
    south = [0.0, 4.2, 9.6, 12.6, 18.4, 22.0, 29.5, 33.2, 36.4, 42.8, 46.0, 50.0]
    north = [0.0, 6.1, 9.4, 14.8, 17.6, 25.2, 28.6, 31.9, 38.0, 43.5, 50.0]
    lounge = [(33.2, 5.4), (33.2, 2.2), (36.4, 2.2), (36.4, 5.4)]
    niche = [(17.6, 7.4), (17.6, 9.0), (14.8, 9.0), (14.8, 7.4)]
    rooms = [
        [(0.0, 5.4), *lounge, (50.0, 5.4), (50.0, 7.4), *niche, (0.0, 7.4)],
        *(rectangle(a, 2.2 if a == 33.2 else 5.4, b, 0.0) for a, b in zip(south, south[1:], strict=False)),
        *(rectangle(a, 9.0 if a == 14.8 else 7.4, b, 13.0) for a, b in zip(north, north[1:], strict=False)),
    ]
    solids = [
        rectangle(7.0, 5.4, 7.9, 5.75),  # pilasters and shafts in the corridor
        rectangle(26.1, 7.05, 27.3, 7.4),
        rectangle(40.0, 5.4, 40.6, 5.7),
        rectangle(9.6, 0.0, 10.3, 0.9),
        rectangle(24.3, 12.2, 25.2, 13.0),
        rectangle(48.4, 12.3, 50.0, 13.0),
    ]
    holes = [
        *(door(x, 5.4, 0.9) for x in (1.0, 5.2, 11.5, 13.6, 20.9, 23.0, 30.6, 38.4, 45.1, 49.0)),
        door(34.2, 2.2, 0.8),
        *(door(x, 7.4, 0.9) for x in (4.9, 7.4, 10.6, 18.9, 29.6, 33.0, 36.6, 40.9, 44.6)),
        door(28.0, 7.4, 0.8),
        door(16.9, 9.0, 0.8),
        *(window((a + b) / 2, 0.0, min(2.4, 0.5 * (b - a)), 0.9, 2.2) for a, b in zip(south, south[1:], strict=False)),
        *(window((a + b) / 2, 13.0, min(2.4, 0.5 * (b - a)), 0.9, 2.2) for a, b in zip(north, north[1:], strict=False)),
        window(50.0, 6.4, 1.2, 0.4, 2.3),
    ]
    return Shell.from_rooms(rooms, 0.12, 0.2, solids).build(holes, 2.6, "corridor", "Double-loaded corridor.")


def _polar(degrees: float, radius: float, x: float = 0.0, y: float = 0.0) -> tuple[float, float]:
    return x + radius * math.cos(math.radians(degrees)), y + radius * math.sin(math.radians(degrees))


def gallery() -> Floorplan:
    """Museum: a rotunda within galleries of oblique walls, with a curved apse and free-standing walls."""
    cuts = [0, 60, 105, 165, 225, 300, 360]
    apse = [_polar(a, 3.4, 1.4, -10.4) for a in range(-165, -14, 10)]
    shell: dict[int, list[tuple[float, float]]] = {  # outer corners after each cut, up to and with the next
        0: [(13.5, 0.0), (14.2, 7.6), (6.0, 11.2)],
        60: [(6.0, 11.2), (-3.2, 12.6)],
        105: [(-3.2, 12.6), (-11.0, 11.0), (-12.2, 3.4)],
        165: [(-12.2, 3.4), (-13.4, -3.0), (-9.5, -9.0)],
        225: [(-9.5, -9.0), (-2.6, -11.2), *apse, (6.4, -10.6)],
        300: [(6.4, -10.6), (12.6, -7.4), (13.5, 0.0)],
    }
    rooms = [[_polar(a, 5.0) for a in range(0, 360, 15)]]
    rooms += [
        [*(_polar(a, 5.0) for a in range(b, a_ - 1, -15)), *shell[a_]] for a_, b in zip(cuts, cuts[1:], strict=False)
    ]

    def screen(x: float, y: float, length: float, degrees: float) -> list[tuple[float, float]]:
        """Free-standing exhibition wall, 0.2 m thick."""
        along, across = _polar(degrees, length / 2), _polar(degrees + 90, 0.1)
        signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
        return [(x + i * along[0] + j * across[0], y + i * along[1] + j * across[1]) for i, j in signs]

    solids = [
        screen(9.4, 4.6, 3.2, 62.0),
        screen(-7.6, 6.6, 2.8, -35.0),
        screen(-9.2, -3.2, 2.4, 80.0),
        screen(1.8, -9.2, 3.6, 8.0),
        screen(9.2, -4.6, 2.2, -48.0),
        screen(0.9, 0.6, 2.0, 27.0),
        [_polar(a, 0.35, -2.2, -1.6) for a in range(0, 360, 30)],
    ]
    holes = [
        *(door(*_polar(a, 4.96), 0.9, 2.3) for a in (22.5, 127.5, 262.5)),
        door(9.0, 0.0, 1.8, 2.6),
        door(4.5, 8.0, 1.5, 2.6),
        door(-2.3, 9.0, 1.6, 2.6),
        door(-8.6, 2.3, 2.2, 2.6),
        door(-6.6, -6.3, 1.6, 2.6),
        door(4.6, -7.6, 1.4, 2.6),
        window(13.9, 3.8, 2.4, 1.0, 2.8),
        window(1.4, 11.9, 3.0, 1.0, 2.8),
        window(-7.2, 11.8, 2.0, 1.0, 2.8),
        window(-12.8, 0.2, 2.4, 1.0, 2.8),
        window(10.0, -8.8, 2.2, 1.0, 2.8),
    ]
    return Shell.from_rooms(rooms, 0.15, 0.2, solids).build(holes, 3.2, "gallery", "Museum with a rotunda.")


def main() -> None:
    """Write every plan."""
    PLANS.mkdir(exist_ok=True)
    for plan in (apartment(), house(), office(), corridor(), gallery()):
        print(plan.save(PLANS / f"{plan.name}.json").name, len(plan.segments), "segments")


if __name__ == "__main__":
    main()
