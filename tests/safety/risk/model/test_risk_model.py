"""A model of the body: made of arrays that fit each other, and asked only where it knows."""

import numpy as np
import pytest

from safety.risk.model.risk_model import RiskModelError, risk_model
from tests.safety.risk.networks import Arrays, model_arrays


def test_the_parts_of_a_model_are_there() -> None:
    model = risk_model(model_arrays(), "relu", "silu")
    assert (model.inputs, model.points.components, model.shapes.dimensions) == (4, 5, 6)
    assert model.basis.coefficients == 6


def test_it_knows_what_is_near_its_training_and_nothing_else() -> None:
    arrays = model_arrays()
    model = risk_model(arrays, "relu", "relu")
    scale, known = arrays["points/input_scale"], arrays["training/inputs"]
    beside = known[17] + np.array([0.3, 0.0, 0.0, 0.4]) * scale
    assert model.distance(known[17]) == pytest.approx(0.0, abs=1e-9)
    assert model.distance(beside) <= 0.5 + 1e-9
    assert model.knows(beside) == (model.distance(beside) <= model.reach)
    assert model.knows(known[3])
    assert not model.knows(known.max(axis=0) + 10.0 * scale)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e300])
def test_it_knows_nothing_of_what_is_not_finite(bad: float) -> None:
    model = risk_model(model_arrays(), "relu", "relu")
    with np.errstate(over="ignore"):
        assert not model.knows([0.0, bad, 0.0, 0.0])


def without(name: str) -> Arrays:
    arrays = model_arrays()
    del arrays[name]
    return arrays


@pytest.mark.parametrize(
    ("arrays", "told"),
    [
        (without("points/trunk.0.weight"), "points/trunk.0.weight: is missing"),
        (without("shapes/input_scale"), "shapes/input_scale: is missing"),
        (without("basis/modes"), "basis/modes: is missing"),
        (without("training/reach"), "training/reach: is missing"),
        (model_arrays() | {"training/reach": np.array(0.0)}, "training/reach: must be one pos"),
        (model_arrays() | {"training/inputs": np.zeros((9, 3))}, r"inputs: must be .* \(n, 4\)"),
        (model_arrays() | {"training/inputs": np.full((9, 4), np.nan)}, "training/inputs: must be"),
        (model_arrays() | {"training/load": np.zeros(3)}, "training/load: belongs to nothing"),
        (model_arrays() | {"elsewhere": np.zeros(3)}, "elsewhere: belongs to nothing"),
        (model_arrays() | {"basis/radius_mm": np.zeros(11)}, "basis/radius_mm must be positive"),
        (model_arrays(coefficients=5) | {"basis/modes": np.ones((6, 11, 3))}, "over 5 coefficie"),
        (model_arrays(dimensions=2), "points/: places have 3 coordinates, not 2"),
        (model_arrays(shape_inputs=3), "shapes/: takes 3 inputs, points/ 4"),
    ],
)
def test_parts_that_do_not_fit_are_refused_by_name(arrays: Arrays, told: str) -> None:
    with pytest.raises(RiskModelError, match=told):
        risk_model(arrays, "relu", "relu")


def coming_round(period: float = 6.0) -> Arrays:
    """The second of four inputs comes round."""
    arrays = model_arrays()
    for prefix, wide in (("points/", 5), ("shapes/", 5)):
        weight = arrays[f"{prefix}trunk.0.weight"]
        arrays[f"{prefix}trunk.0.weight"] = np.resize(weight, (len(weight), wide))
        arrays[f"{prefix}input_period"] = np.array([0.0, period, 0.0, 0.0])
    return arrays


def test_what_comes_round_is_known_in_every_round() -> None:
    arrays = coming_round()
    model = risk_model(arrays, "relu", "relu")
    known, round_after_round = arrays["training/inputs"], np.array([0.0, 6.0, 0.0, 0.0])
    assert model.features(known[0]).shape == (5,)
    for one in known[:9]:
        for rounds in (-3, 1, 40):
            assert model.distance(one + rounds * round_after_round) == pytest.approx(0.0, abs=1e-6)
    opposite = known[5] + 0.5 * round_after_round
    assert model.distance(opposite) > 0.2
    assert model.scale[1] == pytest.approx(2.0 * np.pi / 6.0)


def test_both_networks_come_round_after_the_same() -> None:
    arrays = coming_round() | {"shapes/input_period": np.array([0.0, 7.0, 0.0, 0.0])}
    with pytest.raises(RiskModelError, match="other inputs come round"):
        risk_model(arrays, "relu", "relu")


def test_a_place_of_another_length_is_an_error() -> None:
    with pytest.raises(ValueError, match="take 4 numbers"):
        risk_model(coming_round(), "relu", "relu").knows([0.0, 1.0])


@pytest.mark.parametrize("period", [0.0, 6.0])
def test_what_is_known_is_what_is_within_reach_of_the_training(period: float) -> None:
    model = risk_model(coming_round(period) if period else model_arrays(), "relu", "relu")
    random = np.random.default_rng(4)
    off = random.normal(scale=0.6 * model.reach / model.scale, size=(400, 4))
    places = model.known[random.integers(0, len(model.known), 400)] + off
    known = [model.knows(u) for u in places]
    assert known == [model.distance(u) <= model.reach for u in places]
    assert 20 < sum(known) < 380
    assert model.knows(model.known[-1])
    assert not model.knows([np.nan, 0.0, 0.0, 0.0])
    assert not model.knows([np.inf, 0.0, 0.0, 0.0])
