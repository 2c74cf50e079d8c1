"""Which motions become samples, and which never do."""

import itertools
from collections.abc import Iterable
from dataclasses import replace
from math import hypot, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from config.control import PoseFilterSettings
from daemon.estimation.pose_filter import PoseFilter
from daemon.learning.samples.motion import MotionSample
from daemon.learning.samples.motion_samples import MotionSampler, SamplingSettings
from drivers.pose import Pose, Vector

FRAME_NS = 25_000_000
TRAVEL = np.array([50.0, 50.0])
MM_PER_MM = np.array([[2.0, 0.0], [0.0, 1.0], [0.5, -0.5]])
AT_ONCE = SamplingSettings(confirm_s=0.0, averaged_share=0.0)
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


def tip_of(u: Vector) -> Vector:
    return np.array([0.0, 0.0, 180.0]) + MM_PER_MM @ u


def back_and_forth(frames: int, speed_mm_s: float = 8.0) -> Vector:
    """(frames, 2) axes that never stand still."""
    way = speed_mm_s * 0.025 * np.arange(frames)
    first = 10.0 - np.abs(way % 20.0 - 10.0)
    second = 7.5 - np.abs((0.8 * way + 3.0) % 15.0 - 7.5)
    return np.stack([first, second], axis=1)


def samples_of(
    u: Vector, tips: Vector, settings: SamplingSettings = AT_ONCE, start: int = 0
) -> list[MotionSample]:
    """What a sampler makes of frames in a row."""
    sampler = MotionSampler(settings, TRAVEL)
    frames = zip(range(start, start + len(u)), tips, u, strict=True)
    given_ones = (sampler.add(k * FRAME_NS, tip, axes) for k, tip, axes in frames)
    return [sample for sample in given_ones if sample is not None]


def tips_of(u: Vector, noise_mm: float = 0.0, seed: int = 0) -> Vector:
    exact = np.array([tip_of(axes) for axes in u])
    return exact + noise_mm * np.random.default_rng(seed).normal(size=exact.shape)


def unexplained_mm(samples: Iterable[MotionSample]) -> float:
    """The worst difference between what was sampled and what the axes did to the tip."""
    return max(
        float(np.linalg.norm(sample.delta_tip_mm - MM_PER_MM @ sample.delta_u))
        for sample in samples
    )


def test_a_sample_ends_when_the_tip_has_gone_far_enough_and_the_next_begins_there() -> None:
    u = back_and_forth(400)
    samples = samples_of(u, tips_of(u))
    assert len(samples) > 50
    for sample, after in itertools.pairwise(samples):
        assert np.linalg.norm(sample.delta_tip_mm) >= AT_ONCE.tip_mm
        np.testing.assert_allclose(sample.tip_mm + sample.delta_tip_mm, after.tip_mm)
        np.testing.assert_allclose(sample.u + sample.delta_u, after.u)
    assert unexplained_mm(samples) < 1e-9


def test_a_larger_threshold_makes_fewer_and_longer_samples() -> None:
    u = back_and_forth(400)
    few = samples_of(u, tips_of(u), replace(AT_ONCE, tip_mm=3.0, travel_share=0.5))
    many = samples_of(u, tips_of(u), replace(AT_ONCE, tip_mm=0.5))
    assert 2 * len(few) < len(many)
    assert min(np.linalg.norm(sample.delta_tip_mm) for sample in few) >= 3.0


def test_no_motion_is_shorter_than_it_may_be_however_far_it_goes() -> None:
    u = back_and_forth(400)
    quick = samples_of(u, tips_of(u), replace(AT_ONCE, tip_mm=0.5))
    patient = samples_of(u, tips_of(u), replace(AT_ONCE, tip_mm=0.5, shortest_s=0.5))
    assert 2 * len(patient) < len(quick)
    lengths = [np.linalg.norm(sample.delta_tip_mm) for sample in patient]
    assert np.median(lengths) > 2.0 * np.median(
        [np.linalg.norm(sample.delta_tip_mm) for sample in quick]
    )


def test_axes_that_move_and_leave_the_tip_where_it_is_are_a_sample_too() -> None:
    u = back_and_forth(200)
    tips = np.array([0.0, 0.0, 180.0]) + 0.1 * np.random.default_rng(0).normal(size=(200, 3))
    samples = samples_of(u, tips)
    assert samples
    assert all(
        np.linalg.norm(sample.delta_u / TRAVEL) >= AT_ONCE.travel_share for sample in samples
    )


