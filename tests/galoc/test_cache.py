"""The cache on disk: what comes back, what happens to damaged files, several processes, limits, bad folders."""

import errno
import multiprocessing
import os
import time
import warnings
from pathlib import Path

import numpy as np
import pytest

from galoc import Floorplan, GalocError, cache_file, profiles
from galoc import cache as cache_module
from galoc.cache import SUFFIX, DiskCache, content_key
from galoc.cache_place import DEFAULT_LIMIT, cache_folder, cache_limit
from galoc.errors import CacheWarning

KEY = content_key("test", 1)
ARRAYS = {
    "ranges": np.arange(12, dtype=np.float32).reshape(3, 4),
    "index": np.array([[-1, 2**40]]),
    "flag": np.array([True, False, True]),
    "none": np.zeros((0, 360), np.uint8),
    "scalar": np.array(2.5),
    "transposed": np.arange(6.0).reshape(2, 3).T,
}


@pytest.fixture
def cache(tmp_path: Path) -> DiskCache:
    return DiskCache(tmp_path / "a folder with spaces", DEFAULT_LIMIT)


@pytest.fixture(autouse=True)
def fresh_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if no file had been checked and no folder been warned of."""
    monkeypatch.setattr(cache_module, "_checked", set())
    monkeypatch.setattr(cache_module, "_warned", set())


def file_of(cache: DiskCache, key: str = KEY) -> Path:
    assert cache.folder is not None
    return cache.folder / (key + SUFFIX)


def assert_same(found: dict | None, expected: dict = ARRAYS) -> None:
    assert found is not None and list(found) == list(expected)
    for name, array in expected.items():
        assert (found[name].dtype, found[name].shape) == (array.dtype, array.shape)
        np.testing.assert_array_equal(found[name], array)


def never() -> dict:
    raise AssertionError("built although it was kept")


def test_round_trip(cache: DiskCache) -> None:
    assert cache.load(KEY) is None and cache.size == 0 and cache.entries() == []
    assert cache.save(KEY, ARRAYS, "six arrays")
    found = cache.load(KEY)
    assert_same(found)
    assert found is not None
    for array in found.values():
        assert not array.flags.writeable and array.ctypes.data % 64 == 0
    (entry,) = cache.entries()
    assert (entry.key, entry.note, entry.size) == (KEY, "six arrays", file_of(cache).stat().st_size)
    assert cache.size == entry.size
    assert cache.clear() == entry.size
    assert cache.load(KEY) is None and list(file_of(cache).parent.iterdir()) == []
    assert_same(found)  # what is mapped outlives its file


def test_writable_arrays_leave_the_file_alone(cache: DiskCache) -> None:
    cache.save(KEY, ARRAYS)
    mine = cache.load(KEY, writable=True)
    assert mine is not None
    mine["ranges"][:] = -1.0
    assert_same(cache.load(KEY))


def test_fetch_builds_once(cache: DiskCache) -> None:
    built = cache.fetch(KEY, lambda: dict(ARRAYS))
    assert_same(built)
    kept = cache.fetch(KEY, never)
    assert_same(kept)
    assert [a.flags.writeable for a in built.values()] == [a.flags.writeable for a in kept.values()] == [False] * 6
    assert ARRAYS["ranges"].flags.writeable
    assert [p.name for p in file_of(cache).parent.iterdir()] == [KEY + SUFFIX]


@pytest.mark.parametrize("damage", ["cut", "empty", "data", "header", "magic", "longer", "renamed"])
def test_damaged_files_are_dropped_and_built_again(cache: DiskCache, damage: str) -> None:
    path = file_of(cache)
    cache.save(KEY, ARRAYS)
    content = bytearray(path.read_bytes())
    if damage == "renamed":
        cache.save("other", {"ranges": ARRAYS["ranges"]})
        os.replace(file_of(cache, "other"), path)
    else:
        at = {"data": content.index(ARRAYS["ranges"].tobytes()) + 7, "header": 40, "magic": 0}.get(damage)
        if at is not None:
            content[at] ^= 1
        new = {"cut": content[:-1], "empty": b"", "longer": content + b"\0"}.get(damage, content)
        path.write_bytes(new)
    with pytest.warns(CacheWarning, match="is damaged"):
        assert_same(cache.fetch(KEY, lambda: dict(ARRAYS)))
    assert_same(cache.fetch(KEY, never))


def test_every_byte_counts(cache: DiskCache) -> None:
    """No single wrong byte gives other arrays."""
    path = file_of(cache)
    cache.save(KEY, {"a": np.arange(8.0)}, "note")
    content = path.read_bytes()
    for at in range(len(content)):
        cache_module._checked.clear()
        path.write_bytes(content[:at] + bytes([content[at] ^ 0x55]) + content[at + 1 :])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", CacheWarning)
            found = cache.load(KEY)
        if found is not None:  # a byte between header and data
            assert_same(found, {"a": np.arange(8.0)})


def test_a_file_is_checked_once_per_process(cache: DiskCache, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    monkeypatch.setattr(cache_module, "checksum", lambda data: calls.append(1) or cache_file.checksum(data))
    cache.save(KEY, ARRAYS)
    for _ in range(3):
        cache.load(KEY)
    assert len(calls) == 1
    cache.save(KEY, {"ranges": np.ones(3)})
    cache.load(KEY)
    assert len(calls) == 2


def _build_slowly(folder: str, barrier, answers) -> None:  # type: ignore[no-untyped-def]
    def build() -> dict:
        with (Path(folder).parent / "builds").open("a") as log:
            log.write("x")
        time.sleep(0.5)  # long enough for the other process to ask meanwhile
        return {"a": np.arange(1000.0)}

    barrier.wait()
    answers.put(float(DiskCache(Path(folder)).fetch(KEY, build)["a"].sum()))


def test_two_processes_build_once(tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    barrier, answers = context.Barrier(2), context.Queue()
    folder = tmp_path / "shared folder"
    workers = [context.Process(target=_build_slowly, args=(str(folder), barrier, answers)) for _ in range(2)]
    for worker in workers:
        worker.start()
    found = [answers.get(timeout=60) for _ in workers]
    for worker in workers:
        worker.join()
    assert found == [499500.0] * 2
    assert (tmp_path / "builds").read_text() == "x"
    assert [p.name for p in folder.iterdir()] == [KEY + SUFFIX]


def test_least_recently_used_go_first(tmp_path: Path) -> None:
    keys = [content_key("test", n) for n in range(5)]
    array = {"a": np.zeros(10_000)}
    cache = DiskCache(tmp_path, 3 * 81_000)  # three entries of 80 kB and their headers
    for age, key in enumerate(keys[:3]):
        cache.save(key, array)
        os.utime(file_of(cache, key), (age, age))
    assert cache.load(keys[0]) is not None  # now the last used
    cache.save(keys[3], array)
    assert {e.key for e in cache.entries()} == {keys[0], keys[2], keys[3]}
    cache.save(keys[4], array)
    assert {e.key for e in cache.entries()} == {keys[0], keys[3], keys[4]}
    assert cache.size <= cache.limit_bytes
    assert [e.key for e in cache.entries()] == [keys[4], keys[3], keys[0]]


def test_what_exceeds_the_limit_is_not_kept(tmp_path: Path) -> None:
    cache = DiskCache(tmp_path, 80_000)
    small = content_key("small")
    assert cache.save(small, {"a": np.zeros(1000)})
    big = {"a": np.arange(10_000.0)}
    assert_same(cache.fetch(KEY, lambda: big), big)
    assert_same(cache.fetch_filled(KEY, {"a": ((10_000,), float)}, lambda a: a["a"].__iadd__(big["a"])), big)
    assert [e.key for e in cache.entries()] == [small]
    assert not DiskCache(tmp_path, 0).save(KEY, big)


def test_writer_fills_in_place(cache: DiskCache) -> None:
    with cache.writer(KEY, {"a": ((4, 3), np.uint16), "b": ((2,), ">f8")}, "tiles") as arrays:
        assert not arrays["a"].any()
        for row in range(4):
            arrays["a"][row] = row
        assert cache.load(KEY) is None
    expected = {"a": np.repeat(np.arange(4, dtype=np.uint16), 3).reshape(4, 3), "b": np.zeros(2, ">f8")}
    assert_same(arrays, expected)
    assert_same(cache.load(KEY), expected)
    with pytest.raises(ValueError, match="read-only"):
        arrays["a"][0] = 1
    assert_same(cache.fetch_filled(KEY, {}, lambda arrays: never()), expected)


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError, OSError])
def test_interrupted_work_leaves_nothing(cache: DiskCache, error: type[BaseException]) -> None:
    def build() -> dict:
        raise error

    with pytest.raises(error):
        cache.fetch(KEY, build)
    with pytest.raises(error), cache.writer(KEY, {"a": ((1000,), float)}) as arrays:
        arrays["a"][:] = 1.0
        assert len(list(file_of(cache).parent.iterdir())) == 1
        raise error
    with pytest.raises(error):
        cache.fetch_filled(KEY, {"a": ((1000,), float)}, lambda arrays: build() and None)
    assert list(file_of(cache).parent.iterdir()) == []
    assert_same(cache.fetch(KEY, lambda: dict(ARRAYS)))


def test_leftovers_of_dead_processes_go_after_a_day(cache: DiskCache) -> None:
    cache.save(KEY, ARRAYS)
    folder = file_of(cache).parent
    dead, old, own = (f".{KEY}.{pid}-00.tmp" for pid in (2**22 + 1, 2**22 + 2, os.getpid()))
    for name in (dead, old, own):
        (folder / name).touch()
    for name in (old, own):
        os.utime(folder / name, (0, 0))
    cache.save(KEY, ARRAYS)
    assert {p.name for p in folder.iterdir()} == {KEY + SUFFIX, dead, own}
    cache.clear()
    assert {p.name for p in folder.iterdir()} == {own}


def unwritable(*args: object, **kwargs: object) -> None:
    raise OSError(errno.EROFS, os.strerror(errno.EROFS))


def full(*args: object) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize(("where", "what"), [("open", unwritable), ("posix_fallocate", full), ("replace", full)])
def test_results_come_without_a_disk(cache: DiskCache, monkeypatch: pytest.MonkeyPatch, where: str, what) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.setattr(cache_file.os, where, what)
    with pytest.warns(CacheWarning, match="GALOC_CACHE") as caught:
        assert_same(cache.fetch(KEY, lambda: dict(ARRAYS)))
        assert_same(cache.fetch(KEY, lambda: dict(ARRAYS)))
        specs = {"a": ((3,), float)}
        assert_same(cache.fetch_filled(KEY, specs, lambda a: a["a"].fill(1.0)), {"a": np.ones(3)})
    assert len(caught) == 1  # per process
    monkeypatch.undo()
    assert list(file_of(cache).parent.iterdir()) == []


def test_a_file_in_the_place_of_the_folder(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("mine")
    cache = DiskCache(tmp_path / "taken")
    with pytest.warns(CacheWarning):
        assert_same(cache.fetch(KEY, lambda: dict(ARRAYS)))
    assert cache.entries() == [] and cache.clear() == 0
    assert (tmp_path / "taken").read_text() == "mine"


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere")
def test_read_only_folder(cache: DiskCache) -> None:
    cache.save(KEY, ARRAYS)
    folder = file_of(cache).parent
    folder.chmod(0o500)
    try:
        assert_same(cache.fetch(KEY, never))
        with pytest.warns(CacheWarning):
            cache.fetch("other", lambda: dict(ARRAYS))
        with pytest.raises(GalocError, match="cannot be removed"):
            cache.clear()
    finally:
        folder.chmod(0o700)


def test_without_locks_everybody_builds(cache: DiskCache, monkeypatch: pytest.MonkeyPatch) -> None:
    import fcntl

    monkeypatch.setattr(fcntl, "flock", unwritable)
    assert_same(cache.fetch(KEY, lambda: dict(ARRAYS)))
    assert_same(cache.load(KEY))


def test_place_by_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GALOC_CACHE", str(tmp_path / "x y"))
    assert cache_folder() == DiskCache().folder == tmp_path / "x y"
    monkeypatch.setenv("GALOC_CACHE", "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "galoc"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_folder() == tmp_path / ".cache" / "galoc"
    monkeypatch.setenv("GALOC_CACHE", "off")
    off = DiskCache()
    assert off.folder is None and not off.save(KEY, ARRAYS) and off.load(KEY) is None
    assert_same(off.fetch(KEY, lambda: dict(ARRAYS)))
    assert_same(off.fetch_filled(KEY, {"a": ((3,), float)}, lambda a: a["a"].fill(1.0)), {"a": np.ones(3)})
    assert off.entries() == [] and off.clear() == off.size == 0
    assert list(tmp_path.iterdir()) == []


def test_limit_by_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("GALOC_CACHE_GB", raising=False)
    assert cache_limit() == DEFAULT_LIMIT
    monkeypatch.setenv("GALOC_CACHE_GB", "0.5")
    assert DiskCache().limit_bytes == 2**29
    for bad in ("much", "-1", "nan", "inf", "4 GB"):
        monkeypatch.setenv("GALOC_CACHE_GB", bad)
        with pytest.raises(GalocError, match="GALOC_CACHE_GB"):
            DiskCache()


def test_keys_tell_everything_apart() -> None:
    a = np.arange(6.0)
    parts = [
        ("k", a), ("l", a), ("k", a.reshape(2, 3)), ("k", a.astype(np.float32)), ("k", a.view(np.int64)), ("k", a, 1),
        ("k", a, 1.0), ("k", a, "1"), ("k", a, True), ("k", 1, a), ("k", "ab", "c"), ("k", "a", "bc"), ("k", "abc"),
        ("k", a + np.spacing(a)),
    ]  # fmt: skip
    assert len({content_key(*p) for p in parts}) == len(parts)
    assert content_key("k", a[::2], np.float64(2.0)) == content_key("k", a[::2].copy(), 2.0)
    assert len(KEY) == 32 and int(KEY, 16) >= 0
    with pytest.raises(TypeError):
        content_key("k", None)  # type: ignore[arg-type]


def test_odd_keys_and_dtypes_are_refused(cache: DiskCache) -> None:
    with pytest.raises(ValueError, match="cache key"):
        cache.load("../elsewhere")
    with pytest.raises(TypeError, match="plain numbers"):
        cache.save(KEY, {"a": np.array([None])})
    assert cache.entries() == []


@pytest.fixture
def counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Profiles are kept in an empty folder, also of small plans; counts the positions of each casting."""
    monkeypatch.setenv("GALOC_CACHE", str(tmp_path / "profiles"))
    monkeypatch.setattr(profiles, "KEPT_WORK", 0)
    calls: list[int] = []
    cast = profiles.Caster.__call__
    monkeypatch.setattr(profiles.Caster, "__call__", lambda self, xy: calls.append(len(xy)) or cast(self, xy))
    return calls


