"""The trajectory's own clock: it stands still while the robot does."""

from pathlib import Path

import numpy as np
import pytest

from config.tasks.trajectory import load_trajectory_options
from daemon.reference.reference import (
    Aim,
    Reference,
    TrajectoryReference,
)
from daemon.reference.teleoperation import TeleoperationReference
from daemon.reference.trajectories import Cycle, Trajectory, make_trajectory
from drivers.pose import Vector

MS = 1_000_000
TIP = np.array([0.0, 0.0, 180.0])
RUN_UP_S = 2.0


def rectangle(cycles: int = 2) -> TrajectoryReference:
    options = load_trajectory_options(
        {
            "kind": "rectangle",
            "center_mm": [0.0, 0.0, 180.0],
            "width_mm": 20.0,
            "height_mm": 40.0,
            "cycle_s": 12.0,
            "cycles": cycles,
        }
    )
    return TrajectoryReference(make_trajectory(options, Path()), blend_speed_mm_s=10.0)


def follow(reference: TrajectoryReference, seconds: float) -> list[tuple[float, ...]]:
    aims = [reference.advance(0, 0.025) for _ in range(round(seconds / 0.025))]
    return [(*aim.position_mm, aim.cycle) for aim in aims]


def test_the_tip_is_led_to_the_start_without_a_jump() -> None:
    reference = rectangle()
    reference.begin(TIP)
    before = TIP
    for _ in range(400):
        aim = reference.advance(0, 0.025)
        assert np.linalg.norm(aim.position_mm - before) < 0.5
        before = aim.position_mm
    assert aim.cycle == 0


@pytest.mark.parametrize(("least_s", "lasts_s"), [(30.0, 30.0), (0.1, None)])
def test_the_way_to_the_start_takes_no_less_than_the_axes_should_have(
    least_s: float, lasts_s: float | None
) -> None:
    hurried = rectangle()
    unhurried = TrajectoryReference(hurried.trajectory, 10.0, lambda way: least_s)
    durations = []
    for reference in (hurried, unhurried):
        reference.begin(TIP)
        steps = 0
        while reference.advance(0, 0.025).cycle < 0:
            steps += 1
        durations.append(0.025 * steps)
    expected_s = durations[0] if lasts_s is None else lasts_s + RUN_UP_S
    assert durations[1] == pytest.approx(expected_s, abs=0.03)


def test_while_it_waits_it_is_where_motion_began() -> None:
    reference = rectangle()
    reference.begin(TIP)
    aim = reference.wait()
    assert aim.position_mm.tolist() == TIP.tolist()
    assert aim.cycle == -1
    assert reference.elapsed_s == 0.0


def test_after_a_hold_it_goes_on_where_it_was() -> None:
    reference = rectangle()
    reference.begin(TIP)
    follow(reference, 10.0)
    elapsed_s = reference.elapsed_s
    there, _ = reference.trajectory.at(elapsed_s)
    reference.begin(there + np.array([3.0, 0.0, 0.0]))
    back = follow(reference, 0.2)
    assert all(cycle == -1 for *_, cycle in back)
    assert reference.elapsed_s == elapsed_s
    follow(reference, 5.0)
    assert reference.elapsed_s > elapsed_s


def test_it_is_finished_after_its_last_cycle_and_not_before() -> None:
    reference = rectangle(cycles=1)
    reference.begin(reference.trajectory.start_mm)
    while reference.advance(0, 0.025).cycle < 0:
        pass
    cycles = follow(reference, 11.9)
    assert not reference.finished
    assert {row[-1] for row in cycles} == {0}
    follow(reference, 0.2)
    assert reference.finished


PATHS: dict[str, dict[str, object]] = {
    "circle": {"kind": "circle", "center_mm": [0.0, 0.0, 180.0], "radius_mm": 20.0, "cycle_s": 4.0},
    "square": {
        "kind": "rectangle",
        "center_mm": [0.0, 0.0, 180.0],
        "width_mm": 20.0,
        "height_mm": 20.0,
        "cycle_s": 4.0,
    },
    "short": {"kind": "circle", "center_mm": [0.0, 0.0, 180.0], "radius_mm": 2.0, "cycle_s": 1.0},
}


