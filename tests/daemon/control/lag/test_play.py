"""Small motions tell how much play there is, and an axis that turns is asked for that besides."""

import numpy as np
import pytest

from daemon.control.lag import play as small_play
from daemon.control.lag.body_lag import BodyLag, Underway
from daemon.control.lag.play import Play, SmallMotion
from daemon.control.lag.probing import PROMPT_LAG_S, place_mm
from daemon.learning.samples.motion import DEAD_SHARE

DT_S = 0.025
TRAVEL = np.full(4, 50.0)
JACOBIAN = np.array([[2.5, -1.0, 0.8, 0.4], [0.3, 2.2, -2.4, 0.5], [0.2, 0.4, 0.3, 1.4]])
INVERSE = np.linalg.pinv(JACOBIAN)
LAG_S = 0.12
NOISE_MM = 0.15
STEPS = 140
"""All that is asked for of a prompt body takes about as long."""


def probed(
    play: Play,
    play_mm: float,
    lag: BodyLag,
    gain: float = 1.0,
    seed: int = 1,
    steps: int = STEPS,
    late_s: float = LAG_S,
    dead_share: float = DEAD_SHARE,
) -> Play:
    """After small motions of an arm, so late, whose axes have so much of it, either way."""
    random, within, underway = np.random.default_rng(seed), np.zeros(4), Underway()
    place, made = np.zeros(3), list[SmallMotion]()
    pace = 1.0 if late_s > PROMPT_LAG_S else 1.5
    for number in range(steps):
        t_s = number * DT_S
        told_mm = 0.2 * (place_mm(pace * t_s) - place)
        place, moved = place + told_mm, INVERSE @ told_mm
        stopped = np.clip(within + moved, -play_mm, play_mm)
        arrives_mm = gain * JACOBIAN @ (moved - (stopped - within))
        within = stopped
        underway.tell(t_s, DT_S, arrives_mm, late_s, dead_share)
        tip_mm = underway.told_mm - underway.left_mm + NOISE_MM * random.normal(size=3)
        play.follow(moved)
        told_mm = told_mm - play.lost_mm(JACOBIAN)
        made.append(SmallMotion(t_s, DT_S, told_mm, play.within_mm(JACOBIAN), tip_mm))
    play.learn(made, lag)
    return play


def known(share: float) -> Play:
    play = Play(TRAVEL)
    play.share = share
    return play


@pytest.mark.parametrize("gain", [0.8, 1.0, 1.2])
@pytest.mark.parametrize("play_mm", [0.08, 0.12, 0.2])
def test_small_motions_tell_it_whatever_the_gain(play_mm: float, gain: float) -> None:
    found = [
        probed(Play(TRAVEL), play_mm, BodyLag(LAG_S), gain, seed).share * 50.0 for seed in range(5)
    ]
    assert 0.5 * play_mm < np.median(found) < 1.3 * play_mm


def test_where_there_is_none_next_to_none_is_found() -> None:
    found = [probed(Play(TRAVEL), 0.0, BodyLag(LAG_S), seed=seed).share * 50.0 for seed in range(9)]
    assert np.median(found) < 0.01
    assert max(found) < 0.05


@pytest.mark.parametrize(("late_s", "steps"), [(LAG_S, STEPS), (0.5, 296)])
def test_what_made_the_body_look_late_is_taken_off_its_lag(late_s: float, steps: int) -> None:
    lag = BodyLag(late_s + 0.04)
    found = probed(Play(TRAVEL), 0.12, lag, steps=steps, late_s=late_s)
    assert 0.06 < found.share * 50.0 < 0.17
    assert late_s - 0.01 < lag.lag_s < late_s + 0.02


@pytest.mark.parametrize("seed", range(3))
def test_dead_time_that_play_made_look_like_a_lag_is_told_to_be_one(seed: int) -> None:
    lag = BodyLag(0.34)
    assert lag.dead_share == DEAD_SHARE
    probed(Play(TRAVEL), 0.2, lag, seed=seed, steps=296, late_s=0.26, dead_share=0.85)
    assert lag.dead_share == 0.85
    assert lag.lag_s == pytest.approx(0.26, abs=0.03)


