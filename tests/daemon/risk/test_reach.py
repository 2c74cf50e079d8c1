"""How far from its base a body may be: as far, surroundings have to be known, and no farther."""

from pathlib import Path

import numpy as np
import pytest

from config.control import Surface
from daemon.risk.mesh_file import write_mesh
from daemon.risk.model_file import read_model
from daemon.risk.surroundings import BodySize, read_surroundings
from daemon.workbench.body_model.evaluation import shapes
from safety.risk.body_risk import BodyRisk
from safety.risk.model.mixture import FloatArray
from safety.risk.model.risk_model import RiskModel
from tests import SHIPPED_ROBOTS

RADIUS_MM = 6.0


def mean_line(model: RiskModel, u: FloatArray) -> FloatArray:
    """(n, 3)."""
    mixture = model.shapes.mixture(u)
    assert mixture is not None
    mean = mixture.weights @ mixture.means_mm
    return np.asarray(model.basis.base_mm + np.tensordot(mean, model.basis.modes, axes=1))


@pytest.mark.parametrize("name", ["concentric_tubes", "soft_arm", "one_segment_arm"])
def test_a_region_that_only_the_longest_body_comes_to_counts(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    model = read_model(SHIPPED_ROBOTS.parent / "models" / f"{name}.npz").model
    tips = np.array([mean_line(model, u)[-1] for u in model.known])
    highest = int(np.argmax(tips[:, 2]))
    # Farther up than the arc's mean length, with all that is left free beyond it.
    longest_mm = float(model.basis.arc_mm[-1]) + model.basis.thickest_mm + 10.0
    x, y, z = tips[highest]
    ball = (float(x), float(y), longest_mm + RADIUS_MM + 0.5)
    assert ball[2] - z < RADIUS_MM + float(model.basis.radius_mm[-1])  # and the tip is in it
    mesh = tmp_path / "aside.stl"
    write_mesh(mesh, shapes.box((10.0, 10.0, 10.0), (-150.0, 0.0, 0.0), 2))
    region = {"kind": "ball", "keep": "out", "centre_mm": ball, "radius_mm": RADIUS_MM}
    surface = Surface.model_validate({"mesh": str(mesh), "free": "outside", "regions": [region]})
    around = read_surroundings(surface, tmp_path / "robot.yaml", BodySize.of(model))
    risk = BodyRisk(model, around.environment, around.grid, 200)
    u = model.known[highest].tolist()
    found = risk.of_way(u, u)
    assert not isinstance(found, str)
    assert found.contact.probability > 0.9


@pytest.mark.parametrize("free", ["inside", "outside"])
def test_of_surroundings_far_larger_than_the_body_what_is_in_its_reach_counts(
    free: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    mesh = tmp_path / "large.stl"
    # A hall in which the body stands beside a wall, or a wall as large in the open.
    write_mesh(mesh, shapes.box((3000.0, 3000.0, 3000.0), (1520.0, 0.0, 0.0), 2))
    at_mm = (-40.0, 0.0, 0.0) if free == "inside" else (0.0, 0.0, 0.0)
    surface = Surface.model_validate({"mesh": str(mesh), "free": free, "at_mm": at_mm})
    size = BodySize(5.0, 5.0, (0.0, 0.0, 0.0), 40.0)
    grid = read_surroundings(surface, tmp_path / "robot.yaml", size).grid
    wall = 20.0 + at_mm[0]
    x = grid.origin_mm[0] + grid.spacing_mm * np.arange(grid.values_mm.shape[0])
    middle = grid.values_mm.shape[1] // 2
    expected = x - wall if free == "inside" else wall - x
    near = np.abs(expected) < size.margin_mm
    found = grid.values_mm[near, middle, middle]
    np.testing.assert_allclose(found, expected[near], atol=1e-3)
    assert x[0] <= -55.0 and 55.0 <= x[-1] < 70.0
    assert grid.solid_around, "what is beyond the reach is not known, and not taken for free"
