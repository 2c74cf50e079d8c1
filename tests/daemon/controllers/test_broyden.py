"""The controller without a model: its first motions, its corrections, and its file."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from config.robot import Robot
from config.tasks.controllers import Broyden, ConstantCurvature
from daemon.array_files import ModelError
from daemon.control.controller import ControllerError, Observation
from daemon.controllers.broyden import BroydenController
from daemon.controllers.constant_curvature import ConstantCurvatureController
from drivers.pose import Vector
from tests.daemon.control.closed_loop import DT_S, ROBOT

OPTIONS = Broyden(kind="broyden")


@dataclass
class LinearRobot:
    """Any number of axes, a tip that moves with them in proportion, a controller and noise."""

    robot: Robot = ROBOT
    options: Broyden = OPTIONS
    noise_mm: float = 0.2
    drift_mm_s: float = 0.0
    seed: int = 4

    def __post_init__(self) -> None:
        self.generator = np.random.default_rng(self.seed)
        self.count = len(self.robot.axes)
        self.jacobian = 3.0 * np.random.default_rng(9).normal(size=(3, self.count))
        self.controller = BroydenController(self.options, self.robot)
        self.targets = np.full(self.count, 10.0)
        self.frames = 0
        self.stuck: int | None = None

    @property
    def truth_mm(self) -> Vector:
        drift = self.drift_mm_s * DT_S * self.frames
        moved = self.jacobian @ (self.targets - 10.0)
        return np.asarray(moved + np.array([0.0, 0.0, drift]))

    def seen(self, reference_mm: Vector | None = None) -> Observation:
        tip = self.truth_mm + self.noise_mm * self.generator.normal(size=3)
        return Observation(
            t_ns=round(self.frames * DT_S * 1e9),
            dt_s=DT_S,
            u=self.targets.copy(),
            targets=self.targets.copy(),
            tip_mm=tip,
            tip_velocity_mm_s=np.zeros(3),
            reference_mm=tip if reference_mm is None else reference_mm,
            reference_velocity_mm_s=np.zeros(3),
        )

    def step(self, reference_mm: Vector | None = None) -> Vector:
        self.frames += 1
        observation = self.seen(reference_mm)
        self.controller.observe(observation)
        step = self.controller.propose(observation).delta_u.copy()
        if self.stuck is not None:
            step[self.stuck] = 0.0
        self.targets = self.targets + step
        return step

    def explore(self) -> None:
        self.controller.reset(self.seen())
        for _ in range(3000):
            if self.controller.ready:
                return
            self.step()
        raise AssertionError("explores for ever")

    @property
    def error(self) -> float:
        """Of the controller's Jacobian, relative."""
        found = self.controller.jacobian
        assert found is not None
        return float(np.linalg.norm(found - self.jacobian) / np.linalg.norm(self.jacobian))


def with_axes(count: int) -> Robot:
    return ROBOT.model_copy(update={"axes": ROBOT.axes[:count]})


@pytest.mark.parametrize("count", [2, 3, 5, 6])
def test_exploration_finds_the_jacobian_in_spite_of_noise(count: int) -> None:
    loop = LinearRobot(robot=with_axes(count))
    loop.explore()
    assert loop.error < 0.03


@pytest.mark.parametrize("together", [True, False])
def test_a_steady_drift_does_not_disturb_it(together: bool) -> None:
    options = OPTIONS.model_copy(update={"explore_together": together})
    loop = LinearRobot(options=options, noise_mm=0.0, drift_mm_s=0.5)
    loop.explore()
    assert loop.error < 1e-6


def test_exploration_is_small_slow_and_ends_where_it_began() -> None:
    loop = LinearRobot()
    before = loop.targets
    loop.controller.reset(loop.seen())
    farthest, fastest = 0.0, 0.0
    for _ in range(3000):
        if loop.controller.ready:
            break
        fastest = max(fastest, float(np.abs(loop.step()).max()))
        farthest = max(farthest, float(np.abs(loop.targets - before).max()))
    assert farthest <= OPTIONS.explore_share * 50.0 + 1e-9
    assert fastest <= OPTIONS.explore_speed_share * 10.0 * DT_S + 1e-9
    np.testing.assert_allclose(loop.targets, before, atol=0.1 * OPTIONS.explore_share * 50.0)


def test_where_there_is_no_room_outwards_it_goes_inwards() -> None:
    loop = LinearRobot()
    loop.targets = np.array([50.0, 10.0, 49.0, 0.0, 10.0, 50.0])
    loop.controller.reset(loop.seen())
    while not loop.controller.ready:
        loop.step()
        assert (loop.targets >= 0.0).all()
        assert (loop.targets <= 50.0).all()
    assert loop.error < 0.03


