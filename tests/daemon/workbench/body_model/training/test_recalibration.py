"""Each component becomes a narrow and a wide one, as what was kept back asks for."""

from typing import Any

import numpy as np
import pytest

from daemon.workbench.body_model.training.calibration import scores
from daemon.workbench.body_model.training.recalibration import Widths, doubled, recalibrated
from safety.risk.model.mixture_network import MixtureNetwork
from tests.safety.risk.networks import random_arrays


@pytest.mark.parametrize(("d", "heads"), [(3, ()), (8, (6,))])
def test_both_are_where_the_one_was_and_turned_alike(d: int, heads: tuple[int, ...]) -> None:
    arrays = random_arrays(2, (16,), heads, 3, d)
    widths = Widths(0.7, 1.6, 0.25)
    before = MixtureNetwork(arrays, "silu")
    after = MixtureNetwork(doubled(arrays, widths), "silu")
    for u in np.random.default_rng(2).normal(size=(4, 2)):
        one, both = before.mixture(u), after.mixture(u)
        assert one is not None
        assert both is not None
        for half, width, share in ((slice(3), 0.7, 0.75), (slice(3, 6), 1.6, 0.25)):
            np.testing.assert_allclose(both.weights[half], share * one.weights, rtol=1e-5)
            np.testing.assert_array_equal(both.means_mm[half], one.means_mm)
            again = both.factors_per_mm[half] * width
            np.testing.assert_allclose(again, one.factors_per_mm, rtol=1e-4, atol=1e-8)


def seen_by(network: MixtureNetwork, samples: int) -> tuple[Any, Any]:
    random = np.random.default_rng(3)
    u = random.normal(size=(120, 2))
    mixtures = [network.mixture(one) for one in u]
    return u, np.stack([one.sample(samples, random) for one in mixtures if one is not None])


@pytest.mark.parametrize(
    "truly", [Widths(0.6, 1.3, 0.4), Widths(0.9, 2.0, 0.2), Widths(0.8, 0.8, 0.5)]
)
def test_those_widths_are_found_that_the_data_were_made_with(truly: Widths) -> None:
    arrays = random_arrays(2, (16,), (), 2, 8)
    u, samples = seen_by(MixtureNetwork(doubled(arrays, truly), "silu"), samples=20)
    made, widths = recalibrated(arrays, "silu", u, samples)
    if truly.narrow < truly.wide:
        assert widths.narrow == pytest.approx(truly.narrow, rel=0.06)
        assert widths.wide == pytest.approx(truly.wide, rel=0.06)
        assert widths.wide_share == pytest.approx(truly.wide_share, abs=0.06)
    assert widths.enough
    found = scores(MixtureNetwork(made, "silu"), u, samples)
    np.testing.assert_allclose(found.coverage(), [0.5, 0.8, 0.95], atol=0.03)


def test_a_network_that_is_nothing_like_the_data_is_not_widened_without_end() -> None:
    arrays = random_arrays(2, (16,), (), 2, 4)
    u, samples = seen_by(MixtureNetwork(arrays, "silu"), samples=5)
    _, widths = recalibrated(arrays, "silu", u, samples * 50.0)
    assert 1.0 / 3.0 - 1e-9 <= widths.narrow <= widths.wide <= 3.0 + 1e-9
    assert not widths.enough, "whoever trains it is told"


def test_an_array_that_is_given_is_not_changed() -> None:
    arrays = random_arrays(2, (16,), (), 2, 3)
    copies = {name: array.copy() for name, array in arrays.items()}
    doubled(arrays, Widths(0.7, 1.3, 0.5))
    for name, array in copies.items():
        np.testing.assert_array_equal(arrays[name], array)
