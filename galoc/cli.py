"""The ``galoc`` command."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import tyro

from galoc.cli_cache import cache
from galoc.cli_detect import detect
from galoc.cli_locate import locate
from galoc.errors import GalocError
from galoc.floorplan import Floorplan


def plan(
    file: tyro.conf.Positional[str],
    /,
    *,
    scale: float | None = None,
    ceiling_height: float | None = None,
    out: Path | None = None,
    save: Path | None = None,
) -> None:
    """Check a floorplan, print its facts and draw it.

    Args:
        file: plan file (.json, ROS map .yaml, or an image with --scale), or the name of a shipped plan.
        scale: metres per pixel; needed for images.
        ceiling_height: replaces the plan's ceiling height, m.
        out: where to write the drawing; default: <name>.plan.png in the current folder.
        save: also write the plan as galoc JSON to this file.
    """
    from galoc.plot import save_plan_figure

    loaded = Floorplan.load(file, scale=scale, ceiling_height=ceiling_height)
    picture = save_plan_figure(loaded, out if out is not None else Path(f"{Path(file).stem}.plan.png"))
    print(facts_text(loaded))
    print(f"{'drawing':<16}{picture}")
    if save is not None:
        print(f"{'saved':<16}{loaded.save(save)}")


def facts_text(loaded: Floorplan) -> str:
    """The plan's facts, one a line."""
    from galoc.plan_facts import plan_facts

    facts = plan_facts(loaded)
    rows = {
        "name": loaded.name or "-",
        "extent": f"{facts.width:.2f} m x {facts.depth:.2f} m",
        "wall segments": f"{facts.segments}",
        "wall length": f"{facts.wall_length:.1f} m (all faces)",
        "free area": f"{facts.free_area:.1f} m2",
        "rooms": f"{facts.rooms}" if facts.doors else f"{facts.rooms} (parted by gaps up to 1.1 m)",
        "doors": f"{facts.doors}" if loaded.openings else "not given",
        "windows": f"{facts.windows}" if loaded.openings else "not given",
        "ceiling height": f"{facts.ceiling_height:.2f} m",
        "manhattan share": f"{100 * facts.manhattan_share:.0f} % of wall length within 2 deg of a right-angled grid "
        f"at {math.degrees(facts.manhattan_rad):.1f} deg",
    }
    return "\n".join(f"{key:<16}{value}" for key, value in rows.items())


INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it."""
COMMANDS: dict[str, Callable[..., Any]] = {"plan": plan, "cache": cache, "detect": detect, "locate": locate}
"""Subcommands by name; the function's signature is the command line, what it returns the exit code (None: 0)."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; bad input becomes one message on stderr and exit code 2, Ctrl-C exit code 130.

    Args:
        argv: arguments without the program name; default: those of the process.

    Returns:
        Exit code.
    """
    app = tyro.extras.SubcommandApp()
    for name, function in COMMANDS.items():
        app.command(name=name)(function)
    try:
        code = app.cli(prog="galoc", description="Find a camera's pose in a floorplan.", args=argv)
    except GalocError as error:
        print(f"galoc: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("galoc: stopped; nothing half-written was left behind", file=sys.stderr)
        return INTERRUPTED
    return int(code or 0)


if __name__ == "__main__":
    sys.exit(main())
