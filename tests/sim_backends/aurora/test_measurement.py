"""The emulated tracker's errors are the ones that were asked for, and only those."""

import numpy as np
import pytest
from numpy.typing import NDArray

from config.emulation.lab import EmulatedTool, EmulatedTracker
from drivers.aurora.codec.status_bits import PortStatus
from drivers.pose import PlainPose, Pose, conjugate, multiply, rotate
from sim_backends.devices.aurora.measurement import (
    CENTRE_MM,
    HALF_WIDTH_MM,
    Measured,
    Sensing,
    SmoothField,
)
from tests.sim_backends.aurora.bench import BASE, EXACT, TIP, UPRIGHT

CENTRE = Pose(CENTRE_MM, UPRIGHT)
CORNER = Pose(CENTRE_MM + HALF_WIDTH_MM - 1.0, UPRIGHT)
FIVE = TIP.model_copy(update={"degrees_of_freedom": 5})


def sensing(seed: int = 0, **settings: float) -> Sensing:
    config = EmulatedTracker(tools=[TIP, BASE], **{**EXACT, **settings})
    return Sensing(config, np.random.SeedSequence(seed))


def readings(
    sensing: Sensing, pose: Pose, count: int, tool: EmulatedTool = TIP, fast: bool = False
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Position errors in mm (count, 3) and rotation errors in rad (count, 3)."""
    positions, turns = [], []
    for _ in range(count):
        found = sensing.measure(tool, pose.plain(), 0.025, fast).pose
        assert found is not None
        measured = found.vectors()
        positions.append(measured.position_mm - pose.position_mm)
        turns.append(2.0 * multiply(measured.quaternion, conjugate(pose.quaternion))[1:])
    return np.array(positions), np.array(turns)


def test_without_errors_the_truth_is_measured() -> None:
    positions, turns = readings(sensing(), CORNER, 10)
    assert positions == pytest.approx(0.0)
    assert turns == pytest.approx(0.0)


@pytest.mark.parametrize("seed", range(3))
def test_the_distortion_has_its_root_mean_square_over_the_volume(seed: int) -> None:
    random = np.random.default_rng(seed)
    field = SmoothField(0.8, random)
    points = CENTRE_MM + random.uniform(-HALF_WIDTH_MM, HALF_WIDTH_MM, size=(4000, 3))
    squares = [float(np.sum(field.at(point) ** 2)) for point in points]
    assert np.sqrt(np.mean(squares)) == pytest.approx(0.8, rel=0.12)


@pytest.mark.parametrize("seed", range(3))
def test_the_distortion_is_fixed_smooth_and_grows_towards_the_edge(seed: int) -> None:
    field = SmoothField(0.8, np.random.default_rng(seed))
    random = np.random.default_rng(seed + 100)
    directions = random.normal(size=(400, 3))
    directions /= np.abs(directions).max(axis=1, keepdims=True)
    inner = [np.linalg.norm(field.at(CENTRE_MM + 60.0 * d)) for d in directions]
    outer = [np.linalg.norm(field.at(CENTRE_MM + 245.0 * d)) for d in directions]
    assert np.mean(outer) > 2.0 * np.mean(inner)
    for point in CENTRE_MM + 240.0 * directions[:50]:
        assert field.at(point) == pytest.approx(field.at(point), abs=0.0)
        step = np.linalg.norm(field.at(point + 5.0) - field.at(point))
        assert step < 0.25  # over 8.7 mm: no place where a local model would break


def test_the_distortion_of_one_point_is_that_of_many() -> None:
    field = SmoothField(0.8, np.random.default_rng(1))
    points = CENTRE_MM + np.random.default_rng(2).uniform(-900.0, 900.0, size=(200, 3))
    one_by_one = [field.at_point(*point) for point in points.tolist()]
    np.testing.assert_allclose(one_by_one, field.at(points), atol=1e-12)


def test_repeated_readings_at_one_place_share_the_distortion() -> None:
    positions, turns = readings(sensing(distortion_rms_mm=0.8, distortion_rms_rad=0.012), CORNER, 5)
    assert np.ptp(positions, axis=0) == pytest.approx(0.0)
    assert np.linalg.norm(positions[0]) > 0.05
    assert np.linalg.norm(turns[0]) > 0.001


def test_jitter_has_its_size_at_300_mm_and_grows_with_the_distance() -> None:
    near = Pose(np.array([0.0, 0.0, -100.0]), UPRIGHT)
    far = Pose(np.array([0.0, 0.0, -500.0]), UPRIGHT)
    spread = {}
    for name, pose in {"near": near, "centre": CENTRE, "far": far}.items():
        positions, turns = readings(sensing(jitter_mm=0.1, jitter_rad=0.0013), pose, 2000)
        spread[name] = float(positions.std())
        assert turns.std() / positions.std() == pytest.approx(0.013, rel=0.05)
    assert spread["centre"] == pytest.approx(0.1, rel=0.05)
    assert spread["near"] < 0.6 * spread["centre"] < spread["far"] / 1.5


def test_fast_mode_doubles_the_jitter() -> None:
    slow, _ = readings(sensing(jitter_mm=0.1), CENTRE, 1000)
    fast, _ = readings(sensing(jitter_mm=0.1), CENTRE, 1000, fast=True)
    assert fast == pytest.approx(2.0 * slow)


def test_outliers_come_as_often_and_as_far_as_configured() -> None:
    positions, _ = readings(sensing(outliers_per_s=2.0), CENTRE, 4000)
    lengths = np.linalg.norm(positions, axis=1)
    found = lengths[lengths > 1e-9]
    assert len(found) == pytest.approx(2.0 * 0.025 * 4000, rel=0.2)
    assert 5.0 <= found.min() <= found.max() <= 50.0


def test_a_sensor_with_one_coil_cannot_tell_its_roll() -> None:
    axis = np.array([0.3, -0.5, 0.8])
    axis /= np.linalg.norm(axis)
    rolls = []
    for angle in (0.0, 1.0, 2.0):
        tilt = np.array([0.9, 0.3, -0.3, 0.1])
        tilt /= np.linalg.norm(tilt)
        roll = np.array([np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)])
        true = Pose(CENTRE_MM, multiply(tilt, roll))
        measured = sensing().measure(FIVE, true.plain(), 0.025, False)
        assert measured.pose is not None
        z = np.array([0.0, 0.0, 1.0])
        assert rotate(np.array(measured.pose.quaternion), z) == pytest.approx(
            rotate(true.quaternion, z)
        )
        assert measured.indicator == 0.0
        rolls.append(measured.pose.quaternion)
    assert rolls[1] == pytest.approx(rolls[0])
    assert rolls[2] == pytest.approx(rolls[0])


def test_a_sensor_that_points_straight_down_is_measured_too() -> None:
    true = Pose(CENTRE_MM, np.array([0.0, 1.0, 0.0, 0.0]))
    measured = sensing().measure(FIVE, true.plain(), 0.025, False)
    assert measured.pose is not None
    z = np.array([0.0, 0.0, 1.0])
    assert rotate(np.array(measured.pose.quaternion), z) == pytest.approx([0.0, 0.0, -1.0])


EDGE_Z = -50.0


@pytest.mark.parametrize(
    ("tool", "z_mm", "flags"),
    [
        (TIP, EDGE_Z - 10.0, PortStatus(0)),
        (TIP, EDGE_Z, PortStatus.PARTIALLY_OUT_OF_VOLUME),
        (TIP, EDGE_Z + 10.0, PortStatus.OUT_OF_VOLUME),
        (FIVE, EDGE_Z - 1.0, PortStatus(0)),
        (FIVE, EDGE_Z + 1.0, PortStatus.OUT_OF_VOLUME),
        (TIP, -560.0, PortStatus.OUT_OF_VOLUME),
    ],
)
def test_the_volume_ends_where_the_maker_says(
    tool: EmulatedTool, z_mm: float, flags: PortStatus
) -> None:
    measured: Measured = sensing().measure(
        tool, PlainPose((0.0, 0.0, z_mm), (1.0, 0.0, 0.0, 0.0)), 0.025, False
    )
    assert measured.flags == flags


def test_equal_seeds_give_equal_readings_and_other_seeds_others() -> None:
    settings = {"distortion_rms_mm": 0.8, "jitter_mm": 0.1, "outliers_per_s": 1.0}
    first, _ = readings(sensing(1, **settings), CENTRE, 50)
    again, _ = readings(sensing(1, **settings), CENTRE, 50)
    other, _ = readings(sensing(2, **settings), CENTRE, 50)
    assert (first == again).all()
    assert not (first == other).any()
