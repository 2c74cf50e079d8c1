"""Where installation or home are read-only, there is another place, which is the user's alone."""

import tempfile
from pathlib import Path

import pytest

from daemon.host import writable_places
from daemon.host.writable_places import ensure_writable_places

ALL = {"XDG_CACHE_HOME", "XDG_DATA_HOME", "MPLCONFIGDIR", "NUMBA_CACHE_DIR"}


@pytest.fixture(autouse=True)
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder for temporary files; and no folder outside of tmp_path may be written to."""
    there = tmp_path / "tmp"
    there.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(there))
    return there


def read_only(monkeypatch: pytest.MonkeyPatch, *folders: Path) -> None:
    """As for a user who is not root, whom the tests' own user may be."""
    asked = writable_places._can_be_made

    def can_be_made(folder: Path) -> bool:
        return not any(folder.is_relative_to(one) for one in folders) and asked(folder)

    monkeypatch.setattr(writable_places, "_can_be_made", can_be_made)


def test_where_everything_can_be_written_nothing_is_changed(tmp_path: Path) -> None:
    environment = {"HOME": str(tmp_path)}
    assert ensure_writable_places(environment) == []
    assert environment == {"HOME": str(tmp_path)}


def test_a_home_that_is_a_file_or_not_there_is_no_place(
    tmp_path: Path, temporary: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read_only(monkeypatch, writable_places._ROOT)
    (tmp_path / "file").write_text("")
    environment = {"HOME": str(tmp_path / "file")}
    assert set(ensure_writable_places(environment)) == ALL
    place = next(temporary.iterdir())
    assert place.stat().st_mode & 0o777 == 0o700
    assert all(Path(environment[name]).is_relative_to(place) for name in ALL)
    assert ensure_writable_places(environment) == []


def test_the_same_place_is_used_again_but_not_what_somebody_else_has_put_there(
    tmp_path: Path, temporary: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read_only(monkeypatch, writable_places._ROOT, tmp_path / "home")
    first: dict[str, str] = {"HOME": str(tmp_path / "home")}
    second, third = dict(first), dict(first)
    ensure_writable_places(first)
    ensure_writable_places(second)
    assert first == second
    place = Path(first["NUMBA_CACHE_DIR"]).parent
    place.chmod(0o777)
    ensure_writable_places(third)
    assert Path(third["NUMBA_CACHE_DIR"]).parent != place
    assert Path(third["NUMBA_CACHE_DIR"]).parent.stat().st_mode & 0o777 == 0o700
    place.rmdir()
    place.symlink_to(tmp_path)
    fourth = {"HOME": str(tmp_path / "home")}
    ensure_writable_places(fourth)
    assert Path(fourth["NUMBA_CACHE_DIR"]).parent not in (place, tmp_path)


def test_what_somebody_has_named_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read_only(monkeypatch, writable_places._ROOT, tmp_path / "home")
    named = {name: f"/of/mine/{name}" for name in ALL}
    environment = {"HOME": str(tmp_path / "home"), **named}
    assert ensure_writable_places(environment) == []
    assert environment == {"HOME": str(tmp_path / "home"), **named}


def test_numba_goes_to_the_home_itself_where_that_can_be_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read_only(monkeypatch, writable_places._ROOT)
    assert ensure_writable_places({"HOME": str(tmp_path)}) == []
