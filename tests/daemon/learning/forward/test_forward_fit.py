"""What is said of how well a forward model foretells."""

from dataclasses import replace

import numpy as np
import pytest

from daemon.learning.forward.forward_fit import forward_fit
from tests.daemon.learning.forward.test_pretraining import learnt


def test_a_model_that_is_right_explains_everything() -> None:
    one = learnt()
    fit = forward_fit(replace(one, predicted_mm=one.motions.delta_tip_mm))
    assert fit.kept_back == bool(one.test.any())
    assert fit.motions == int(one.test.sum())
    assert (fit.rmse_mm, fit.r2, fit.field_r2) == (0.0, 1.0, [1.0, 1.0, 1.0])


def test_a_model_that_says_nothing_explains_nothing() -> None:
    one = learnt()
    fit = forward_fit(replace(one, predicted_mm=np.zeros_like(one.predicted_mm)))
    assert fit.rmse_mm == pytest.approx(fit.spread_mm)
    assert fit.r2 == pytest.approx(0.0)
    assert fit.field_r2 == pytest.approx([0.0, 0.0, 0.0])


def test_one_that_says_the_opposite_is_worse_than_nothing() -> None:
    one = learnt()
    assert forward_fit(replace(one, predicted_mm=-one.motions.delta_tip_mm)).r2 == pytest.approx(-3)


def test_only_what_was_kept_back_counts_where_there_is_any() -> None:
    one = learnt()
    said = np.where(one.test[:, None], one.motions.delta_tip_mm, 1e6)
    assert forward_fit(replace(one, predicted_mm=said)).r2 == 1.0
    none = replace(one, test=np.zeros_like(one.test), predicted_mm=one.motions.delta_tip_mm)
    fit = forward_fit(none)
    assert not fit.kept_back
    assert fit.motions == len(one.motions)


def test_fields_without_motions_say_nothing() -> None:
    one = learnt()
    few = np.zeros_like(one.test)
    few[:2] = True
    assert forward_fit(replace(one, test=few)).field_r2 is None
