"""First motions tell how late a body is that nobody knows, and are given again as it shows them."""

from collections.abc import Sequence

import numpy as np
import pytest

from config.tasks.exploration import MotorBabbling
from daemon.control.controller import Observation
from daemon.control.lag.body_lag import parts
from daemon.controllers.exploration.first_motions import FirstMotions
from daemon.controllers.exploration.motor_babbling import Babbling
from daemon.robot.axes import AxisRanges
from tests.daemon.control.closed_loop import DT_S, ROBOT

AXES = AxisRanges.of(ROBOT)
EXPECTED_S = 0.1
NOISE_MM = 0.1
JACOBIAN = 1.5 * np.random.default_rng(3).normal(size=(3, 6))


def babbled(
    lag_s: float, dead_share: float, dt_s: float = DT_S, seed: int = 1
) -> list[Observation]:
    """Fifteen seconds of a body with that lag."""
    babbling = Babbling(MotorBabbling(duration_s=15.0), AXES, seed)
    random = np.random.default_rng(seed)
    dead_s, first_order_s = parts(lag_s, dead_share)
    told, still = [np.full(6, 20.0)], np.zeros(3)
    frames: list[Observation] = []
    shown, arrives = told[0], -np.expm1(-dt_s / max(first_order_s, 1e-9))
    while not babbling.done:
        due = told[max(len(told) - 1 - round(dead_s / dt_s), 0)]
        shown = shown + arrives * (due - shown)
        tip_mm, u = JACOBIAN @ shown + NOISE_MM * random.normal(size=3), told[-1]
        t_ns = round(len(told) * dt_s * 1e9)
        frames.append(Observation(t_ns, dt_s, u, u, tip_mm, still, tip_mm, still))
        told.append(u + babbling.propose(frames[-1]))
    return frames


def seen(frames: Sequence[Observation | None]) -> FirstMotions:
    motions = FirstMotions(AXES.scale, EXPECTED_S)
    for frame in frames:
        if frame is None:
            motions.break_off()
        else:
            motions.see(frame)
    return motions


def given_again(motions: FirstMotions) -> list[Observation | None]:
    frames: list[Observation | None] = []
    while not motions.told:
        frames.append(motions.next_again())
    return frames


def off(frames: Sequence[Observation | None]) -> float:
    """How far the Jacobian is off that the frames tell, as a share of it."""
    sound = [frame for frame in frames if frame is not None and frame.believed]
    u, tip = np.array([one.u for one in sound]), np.array([one.tip_mm for one in sound])
    found = np.linalg.lstsq(u - u.mean(axis=0), tip - tip.mean(axis=0), rcond=None)[0].T
    return float(np.linalg.norm(found - JACOBIAN) / np.linalg.norm(JACOBIAN))


@pytest.mark.parametrize("dt_s", [0.01, 0.025])
@pytest.mark.parametrize(
    ("lag_s", "dead_share"), [(0.3, 0.35), (0.5, 0.35), (0.5, 0.6), (0.8, 0.85), (1.2, 0.35)]
)
def test_first_motions_tell_how_late_a_body_is_and_then_what_it_does(
    lag_s: float, dead_share: float, dt_s: float
) -> None:
    frames = babbled(lag_s, dead_share, dt_s)
    motions = seen(frames)
    assert motions.ask()
    assert motions.lag.lag_s == pytest.approx(lag_s, abs=0.051)
    again = given_again(motions)
    assert len(again) == len(frames)
    assert off(frames) > 0.3
    assert off(again) < 0.1


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_those_of_a_body_that_is_as_late_as_expected_are_not_given_again(seed: int) -> None:
    motions = seen(babbled(EXPECTED_S, 0.35, seed=seed))
    assert not motions.ask()
    assert motions.told
    assert motions.lag == motions.expected


def test_a_tip_that_nothing_moves_is_as_late_as_expected() -> None:
    random = np.random.default_rng(7)
    frames = [one._replace(tip_mm=NOISE_MM * random.normal(size=3)) for one in babbled(0.5, 0.35)]
    assert not seen(frames).ask()


def test_pauses_and_what_is_not_believed_do_not_hide_how_late_a_body_is() -> None:
    whole = babbled(0.5, 0.35)
    frames: list[Observation | None] = [
        one._replace(tip_mm=one.tip_mm + 50.0, believed=False) if k % 10 == 3 else one
        for k, one in enumerate(whole)
    ]
    later = babbled(0.5, 0.35, seed=2)
    hour_ns = 3_600_000_000_000
    frames += [None, *(one._replace(t_ns=one.t_ns + hour_ns) for one in later)]
    motions = seen(frames)
    assert motions.ask()
    assert motions.lag.lag_s == pytest.approx(0.5, abs=0.05)
    assert given_again(motions).index(None) == len(whole)


def test_who_goes_on_is_asked_again_with_all_that_was_seen() -> None:
    motions = seen(babbled(0.5, 0.35))
    assert motions.ask()
    given_again(motions)
    motions.go_on()
    assert not motions.asked
    assert motions.ask()
    assert len(given_again(motions)) == len(babbled(0.5, 0.35))


def test_no_more_than_the_last_frames_are_kept() -> None:
    motions = FirstMotions(AXES.scale, EXPECTED_S)
    frames, length_ns = babbled(0.5, 0.35), 16_000_000_000
    for part in range(8):
        for frame in frames:
            motions.see(frame._replace(t_ns=frame.t_ns + part * length_ns))
    assert motions.ask()
    assert len(given_again(motions)) == 4000
