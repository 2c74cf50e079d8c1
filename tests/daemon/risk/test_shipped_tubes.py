"""The model that is shipped for concentric tubes: of this robot, the same however it rolls."""

from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from config.loader import load_robot
from daemon.array_files import misfit_of
from daemon.risk.body_risk_source import read_risk_files
from daemon.risk.mesh_file import write_mesh
from daemon.risk.model_file import ModelFile, read_model
from daemon.robot.axes import AxisRanges
from daemon.workbench.body_model.clouds.emulated_body import EmulatedBody
from daemon.workbench.body_model.evaluation.shapes import ball
from tests import SHIPPED_ROBOTS

ROBOT = load_robot(SHIPPED_ROBOTS / "concentric_tubes.yaml").robot
MODEL = Path(str(SHIPPED_ROBOTS.parent / "models" / "concentric_tubes.npz"))
SOMEWHERE = np.array([0.7, -1.1, 2.0, 3.0, 5.0])


@pytest.fixture(scope="module")
def file() -> ModelFile:
    return read_model(MODEL)


def test_it_is_of_the_shipped_robot_and_says_how_it_was_made(file: ModelFile) -> None:
    assert misfit_of(file.about, ROBOT) == ""
    np.testing.assert_allclose(file.model.points.period, AxisRanges.of(ROBOT).period)
    collected, trained = file.about["commands"]
    assert "--bodies 200" in collected
    assert "mdn train concentric_tubes.yaml" in trained


def test_after_a_turn_of_any_tube_it_says_the_same(file: ModelFile) -> None:
    here = file.model.shapes.mixture(SOMEWHERE)
    assert here is not None
    for tube in range(3):
        turned = SOMEWHERE + 2.0 * pi * np.eye(5)[tube]
        assert file.model.knows(turned)
        there = file.model.shapes.mixture(turned)
        assert there is not None
        np.testing.assert_allclose(there.means_mm, here.means_mm, atol=1e-2)


@pytest.mark.parametrize("roll", [0.0, 1.0, 2.5, -2.0])
def test_the_body_is_where_it_says_however_it_is_rolled(file: ModelFile, roll: float) -> None:
    u = SOMEWHERE + roll * np.array([1.0, 1.0, 1.0, 0.0, 0.0])
    line = EmulatedBody(ROBOT).go(u).centreline_mm
    mixture, basis = file.model.shapes.mixture(u), file.model.basis
    assert mixture is not None
    mean = mixture.weights @ mixture.means_mm
    expected = basis.base_mm + np.tensordot(mean, basis.modes, axes=1)
    off = np.linalg.norm(expected - line, axis=1)
    assert off.max() < 4.0
    assert off.mean() < 1.5


def test_what_is_around_them_is_known_as_finely_as_thin_tubes_ask(tmp_path: Path) -> None:
    write_mesh(tmp_path / "ball.stl", ball(8.0, [60.0, 0.0, 180.0], 200))
    robot: dict[str, Any] = yaml.safe_load((SHIPPED_ROBOTS / "concentric_tubes.yaml").read_text())
    surface: dict[str, Any] = {"mesh": "ball.stl", "free": "outside"}
    for given, spacing_mm in (({}, 0.7), ({"grid_mm": 2.0}, 2.0)):
        robot["risk"] = {"model": "builtin:concentric_tubes.npz", "surface": {**surface, **given}}
        path = tmp_path / "robot.yaml"
        path.write_text(yaml.safe_dump(robot))
        made = read_risk_files(load_robot(path)).grid
        assert made.spacing_mm == pytest.approx(spacing_mm)
