"""A forward model learnt from an exploration: how good, how large, and from what."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from daemon.learning.forward.forward_model import (
    forward_settings,
    receptive_fields,
    slopes_by_step,
)
from daemon.learning.forward.pretraining import (
    EpochErrors,
    Pretraining,
    PretrainingError,
    PretrainingSettings,
    pretrain,
)
from daemon.learning.lwpr.model import Lwpr
from daemon.learning.samples.dataset import Dataset
from daemon.learning.samples.motion import MotionTable
from daemon.learning.samples.motion_samples import SamplingSettings
from tests.daemon.learning.frames_of_arm import ARM, ROBOT, arm_dataset, arm_frames

LINES = 30
EPOCHS = 6


@cache
def learnt(**changes: object) -> Pretraining:
    settings = PretrainingSettings(**{"epochs": EPOCHS, **changes})  # type: ignore[arg-type]
    return pretrain(arm_dataset(LINES, lag_s=0.1), settings)


def test_it_predicts_motions_that_it_has_not_seen() -> None:
    pretraining = learnt()
    spread_mm = float(pretraining.motions.delta_tip_mm[pretraining.test].std())
    best = pretraining.errors[pretraining.best_epoch - 1]
    assert best.test_mm < 0.4 * spread_mm
    assert best.train_mm <= best.all_mm <= best.test_mm


def test_the_model_is_the_one_of_the_epoch_with_the_lowest_test_error() -> None:
    pretraining = learnt()
    tests = [errors.test_mm for errors in pretraining.errors]
    assert [errors.epoch for errors in pretraining.errors] == list(range(1, EPOCHS + 1))
    assert pretraining.best_epoch == 1 + int(np.argmin(tests))
    inputs = pretraining.motions.inputs
    said = np.array([pretraining.model.predict(x) for x in inputs])
    np.testing.assert_array_equal(said, pretraining.predicted_mm)
    wrong = (said - pretraining.motions.delta_tip_mm)[pretraining.test]
    assert min(tests) == pytest.approx(float(np.sqrt((wrong**2).mean())))


def test_every_epoch_is_told() -> None:
    told: list[EpochErrors] = []
    pretraining = pretrain(arm_dataset(6), PretrainingSettings(epochs=3), told.append)
    assert tuple(told) == pretraining.errors


def test_a_fifth_of_the_lines_is_kept_back_and_none_is_cut() -> None:
    pretraining = learnt()
    kept = set(pretraining.motions.line[pretraining.test].tolist())
    used = set(pretraining.motions.line[~pretraining.test].tolist())
    assert len(kept) == LINES // 5
    assert not kept & used


def test_without_a_test_everything_is_learnt() -> None:
    pretraining = learnt(test_share=0.0)
    assert not pretraining.test.any()
    assert all(np.isnan(errors.test_mm) for errors in pretraining.errors)
    trained = [errors.train_mm for errors in pretraining.errors]
    assert pretraining.best_epoch == 1 + int(np.argmin(trained))


@pytest.mark.parametrize("fields", [1, 12, 40])
def test_there_are_as_many_fields_as_asked_for(fields: int) -> None:
    assert learnt(fields=fields, epochs=1).model.count == pytest.approx(fields, abs=1)


def test_left_alone_there_is_a_field_for_every_hundred_motions() -> None:
    pretraining = pretrain(arm_dataset(60), PretrainingSettings(epochs=1))
    learnt_from = int((~pretraining.test).sum())
    assert learnt_from > 2000
    assert pretraining.model.count == pytest.approx(learnt_from / 100, abs=2)


def test_few_motions_are_learnt_by_way_of_many_that_are_made_up() -> None:
    pretraining = learnt()
    assert (~pretraining.test).sum() < 2000
    assert pretraining.model.count == pytest.approx(40, abs=2)
    assert len(pretraining.predicted_mm) == len(pretraining.motions)


def test_the_lag_is_found_and_kept_with_the_samples() -> None:
    pretraining = learnt()
    assert pretraining.sampling.lag_s == pytest.approx(0.1, abs=0.03)
    wrong = learnt(lag_s=0.0)
    assert wrong.sampling.lag_s == 0.0
    assert min(e.test_mm for e in pretraining.errors) < min(e.test_mm for e in wrong.errors)


def test_the_same_seed_learns_the_same_and_another_one_does_not() -> None:
    settings = PretrainingSettings(epochs=2)
    one, same = (pretrain(arm_dataset(8), settings) for _ in range(2))
    other = pretrain(arm_dataset(8), PretrainingSettings(epochs=2, seed=2))
    np.testing.assert_array_equal(one.predicted_mm, same.predicted_mm)
    assert one.errors == same.errors
    assert other.errors != one.errors


def test_the_slopes_are_those_of_the_arm() -> None:
    pretraining, shares = learnt(test_share=0.0), []
    for tip_mm, u in zip(
        pretraining.motions.tip_mm[::60], pretraining.motions.u[::60], strict=True
    ):
        slopes = slopes_by_step(pretraining.model, tip_mm, u)
        true = ARM.tip(u)[1]
        shares.append(np.linalg.norm(slopes - true) / np.linalg.norm(true))
    assert np.median(shares) < 0.35


def test_an_axis_that_stood_but_for_its_encoder_is_not_said_to_move_the_tip() -> None:
    random, count = np.random.default_rng(3), 800
    u, moved = random.uniform(15.0, 35.0, (count, 6)), random.normal(0.0, 1.5, (count, 6))
    u[:, 5] = 10.0 + 1e-3 * random.integers(-1, 2, count)
    moved[:, 5] = 1e-3 * random.integers(-1, 2, count)
    true = 1.5 * random.normal(size=(3, 6))
    seen = moved @ true.T + 0.2 * random.normal(size=(count, 3))
    motions = MotionTable(u @ true.T, u, moved, seen, np.arange(count) // 50)
    model = Lwpr(forward_settings(motions, np.full(6, 50.0), 1.0))
    model.fit(motions.inputs, seen, 3)
    slopes = slopes_by_step(model, motions.tip_mm[0], u[0])
    np.testing.assert_allclose(slopes[:, :5], true[:, :5], atol=0.05)
    assert np.abs(slopes[:, 5]).max() < 1.0


def test_local_controllers_get_the_fields_of_the_model() -> None:
    pretraining = learnt()
    fields = receptive_fields(pretraining.model)
    assert fields.count == pretraining.model.count
    tip_mm, u = pretraining.motions.tip_mm[5], pretraining.motions.u[5]
    x = np.concatenate([tip_mm, u, np.zeros(6)])
    np.testing.assert_allclose(fields.weights(tip_mm, u), pretraining.model.weights(x), atol=1e-12)


def test_too_few_motions_are_no_data() -> None:
    sampling = SamplingSettings(tip_mm=80.0, travel_share=0.9)
    far_apart = PretrainingSettings(sampling=sampling, test_share=0.0)
    with pytest.raises(PretrainingError, match="too few") as raised:
        pretrain(arm_dataset(8), far_apart)
    for remedy in ("--sample", "sample_tip_mm: 40", "--duration", "waypoints: 80"):
        assert remedy in str(raised.value)
    with pytest.raises(PretrainingError, match="3 lines are too few"):
        pretrain(arm_dataset(3), PretrainingSettings())


SHORT_ARM = np.array([[0.3, -0.15, -0.15], [0.0, 0.25, -0.25], [0.07, 0.07, 0.07]])
"""(3, 3) mm per mm: its tip goes so little that 5 % of the axes' travel makes a sample."""


