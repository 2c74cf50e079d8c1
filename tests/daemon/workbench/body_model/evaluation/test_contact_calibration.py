"""Predicted beside observed contacts: what counts as a contact, and how far off is off."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from config.loader import load_robot
from daemon.host.progress import Unheard
from daemon.risk.model_file import ModelFile
from daemon.workbench.body_model.clouds.collection import CollectionError
from daemon.workbench.body_model.clouds.emulated_body import EmulatedBody
from daemon.workbench.body_model.evaluation.contact_calibration import (
    Block,
    ContactCalibration,
    contact_calibration,
    grazed_block,
)
from daemon.workbench.body_model.evaluation.rollouts import Rollouts, roll_out
from safety.risk.model.risk_model import risk_model
from tests import SOFT_ARM
from tests.safety.risk.test_body_risk import arrays, at

TENDON_ARM = SOFT_ARM.with_name("tendon_arm.yaml")
RADIUS_MM = 5.0


def block(away_mm: float) -> Block:
    """With a side to the z axis, at this distance."""
    return Block(np.array([10.0, 40.0, 40.0]), np.eye(3), np.array([away_mm + 5.0, 0.0, 50.0]))


def rod(x_mm: float) -> np.ndarray:
    """(1, n, 3) straight along z."""
    along = np.linspace(0.0, 100.0, 6)
    return np.column_stack([np.full(6, x_mm), np.zeros(6), along])[None]


@pytest.mark.parametrize(("x_mm", "touches"), [(-0.1, False), (0.1, True), (30.0, False)])
def test_a_body_touches_what_is_within_its_radius(x_mm: float, touches: bool) -> None:
    assert block(RADIUS_MM).touched(rod(x_mm), RADIUS_MM).tolist() == [touches]


def test_a_thin_block_between_two_nodes_is_touched() -> None:
    thin = Block(np.array([20.0, 20.0, 1.0]), np.eye(3), np.array([0.0, 0.0, 50.0]))
    assert thin.touched(rod(0.0), 2.0).tolist() == [True]


def test_the_triangles_of_a_block_are_the_block() -> None:
    random = np.random.default_rng(0)
    axes = np.linalg.qr(random.normal(size=(3, 3)))[0]
    turned = Block(np.array([20.0, 30.0, 40.0]), axes, np.array([1.0, 2.0, 3.0]))
    places = random.uniform(-30.0, 30.0, (500, 3))
    solid = turned.environment().solid(places)
    assert solid.tolist() == (turned.distances_mm(places) < 0.0).tolist()
    assert 20 < solid.sum() < 480


@pytest.mark.parametrize("seed", range(20))
def test_a_block_is_put_where_it_nearly_touches(seed: int) -> None:
    random = np.random.default_rng(seed)
    lines = (rod(0.0) + random.normal(0.0, 1.0, (50, 1, 3)) * (1.0, 1.0, 0.0)).astype(np.float32)
    found = grazed_block(lines, RADIUS_MM, random)
    away_mm = found.distances_mm(lines.reshape(-1, 3)).reshape(50, -1).min(axis=1) - RADIUS_MM
    assert abs(np.median(away_mm)) < 15.0
    assert np.linalg.det(found.axes) == pytest.approx(1.0)


def test_how_far_off_it_is_is_told_in_tenths() -> None:
    predicted = np.array([0.05] * 30 + [0.95] * 10)
    observed = np.array([0.1, 0.2] * 15 + [0.95] * 10)
    limit = predicted + 0.06
    found = ContactCalibration(predicted, limit, observed, 200, 3, 1)
    assert found.expected_error == pytest.approx(0.75 * 0.1)
    assert found.largest_error == pytest.approx(0.1)
    assert found.single_error == pytest.approx(0.75 * 0.1)
    assert found.exceeded == pytest.approx(15 / 40)
    assert found.undecided == 1.0
    assert [n for _, _, n in found.bins()] == [30, 10]
    assert found.summary()["unknown_configurations"] == 3
    assert found.summary()["left_out_because_trained_at"] == 1


@pytest.fixture(scope="module")
def file() -> ModelFile:
    """A straight body whose end the first input moves along x, 10 mm per unit."""
    return ModelFile(risk_model(arrays(), "silu", "relu"), {"robot": "arm"})


def as_the_model_has_it(file: ModelFile, rollouts: int) -> Rollouts:
    """Bodies drawn from the model itself."""
    random = np.random.default_rng(1)
    u = np.array([at(first) for first in np.linspace(-4.1, 4.1, 12)])
    lines = []
    for one in u:
        mixture = file.model.shapes.mixture(one)
        assert mixture is not None
        drawn = mixture.sample(rollouts, random)
        lines.append(file.model.basis.base_mm + np.tensordot(drawn, file.model.basis.modes, axes=1))
    return Rollouts(u, np.array(lines, np.float32), RADIUS_MM)


def test_a_model_that_is_right_is_found_to_be(file: ModelFile) -> None:
    rollouts = as_the_model_has_it(file, 100)
    found = contact_calibration(file, rollouts, 3, 1000, 2.0, 1, lambda _: None)
    assert len(found.predicted) == 36
    assert found.single_error < 0.06
    assert found.exceeded < 0.4


def test_a_model_that_is_wrong_is_found_out(file: ModelFile) -> None:
    """The bodies are elsewhere."""
    rollouts = as_the_model_has_it(file, 100)
    elsewhere = replace(rollouts, u=rollouts.u + np.array(at(1.5)))
    found = contact_calibration(file, elsewhere, 3, 500, 2.0, 1, lambda _: None)
    assert found.single_error > 0.15


def test_what_the_model_does_not_know_is_left_out(file: ModelFile) -> None:
    rollouts = as_the_model_has_it(file, 20)
    u = rollouts.u.copy()
    u[2:] += 100.0
    found = contact_calibration(file, replace(rollouts, u=u), 3, 500, 2.0, 1, lambda _: None)
    assert (found.unknown, len(found.predicted)) == (10, 6)
    nowhere = replace(rollouts, u=rollouts.u + 100.0)
    with pytest.raises(ValueError, match="trained at 0, and 12 it does not know"):
        contact_calibration(file, nowhere, 3, 500, 2.0, 1, lambda _: None)


def test_configurations_that_the_model_was_trained_at_are_left_out(file: ModelFile) -> None:
    rollouts = as_the_model_has_it(file, 20)
    known = (file.model.known / file.model.scale)[:2]
    u = np.concatenate([known, rollouts.u[2:]])
    found = contact_calibration(file, replace(rollouts, u=u), 3, 500, 2.0, 1, lambda _: None)
    assert (found.learnt, len(found.predicted)) == (2, 30)
    assert found.summary()["left_out_because_trained_at"] == 2


def test_rollouts_come_to_one_place_from_many_and_are_the_same_again() -> None:
    robot = load_robot(TENDON_ARM).robot
    with ThreadPoolExecutor(1) as workers:
        first, again = (roll_out(robot, 4, 3, 7, workers, Unheard()) for _ in range(2))
    assert np.array_equal(first.centrelines_mm, again.centrelines_mm)
    assert first.centrelines_mm.shape[:2] == (4, 3)
    ends = first.centrelines_mm[:, :, -1].astype(float)
    within, between = ends.std(axis=1).max(), ends.mean(axis=1).std(axis=0).max()
    assert 0.0 < within < between, "where it came from shows, but less than where it is"
    body = EmulatedBody(robot)
    body.go(first.u[0])
    assert np.allclose(body.at, first.u[0])


def test_too_few_configurations_are_refused() -> None:
    robot = load_robot(TENDON_ARM).robot
    with ThreadPoolExecutor(1) as workers, pytest.raises(CollectionError, match="too few"):
        roll_out(robot, 3, 3, 1, workers, Unheard())
    with ThreadPoolExecutor(1) as workers, pytest.raises(CollectionError, match="no 'emulation'"):
        bare = robot.model_copy(update={"emulation": None})
        roll_out(bare, 3, 2, 1, workers, Unheard())
