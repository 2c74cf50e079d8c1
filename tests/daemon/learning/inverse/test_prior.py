"""What pre-training hands over to the local controllers."""

import numpy as np
import pytest

from daemon.learning.inverse.prior import Prior, prior_for
from tests.daemon.learning.exploring_arm import exploration, fields_over, settings_for

POSTURE = np.full(6, 10.0)
SAMPLES = exploration(600)
FIELDS = fields_over(SAMPLES, 8.0)
SETTINGS = settings_for(SAMPLES)


def test_it_never_counts_more_than_asked_nor_more_than_there_was() -> None:
    asked = settings_for(SAMPLES, prior_mass=5.0)
    few = SAMPLES[:40]
    weights = sum(FIELDS.weights(sample.tip_mm, sample.u) for sample in few)
    prior = Prior.of(few, FIELDS, asked, POSTURE)
    expected = np.where(weights < asked.minimum_mass, 0.0, np.minimum(weights, 5.0))
    assert prior.mass == pytest.approx(expected)
    assert (prior.mass == 5.0).any()
    assert (prior.mass == 0.0).any()


def test_its_sums_are_means() -> None:
    prior = Prior.of(SAMPLES, FIELDS, SETTINGS, POSTURE)
    assert prior.products[:, 0] == pytest.approx(np.ones(FIELDS.count))
    again = Prior.of(SAMPLES + SAMPLES, FIELDS, SETTINGS, POSTURE)
    assert again.products == pytest.approx(prior.products)


def test_it_comes_back_from_a_file_bit_by_bit() -> None:
    prior = Prior.of(SAMPLES, FIELDS, SETTINGS, POSTURE)
    back = Prior.from_arrays(prior.to_arrays(), FIELDS, SETTINGS)
    assert np.array_equal(back.products, prior.products)
    assert np.array_equal(back.mass, prior.mass)
    assert np.array_equal(back.posture, prior.posture)


def test_it_is_made_anew_for_another_posture_as_long_as_its_samples_are_known() -> None:
    prior, elsewhere = Prior.of(SAMPLES, FIELDS, SETTINGS, POSTURE), np.full(6, 3.0)
    direct = Prior.of(SAMPLES, FIELDS, SETTINGS, elsewhere)
    assert np.array_equal(prior.towards(elsewhere).products, direct.products)
    assert not np.allclose(direct.products, prior.products)
    assert prior.towards(POSTURE) is prior
    loaded = Prior.from_arrays(prior.to_arrays(), FIELDS, SETTINGS)
    assert np.array_equal(loaded.towards(elsewhere).products, prior.products)


def test_one_for_other_fields_is_refused() -> None:
    prior = Prior.of(SAMPLES, FIELDS, SETTINGS, POSTURE)
    fewer = fields_over(SAMPLES, 4.0)
    with pytest.raises(ValueError, match="the prior is for"):
        prior_for(prior, fewer, SETTINGS, POSTURE)
    with pytest.raises(ValueError, match="do not fit"):
        Prior.from_arrays(prior.to_arrays(), fewer, SETTINGS)
    with pytest.raises(ValueError, match="has no mass"):
        Prior.from_arrays({"products": prior.products}, FIELDS, SETTINGS)


def test_without_samples_nothing_is_known() -> None:
    assert (Prior.of([], FIELDS, SETTINGS, POSTURE).mass == 0.0).all()