def test_three_axes_need_fewer_motions_than_six() -> None:
    def short_exploration(lines: int, axes: int) -> Dataset:
        frames = arm_frames(lines)
        frames = replace(frames, u=frames.u[:, :axes], tip_mm=frames.u[:, :3] @ SHORT_ARM.T)
        return Dataset.of(frames, ROBOT.model_copy(update={"axes": ROBOT.axes[:axes]}), {})

    settings = PretrainingSettings(test_share=0.0, lag_s=0.0)
    learnt = pretrain(short_exploration(6, axes=3), settings)
    assert 27 <= len(learnt.motions) < 50
    middle = learnt.motions.tip_mm.mean(axis=0), learnt.motions.u.mean(axis=0)
    np.testing.assert_allclose(slopes_by_step(learnt.model, *middle), SHORT_ARM, atol=0.03)
    with pytest.raises(PretrainingError, match="39 motions are too few"):
        pretrain(short_exploration(4, axes=6), settings)


@pytest.mark.parametrize(
    "changes",
    [{"epochs": 0}, {"fields": 0}, {"test_share": 1.0}, {"seed": -1}, {"lag_s": -0.1}],
)
def test_settings_that_make_no_sense_are_refused(changes: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"epochs|kept back|late"):
        PretrainingSettings(**changes)  # type: ignore[arg-type]
