"""What tests of the daemon share."""

import pytest


@pytest.fixture
def shared_grids(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cache of all tests of this process: a grid is found by what it is of."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "cache"))