def test_nothing_is_sampled_while_the_robot_stands_still() -> None:
    u = np.tile([20.0, 30.0], (2000, 1))
    flicker = 0.0005 * np.random.default_rng(1).integers(-1, 2, size=u.shape)
    assert not samples_of(u + flicker, tips_of(u, noise_mm=0.2))


def test_nothing_is_sampled_when_something_else_moves_the_tip() -> None:
    u = np.tile([20.0, 30.0], (400, 1))
    pushed = tips_of(u, noise_mm=0.1) + np.linspace(0.0, 20.0, 400)[:, None]
    assert not samples_of(u, pushed)


def test_what_creeps_too_slowly_is_no_motion() -> None:
    u = back_and_forth(2000, speed_mm_s=0.1)
    assert not samples_of(u, tips_of(u))


def test_a_sample_is_given_when_what_came_after_it_was_sound_too() -> None:
    u = back_and_forth(200)
    sampler = MotionSampler(replace(AT_ONCE, confirm_s=0.3), TRAVEL)
    for k, (tip, axes) in enumerate(zip(tips_of(u), u, strict=True)):
        sample = sampler.add(k * FRAME_NS, tip, axes)
        if sample is not None:
            ended = sampler.began_ns / FRAME_NS + np.linalg.norm(sample.delta_u) / hypot(0.2, 0.16)
            assert (k - ended) * FRAME_NS >= 0.29e9
            return
    raise AssertionError("no sample was ever given")


def test_a_gap_is_not_bridged() -> None:
    u = back_and_forth(80)
    sampler = MotionSampler(replace(AT_ONCE, tip_mm=3.0, travel_share=0.9), TRAVEL)
    began_ns = []
    for k in range(80):
        t_ns = (k + 10 * (k >= 20)) * FRAME_NS
        if sampler.add(t_ns, tip_of(u[k]), u[k]) is not None and k >= 20:
            began_ns.append(sampler.began_ns)
    assert min(began_ns) >= 30 * FRAME_NS


def test_frames_of_a_slow_tracker_are_no_gaps() -> None:
    u = back_and_forth(80)
    sampler = MotionSampler(replace(AT_ONCE, longest_s=5.0), TRAVEL)
    given = [sampler.add(5 * k * FRAME_NS, tip_of(u[k]), u[k]) for k in range(80)]
    assert sum(sample is not None for sample in given) > 20
    missing = [sampler.add(5 * (k + 500) * FRAME_NS, tip_of(u[k]), u[k]) for k in range(2)]
    assert missing == [None, None]


def test_a_gap_after_the_first_frame_is_one() -> None:
    u = back_and_forth(40)
    sampler = MotionSampler(replace(AT_ONCE, longest_s=100.0), TRAVEL)
    sampler.add(0, tip_of(u[20]), u[20])
    for k in range(40):
        if sampler.add((400 + k) * FRAME_NS, tip_of(u[k]), u[k]) is not None:
            assert sampler.began_ns >= 400 * FRAME_NS


def test_nothing_spans_a_break() -> None:
    u = back_and_forth(60)
    sampler = MotionSampler(replace(AT_ONCE, confirm_s=0.1), TRAVEL)
    for k in range(60):
        if k == 30:
            sampler.break_off()
        sample = sampler.add(k * FRAME_NS, tip_of(u[k]), u[k])
        if k >= 30 and sample is not None:
            assert sampler.began_ns >= 30 * FRAME_NS


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("where", ["tip", "axes"])
def test_what_is_not_finite_breaks_off_and_never_gets_in(bad: float, where: str) -> None:
    u, settings = back_and_forth(200), SamplingSettings()
    tips = tips_of(u)
    (tips if where == "tip" else u)[100:103, 1] = bad
    samples = samples_of(u, tips, settings)
    assert len(samples) > 20
    assert all(np.isfinite(np.concatenate(sample)).all() for sample in samples)
    assert unexplained_mm(samples) < 1e-9


def test_an_outlier_spoils_no_sample() -> None:
    u = back_and_forth(400)
    tips = tips_of(u)
    tips[[100, 250, 251]] += np.array([[12.0, 0.0, 0.0], [0.0, 9.0, 0.0], [0.0, -9.0, 4.0]])
    assert unexplained_mm(samples_of(u, tips, SamplingSettings())) < 1e-9


