"""Grids are made once; nothing that is wrong with the files of the cache can be seen outside."""

from pathlib import Path

import numpy as np
import pytest

from daemon.risk import grid_cache
from daemon.risk.grid_cache import cached_grid, default_cache_directory, fitting_spacing_mm
from daemon.workbench.body_model.evaluation.shapes import box, turned
from daemon.workbench.planning.clearance_slopes import distance_at
from safety.risk.model.mixture import FloatArray
from safety.risk.surroundings.distance_grid import DistanceGrid, distance_grid
from safety.risk.surroundings.environment import Environment, environment

BLOCK = environment(*box((20.0, 20.0, 20.0), (0.0, 0.0, 0.0), 2))


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The spacings of the grids that were really made."""
    spacings: list[float] = []

    def counted(
        mesh: Environment, spacing_mm: float, exact_to_mm: float, *boxes: FloatArray | None
    ) -> DistanceGrid:
        spacings.append(spacing_mm)
        return distance_grid(mesh, spacing_mm, exact_to_mm, *boxes)

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


@pytest.mark.parametrize(
    ("radius_mm", "spacing_mm"), [(15.0, 1.5), (3.0, 1.5), (2.9, 1.45), (1.4, 0.7), (0.5, 0.25)]
)
def test_a_grid_is_as_fine_as_a_thin_body_asks(radius_mm: float, spacing_mm: float) -> None:
    assert fitting_spacing_mm(BLOCK, radius_mm, 10.0) == pytest.approx(spacing_mm)


def test_in_large_surroundings_it_is_coarser_but_never_than_usual() -> None:
    room = environment(*box((180.0, 180.0, 180.0), (0.0, 0.0, 0.0), 2))
    spacing_mm = fitting_spacing_mm(room, 1.4, 10.0)
    assert 0.7 < spacing_mm < 1.5
    assert 6e6 < (200.0 / spacing_mm) ** 3 <= 8e6
    hall = environment(*box((2000.0, 2000.0, 2000.0), (0.0, 0.0, 0.0), 2))
    assert fitting_spacing_mm(hall, 1.4, 10.0) == 1.5


def test_distances_beside_an_edge_are_right_for_the_body_that_they_are_for() -> None:
    """To a sixteenth of its radius; a grid for thick bodies is off by more than twice as much."""
    radius_mm, random = 1.4, np.random.default_rng(1)
    angle = random.uniform(0.0, 0.5 * np.pi, 2000)
    beside = 10.0 + radius_mm * np.array([np.cos(angle), np.sin(angle)])
    places = np.column_stack([*beside, random.uniform(-5.0, 5.0, angle.size)])

    def too_large_mm(spacing_mm: float) -> float:
        made = distance_grid(BLOCK, spacing_mm, 10.0)
        return float((distance_at(made, places)[0] - radius_mm).max())

    fitting_mm = fitting_spacing_mm(BLOCK, radius_mm, 10.0)
    assert 0.0 < too_large_mm(fitting_mm) < radius_mm / 16.0
    assert too_large_mm(1.5) > 2.0 * radius_mm / 16.0