def test_it_says_what_it_is_doing() -> None:
    loop = LinearRobot()
    loop.controller.reset(loop.seen())
    assert "proximal_1" in loop.controller.propose(loop.seen()).note
    loop.explore()
    assert loop.controller.propose(loop.seen()).note == ""


def test_an_axis_that_does_not_move_is_named() -> None:
    loop = LinearRobot()
    loop.stuck = 2
    with pytest.raises(ControllerError, match=r"proximal_3 was to go to 13 mm, and is at 10"):
        loop.explore()


def test_most_of_an_excursion_tells_enough_where_no_more_of_it_is_let_through() -> None:
    """As beside an obstacle: each axis was to go from 10 to 13 mm, and goes to 12."""
    loop = LinearRobot()
    loop.controller.reset(loop.seen())
    while not loop.controller.ready:
        loop.step()
        loop.targets = np.minimum(loop.targets, 12.0)
    assert loop.error < 0.03


def test_an_interruption_repeats_only_the_excursion_it_broke() -> None:
    loop = LinearRobot()
    loop.controller.reset(loop.seen())
    while "proximal_3" not in loop.controller.propose(loop.seen()).note:
        loop.step()
    for _ in range(40):
        loop.step()
    loop.targets = loop.targets + 2.0
    loop.controller.reset(loop.seen())
    assert "proximal_3" in loop.controller.propose(loop.seen()).note
    while not loop.controller.ready:
        loop.step()
    assert loop.error < 0.03


def test_however_often_it_is_interrupted_it_goes_no_farther_out() -> None:
    loop = LinearRobot()
    before, amplitude = loop.targets, OPTIONS.explore_share * 50.0
    for _ in range(8):
        loop.controller.reset(loop.seen())
        for _ in range(200):
            loop.step()
            if np.abs(loop.targets - before).max() > 0.5 * amplitude:
                break
    loop.explore()
    assert np.abs(loop.targets - before).max() <= 0.2 * amplitude
    assert loop.error < 0.03


def test_where_it_was_carried_elsewhere_meanwhile_it_begins_there() -> None:
    loop = LinearRobot()
    loop.controller.reset(loop.seen())
    for _ in range(60):
        loop.step()
    loop.targets = loop.targets + 9.0
    before, amplitude = loop.targets, OPTIONS.explore_share * 50.0
    loop.explore()
    assert np.abs(loop.targets - before).max() <= 0.2 * amplitude


class LateRobot(LinearRobot):
    """Its tip follows with a dead time and a first-order lag."""

    dead_s, first_order_s = 0.0, 0.5
    shown: Vector | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        self.told = [self.targets]

    @property
    def truth_mm(self) -> Vector:
        self.told.append(self.targets)
        due = self.told[max(0, len(self.told) - 1 - round(self.dead_s / DT_S))]
        before = due if self.shown is None else self.shown
        self.shown = before + (1.0 - np.exp(-DT_S / self.first_order_s)) * (due - before)
        return np.asarray(self.jacobian @ (self.shown - 10.0))


def found_lag_s(loop: LinearRobot) -> float:
    """After the first motions, and what is worked out in spare time."""
    loop.controller.reset(loop.seen())
    while not loop.controller.ready:
        loop.step()
        loop.controller.learn()
    return loop.controller._follower.leading.lag.lag_s


def test_however_long_it_is_held_in_its_first_motions_they_tell_how_late_the_body_is() -> None:
    options = OPTIONS.model_copy(update={"lead": True})
    held, not_held = LateRobot(options=options), LateRobot(options=options)
    held.controller.reset(held.seen())
    for _ in range(16):
        held.step()
    for _ in range(6000):
        held.frames += 1
        held.controller.observe(held.seen())
    assert found_lag_s(held) == pytest.approx(found_lag_s(not_held), abs=0.05)


@pytest.mark.parametrize("seed", range(3))
def test_of_a_body_that_is_later_than_its_rests_all_that_comes_is_measured(seed: int) -> None:
    """Of 3 mm out, 1 to 2 mm at the tip, two thirds come when the axis is on its way back."""
    loop = LateRobot(options=OPTIONS.model_copy(update={"lead": True}), seed=seed)
    loop.dead_s, loop.first_order_s, loop.jacobian = 0.25, 0.75, 0.15 * loop.jacobian
    assert found_lag_s(loop) == pytest.approx(1.0, abs=0.15)
    assert loop.error < 0.2


