"""The exploration stays where the tip may be, goes everywhere else, and ends."""

import numpy as np
import pytest

from config.control import Workspace
from config.loader import load_robot
from config.robot import Robot
from config.tasks.exploration import WaypointExploration
from daemon.array_files import ModelError
from daemon.control.controller import Observation
from daemon.controllers.exploration.exploration_controller import ExplorationController
from daemon.controllers.exploration.walls import Walls
from daemon.controllers.exploration.waypoint_exploration import WaypointExplorationController
from daemon.robot.coupled_axes import CoupledAxes
from drivers.pose import Vector
from tests import SHIPPED_ROBOTS
from tests.daemon.control.closed_loop import DT_S, ROBOT, ClosedLoop

TRAVEL_MM = 50.0
FRAMES_AT_MOST = 6000


def controller(
    seed: int = 1, robot: Robot = ROBOT, **options: float
) -> WaypointExplorationController:
    asked = {"kind": "waypoint_exploration", "waypoints": 10, **options}
    return WaypointExplorationController(WaypointExploration.model_validate(asked), robot, seed)


def explored(loop: ClosedLoop) -> tuple[Vector, Vector]:
    """Where axes and the true tip were, (n, 6) and (n, 3), from the start to the end."""
    loop.start()
    places: list[Vector] = []
    tips: list[Vector] = []
    for _ in range(FRAMES_AT_MOST):
        loop.step(loop.tip_mm, np.zeros(3))
        if loop.controller.ready:
            return np.array(places), np.array(tips)
        places.append(loop.u)
        tips.append(loop.body.tip.position_mm)
    raise AssertionError("it explores for ever")


@pytest.fixture(scope="module")
def arm() -> tuple[Vector, Vector]:
    return explored(ClosedLoop(controller()))


def test_the_tip_stays_in_its_workspace(arm: tuple[Vector, Vector]) -> None:
    box = ROBOT.workspace
    assert box is not None
    lowest, highest = np.array([box.x_mm, box.y_mm, box.z_mm]).T
    _, tips = arm
    assert (tips >= lowest).all()
    assert (tips <= highest).all()


def test_all_axes_are_used(arm: tuple[Vector, Vector]) -> None:
    places, tips = arm
    assert (np.ptp(places, axis=0) > 0.4 * TRAVEL_MM).all()
    assert (np.ptp(tips, axis=0)[:2] > 60.0).all()


def test_the_axes_are_kept_busy(arm: tuple[Vector, Vector]) -> None:
    places, _ = arm
    speeds = np.abs(np.diff(places, axis=0)).max(axis=1) / DT_S
    assert speeds.mean() > 0.5 * ROBOT.axes[0].max_velocity_mm_s  # type: ignore[union-attr]


def test_the_same_seed_goes_the_same_way_and_another_one_does_not() -> None:
    ways = [explored(ClosedLoop(controller(seed, waypoints=2)))[0] for seed in (1, 1, 2)]
    np.testing.assert_array_equal(ways[0], ways[1])
    assert len(ways[0]) != len(ways[2]) or not np.allclose(ways[0], ways[2])


def still(u: Vector, tip_mm: Vector, velocity_mm_s: Vector | None = None) -> Observation:
    velocity = np.zeros(3) if velocity_mm_s is None else velocity_mm_s
    return Observation(0, DT_S, u, u, tip_mm, velocity, tip_mm, np.zeros(3))


def walked(control: WaypointExplorationController, frames: int = 4000) -> Vector:
    """(n, 6) axes of a body whose tip stays in the middle of the workspace."""
    u, tip = np.full(6, 25.0), np.array([0.0, 0.0, 185.0])
    places = [u]
    control.reset(still(u, tip))
    for _ in range(frames):
        observation = still(u, tip)
        control.observe(observation)
        u = u + control.propose(observation).delta_u
        if control.ready:
            break
        places.append(u)
    return np.array(places)