def test_profiles_are_read_back(counted: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = (profiles.profile_field(Floorplan.load("apartment"), 0.3) for _ in range(2))
    assert counted == [len(first.positions)]
    np.testing.assert_array_equal(second.ranges, first.ranges)
    assert second.ranges.flags.writeable  # numba compiles a second time for read-only arrays
    (entry,) = DiskCache().entries()
    assert entry.note == "profiles of apartment, 0.3 m"
    profiles.profile_field(Floorplan.load("apartment"), 0.35)
    walls = Floorplan.load("apartment").segments.copy()
    walls[0] += 1e-6
    profiles.profile_field(Floorplan.from_segments(walls), 0.3)
    monkeypatch.setattr(profiles, "CASTER_VERSION", -1)
    profiles.profile_field(Floorplan.load("apartment"), 0.3)
    assert len(counted) == len(DiskCache().entries()) == 4


def test_small_plans_are_not_kept(counted: list[int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(profiles, "KEPT_WORK", 1_000_000)
    for _ in range(2):
        profiles.profile_field(Floorplan.load("apartment"), 0.3)
    assert len(counted) == 2 and DiskCache().entries() == []


def test_caster_version_is_counted_up_with_its_ranges() -> None:
    """If this fails because the caster is meant to give other ranges: count CASTER_VERSION up and record them here."""
    plan = Floorplan.load("apartment")
    bounds = np.array(plan.bounds).reshape(2, 2)
    at = bounds[0] + np.array([[0.21, 0.34], [0.55, 0.48], [0.83, 0.77]]) * (bounds[1] - bounds[0])
    found = profiles.Caster(plan)(at)[:, 7::45]
    np.testing.assert_allclose(
        found, RECORDED[profiles.CASTER_VERSION], rtol=0.0, atol=1e-4
    )  # m; the last bits differ between processors


RECORDED = {
    1: [
        [2.89075, 2.24464, 4.90536, 2.80555, 2.22740, 3.05986, 2.42931, 3.64107],
        [4.35849, 1.26090, 3.82209, 6.16183, 1.52951, 0.28262, 3.51258, 2.36799],
        [1.76475, 1.98779, 1.57816, 2.54426, 2.34589, 1.41318, 1.12196, 1.80879],
    ]
}
"""Ranges of three places in the apartment by CASTER_VERSION, m."""
