"""Receptive fields: how much a local model counts at a place."""

import numpy as np
import pytest

from daemon.learning.samples.receptive_fields import ReceptiveFields
from drivers.pose import Vector

SCALE = np.array([100.0, 100.0, 50.0, 20.0, 10.0])


def some_fields(count: int = 7, seed: int = 0, diagonal: bool = False) -> ReceptiveFields:
    random = np.random.default_rng(seed)
    d = len(SCALE)
    roots = random.normal(size=(count, d, d))
    metrics = roots @ roots.transpose(0, 2, 1) + np.eye(d)
    if diagonal:
        metrics = metrics * np.eye(d)
    return ReceptiveFields(random.normal(size=(count, d)), metrics, SCALE)


def weight(fields: ReceptiveFields, index: int, tip_mm: Vector, u: Vector) -> float:
    away = np.r_[tip_mm, u] / SCALE - fields.centres[index]
    return float(np.exp(-0.5 * away @ fields.metrics[index] @ away))


def test_a_weight_is_gaussian_in_the_scaled_distance() -> None:
    fields = some_fields()
    tip_mm, u = np.array([20.0, -30.0, 10.0]), np.array([5.0, -2.0])
    expected = [weight(fields, i, tip_mm, u) for i in range(fields.count)]
    assert fields.weights(tip_mm, u) == pytest.approx(expected, rel=1e-12)


def test_a_field_counts_fully_at_its_centre_and_less_everywhere_else() -> None:
    fields = some_fields()
    centre = fields.centres[3] * SCALE
    assert fields.weights(centre[:3], centre[3:])[3] == 1.0
    assert fields.weights(centre[:3] + 1.0, centre[3:])[3] < 1.0


def test_logarithms_of_weights_still_differ_where_weights_are_all_zero() -> None:
    fields = some_fields()
    far = fields.log_weights(np.full(3, 1e4), np.full(2, 1e4))
    assert (fields.weights(np.full(3, 1e4), np.full(2, 1e4)) == 0.0).all()
    assert np.isfinite(far).all()
    assert len(np.unique(far)) == fields.count


def test_roots_are_upper_triangular_and_make_the_metrics() -> None:
    fields = some_fields()
    assert np.array_equal(fields.roots, np.triu(fields.roots))
    assert np.allclose(fields.roots.transpose(0, 2, 1) @ fields.roots, fields.metrics)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"scale": SCALE[:3]}, r"scale must be"),
        ({"scale": -SCALE}, "scale must be positive"),
        ({"centres": np.zeros((7, 4))}, "centres must be"),
        ({"metrics": np.zeros((6, 5, 5))}, "metrics must be"),
        ({"metrics": np.zeros((7, 5, 5))}, "not positive definite"),
        ({"metrics": np.triu(np.ones((7, 5, 5)))}, "not symmetric"),
        ({"centres": np.full((7, 5), np.nan)}, "not finite"),
    ],
)
def test_what_are_no_fields_is_refused(change: dict[str, Vector], message: str) -> None:
    fields = some_fields()
    parts = {"centres": fields.centres, "metrics": fields.metrics, "scale": fields.scale} | change
    with pytest.raises(ValueError, match=message):
        ReceptiveFields(**parts)