def test_what_is_seen_while_it_is_held_teaches_it_nothing() -> None:
    """An hour in one place would count for more than all that was explored."""
    control, u = controller(waypoints=40), np.full(6, 25.0)
    control.reset(still(u, u[:3]))
    for _ in range(400):
        control.observe(still(u, u[:3]))
        u = u + control.propose(still(u, u[:3])).delta_u
    for _ in range(2):
        control.observe(still(u, u[:3]))
    places = np.random.default_rng(1).uniform(0.0, TRAVEL_MM, (20, 6))
    before = control._guess.at(places)
    for _ in range(1000):
        control.observe(still(u, u[:3] + 1.0))
    np.testing.assert_array_equal(control._guess.at(places), before)


def test_it_goes_to_as_many_places_as_asked_for_and_says_which() -> None:
    control, notes = controller(waypoints=3), []
    u, tip = np.full(6, 25.0), np.array([0.0, 0.0, 185.0])
    control.reset(still(u, tip))
    while not control.ready:
        proposal = control.propose(still(u, tip))
        u = u + proposal.delta_u
        notes.append(proposal.note)
    assert list(dict.fromkeys(notes)) == ["line 1 of 3", "line 2 of 3", "line 3 of 3", ""]
    np.testing.assert_array_equal(control.propose(still(u, tip)).delta_u, np.zeros(6))


def test_places_come_from_the_middle_share_of_the_travel() -> None:
    places = walked(controller(travel_share=0.4, waypoints=60, dither_share=0.0), frames=8000)
    assert np.ptp(places, axis=0) == pytest.approx(np.full(6, 18.0), abs=2.5)
    assert (np.abs(places - 25.0) <= 10.0 + 0.5).all()


@pytest.mark.parametrize(("every", "home"), [(8, ["9", "17"]), (5, ["6", "11", "16"]), (0, [])])
def test_now_and_then_a_line_leads_home_where_the_first_began(every: int, home: list[str]) -> None:
    control = controller(waypoints=18, home_every=every)
    u, tip = np.full(6, 3.0), np.array([0.0, 0.0, 185.0])
    control.reset(still(u, tip))
    ends: dict[str, Vector] = {}
    while not control.ready:
        proposal = control.propose(still(u, tip))
        u = u + proposal.delta_u
        ends[proposal.note] = u
    away = {note: float(np.abs(end - 3.0).max()) for note, end in ends.items() if note}
    assert [note.split()[1] for note, mm in away.items() if mm < 3.0] == home


def test_without_dither_steps_of_a_line_all_go_one_way_and_with_it_they_do_not() -> None:
    straight, dithered = (
        walked(controller(waypoints=1, dither_share=share)) for share in (0.0, 0.03)
    )
    assert spread_of_directions(straight) < 0.02
    assert spread_of_directions(dithered) > 0.1


def spread_of_directions(places: Vector) -> float:
    """Share of the steps' power outside their main direction."""
    steps = np.diff(places, axis=0)[20:-20]
    power = np.linalg.svd(steps, compute_uv=False) ** 2
    return float(1.0 - power[0] / power.sum())


def test_no_axis_leaves_its_travel_or_is_faster_than_it_may_be() -> None:
    places = walked(controller(waypoints=15, dither_share=0.2, speed_share=1.0))
    assert (places >= -1e-9).all()
    assert (places <= TRAVEL_MM + 1e-9).all()
    assert (np.abs(np.diff(places, axis=0)) <= 10.0 * DT_S + 1e-9).all()


def test_near_a_wall_it_goes_back_the_way_it_came() -> None:
    control = controller(waypoints=4, dither_share=0.0)
    u, tip = np.full(6, 25.0), np.array([0.0, 0.0, 185.0])
    control.reset(still(u, tip))
    trail = []
    for _ in range(60):
        trail.append(u)
        u = u + control.propose(still(u, tip)).delta_u
    at_the_wall = still(u, np.array([74.0, 0.0, 185.0]), np.array([20.0, 0.0, 0.0]))
    for _ in range(40):
        u = u + control.propose(still(u, at_the_wall.tip_mm, at_the_wall.tip_velocity_mm_s)).delta_u
    nearest = np.linalg.norm(np.array(trail) - u, axis=1)
    assert nearest.min() < 0.5
    assert int(np.argmin(nearest)) < 40


