"""Trajectories: where they are, how fast, and how they end."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from config.tasks.trajectory import (
    Circle,
    Helix,
    Hold,
    Lissajous,
    RandomSmooth,
    Rectangle,
    Star,
    TrajectoryOptions,
    Waypoints,
)
from daemon.reference.trajectories import Trajectory, make_trajectory
from drivers.pose import Vector

HERE = Path()
CENTER = (1.0, -2.0, 185.0)
MIDDLE = np.array(CENTER)
RECTANGLE = Rectangle(
    kind="rectangle", center_mm=CENTER, width_mm=25.0, height_mm=100.0, cycle_s=50.0, cycles=3
)
PERIODIC: list[TrajectoryOptions] = [
    RECTANGLE,
    RECTANGLE.model_copy(update={"plane": "xz"}),
    Circle(kind="circle", center_mm=CENTER, radius_mm=20.0, plane="yz", cycle_s=30.0, cycles=2),
    Lissajous(
        kind="lissajous",
        center_mm=CENTER,
        amplitude_mm=(20.0, 30.0, 5.0),
        frequencies=(1, 2, 3),
        phases_rad=(0.1, 0.2, 0.3),
        cycle_s=40.0,
        cycles=2,
    ),
    Helix(
        kind="helix", center_mm=CENTER, radius_mm=15.0, turns=1.5, rise_mm=20.0, cycle_s=30.0,
        cycles=2,
    ),
    Star(
        kind="star", center_mm=CENTER, plane="xz", radius_mm=30.0, inner_radius_mm=12.0,
        cycle_s=30.0, cycles=2,
    ),
    RandomSmooth(
        kind="random_smooth", center_mm=CENTER, size_mm=(60.0, 40.0, 10.0), cycle_s=30.0, cycles=2
    ),
]  # fmt: skip


def made(options: TrajectoryOptions) -> Trajectory:
    return make_trajectory(options, HERE)


def test_a_rectangle_is_gone_round_at_constant_speed_with_sharp_corners() -> None:
    trajectory = made(RECTANGLE)
    speed = 250.0 / 50.0
    corners = [(-12.5, -50), (12.5, -50), (12.5, 50), (-12.5, 50), (-12.5, -50)]
    at_s = [0.0, 5.0, 25.0, 30.0, 50.0]
    for (x, y), t_s in zip(corners, at_s, strict=True):
        position, velocity = trajectory.at(t_s)
        np.testing.assert_allclose(position, MIDDLE + np.array([x, y, 0.0]), atol=1e-9)
        assert np.linalg.norm(velocity) == pytest.approx(speed)
    np.testing.assert_allclose(trajectory.at(2.5)[1], [speed, 0, 0], atol=1e-9)
    np.testing.assert_allclose(trajectory.at(15.0)[1], [0, speed, 0], atol=1e-9)


def test_cycles_are_counted_from_nought_and_end_at_the_last() -> None:
    trajectory = made(RECTANGLE)
    assert trajectory.duration_s == 150.0
    assert [trajectory.cycle_of(t) for t in (-1.0, 0.0, 49.9, 50.1, 149.9, 150.0, 1e6)] == [
        0, 0, 0, 1, 2, 2, 2,
    ]  # fmt: skip


@pytest.mark.parametrize("options", PERIODIC, ids=lambda options: options.kind)
def test_before_and_after_its_time_a_trajectory_stands_still(options: TrajectoryOptions) -> None:
    trajectory = made(options)
    for t_s, place in (
        (-1.0, trajectory.start_mm),
        (trajectory.duration_s, trajectory.end_mm),
        (1e6, trajectory.end_mm),
    ):
        position, velocity = trajectory.at(t_s)
        np.testing.assert_allclose(position, place, atol=1e-9)
        np.testing.assert_array_equal(velocity, 0.0)


@pytest.mark.parametrize("options", PERIODIC, ids=lambda options: options.kind)
def test_a_cycle_ends_where_it_began(options: TrajectoryOptions) -> None:
    trajectory = made(options)
    np.testing.assert_allclose(trajectory.end_mm, trajectory.start_mm, atol=1e-9)
    before, after = (trajectory.at(trajectory.cycle_s + dt)[0] for dt in (-1e-7, 1e-7))
    np.testing.assert_allclose(before, after, atol=1e-5)


@settings(max_examples=100, deadline=None)
@given(options=st.sampled_from(PERIODIC), share=st.floats(0.0, 1.0))
def test_the_velocity_is_how_the_position_changes(options: TrajectoryOptions, share: float) -> None:
    trajectory = made(options)
    t_s, h = share * (trajectory.duration_s - 1e-3), 1e-5
    position, velocity = trajectory.at(t_s)
    for ahead in (h, -h):
        if t_s + ahead >= 0.0:
            moved = trajectory.at(t_s + ahead)[0] - position
            if np.allclose(moved / ahead, velocity, atol=1e-3 * (1 + np.abs(velocity).max())):
                return  # at a corner one side is enough
    pytest.fail(f"velocity {velocity} at {t_s} s is none of the slopes there")


def test_what_is_handed_out_can_be_changed_by_who_has_it() -> None:
    trajectory = made(RECTANGLE)
    for t_s in (-1.0, 1.0, 1e9):
        position, velocity = trajectory.at(t_s)
        position += 100.0
        velocity += 100.0
        trajectory.start_mm[0] += 5.0
    np.testing.assert_allclose(trajectory.at(0.0)[0], MIDDLE + np.array([-12.5, -50.0, 0.0]))
    np.testing.assert_allclose(trajectory.at(1.0)[1], [5.0, 0.0, 0.0])


def test_a_star_has_its_points_on_one_circle_and_sharp_corners_between_them_on_another() -> None:
    star = made(
        Star(kind="star", center_mm=CENTER, radius_mm=30.0, inner_radius_mm=12.0, cycle_s=20.0)
    )
    np.testing.assert_allclose(star.start_mm, MIDDLE + np.array([30.0, 0.0, 0.0]), atol=1e-9)
    corners = np.array([star.in_cycle(t_s)[0] for t_s in star.corners_s]) - MIDDLE
    assert len(corners) == 11
    np.testing.assert_allclose(np.linalg.norm(corners[::2], axis=1), 30.0)
    np.testing.assert_allclose(np.linalg.norm(corners[1::2], axis=1), 12.0)
    speeds = [np.linalg.norm(star.in_cycle(t_s)[1]) for t_s in np.linspace(0.1, 19.9, 50)]
    np.testing.assert_allclose(speeds, speeds[0])


def test_a_random_path_fills_its_box_and_its_seed_says_which_it_is() -> None:
    options = RandomSmooth(
        kind="random_smooth", center_mm=CENTER, size_mm=(60.0, 40.0, 0.0), cycle_s=20.0, seed=3
    )
    times = np.linspace(0.0, 20.0, 4001)

    def course(seed: int) -> Vector:
        path = made(options.model_copy(update={"seed": seed}))
        points: Vector = np.array([path.in_cycle(t_s)[0] for t_s in times]) - MIDDLE
        return points

    points = course(3)
    np.testing.assert_allclose(points.max(axis=0), [30.0, 20.0, 0.0], atol=0.01)
    np.testing.assert_allclose(points.min(axis=0), [-30.0, -20.0, 0.0], atol=0.01)
    np.testing.assert_array_equal(points, course(3))
    assert np.abs(points - course(4)).max() > 5.0


def test_a_hold_holds() -> None:
    trajectory = made(Hold(kind="hold", position_mm=CENTER, duration_s=5.0))
    for t_s in (0.0, 2.0, 9.0):
        position, velocity = trajectory.at(t_s)
        np.testing.assert_array_equal(position, CENTER)
        np.testing.assert_array_equal(velocity, 0.0)
    assert trajectory.duration_s == 5.0


def test_cycles_can_be_asked_for_otherwise() -> None:
    assert make_trajectory(RECTANGLE, HERE, cycles=7).duration_s == 350.0
    with pytest.raises(ValueError, match="1 cycle or more"):
        make_trajectory(RECTANGLE, HERE, cycles=0)
    with pytest.raises(ValueError, match="take longer than"):
        make_trajectory(RECTANGLE, HERE, cycles=10**300)


@pytest.mark.parametrize(
    ("last", "why"),
    [
        ((4.0, 0.0, 5.0, 180.0, 0.0, 0.0, 1.0), "its end is 5.00 mm away from its beginning"),
        ((4.0, 0.0, 0.0, 180.0, 1.0, 0.0, 1.0), "at its end it points otherwise than"),
    ],
)
def test_what_does_not_end_as_it_begins_is_gone_along_once(
    last: tuple[float, ...], why: str
) -> None:
    first = (0.0, 0.0, 0.0, 180.0, 0.0, 0.0, 1.0)
    between = (2.0, 5.0, 0.0, 180.0, 0.0, 0.0, 1.0)
    rows = {"kind": "waypoints", "points": (first, between, last)}
    trajectory = made(Waypoints.model_validate(rows))
    assert not trajectory.closed
    assert trajectory.why_open.startswith(why)
    with pytest.raises(
        ValueError, match=r"the last point must be the first one|gone along 2 times"
    ):
        made(Waypoints.model_validate({**rows, "cycles": 2}))


def test_waypoints_are_met_at_their_times(tmp_path: Path) -> None:
    (tmp_path / "way.csv").write_text("t, x, y, z\n10, 0, 0, 180\n12, 4, 0, 180\n13,4,6,180\n")
    trajectory = make_trajectory(Waypoints(kind="waypoints", file="way.csv"), tmp_path)
    assert trajectory.duration_s == 3.0
    np.testing.assert_allclose(trajectory.at(0.0)[0], [0, 0, 180])
    position, velocity = trajectory.at(1.0)
    np.testing.assert_allclose(position, [2, 0, 180])
    np.testing.assert_allclose(velocity, [2, 0, 0])
    np.testing.assert_allclose(trajectory.at(2.5)[1], [0, 6, 0])
    np.testing.assert_allclose(trajectory.at(99.0)[0], [4, 6, 180])