@pytest.mark.parametrize("speed_mm_s", [1.0, 3.0, 10.0])
@pytest.mark.parametrize("filtered", [True, False])
def test_a_frozen_tracker_spoils_no_sample(speed_mm_s: float, filtered: bool) -> None:
    """The filter makes a stop of it that looks like a motion for a while."""
    u = back_and_forth(600, speed_mm_s)
    measured = tips_of(u, noise_mm=0.1)
    measured[300:] = measured[299]
    tips = through_the_filter(measured) if filtered else measured
    before = samples_of(u[:300], tips[:300], SamplingSettings(confirm_s=0.0))
    all_of_them = samples_of(u, tips, SamplingSettings())
    assert 3 < len(all_of_them) <= len(before)
    assert unexplained_mm(all_of_them) < 1.0


def through_the_filter(measured: Vector) -> Vector:
    """What the controller would see."""
    pose_filter, tips = PoseFilter(PoseFilterSettings()), []
    for k, tip in enumerate(measured):
        pose_filter.update(k * FRAME_NS, Pose(tip, LEVEL))
        estimate = pose_filter.estimate(k * FRAME_NS)
        tips.append(tip if estimate is None else estimate.position_mm)
    return np.array(tips)


def test_a_tip_that_stands_still_while_the_axes_do_is_not_frozen() -> None:
    """Between two motions there is a pause, and the second one is sampled like the first."""
    u = back_and_forth(100)
    u = np.concatenate([u, np.tile(u[-1], (200, 1)), u[::-1]])
    assert len(samples_of(u, tips_of(u))) >= 2 * len(samples_of(u[:100], tips_of(u[:100]))) - 2


@pytest.mark.parametrize("lag_s", [0.04, 0.1])
def test_the_axes_are_those_that_caused_the_motion(lag_s: float) -> None:
    u = back_and_forth(400)
    t_s = 0.025 * np.arange(400)
    late = np.stack([np.interp(t_s - lag_s, t_s, column) for column in u.T], axis=1)
    tips = tips_of(late)
    assert unexplained_mm(samples_of(u, tips, replace(AT_ONCE, lag_s=lag_s))) < 1e-9
    assert unexplained_mm(samples_of(u, tips)) > 0.1


def test_noise_is_averaged_out_of_slow_motions() -> None:
    u = back_and_forth(4000, speed_mm_s=1.0)
    tips = tips_of(u, noise_mm=0.1)
    single = samples_of(u, tips, AT_ONCE)
    averaged = samples_of(u, tips, replace(AT_ONCE, averaged_share=0.5))
    assert gain(averaged) > gain(single)
    assert gain(averaged) == pytest.approx(1.0, abs=0.03)


def gain(samples: list[MotionSample]) -> float:
    """Of an inverse model learnt from these: below 1 where noise is taken for motion."""
    true = np.array([MM_PER_MM @ sample.delta_u for sample in samples])
    seen = np.array([sample.delta_tip_mm for sample in samples])
    return float((true * seen).sum() / (seen * seen).sum())


@given(
    st.lists(
        st.tuples(
            st.integers(0, 200_000_000),
            st.lists(st.floats(width=32), min_size=5, max_size=5),
        ),
        max_size=60,
    )
)
def test_whatever_comes_samples_are_finite_and_bounded(
    frames: list[tuple[int, list[float]]],
) -> None:
    sampler = MotionSampler(replace(AT_ONCE, fastest_mm_s=1e6, most_mm=1e5), TRAVEL)
    t_ns = 0
    for later_ns, numbers in frames:
        t_ns += later_ns
        sample = sampler.add(t_ns, np.array(numbers[:3]), np.array(numbers[3:]))
        if sample is not None:
            assert np.isfinite(np.concatenate(sample)).all()
            assert np.linalg.norm(sample.delta_tip_mm) <= 1e6 * AT_ONCE.longest_s


def test_settings_survive_a_file() -> None:
    settings = SamplingSettings(tip_mm=0.63, lag_s=0.1)
    assert SamplingSettings.from_dict(settings.to_dict()) == settings
    with pytest.raises(ValueError, match="unexpected"):
        SamplingSettings.from_dict({"tip": 1.0})


@pytest.mark.parametrize(
    ("name", "value"),
    [("tip_mm", 0.0), ("tip_mm", np.nan), ("lag_s", -0.1), ("averaged_share", 0.6)],
)
def test_settings_that_make_no_sense_are_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=name):
        SamplingSettings(**{name: value})


def test_the_noise_of_the_difference_is_that_of_both_ends() -> None:
    u = back_and_forth(3000)
    samples = samples_of(u, tips_of(u, noise_mm=0.05), replace(AT_ONCE, tip_mm=3.0))
    wrong = [sample.delta_tip_mm - MM_PER_MM @ sample.delta_u for sample in samples]
    assert np.std(wrong) == pytest.approx(sqrt(2.0) * 0.05, rel=0.2)