def test_where_the_way_back_leads_to_a_wall_as_well_it_goes_home() -> None:
    """A body with hysteresis goes back another way than its axes do."""
    control = controller(waypoints=9, dither_share=0.0)
    home = u = np.full(6, 25.0)
    inside, outwards = np.array([0.0, 0.0, 185.0]), np.array([20.0, 0.0, 0.0])
    at_the_wall, near_it = np.array([74.0, 0.0, 185.0]), np.array([66.0, 0.0, 185.0])
    control.reset(still(u, inside))
    way = []
    for tip, speed, steps in (
        (inside, 0.0 * outwards, 600),  # several lines
        (at_the_wall, outwards, 10),
        (near_it, -outwards, 20),
        (at_the_wall, outwards, 300),
    ):
        for _ in range(steps):
            way.append(u)
            u = u + control.propose(still(u, tip, speed)).delta_u
    met_again = np.array(way[645:])  # not where the axes still turn round
    straight = (home - met_again[0]) / np.linalg.norm(home - met_again[0])
    along = (met_again - home) @ straight
    aside = np.linalg.norm(met_again - home - np.outer(along, straight), axis=1)
    assert np.linalg.norm(met_again[0] - home) > 10.0
    assert aside.max() < 1.0
    assert np.linalg.norm(met_again[-1] - home) < 0.5


def test_while_the_axes_turn_round_the_same_wall_does_not_send_it_home() -> None:
    """Near and not near by turns: it goes back the way it came."""
    control = controller(waypoints=9, dither_share=0.0)
    u, inside, outwards = np.full(6, 25.0), np.array([0.0, 0.0, 185.0]), np.array([20.0, 0.0, 0.0])
    at_the_wall, near_it = np.array([74.0, 0.0, 185.0]), np.array([66.0, 0.0, 185.0])
    control.reset(still(u, inside))
    trail = []
    for _ in range(600):
        trail.append(u)
        u = u + control.propose(still(u, inside)).delta_u
    for step in range(36):  # less than a second
        tip, speed = (near_it, -outwards) if step % 4 == 3 else (at_the_wall, outwards)
        u = u + control.propose(still(u, tip, speed)).delta_u
        assert np.linalg.norm(np.array(trail) - u, axis=1).min() < 1.5
    assert np.linalg.norm(trail[-1] - u) > 1.0


def test_beside_the_wall_it_does_not_turn_back_while_it_comes_from_there() -> None:
    control = controller(waypoints=2, dither_share=0.0)
    u = np.full(6, 25.0)
    tip, inwards = np.array([79.0, 0.0, 185.0]), np.array([-20.0, 0.0, 0.0])
    control.reset(still(u, tip, inwards))
    start = u
    for _ in range(40):
        u = u + control.propose(still(u, tip, inwards)).delta_u
    assert np.linalg.norm(u - start) > 2.0


def test_a_hold_interrupts_a_line_and_does_not_end_it() -> None:
    control = controller(waypoints=2)
    u, tip = np.full(6, 25.0), np.array([0.0, 0.0, 185.0])
    control.reset(still(u, tip))
    for _ in range(20):
        u = u + control.propose(still(u, tip)).delta_u
    control.reset(still(u, tip))
    assert control.note == "line 1 of 2"
    assert np.abs(control.propose(still(u, tip)).delta_u).max() < 0.1


def test_a_line_that_something_stands_in_the_way_of_is_given_up_and_others_are_gone() -> None:
    """What lets no step through beyond a place of one axis, as a gate beside an obstacle does."""
    control, u = controller(waypoints=8), np.full(6, 25.0)
    tip = np.array([0.0, 0.0, 185.0])
    control.reset(still(u, tip))
    stood_s, places = 0.0, [u]
    for _ in range(FRAMES_AT_MOST):
        step = control.propose(still(u, tip)).delta_u
        if control.ready:
            break
        if (u + step)[0] > 30.0:
            stood_s, step = stood_s + DT_S, np.zeros(6)
        u = u + step
        places.append(u)
    assert control.ready and stood_s > 1.0, "some lines lead there, and all come to an end"
    assert (np.ptp(places, axis=0)[1:] > 0.4 * TRAVEL_MM).all(), "and the others are gone"