class LatePointingRobot(LateRobot):
    """Its tip turns by 0.02 rad for each mm that it goes aside."""

    points = False

    def seen(self, reference_mm: Vector | None = None) -> Observation:
        seen = super().seen(reference_mm)
        assert self.shown is not None
        aside = 0.02 * self.jacobian[:2] @ (self.shown - 10.0)
        along = np.append(aside, 1.0) / np.linalg.norm([*aside, 1.0])
        wanted = along if self.points else None
        return seen._replace(tip_direction=along, reference_direction=wanted)


def test_what_turns_the_tip_of_a_late_body_is_all_that_comes_too() -> None:
    loop = LatePointingRobot(options=OPTIONS.model_copy(update={"lead": True}))
    loop.dead_s, loop.first_order_s, loop.jacobian = 0.25, 0.75, 0.3 * loop.jacobian
    found_lag_s(loop)
    loop.points = True
    loop.controller.observe(loop.seen())
    found, truth = loop.controller.jacobian, OPTIONS.pointing_mm_per_rad * 0.02 * loop.jacobian[:2]
    assert found is not None
    assert np.linalg.norm(found[3:5] - truth) < 0.25 * np.linalg.norm(truth)


@pytest.mark.parametrize(("stiffer", "widest"), [(1.0, 0.06), (30.0, 0.12), (100.0, 0.25)])
def test_where_little_comes_of_first_motions_they_are_made_anew_and_wider(
    stiffer: float, widest: float
) -> None:
    loop = LinearRobot(options=OPTIONS.model_copy(update={"lead": True}))
    loop.jacobian = loop.jacobian / stiffer
    loop.controller.reset(loop.seen())
    farthest = np.zeros(loop.count)
    while not loop.controller.ready:
        loop.step()
        loop.controller.learn()
        farthest = np.maximum(farthest, np.abs(loop.targets - 10.0))
    scale = loop.controller._scale
    np.testing.assert_allclose(farthest, widest * scale, rtol=0.15)
    assert loop.error < 0.4


def test_how_late_the_body_is_is_kept_in_its_file(tmp_path: Path) -> None:
    """Nothing but first motions tells it at once, and who loads a file makes none: taken for prompt
    a body that is half a second late is swung up."""
    options = OPTIONS.model_copy(update={"lead": True})
    loop = LateRobot(options=options)
    lag_s = found_lag_s(loop)
    assert lag_s > 0.3
    loop.controller.save(tmp_path / "broyden.npz")
    for also in (options, OPTIONS):  # who does not lead has no use for it
        again = BroydenController(also, ROBOT)
        again.load(tmp_path / "broyden.npz")
        assert again._follower.leading.lag.lag_s == lag_s


def test_what_is_seen_while_it_is_held_is_not_kept() -> None:
    loop = LinearRobot()
    loop.controller.reset(loop.seen())
    for _ in range(16):
        loop.step()
    before = sum(map(len, loop.controller._excursions._rests))
    for _ in range(1000):
        loop.frames += 1
        loop.controller.observe(loop.seen())
    assert sum(map(len, loop.controller._excursions._rests)) <= before + 1


def test_the_tip_is_brought_to_the_reference() -> None:
    loop = LinearRobot(noise_mm=0.05)
    loop.explore()
    goal = loop.truth_mm + np.array([8.0, -6.0, 4.0])
    for _ in range(200):
        loop.step(goal)
    assert np.linalg.norm(loop.truth_mm - goal) < 0.3


def test_a_body_that_has_changed_is_learnt_while_it_moves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    errors = []
    for updating in (True, False):
        loop = LinearRobot(noise_mm=0.1)
        loop.explore()
        start = loop.truth_mm
        # The body now turns what it did by 50° about z: feedback alone still gets there.
        turn = np.array([[0.64, -0.77, 0.0], [0.77, 0.64, 0.0], [0.0, 0.0, 1.0]])
        loop.jacobian = turn @ loop.jacobian
        offset = start - loop.truth_mm
        if not updating:
            monkeypatch.setattr(loop.controller, "observe", lambda observation: None)
        for k in range(1500):
            angle = 2.0 * np.pi * k / 300.0
            circle = 10.0 * np.array([np.cos(angle) - 1.0, np.sin(angle), 0.3 * np.sin(angle)])
            loop.step(start - offset + circle)
        errors.append(loop.error)
    learnt, left = errors
    assert left > 0.4
    assert learnt < 0.5 * left


def test_noise_alone_teaches_nothing() -> None:
    loop = LinearRobot()
    loop.explore()
    before = loop.controller.jacobian
    for _ in range(400):
        loop.controller.observe(loop.seen())
        loop.frames += 1
    np.testing.assert_array_equal(loop.controller.jacobian, before)


