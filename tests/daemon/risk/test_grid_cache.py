"""Grids are made once; nothing that is wrong with the files of the cache can be seen outside."""

from pathlib import Path

import numpy as np
import pytest

from daemon.risk import grid_cache
from daemon.risk.grid_cache import cached_grid, default_cache_directory
from daemon.workbench.body_model.evaluation.shapes import box, turned
from safety.risk.surroundings.distance_grid import DistanceGrid, distance_grid
from safety.risk.surroundings.environment import Environment, environment

BLOCK = environment(*box((20.0, 20.0, 20.0), (0.0, 0.0, 0.0), 2))


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The spacings of the grids that were really made."""
    spacings: list[float] = []

    def counted(mesh: Environment, spacing_mm: float, exact_to_mm: float) -> DistanceGrid:
        spacings.append(spacing_mm)
        return distance_grid(mesh, spacing_mm, exact_to_mm)

    monkeypatch.setattr(grid_cache, "distance_grid", counted)
    return spacings


def grid(directory: Path, mesh: Environment = BLOCK, spacing_mm: float = 4.0) -> DistanceGrid:
    return cached_grid(mesh, spacing_mm, 10.0, directory)


def same(one: DistanceGrid, other: DistanceGrid) -> bool:
    numbers = ("spacing_mm", "exact_to_mm", "margin_mm", "solid_around")
    return (
        np.array_equal(one.values_mm, other.values_mm)
        and np.array_equal(one.origin_mm, other.origin_mm)
        and all(getattr(one, name) == getattr(other, name) for name in numbers)
    )


def test_a_grid_is_made_once(tmp_path: Path, made: list[float]) -> None:
    first, again = grid(tmp_path / "new"), grid(tmp_path / "new")
    assert made == [4.0]
    assert same(first, again)
    assert [path.suffix for path in (tmp_path / "new").iterdir()] == [".npz"]


def test_another_mesh_spacing_or_free_side_has_its_own(tmp_path: Path, made: list[float]) -> None:
    larger = environment(*box((20.0, 20.0, 21.0), (0.0, 0.0, 0.0), 2))
    room = environment(*turned(box((20.0, 20.0, 20.0), (0.0, 0.0, 0.0), 2)))
    grids = [
        grid(tmp_path),
        grid(tmp_path, spacing_mm=5.0),
        grid(tmp_path, larger),
        grid(tmp_path, room),
    ]
    assert made == [4.0, 5.0, 4.0, 4.0]
    assert not any(same(grids[0], other) for other in grids[1:])


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 torn", b"\x93NUMPY"])
def test_a_torn_file_is_made_again(content: bytes, tmp_path: Path, made: list[float]) -> None:
    first = grid(tmp_path)
    (kept,) = tmp_path.iterdir()
    kept.write_bytes(content)
    assert same(grid(tmp_path), first)
    assert same(grid(tmp_path), first)
    assert made == [4.0, 4.0]


def test_a_file_of_something_else_is_made_again(tmp_path: Path, made: list[float]) -> None:
    first = grid(tmp_path)
    (kept,) = tmp_path.iterdir()
    with kept.open("wb") as file:
        np.savez(file, values_mm=np.zeros(3))
    assert same(grid(tmp_path), first)


def test_a_place_that_cannot_be_written_to_costs_only_time(
    tmp_path: Path, made: list[float]
) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("not a directory")
    assert same(grid(blocked), grid(blocked))
    assert made == [4.0, 4.0]


def test_the_cache_is_where_the_user_has_caches(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    assert default_cache_directory() == Path("/somewhere/tentacled/distance_grids")
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert default_cache_directory().is_relative_to(Path.home())
