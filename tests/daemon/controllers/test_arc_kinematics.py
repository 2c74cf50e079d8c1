"""The constant-curvature model: geometry, Jacobian, and the conventions it shares with the arm."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from config.robot import Robot
from config.tasks.controllers import ConstantCurvature, GasChambers, VolumetricChambers
from daemon.control.controller import ControllerError
from daemon.controllers.constant_curvature import (
    ArcKinematics,
    ConstantCurvatureController,
    EnclosedGas,
    Volumetric,
    arc,
    arc_carries_by_bending,
    arc_end_by_shape,
)
from drivers.pose import Vector
from sim_backends.plants.plant import TipLoad
from tests.daemon.control.closed_loop import ROBOT, soft_arm

BORE_MM2 = np.full(3, np.pi / 4.0 * 25.0**2)
GAS = GasChambers(kind="gas")
BENDING = st.floats(-2.0, 2.0)
PISTONS = st.lists(st.floats(0.0, 50.0), min_size=6, max_size=6)


def kinematics(**options: Any) -> ArcKinematics:
    made = ConstantCurvature(kind="constant_curvature", **options)
    return ConstantCurvatureController(made, ROBOT).kinematics


def by_differences(function: Any, at: Vector, h: float = 1e-5) -> Vector:
    columns = [
        (function(at + h * unit) - function(at - h * unit)) / (2.0 * h) for unit in np.eye(len(at))
    ]
    return np.stack(columns, axis=-1)


def test_a_straight_segment_points_up() -> None:
    end, turn = arc(np.array([0.0, 0.0, 80.0]))
    np.testing.assert_array_equal(end, [0, 0, 80])
    np.testing.assert_array_equal(turn, np.eye(3))


def test_a_quarter_circle_ends_where_a_quarter_circle_ends() -> None:
    end, turn = arc(np.array([0.0, np.pi / 2, 80.0]))
    radius = 80.0 / (np.pi / 2)
    np.testing.assert_allclose(end, [0.0, radius, radius], atol=1e-9)
    np.testing.assert_allclose(turn @ [0, 0, 1], [0, 1, 0], atol=1e-12)


@settings(max_examples=50, deadline=None)
@given(x=BENDING, y=BENDING)
def test_a_segments_end_frame_is_a_rotation_without_twist(x: float, y: float) -> None:
    _, turn = arc(np.array([x, y, 80.0]))
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    np.testing.assert_allclose(turn @ [-y, x, 0.0], [-y, x, 0.0], atol=1e-9)


@pytest.mark.parametrize("size", [0.0, 1e-6, 0.0099, 0.0101, 0.1, 1.0, 3.0])
def test_derivatives_of_an_arc_are_right_near_the_straight_one_too(size: float) -> None:
    shape, point = np.array([0.6 * size, -0.8 * size, 80.0]), np.array([10.0, -20.0, 70.0])
    np.testing.assert_allclose(
        arc_end_by_shape(shape), by_differences(lambda s: arc(s)[0], shape), atol=1e-6
    )
    carried = by_differences(lambda s: arc(s)[1] @ point, shape)
    np.testing.assert_allclose(arc_carries_by_bending(shape, point), carried[:, :2], atol=1e-6)


@settings(max_examples=50, deadline=None)
@given(PISTONS)
def test_the_jacobian_is_the_derivative_of_the_tip(pistons: list[float]) -> None:
    model, u = kinematics(), np.array(pistons)
    numeric = by_differences(lambda v: model.tip(v)[0], u, 1e-4)
    np.testing.assert_allclose(model.tip(u)[1], numeric, atol=1e-5)


@settings(max_examples=20, deadline=None)
@given(PISTONS)
def test_the_jacobian_keeps_to_the_gains_and_the_linear_chambers(pistons: list[float]) -> None:
    model = kinematics(
        chambers=VolumetricChambers(kind="volumetric", elongation_mm_per_ml=0.8),
        bending_gain=0.9,
        elongation_gain=1.2,
        first_chamber_rad=(0.3, -0.4),
    )
    u = np.array(pistons)
    numeric = by_differences(lambda v: model.tip(v)[0], u, 1e-4)
    np.testing.assert_allclose(model.tip(u)[1], numeric, atol=1e-5)


def test_gains_change_what_they_say_and_nothing_else() -> None:
    straight = np.full(6, 20.0)
    plain, taller = kinematics(), kinematics(elongation_gain=1.5)
    rise = plain.tip(straight)[0][2] - 155.0
    assert taller.tip(straight)[0][2] - 155.0 == pytest.approx(1.5 * rise)
    weak = np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0])
    lateral = [kinematics(bending_gain=gain).tip(weak)[0][0] for gain in (1.0, 2.0)]
    assert lateral[1] == pytest.approx(2.0 * lateral[0], rel=1e-3)


def test_the_base_can_stand_elsewhere() -> None:
    offset = np.array([1.0, -2.0, 30.0])
    u = np.array([10.0, 0.0, 5.0, 20.0, 3.0, 0.0])
    np.testing.assert_allclose(
        kinematics(base_offset_mm=tuple(offset)).tip(u)[0], kinematics().tip(u)[0] + offset
    )


@pytest.mark.parametrize("axis", range(6))
def test_each_piston_moves_the_tip_the_way_it_moves_the_arms(axis: int) -> None:
    u = np.full(6, 20.0)
    u[axis] += 5.0
    real = soft_arm().step(u, TipLoad(), 60.0).tip.position_mm[:2]
    modelled = kinematics().tip(u)[0][:2]
    cosine = real @ modelled / np.linalg.norm(real) / np.linalg.norm(modelled)
    assert cosine > 0.99
    assert 0.6 < np.linalg.norm(modelled) / np.linalg.norm(real) < 1.2


def test_enclosed_gas_and_body_are_in_balance() -> None:
    length, radius, pistons = 77.5, 7.5, np.array([10.0, 25.0, 0.0])
    lengths, _ = EnclosedGas(GAS, length, radius, BORE_MM2).lengths(pistons)
    rest, _ = EnclosedGas(GAS, length, radius, BORE_MM2).lengths(np.zeros(3))
    pressure = (
        (0.04 + 0.101325) * (27.5e3 + 95.0 * rest) / (27.5e3 - BORE_MM2 * pistons + 95.0 * lengths)
    )
    push = 95.0 * (pressure - 0.101325)
    stretch = lengths.mean() / length - 1.0
    assert push.sum() == pytest.approx(130.0 * stretch)
    angles = 2.0 * np.pi / 3.0 * np.arange(3)
    directions = np.stack([np.cos(angles), np.sin(angles)])
    bending = -2.0 / (3.0 * radius) * directions @ lengths
    np.testing.assert_allclose(-radius * directions @ push, 8.0e3 * bending / length)


def test_the_balance_does_not_depend_on_where_it_was_before() -> None:
    gas = EnclosedGas(GAS, 77.5, 7.5, BORE_MM2)
    first, _ = gas.lengths(np.array([10.0, 25.0, 0.0]))
    gas.lengths(np.array([50.0, 0.0, 50.0]))
    again, _ = gas.lengths(np.array([10.0, 25.0, 0.0]))
    np.testing.assert_allclose(again, first, atol=1e-8)
    gas.lengths(np.full(3, np.nan))
    after_nonsense, _ = gas.lengths(np.array([10.0, 25.0, 0.0]))
    np.testing.assert_allclose(after_nonsense, first, atol=1e-8)


def test_volumetric_chambers_follow_the_volume() -> None:
    options = VolumetricChambers(kind="volumetric", elongation_mm_per_ml=2.0)
    lengths, slope = Volumetric(options, 77.5, BORE_MM2).lengths(np.array([0.0, 10.0, 20.0]))
    per_mm = 2.0 * BORE_MM2[0] * 1e-3
    np.testing.assert_allclose(lengths, 77.5 + per_mm * np.array([0.0, 10.0, 20.0]))
    np.testing.assert_allclose(slope, per_mm * np.eye(3))


@settings(max_examples=25, deadline=None)
@given(st.lists(st.floats(5.0, 45.0), min_size=6, max_size=6))
def test_what_the_model_can_reach_it_finds_a_way_to(pistons: list[float]) -> None:
    model = kinematics()
    goal = model.tip(np.array(pistons))[0]
    u, miss_mm = model.reach(goal, None)
    assert miss_mm < 0.5
    assert (u >= 0.0).all()
    assert (u <= 50.0).all()
    np.testing.assert_allclose(np.linalg.norm(model.tip(u)[0] - goal), miss_mm, atol=1e-6)


def test_what_is_out_of_reach_is_missed_by_how_far_it_is() -> None:
    model = kinematics()
    tallest = model.tip(np.full(6, 50.0))[0][2]
    _, miss_mm = model.reach(np.array([0.0, 0.0, tallest + 40.0]), None)
    assert miss_mm == pytest.approx(40.0, abs=1.0)


def changed_axes(axes: list[Any]) -> Robot:
    return ROBOT.model_copy(update={"axes": axes})


def test_a_robot_that_is_no_such_arm_is_refused() -> None:
    options = ConstantCurvature(kind="constant_curvature")
    with pytest.raises(
        ControllerError, match=r"for 6 chambers \(2 in segment_length_mm\), and soft_arm has 5 axes"
    ):
        ConstantCurvatureController(options, changed_axes(ROBOT.axes[:5]))
    bare = [axis.model_copy(update={"bore_mm": None}) for axis in ROBOT.axes]
    with pytest.raises(ControllerError, match="proximal_1 is none"):
        ConstantCurvatureController(options, changed_axes(bare))


def test_a_cylinder_that_is_too_small_for_its_stroke_is_refused() -> None:
    options = ConstantCurvature(
        kind="constant_curvature", chambers=GAS.model_copy(update={"supply_volume_ml": 10.0})
    )
    with pytest.raises(ControllerError, match="supply_volume_ml"):
        ConstantCurvatureController(options, ROBOT)