def test_a_robot_without_a_workspace_uses_all_of_its_travel() -> None:
    free = ROBOT.model_copy(update={"workspace": None})
    places = walked(controller(robot=free, waypoints=50, dither_share=0.0), frames=20_000)
    assert (np.ptp(places, axis=0) > 0.8 * TRAVEL_MM).all()


def test_walls_thicker_than_the_workspace_leave_some_of_it() -> None:
    small = Workspace(x_mm=(-4.0, 4.0), y_mm=(-4.0, 4.0), z_mm=(183.0, 187.0))
    tight = ROBOT.model_copy(update={"workspace": small})
    control = controller(robot=tight, waypoints=1)
    assert len(walked(control)) > 20
    assert control.ready


THREE_TENDONS = load_robot(SHIPPED_ROBOTS / "three_tendon_arm.yaml").robot
LOWEST_N, HIGHEST_N = THREE_TENDONS.axes[0].tension_range_n or (0.0, 0.0)


def pulled(
    control: ExplorationController, told: bool = True, gap: range = range(0)
) -> tuple[Vector, int]:
    """(n, 3) N that tendons have of 2 N and 0.5 N for each mm, and how many lines were gone; told:
    whether the exploration sees it, but for the first tendon's in a gap of steps."""
    u, tip, tensions = np.zeros(3), np.array([0.0, 0.0, 130.0]), []
    control.reset(still(u, tip))
    for _ in range(FRAMES_AT_MOST):
        tensions.append(2.0 + 0.5 * u)
        seen = tensions[-1].copy()
        if len(tensions) in gap:
            seen[0] = np.nan
        observation = still(u, tip)._replace(tensions_n=seen if told else None)
        control.observe(observation)
        u = u + control.propose(observation).delta_u
        if control.ready:
            break
    return np.array(tensions), control._line


def test_no_tendon_goes_slack_while_all_of_what_does_not_slacken_one_is_used() -> None:
    tensions, lines = pulled(controller(robot=THREE_TENDONS, waypoints=40))
    assert lines == 40
    assert tensions.min() > LOWEST_N
    assert (tensions.min(axis=0) < 1.2).all(), "all of them come near to it"
    assert (tensions.max(axis=0) > 3.4).all()
    blind, _ = pulled(controller(robot=THREE_TENDONS, waypoints=40), told=False)
    assert blind.min() < LOWEST_N, "who does not see it pulls them slack"


def test_no_tendon_is_torn_either() -> None:
    few = [axis.model_copy(update={"max_tension_n": 3.5}) for axis in THREE_TENDONS.axes]
    weak = THREE_TENDONS.model_copy(update={"axes": few})
    tensions, _ = pulled(controller(robot=weak, waypoints=40))
    assert tensions.max() < 3.5
    assert tensions.min() > LOWEST_N


def strung(strung_n: list[float], n_per_mm: float) -> tuple[ExplorationController, Vector]:
    """An exploration of tendons that are strung so, until its first line; (3,) how far they were
    pulled by then."""
    control, u, tip = controller(robot=THREE_TENDONS), np.zeros(3), np.array([0.0, 0.0, 130.0])
    seen = still(u, tip)._replace(tensions_n=np.array(strung_n))
    control.reset(seen)
    for k in range(400):
        if control._line >= 0:
            break
        seen = still(u, tip)._replace(tensions_n=np.array(strung_n) + n_per_mm * u)
        control.observe(seen)
        step = control.propose(seen).delta_u
        assert control._line >= 0 or (k < 200 and (step >= 0.0).all())
        u = u + step
    return control, u


def test_tendons_that_are_strung_loosely_are_pulled_before_the_first_line() -> None:
    """Each as far as it lacks. Lines then lead round where they were pulled to."""
    control, pulled_mm = strung([1.5, 1.9, 3.5], 3.0)
    tensions = np.array([1.5, 1.9, 3.5]) + 3.0 * pulled_mm
    assert tensions[:2].min() > 3.05 and tensions[:2].max() < 3.2
    assert pulled_mm[2] == pytest.approx(0.0, abs=0.02), "that one is tight"
    goals = np.array([control._draw() for _ in range(200)])
    np.testing.assert_allclose(goals.mean(axis=0), control._strung_by, atol=1.0)