def test_what_has_no_play_is_late_for_another_reason() -> None:
    lag = BodyLag(LAG_S + 0.04)
    assert probed(Play(TRAVEL), 0.0, lag, seed=3).share == 0.0
    assert lag.lag_s == LAG_S + 0.04


def test_a_lag_that_is_known_to_be_shorter_stays() -> None:
    lag = BodyLag(0.08)
    assert probed(Play(TRAVEL), 0.12, lag).share > 0.0
    assert lag.lag_s == 0.08


@pytest.mark.parametrize("steps", [0, 1, 4])
def test_motions_that_were_broken_off_tell_nothing(steps: int) -> None:
    assert probed(Play(TRAVEL), 0.12, BodyLag(LAG_S), steps=steps).share == 0.0


@pytest.mark.parametrize(("later_s", "tip_mm"), [(0.0, 0.0), (DT_S, np.nan)])
def test_what_no_motion_can_be_tells_nothing(later_s: float, tip_mm: float) -> None:
    play, lag, told_mm = Play(TRAVEL), BodyLag(LAG_S), np.full(3, 0.02)
    made = list[SmallMotion]()
    for t_s, at_mm in [*((k * DT_S, 0.0) for k in range(20)), (19 * DT_S + later_s, tip_mm)]:
        play.follow(np.full(4, 0.01))
        made.append(SmallMotion(t_s, DT_S, told_mm, play.within_mm(JACOBIAN), np.full(3, at_mm)))
    play.learn(made, lag)
    assert play.share == 0.0
    assert lag.lag_s == LAG_S


def test_an_axis_that_goes_on_is_asked_for_its_step_and_one_that_turned_for_its_play() -> None:
    play, step = known(0.002), np.array([0.02, -0.02, 0.0, 0.5])
    for _ in range(20):
        play.follow(np.array([0.05, 0.05, 0.05, -0.05]))
    goes_on, turned, stands, fast = play.with_what_is_lost(step)
    assert goes_on == pytest.approx(0.02)
    assert turned == pytest.approx(-0.06), "not all of it at once: noise turns axes as well"
    assert stands == 0.0
    assert fast == pytest.approx(0.5 + 0.2), "all that is left of it, and no more"


def test_with_what_is_asked_for_besides_the_body_goes_as_far_as_it_should() -> None:
    play, random = known(0.002), np.random.default_rng(1)
    missing, off = 0.0, list[float]()
    for number in range(800):
        step = np.full(4, 0.05 * np.sin(0.02 * number) + 0.01 * random.normal())
        asked, before = play.with_what_is_lost(step), play.within
        play.follow(asked)
        missing += float((step - asked + (play.within - before))[0])
        off.append(abs(missing))
    assert np.mean(off) < 0.05, "0.1 without"


def test_what_play_takes_is_not_told_to_have_come() -> None:
    play = known(0.002)
    play.follow(np.full(4, 1.0))
    told_mm = JACOBIAN @ np.full(4, -0.15)
    play.follow(np.full(4, -0.15))
    np.testing.assert_allclose(play.lost_mm(JACOBIAN), told_mm)
    play.follow(np.full(4, -0.15))
    np.testing.assert_allclose(play.lost_mm(JACOBIAN), told_mm / 3.0)
    play.follow(np.full(4, -0.15))
    np.testing.assert_array_equal(play.lost_mm(JACOBIAN), np.zeros(3))


@pytest.mark.parametrize(("without_s", "then_s"), [(0.77, 0.77), (0.6, 0.74), (0.9, 0.8)])
def test_without_play_the_lag_is_shorter_by_no_more_than_play_looks_like(
    without_s: float, then_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What friction and creep look like is not to be told from it."""
    monkeypatch.setattr(small_play, "_found", lambda *_: 1e-3)
    monkeypatch.setattr(small_play, "_lag_without", lambda *_: BodyLag(without_s))
    lag = BodyLag(0.8)
    Play(TRAVEL).learn([], lag)
    assert lag.lag_s == pytest.approx(then_s)
