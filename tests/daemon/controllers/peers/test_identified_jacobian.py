"""The Jacobian that is identified by least squares: local where the body asks for it."""

import numpy as np
import pytest

from daemon.controllers.peers.identified_jacobian import IdentifiedJacobian
from tests.daemon.controllers.peers import bodies

MIDDLE = 0.5 * bodies.SCALE
NOWHERE = np.zeros(3)


def identified(bent: float, noise_mm: float = 0.0) -> IdentifiedJacobian:
    found = IdentifiedJacobian(bodies.SCALE)
    found.begin(bodies.model_of(bodies.motions(bent=bent, noise_mm=noise_mm)))
    return found


def missed(found: IdentifiedJacobian, bent: float) -> float:
    """Of the Jacobian, relative to it, on average over places of the travel."""
    places = bodies.SCALE * np.random.default_rng(9).uniform(0.2, 0.8, (40, bodies.AXES))
    shares = []
    for u in places:
        truth = bodies.true_jacobian(u, bent) * bodies.SCALE
        off = found.at(NOWHERE, u) * bodies.SCALE - truth
        shares.append(np.linalg.norm(off) / np.linalg.norm(truth))
    return float(np.mean(shares))


def test_of_a_linear_body_it_is_the_same_everywhere() -> None:
    found = identified(bent=0.0, noise_mm=1.0)
    corners = [found.at(NOWHERE, share * bodies.SCALE) for share in (0.1, 0.9)]
    np.testing.assert_allclose(corners[0] * bodies.SCALE, corners[1] * bodies.SCALE, atol=3.0)
    assert missed(found, 0.0) < 0.05


def test_of_a_bent_body_it_is_that_of_the_place() -> None:
    anywhere = IdentifiedJacobian(bodies.SCALE)
    anywhere.measured(bodies.true_jacobian(MIDDLE))
    assert missed(identified(bent=1.0, noise_mm=0.2), 1.0) < 0.5 * missed(anywhere, 1.0)


def test_far_from_all_motions_it_says_that_it_knows_nothing() -> None:
    found = identified(bent=1.0)
    assert found.covered(NOWHERE, MIDDLE) == 1.0
    assert found.covered(NOWHERE, 20.0 * bodies.SCALE) < 0.1
    assert np.isfinite(found.at(NOWHERE, 20.0 * bodies.SCALE)).all()


def test_what_was_measured_without_an_exploration_comes_back_from_a_file() -> None:
    one, other = IdentifiedJacobian(bodies.SCALE), IdentifiedJacobian(bodies.SCALE)
    one.measured(bodies.true_jacobian(MIDDLE))
    other.restore(one.to_arrays())
    np.testing.assert_array_equal(one.at(NOWHERE, MIDDLE), other.at(NOWHERE, MIDDLE))
    with pytest.raises(ValueError, match="4 axes"):
        other.restore({"everywhere": np.zeros((3, 2))})
