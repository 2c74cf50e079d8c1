"""Small motions tell how late the body is, whatever else makes its tip come late on a path."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from config.emulation.plants import SoftArmPlant
from config.tasks.controllers import ForwardJacobian
from config.tasks.exploration import DesignedExploration
from config.tasks.trajectory import Circle
from daemon.control.lag.lagged_axes import LaggedAxes
from daemon.control.lag.probing import (
    ALIKE_S,
    AMPLITUDE_MM,
    PROBING_S,
    PROMPT_S,
    ProbedMotion,
    Probing,
    place_mm,
)
from daemon.controllers.forward_jacobian import ForwardJacobianController
from drivers.pose import Vector
from sim_backends.plants.soft_arm.soft_arm import SoftArm
from tests.daemon.control import closed_loop
from tests.daemon.control.closed_loop import (
    DT_S,
    PISTON_MM2,
    ROBOT,
    ClosedLoop,
    pretrained,
)

pytestmark = pytest.mark.xdist_group("pretrained_arm")  # which is explored once for all tests

AXES_AND_TRACKER_S = 0.03
"""Targets arrive a frame later, and the filter follows a jerk as much later; of both, half a frame
is the way that they are told evenly until then."""


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("model") / "arm.npz"
    pretrained(50, epochs=3).save(path)
    return str(path)


def arm(monkeypatch: pytest.MonkeyPatch, **figures: object) -> None:
    plant = SoftArmPlant.model_validate({"kind": "soft_arm", **figures})
    monkeypatch.setattr(closed_loop, "soft_arm", lambda _: SoftArm(plant, [PISTON_MM2] * 6))


def controller(model: str, probe: bool = True) -> ForwardJacobianController:
    options = ForwardJacobian(
        kind="forward_jacobian",
        model=model,
        lead=True,
        probe=probe,
        gain_per_s=6.0,
        max_tip_speed_mm_s=80.0,
    )
    return ForwardJacobianController(options, ROBOT, 1)


@pytest.mark.parametrize(
    ("dead_s", "gas_s", "hysteresis"),
    [(0.0, 0.1, 0.15), (0.03, 0.13, 0.4), (0.1, 0.3, 0.3), (0.25, 0.5, 0.4), (0.2, 0.7, 0.2)],
)
def test_the_lag_is_known_before_anything_is_followed(
    dead_s: float, gas_s: float, hysteresis: float, model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    figures = {"dead_time_s": dead_s, "pneumatic_lag_s": gas_s, "hysteresis": hysteresis}
    arm(monkeypatch, creep=0.2, backlash_mm=0.1, **figures)
    made = controller(model)
    loop = ClosedLoop(made)
    begun, begun_ns = loop.targets, loop.t_ns
    loop.start()
    assert not made.ready
    loop.explore()
    lag_s = made._follower.leading.lag.lag_s
    assert lag_s == pytest.approx(dead_s + gas_s + AXES_AND_TRACKER_S, rel=0.2, abs=0.06)
    lasts_s = PROMPT_S if lag_s < 0.25 else PROBING_S
    assert (loop.t_ns - begun_ns) * 1e-9 == pytest.approx(lasts_s, abs=3 * DT_S)
    np.testing.assert_allclose(loop.targets, begun, atol=1e-9)


def test_a_path_makes_it_no_longer(model: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A hysteresis that turns all the way round a circle looks like lag: it was taken for 0.35 s
    on this body, whose gas and line have 0.16 s."""
    arm(monkeypatch, dead_time_s=0.03, pneumatic_lag_s=0.13, hysteresis=0.4, creep=0.2)
    made = controller(model)
    loop = ClosedLoop(made)
    loop.start()
    loop.explore()
    loop.lead(np.array([30.0, 0.0, 185.0]))
    before_s = made._follower.leading.lag.lag_s
    circle = Circle(
        kind="circle", center_mm=(0.0, 0.0, 185.0), radius_mm=30.0, cycle_s=9.425, cycles=3
    )
    errors = loop.follow(circle).errors_mm
    assert made._follower.leading.lag.lag_s == before_s
    assert errors[: len(errors) // 3].mean() < 1.2


@pytest.mark.parametrize("dt_s", [0.015, 0.05, 0.1, 0.14])
def test_the_lag_is_known_as_well_where_the_tracker_is_slow(
    dt_s: float, model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of seven frames in a second and more."""
    arm(monkeypatch, dead_time_s=0.1, pneumatic_lag_s=0.3, hysteresis=0.3, creep=0.2)
    monkeypatch.setattr(closed_loop, "DT_S", dt_s)
    made = controller(model)
    loop = ClosedLoop(made)
    loop.start()
    loop.explore()
    lag_s = made._follower.leading.lag.lag_s
    assert 0.3 < lag_s < 0.6


def test_so_is_a_lag_of_a_second_through_which_little_of_the_steps_is_seen(
    model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    arm(monkeypatch, dead_time_s=0.2, pneumatic_lag_s=1.0, hysteresis=0.5, creep=0.2)
    made = controller(model)
    loop = ClosedLoop(made)
    loop.start()
    loop.explore()
    assert 0.7 < made._follower.leading.lag.lag_s < 1.4


def gone_through(probing: Probing, found_s: float | None, known_s: float) -> float:
    """Seconds until it is done, where the first direction tells the one and the model the other."""
    lasts_s = 0.0
    while not probing.done:
        if probing.asks:
            probing.answer(found_s, known_s)
        probing.made(probing.step(DT_S))
        lasts_s += DT_S
    return lasts_s


def test_a_prompt_body_and_a_long_lag_that_the_model_has_as_well_need_fewer_of_them() -> None:
    assert gone_through(Probing(), 0.8, 0.75) == pytest.approx(ALIKE_S, abs=2 * DT_S)
    assert gone_through(Probing(), 0.8, 0.13) == pytest.approx(PROBING_S, abs=2 * DT_S)
    for known_s in (0.13, 0.8):
        assert gone_through(Probing(), 0.13, known_s) == pytest.approx(PROMPT_S, abs=2 * DT_S)
    assert gone_through(Probing(), None, 0.8) == pytest.approx(PROBING_S, abs=2 * DT_S)


def test_exploring_and_probing_take_less_than_twenty_seconds_on_the_body_that_was_explored() -> (
    None
):
    explored_s = DesignedExploration(kind="designed_exploration").lasts_s(6)
    assert explored_s + max(PROMPT_S, ALIKE_S) < 20.0


def test_who_is_not_to_probe_follows_at_once(model: str) -> None:
    assert controller(model, probe=False).ready


def test_motion_that_was_interrupted_is_made_anew() -> None:
    probing = Probing()
    for _ in range(60):
        probing.made(probing.step(DT_S))
    probing.begin()
    assert probing.note == f"finds how late the body is: 0 of {PROBING_S:.0f} s"
    first = probing.step(DT_S)
    assert 0.0 < first @ place_mm(0.0) < place_mm(0.0) @ place_mm(0.0)
    np.testing.assert_array_equal(np.cross(first, place_mm(0.0)), 0.0)
    while not probing.done:
        probing.made(probing.step(DT_S))
    probing.begin()
    assert probing.done
    assert probing.note == ""


def test_every_direction_is_gone_out_and_back_and_the_end_is_at_rest_where_it_began() -> None:
    places = np.array([place_mm(t_s) for t_s in np.arange(0.0, PROBING_S, DT_S)])
    np.testing.assert_array_equal(places.max(axis=0), 3 * [AMPLITUDE_MM])
    np.testing.assert_array_equal(places.min(axis=0), 3 * [-AMPLITUDE_MM])
    assert not places[-40:].any()


# What the motions tell of the Jacobian that they were made by.


def probed(
    answers: Vector, lag_s: float = 0.13, dead_share: float = 0.3, noise_mm: float = 0.3
) -> ProbedMotion:
    """Probing in all three directions of a body whose tip goes by (3, 3) what it is told."""
    probed, shows, random = ProbedMotion(), LaggedAxes(np.ones(3)), np.random.default_rng(1)
    told = np.zeros(3)
    for t_s in np.arange(0.0, PROBING_S, DT_S):
        moved = place_mm(float(t_s)) - told
        told = told + moved
        tip_mm = answers @ shows.after(float(t_s), told, lag_s, dead_share)
        probed.see(float(t_s), moved, tip_mm + noise_mm * random.normal(size=3), True)
    return probed


def turned(angle_rad: float) -> Vector:
    """(3, 3) about z."""
    return np.asarray(Rotation.from_rotvec([0.0, 0.0, angle_rad]).as_matrix())


@pytest.mark.parametrize(
    "answers",
    [
        np.eye(3),
        0.4 * np.eye(3),
        np.diag([2.2, 2.0, 1.2]),
        np.diag([1.0, 1.0, 0.1]),
        np.zeros((3, 3)),
        0.8 * turned(0.6),
    ],
    ids=["right", "held back", "softer", "hardly upwards", "held fast", "turned a little"],
)
def test_a_body_that_answers_more_or_less_or_a_little_aside_is_the_models(answers: Vector) -> None:
    assert not probed(answers).contradicts(0.13, 0.3)


@pytest.mark.parametrize(
    "answers",
    [0.7 * turned(0.8), turned(1.6), turned(np.pi), np.diag([1.0, 1.0, -0.8])],
    ids=["turned", "crosswise", "the other way", "downwards for upwards"],
)
@pytest.mark.parametrize("lag_s", [0.13, 0.8])
def test_a_body_that_goes_elsewhere_is_another_one(answers: Vector, lag_s: float) -> None:
    assert probed(answers, lag_s).contradicts(lag_s, 0.3)


def test_where_the_tip_was_not_seen_nothing_is_told_of_the_body() -> None:
    unseen = ProbedMotion()
    unseen.see(0.0, np.ones(3), np.zeros(3), False)
    assert not unseen.contradicts(0.13, 0.3)
