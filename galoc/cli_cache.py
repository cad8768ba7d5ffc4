"""The ``galoc cache`` command."""

from __future__ import annotations

import time

from galoc.cache import DiskCache, Entry
from galoc.errors import GalocError

MB = 1 << 20
MAX_NOTE = 60
"""Longer notes are cut in the table."""


def cache(*, clear: bool = False) -> None:
    """List what is kept on disk to start faster: range profiles of large plans, pyramids of the exact search.

    GALOC_CACHE names the folder ("off": keep nothing), GALOC_CACHE_GB its limit. It can be emptied at any time.

    Args:
        clear: remove everything.
    """
    kept = DiskCache()
    if kept.folder is None:
        if clear:
            raise GalocError("--clear while the cache is off", "a cache folder", "Unset GALOC_CACHE first.")
        print("cache is off (GALOC_CACHE)")
        return
    if clear:
        print(f"freed {kept.clear() / MB:.1f} MB in {kept.folder}")
        return
    print(table(kept, time.time()))


def table(kept: DiskCache, now: float) -> str:
    """Folder, limit, total and a line for each entry.

    Args:
        kept: the cache, not off.
        now: Unix time, s.
    """
    entries = kept.entries()
    total = sum(entry.size for entry in entries)
    lines = [
        f"{'folder':<8}{kept.folder}",
        f"{'limit':<8}{kept.limit_bytes / MB:.0f} MB",
        f"{'total':<8}{total / MB:.1f} MB in {len(entries)} {'entry' if len(entries) == 1 else 'entries'}",
    ]
    if entries:
        notes = [_plain(entry) for entry in entries]
        width = max(len("what"), *map(len, notes))
        lines += ["", f"{'what':<{width}}  {'MB':>8}  last used"]
        lines += [
            f"{n:<{width}}  {e.size / MB:>8.1f}  {ago(now - e.last_used)}" for n, e in zip(notes, entries, strict=True)
        ]
    return "\n".join(lines)


def ago(seconds: float) -> str:
    """A span of time in its largest whole unit."""
    for unit, length in (("d", 86400), ("h", 3600), ("min", 60)):
        if seconds >= length:
            return f"{int(seconds // length)} {unit} ago"
    return "just now"


def _plain(entry: Entry) -> str:
    """The note on one line; plan names may hold anything."""
    note = "".join(c if c.isprintable() else " " for c in entry.note) or entry.key
    note = " ".join(note.split())
    return note if len(note) <= MAX_NOTE else note[: MAX_NOTE - 3] + "..."