def test_tendons_that_are_strung_as_they_should_be_are_left_so() -> None:
    control, pulled_mm = strung([3.0, 2.4, 4.0], 3.0)
    assert (pulled_mm == 0.0).all() and (control._strung_by == 0.0).all()


def test_a_tendon_that_gives_is_not_pulled_for_ever() -> None:
    control, pulled_mm = strung([1.0, 1.0, 1.0], 0.0)
    assert control._line == 0
    assert pulled_mm.max() < 5.0


def test_a_tension_that_was_not_known_for_a_moment_is_a_wall_again() -> None:
    control = controller(robot=THREE_TENDONS, waypoints=40)
    tensions, _ = pulled(control, gap=range(5, 10))
    assert tensions.min() > LOWEST_N
    keeping = control._tension_keeping
    assert keeping is not None
    assert np.isfinite(keeping.ahead(1.0)).all()


def test_a_wall_stands_back_behind_the_place_where_the_tip_is_first() -> None:
    walls = Walls(THREE_TENDONS, 5.0)
    values = np.array([[0.0, 0.0, z_mm, 4.0, 4.0, 4.0] for z_mm in (153.0, 154.5, 156.0)])
    assert (walls.beyond(values) > 0.0).all()
    walls.stand_back(np.array([0.0, 0.0, 150.0]))
    assert (walls.beyond(values) > 0.0).tolist() == [False, True, True]
    well_inside = Walls(THREE_TENDONS, 5.0)
    well_inside.stand_back(np.array([0.0, 0.0, 130.0]))
    assert (well_inside.beyond(values) > 0.0).all(), "nothing changes there"


def test_what_is_not_known_of_a_tension_is_no_wall() -> None:
    tensions, lines = pulled(controller(robot=THREE_TENDONS, waypoints=3), told=False)
    assert lines == 3
    assert np.ptp(tensions) > 3.0


def test_there_is_no_model_to_save_or_load(tmp_path: object) -> None:
    from pathlib import Path

    path = Path(str(tmp_path)) / "model.npz"
    with pytest.raises(ModelError, match="no model"):
        controller().save(path)
    with pytest.raises(ModelError, match="no model"):
        controller().load(path)


def test_what_is_not_finite_is_not_remembered() -> None:
    control = controller(waypoints=3)
    u, tip = np.full(6, 25.0), np.array([0.0, 0.0, 185.0])
    control.reset(still(u, tip))
    control.observe(still(u, np.full(3, np.nan)))
    control.observe(still(np.full(6, np.inf), tip))
    assert np.isfinite(walked(control)).all()


def test_waypoints_and_the_ways_between_keep_to_coupled_limits() -> None:
    robot = load_robot(SHIPPED_ROBOTS / "concentric_tubes.yaml").robot
    exploration = controller(robot=robot)
    coupled = CoupledAxes.of(robot)
    exploration._start = np.array([0.0, 0.0, 1.9, 8.0, -40.0])
    for _ in range(200):
        goal = exploration._draw()
        assert coupled.way_inside(exploration._start, goal)
        assert bool((goal != exploration._start).any())
        exploration._start = goal
    exploration._start = np.array([0.0, 0.0, np.pi, 9.9, -43.4])
    np.testing.assert_array_equal(exploration._draw(), exploration._start)  # no way out of there


def test_waypoints_of_tendons_bend_the_arm_and_do_not_tear_it() -> None:
    robot = load_robot(SHIPPED_ROBOTS / "three_tendon_arm.yaml").robot
    exploration = controller(robot=robot)
    exploration._start = np.zeros(3)
    goals = np.array([exploration._draw() for _ in range(100)])
    assert np.abs(goals.mean(axis=1)).max() < 0.5
    assert (np.ptp(goals, axis=0) > 12.0).all()
    free = controller(robot=robot, together_share=1.0)
    free._start = np.zeros(3)
    assert np.abs([free._draw().mean() for _ in range(100)]).max() > 3.0
