"""Where the cache lies and how large it may grow, by environment.

GALOC_CACHE is the folder, or "off"; GALOC_CACHE_GB the limit in GB of 2**30 bytes.
"""

from __future__ import annotations

import math
import os
from pathlib import Path

from galoc.errors import GalocError

DEFAULT_LIMIT = 4 << 30
"""Limit of the cache where GALOC_CACHE_GB does not say, bytes."""


def cache_folder() -> Path | None:
    """The folder of the cache by environment: GALOC_CACHE, else the user's cache folder; None where it is off."""
    given = os.environ.get("GALOC_CACHE", "").strip()
    if given:
        return None if given.lower() == "off" else Path(given).expanduser().absolute()
    base = os.environ.get("XDG_CACHE_HOME", "")
    try:
        return (Path(base) if os.path.isabs(base) else Path.home() / ".cache") / "galoc"
    except RuntimeError:  # a user without a home
        return None


def cache_limit() -> int:
    """Limit of the cache by environment, bytes.

    Raises:
        GalocError: GALOC_CACHE_GB is no number of 0 or more.
    """
    given = os.environ.get("GALOC_CACHE_GB", "").strip()
    if not given:
        return DEFAULT_LIMIT
    try:
        gigabytes = float(given)
    except ValueError:
        gigabytes = math.nan
    if not 0.0 <= gigabytes < 1e9:
        raise GalocError(
            f"GALOC_CACHE_GB={given!r}", "a number of GB, 0 or more", "Set it to 4, say, or unset it; 0 keeps nothing."
        )
    return int(gigabytes * 2**30)