@pytest.mark.parametrize("name", PATHS)
@pytest.mark.parametrize("held_after_s", [0.0, 0.3, 3.1])
def test_a_tip_comes_to_a_closed_path_along_the_path_itself_and_as_fast_as_it_goes_on(
    name: str, held_after_s: float
) -> None:
    trajectory = make_trajectory(load_trajectory_options({**PATHS[name], "cycles": 4}), Path())
    reference = TrajectoryReference(trajectory, blend_speed_mm_s=10.0)
    reference.elapsed_s = held_after_s
    there_mm, velocity = trajectory.at(held_after_s)
    reference.begin(TIP)
    way = []
    while (aim := reference.advance(0, 0.005)).cycle < 0:
        way.append(aim)
    speeds = [float(np.linalg.norm(aim.velocity_mm_s)) for aim in way]
    rest = max(k for k, speed in enumerate(speeds) if speed < 1e-3 * speeds[-1])
    assert RUN_UP_S / 8.0 < 0.005 * (len(way) - rest) < 1.1 * RUN_UP_S
    assert np.abs(np.diff(speeds[rest:])).max() < 0.05 * speeds[-1]
    np.testing.assert_allclose(way[-1].position_mm, there_mm, atol=0.006 * speeds[-1])
    assert speeds[-1] == pytest.approx(float(np.linalg.norm(velocity)), rel=0.01)
    places = np.array([trajectory.at(t)[0] for t in np.linspace(0.0, trajectory.cycle_s, 4001)])
    for aim in way[rest + 1 :]:
        assert np.linalg.norm(places - aim.position_mm, axis=1).min() < 0.05


def test_what_does_not_end_where_it_begins_is_begun_at_its_beginning() -> None:
    options = load_trajectory_options(
        {"kind": "circle", "center_mm": [0.0, 0.0, 180.0], "radius_mm": 20.0, "cycle_s": 4.0}
    )
    whole = make_trajectory(options, Path())
    half = Trajectory("half", Cycle(lambda t_s: whole.in_cycle(0.5 * t_s)), 4.0, 1)
    reference = TrajectoryReference(half, blend_speed_mm_s=10.0)
    reference.begin(half.start_mm)
    assert reference.advance(0, 0.025).cycle == 0
    follow(reference, 2.0)
    reference.begin(TIP)  # but where it was held, all before that leads there
    assert reference.ahead(1e3)[0] == pytest.approx(half.end_mm)
    while (aim := reference.advance(0, 0.005)).cycle < 0:
        last = aim
    np.testing.assert_allclose(last.velocity_mm_s, half.at(2.0)[1], atol=1.0)


def test_teleoperation_stands_where_it_began_until_the_first_setpoint() -> None:
    reference = TeleoperationReference(max_speed_mm_s=10.0, t_ns=0)
    reference.begin(TIP)
    assert reference.age_s(100 * MS) == pytest.approx(0.1)
    assert reference.advance(0, 0.025).position_mm.tolist() == TIP.tolist()


def test_a_setpoint_that_came_before_motion_began_counts() -> None:
    reference = TeleoperationReference(max_speed_mm_s=10.0, t_ns=0)
    reference.set(0, TIP + np.array([5.0, 0.0, 0.0]), 0.3, None)
    reference.begin(TIP)
    reference.advance(0, 0.025)
    assert reference.advance(25 * MS, 0.025).position_mm[0] == pytest.approx(0.25)


def test_who_waits_for_the_controller_says_that_a_hand_points() -> None:
    """It may have to find out first what turns the tip."""
    reference, along = TeleoperationReference(max_speed_mm_s=10.0, t_ns=0), np.array([0, 0, 1.0])
    reference.begin(TIP, along)
    assert reference.wait().direction is None
    reference.set(0, TIP, 0.3, None, np.array([0.0, 0.6, 0.8]))
    waiting = reference.wait()
    assert waiting.direction is not None and waiting.turn is not None
    assert waiting.direction.tolist() == along.tolist() and not waiting.turn.any()


def test_teleoperation_follows_no_faster_than_it_may_and_not_for_ever() -> None:
    reference = TeleoperationReference(max_speed_mm_s=10.0, t_ns=0)
    reference.begin(TIP)
    reference.advance(0, 0.025)
    reference.set(0, TIP + np.array([5.0, 0.0, 0.0]), 0.3, None)
    assert reference.age_s(100 * MS) == pytest.approx(0.1)
    moved = [reference.advance(t * 25 * MS, 0.025).position_mm[0] for t in range(1, 40)]
    assert max(np.diff([0.0, *moved])) <= 0.25 + 1e-9
    assert moved[-1] == pytest.approx(3.0, abs=0.26)  # 0.3 s at 10 mm/s, then it has expired
    assert reference.age_s(400 * MS) == np.inf