def test_a_frame_that_is_not_a_number_teaches_nothing() -> None:
    loop = LinearRobot()
    loop.explore()
    before = loop.controller.jacobian
    for bad in (np.full(3, np.nan), np.array([0.0, np.inf, 0.0])):
        loop.controller.observe(loop.seen()._replace(tip_mm=bad))
    loop.controller.observe(loop.seen()._replace(u=np.full(6, np.nan)))
    np.testing.assert_array_equal(loop.controller.jacobian, before)


def test_a_tip_that_is_only_extrapolated_teaches_nothing() -> None:
    loop = LinearRobot()
    loop.explore()
    before = loop.controller.jacobian
    elsewhere = loop.seen()
    for share in (0.1, 0.2, 0.3):
        loop.controller.observe(
            elsewhere._replace(
                u=elsewhere.u + share, tip_mm=elsewhere.tip_mm - 50.0 * share, believed=False
            )
        )
    loop.controller.observe(elsewhere)
    np.testing.assert_array_equal(loop.controller.jacobian, before)


def test_what_was_learnt_goes_on_from_a_file_without_exploring(tmp_path: Path) -> None:
    loop = LinearRobot()
    loop.explore()
    loop.controller.save(tmp_path / "broyden.npz")
    again = LinearRobot()
    again.controller.load(tmp_path / "broyden.npz")
    assert again.controller.ready
    assert again.error == loop.error


def test_directions_in_a_file_mean_the_same_however_much_they_count(tmp_path: Path) -> None:
    jacobian = np.random.default_rng(3).normal(size=(6, 6))
    saved = BroydenController(OPTIONS, ROBOT)
    saved._begin(jacobian, np.eye(6))
    saved.save(tmp_path / "broyden.npz")
    written, per_rad = saved.jacobian, []
    assert written is not None
    for mm_per_rad in (OPTIONS.pointing_mm_per_rad, 100.0):
        options = OPTIONS.model_copy(update={"pointing_mm_per_rad": mm_per_rad})
        loaded = BroydenController(options, ROBOT)
        loaded.load(tmp_path / "broyden.npz")
        found = loaded.jacobian
        assert found is not None
        np.testing.assert_array_equal(found[:3], written[:3])
        per_rad.append(found[3:] / mm_per_rad)
    np.testing.assert_allclose(per_rad[1], per_rad[0])
    np.testing.assert_allclose(per_rad[0] * OPTIONS.pointing_mm_per_rad, written[3:])


def test_before_there_is_a_jacobian_there_is_nothing_to_save(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="nothing to save"):
        BroydenController(OPTIONS, ROBOT).save(tmp_path / "broyden.npz")
    assert not list(tmp_path.iterdir())


def test_a_model_of_another_robot_or_controller_is_refused(tmp_path: Path) -> None:
    loop = LinearRobot()
    loop.explore()
    path = tmp_path / "broyden.npz"
    loop.controller.save(path)
    other = ROBOT.model_copy(update={"robot": "other_arm"})
    with pytest.raises(ModelError, match="its robot is 'soft_arm', not 'other_arm'"):
        BroydenController(OPTIONS, other).load(path)
    with pytest.raises(ModelError, match="its axes is"):
        BroydenController(OPTIONS, with_axes(5)).load(path)
    analytic = ConstantCurvatureController(ConstantCurvature(kind="constant_curvature"), ROBOT)
    with pytest.raises(ModelError, match="its controller is 'broyden'"):
        analytic.load(path)
    analytic.save(tmp_path / "arcs.npz")
    analytic.load(tmp_path / "arcs.npz")


@pytest.mark.parametrize("content", [b"", b"not a model", b"PK\x03\x04 broken"])
def test_a_file_that_is_no_model_is_refused_and_nothing_changes(
    tmp_path: Path, content: bytes
) -> None:
    path = tmp_path / "broken.npz"
    path.write_bytes(content)
    controller = BroydenController(OPTIONS, ROBOT)
    with pytest.raises(ModelError, match=r"broken\.npz"):
        controller.load(path)
    assert not controller.ready


def test_a_late_frame_in_exploration_does_not_make_an_axis_leap() -> None:
    loop = LinearRobot()
    loop.controller.reset(loop.seen())
    for _ in range(60):
        late = loop.seen()._replace(dt_s=30.0)
        step = loop.controller.propose(late).delta_u
        assert np.abs(step).max() <= 10.0 * 0.1
        loop.controller.observe(late)
        loop.targets = loop.targets + step
        loop.frames += 1
