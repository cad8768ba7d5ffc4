"""The `galoc cache` command."""

from pathlib import Path

import numpy as np
import pytest

from galoc.cache import DiskCache, content_key
from galoc.cli import main
from galoc.cli_cache import ago, table


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("GALOC_CACHE", str(tmp_path / "my cache"))
    monkeypatch.setenv("GALOC_CACHE_GB", "2")
    return tmp_path / "my cache"


def test_lists_and_clears(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["cache"]) == 0
    assert capsys.readouterr().out.splitlines() == [
        f"folder  {folder}", "limit   2048 MB", "total   0.0 MB in 0 entries",
    ]  # fmt: skip
    for name, megabytes in (("office", 3), ("cafe\x1b[31m\n" + "x" * 90, 2)):
        DiskCache().save(content_key(name), {"a": np.zeros(megabytes << 20, np.uint8)}, f"profiles of {name}, 0.1 m")
    (folder / "broken.galoc").write_bytes(b"x" * 1000)
    assert main(["cache"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[2] == "total   5.0 MB in 3 entries"
    assert lines[4].split() == ["what", "MB", "last", "used"]
    assert lines[5].split()[0] == "unreadable"
    assert lines[6].startswith("profiles of cafe [31m xxx") and "...       2.0  just now" in lines[6]
    assert lines[7].split() == ["profiles", "of", "office,", "0.1", "m", "3.0", "just", "now"]
    assert len({line.rindex("just now") for line in lines[5:]}) == 1
    assert main(["cache", "--clear"]) == 0
    assert capsys.readouterr().out == f"freed 5.0 MB in {folder}\n"
    assert list(folder.iterdir()) == []


def test_ages() -> None:
    assert [ago(s) for s in (-5, 59, 60, 7199, 7200, 86400 * 9.5)] == [
        "just now", "just now", "1 min ago", "1 h ago", "2 h ago", "9 d ago",
    ]  # fmt: skip


def test_age_is_that_of_the_last_load(folder: Path) -> None:
    kept = DiskCache()
    kept.save("key", {"a": np.zeros(3)}, "note")
    used = kept.entries()[0].last_used
    assert table(kept, used + 7200.0).splitlines()[-1].endswith("2 h ago")


def test_off_and_bad_settings(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("GALOC_CACHE_GB", "plenty")
    assert main(["cache"]) == 2
    captured = capsys.readouterr()
    assert captured.out == "" and captured.err.count("\n") == 1 and "'plenty'" in captured.err
    monkeypatch.setenv("GALOC_CACHE_GB", "2")
    monkeypatch.setenv("GALOC_CACHE", "off")
    assert main(["cache"]) == 0
    assert "off" in capsys.readouterr().out
    assert main(["cache", "--clear"]) == 2
    assert "GALOC_CACHE" in capsys.readouterr().err
    assert not folder.exists()


def test_clear_says_what_it_cannot_remove(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    DiskCache().save("key", {"a": np.zeros(3)})

    def refuse(self: Path, missing_ok: bool = False) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(Path, "unlink", refuse)
    assert main(["cache", "--clear"]) == 2
    message = capsys.readouterr().err
    monkeypatch.undo()
    assert message.count("\n") == 1 and "cannot be removed (Operation not permitted)" in message