def test_a_setpoint_that_is_not_finite_changes_nothing() -> None:
    reference = TeleoperationReference(max_speed_mm_s=10.0, t_ns=0)
    reference.begin(TIP)
    with pytest.raises(ValueError, match="set-point needs"):
        reference.set(0, np.array([np.nan, 0.0, 0.0]), 0.3, None)
    assert reference.advance(25 * MS, 0.025).position_mm.tolist() == TIP.tolist()


def test_what_is_seen_ahead_is_what_comes_from_the_way_to_the_start_on() -> None:
    reference = rectangle(cycles=1)
    reference.begin(TIP)
    seen, came = [], []
    while not reference.finished:
        aim = reference.advance(0, 0.025)
        came.append((*aim.position_mm, *aim.velocity_mm_s))
        position, velocity = reference.ahead(20 * 0.025)
        seen.append((*position, *velocity))
    same = np.abs(np.array(came[20:]) - np.array(seen[:-20])).max(axis=1) < 1e-6
    assert same.mean() > 0.98  # but where a corner falls within a step
    np.testing.assert_allclose(seen[-1][3:], 0.0)
    np.testing.assert_allclose(seen[-1][:3], came[-1][:3], atol=1e-6)


@pytest.mark.parametrize("cycles", [1, 3])
def test_only_a_path_that_is_repeated_says_where_along_its_cycle_it_is(cycles: int) -> None:
    reference = rectangle(cycles=cycles)
    reference.begin(TIP)
    along = []
    while not reference.finished:
        aim = reference.advance(0, 0.025)
        along.append((aim.cycle, aim.in_cycle_s, aim.cycle_s))
    followed = [one for one in along if one[0] >= 0]
    assert all(one[1] is None for one in along if one[0] < 0)
    if cycles == 1:
        assert all(one[1] is None for one in followed)
        return
    total_s = [cycle * cycle_s + (in_cycle_s or 0.0) for cycle, in_cycle_s, cycle_s in followed]
    np.testing.assert_allclose(np.diff(total_s)[:-1], 0.025)


def test_nobody_sees_ahead_what_a_hand_will_do() -> None:
    reference: Reference = TeleoperationReference(10.0, 0)
    reference.begin(TIP)
    assert reference.ahead(0.5) is None


# Where the tip shall point, told by set-points.


def pointed(directions: list[Vector | None], turn_rad_s: float = 0.4) -> list[Aim]:
    """One after the other, each for half a second; the tip points up at first."""
    reference = TeleoperationReference(15.0, 0, turn_rad_s)
    reference.begin(np.zeros(3), np.array([0.0, 0.0, 1.0]))
    found, t_ns = [], 0
    for direction in directions:
        for _ in range(20):
            t_ns += 25_000_000
            reference.set(t_ns, np.zeros(3), 0.2, None, direction)
            found.append(reference.advance(t_ns, 0.025))
    return found


def test_a_direction_is_led_on_no_faster_than_it_may_turn() -> None:
    wanted = np.array([np.sin(0.15), 0.0, np.cos(0.15)])
    aims = pointed([wanted])
    first, last = aims[0], aims[-1]
    assert first.direction is not None
    assert first.turn is not None
    assert float(np.arcsin(first.direction[0])) == pytest.approx(0.4 * 0.025)
    assert float(np.linalg.norm(first.turn)) == pytest.approx(0.4, rel=1e-3)
    assert last.direction is not None
    assert last.turn is not None
    np.testing.assert_allclose(last.direction, wanted, atol=1e-9)
    np.testing.assert_allclose(last.turn, 0.0, atol=1e-6)


def test_set_points_without_a_direction_let_the_tip_point_anywhere() -> None:
    aims = pointed([None, np.array([0.0, 0.0, 1.0]), None])
    assert [aim.direction is None for aim in aims[::20]] == [True, False, True]


def test_a_direction_stays_when_its_set_point_is_over() -> None:
    reference = TeleoperationReference(15.0, 0)
    reference.begin(np.zeros(3), np.array([0.0, 0.0, 1.0]))
    reference.set(0, np.zeros(3), 0.1, None, np.array([1.0, 0.0, 0.0]))
    before = reference.advance(90_000_000, 0.09).direction
    after = reference.advance(900_000_000, 0.025)
    assert before is not None
    assert after.direction is not None
    assert after.turn is not None
    np.testing.assert_array_equal(after.direction, before)
    np.testing.assert_array_equal(after.turn, np.zeros(3))


def test_where_nobody_knows_where_the_tip_points_it_is_not_led() -> None:
    reference = TeleoperationReference(15.0, 0)
    reference.begin(np.zeros(3))
    reference.set(0, np.zeros(3), 0.1, None, np.array([1.0, 0.0, 0.0]))
    assert reference.advance(25_000_000, 0.025).direction is None
