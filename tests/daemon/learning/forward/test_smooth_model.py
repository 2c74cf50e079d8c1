"""A quadratic of the axes is found in seconds of motion, whatever the lag, and makes up motions."""

from dataclasses import replace

import numpy as np
import pytest

from daemon.learning.forward.pretraining import PretrainingSettings, pretrain
from daemon.learning.forward.smooth_model import (
    SmoothModel,
    axes_shown,
    imagined,
    shown_lag_s,
    smooth_model,
)
from daemon.learning.samples.dataset import Dataset, Frames
from daemon.learning.samples.motion_samples import SamplingSettings
from drivers.pose import Vector
from tests.daemon.learning.frames_of_arm import ARM, RANGES, ROBOT, arm_frames, without

SECONDS = 16.0


def seen(lag_s: float = 0.0, seconds: float = SECONDS) -> Frames:
    """Of an arm that answers with a dead time and a first-order lag."""
    frames = arm_frames(12)
    count = int(np.searchsorted(frames.t_ns, seconds * 1e9))
    frames = without(frames, count, len(frames))
    shown = axes_shown(np.asarray(frames.t_ns * 1e-9, np.float64), frames.u, lag_s)
    noise = 0.1 * np.random.default_rng(5).normal(size=frames.tip_mm.shape)
    return replace(frames, tip_mm=np.array([ARM.tip(u)[0] for u in shown]) + noise)


def found(frames: Frames, lag_s: float = 0.0) -> SmoothModel:
    return smooth_model(frames, frames.line, RANGES.travel, lag_s)


def slopes(model: SmoothModel, u: Vector) -> Vector:
    """(3, 6) mm per mm."""
    steps = 0.5 * np.eye(6)
    return (model.tip_mm(u + steps) - model.tip_mm(u - steps)).T


@pytest.mark.parametrize("lag_s", [0.0, 0.1, 0.8])
def test_seconds_of_motion_tell_how_the_jacobian_changes(lag_s: float) -> None:
    model = found(seen(lag_s), lag_s)
    off = []
    for at in 25.0 + np.random.default_rng(1).uniform(-8.0, 8.0, (30, 6)):
        true = ARM.tip(at)[1]
        off.append(np.linalg.norm(slopes(model, at) - true) / np.linalg.norm(true))
    assert np.median(off) < 0.15


@pytest.mark.parametrize("lag_s", [0.0, 0.1, 0.5, 1.1])
def test_the_lag_is_found_as_a_sum_of_its_parts(lag_s: float) -> None:
    assert shown_lag_s(seen(lag_s), RANGES.travel) == pytest.approx(lag_s, abs=0.04)


def test_pretraining_learns_a_late_body_from_seconds_with_its_lag() -> None:
    dataset = Dataset.of(seen(0.8), ROBOT, {})
    learnt = pretrain(dataset, PretrainingSettings(epochs=3, test_share=0.0))
    assert learnt.sampling.lag_s == pytest.approx(0.8, abs=0.05)
    assert learnt.errors[-1].all_mm < 0.25 * learnt.motions.delta_tip_mm.std()
    told_wrong = PretrainingSettings(epochs=3, test_share=0.0, lag_s=0.1)
    assert learnt.errors[-1].all_mm < 0.5 * pretrain(dataset, told_wrong).errors[-1].all_mm


def test_lines_that_are_kept_back_tell_it_nothing() -> None:
    frames = seen()
    known = np.unique(frames.line)[:-1]
    kept_back = frames.line == frames.line[-1]
    other = replace(frames, tip_mm=np.where(kept_back[:, None], 0.3 * frames.tip_mm, frames.tip_mm))
    at = np.full((1, 6), 24.0)
    one, same = (smooth_model(each, known, RANGES.travel, 0.0) for each in (frames, other))
    np.testing.assert_array_equal(one.tip_mm(at), same.tip_mm(at))


def test_what_happens_in_a_gap_is_no_motion() -> None:
    """The tip is elsewhere afterwards, for another reason than the axes."""
    frames = seen()
    half = len(frames) // 2
    t_ns, tip_mm = frames.t_ns.copy(), frames.tip_mm.copy()
    t_ns[half:] += 5_000_000_000
    tip_mm[half:] += np.array([30.0, 0.0, 0.0])
    torn = found(replace(frames, t_ns=t_ns, tip_mm=tip_mm))
    at = np.full(6, 25.0)
    np.testing.assert_allclose(slopes(torn, at), slopes(found(frames), at), atol=0.15)


def test_motions_that_are_made_up_are_the_model_s_where_axes_have_been() -> None:
    frames = seen()
    model = found(frames)
    motions = Dataset.of(frames, ROBOT, {}).motions(SamplingSettings())
    made = imagined(model, motions, 500, seed=1)
    np.testing.assert_allclose(made.tip_mm, model.tip_mm(made.u))
    np.testing.assert_allclose(
        made.delta_tip_mm, model.tip_mm(made.u + made.delta_u) - made.tip_mm, atol=1e-9
    )
    middle = made.u + 0.5 * made.delta_u
    assert (middle >= motions.u.min(axis=0)).all()
    assert (middle <= motions.u.max(axis=0)).all()
    ratio = made.delta_u.std(axis=0) / np.sqrt((motions.delta_u**2).mean(axis=0))
    assert ratio == pytest.approx(np.ones(6), abs=0.15)
    again = imagined(model, motions, 500, seed=1)
    np.testing.assert_array_equal(again.u, made.u)


def test_axes_that_stand_show_where_they_are_and_those_that_go_on_show_late() -> None:
    t_s = np.arange(0.0, 8.0, 0.025)
    u = np.where(t_s > 2.0, 1.5 * (t_s - 2.0), 0.0)[:, None] + np.zeros((1, 2))
    shown = axes_shown(t_s, u, 0.8)
    assert not shown[t_s <= 2.0].any()
    assert u[-1] - shown[-1] == pytest.approx(np.full(2, 1.5 * 0.8), rel=0.03)
