"""The network at run time: what the paper's equations say, its derivative, and what it refuses."""

from collections.abc import Callable

import numpy as np
import pytest

from safety.risk.model.mixture import FloatArray, Mixture
from safety.risk.model.mixture_network import MixtureNetwork, NetworkError
from tests.safety.risk.networks import Arrays, random_arrays

U = np.array([1.5, -2.0, 0.3, 4.0])


def by_the_equations(arrays: Arrays, activation: str, u: FloatArray) -> Mixture:
    """Layer by layer, in plain numpy; the factor as equation 2 has it."""
    functions: dict[str, Callable[[FloatArray], FloatArray]] = {
        "relu": lambda x: np.maximum(x, 0.0),
        "tanh": np.tanh,
        "silu": lambda x: x / (1.0 + np.exp(-x)),
    }

    def stack(name: str, x: FloatArray, active_end: bool) -> FloatArray:
        layer = 0
        while f"{name}.{layer}.weight" in arrays:
            x = arrays[f"{name}.{layer}.weight"] @ x + arrays[f"{name}.{layer}.bias"]
            layer += 1
            if active_end or f"{name}.{layer}.weight" in arrays:
                x = functions[activation](x)
        return x

    scale = float(arrays["output_scale_mm"])
    trunk = stack("trunk", (u - arrays["input_offset"]) / arrays["input_scale"], active_end=True)
    logits = stack("weights", trunk, active_end=False)
    d = arrays["output_offset_mm"].size
    means = arrays["output_offset_mm"] + scale * stack("means", trunk, False).reshape(-1, d)
    factors = np.zeros((len(means), d, d))
    rows, columns = np.triu_indices(d)
    factors[:, rows, columns] = stack("factors", trunk, False).reshape(len(means), -1)
    for factor in factors:
        np.fill_diagonal(factor, np.exp(np.clip(np.diag(factor), *arrays["log_diagonal_limits"])))
    weights = np.exp(logits) / np.exp(logits).sum()
    return Mixture.checked(weights, means, factors / scale)


@pytest.mark.parametrize("activation", ["relu", "tanh", "silu"])
@pytest.mark.parametrize(
    ("components", "dimensions", "trunk", "heads"),
    [(5, 3, (128, 128, 128), ()), (1, 3, (7,), ()), (16, 3, (30, 21), (9, 5)), (3, 9, (33,), (6,))],
)
def test_the_network_gives_the_mixture_that_the_equations_say(
    activation: str, components: int, dimensions: int, trunk: tuple[int], heads: tuple[int]
) -> None:
    arrays = random_arrays(4, trunk, heads, components, dimensions)
    network = MixtureNetwork(arrays, activation)
    assert (network.inputs, network.components, network.dimensions) == (4, components, dimensions)
    mixture, wanted = network.mixture(U), by_the_equations(arrays, activation, U)
    assert mixture is not None
    np.testing.assert_allclose(mixture.weights, wanted.weights, rtol=1e-4)
    np.testing.assert_allclose(mixture.means_mm, wanted.means_mm, atol=1e-3)
    np.testing.assert_allclose(mixture.factors_per_mm, wanted.factors_per_mm, atol=1e-5)


def test_what_comes_out_is_a_mixture_wherever_one_asks() -> None:
    network = MixtureNetwork(random_arrays(), "relu")
    for scale in (0.0, 1.0, 1e3, 1e6):
        mixture = network.mixture(scale * U)
        assert mixture is not None
        Mixture.checked(mixture.weights, mixture.means_mm, mixture.factors_per_mm)


@pytest.mark.parametrize("u", [[np.nan, 0, 0, 0], [0, np.inf, 0, 0], [1e300, 0, 0, 0]])
def test_an_input_without_a_finite_answer_gets_none(u: list[float]) -> None:
    assert MixtureNetwork(random_arrays(), "relu").mixture(u) is None


def test_an_input_of_another_length_is_an_error() -> None:
    with pytest.raises(ValueError, match="takes 4 numbers"):
        MixtureNetwork(random_arrays(), "relu").mixture([1.0, 2.0])


@pytest.mark.parametrize("activation", ["relu", "tanh", "silu"])
@pytest.mark.parametrize("heads", [(), (11, 6)])
def test_the_gradient_is_that_of_finite_differences(activation: str, heads: tuple[int]) -> None:
    arrays = random_arrays(4, (40, 30), heads, 4, 3, seed=3, dtype=np.float64)
    network = MixtureNetwork(arrays, activation)
    random = np.random.default_rng(4)
    slopes = random.normal(size=4), random.normal(size=(4, 3)), random.normal(size=(4, 3, 3))

    def value(u: FloatArray) -> float:
        mixture = network.mixture(u)
        assert mixture is not None
        parts = (mixture.weights, mixture.means_mm, mixture.factors_per_mm)
        return sum(float((s * part).sum()) for s, part in zip(slopes, parts, strict=True))

    step = 1e-6
    differences = [
        (value(U + step * axis) - value(U - step * axis)) / (2.0 * step) for axis in np.eye(4)
    ]
    np.testing.assert_allclose(network.gradient(U, *slopes), differences, rtol=1e-5, atol=1e-7)


def test_a_logarithm_beyond_its_limits_has_no_gradient() -> None:
    arrays = random_arrays(2, (8,), (), 1, 1, dtype=np.float64)
    arrays["factors.0.bias"][:] = 100.0
    network = MixtureNetwork(arrays, "tanh")
    mixture = network.mixture([0.0, 0.0])
    assert mixture is not None
    assert mixture.factors_per_mm[0, 0, 0] == pytest.approx(np.exp(4.0) / 40.0)
    slopes = np.zeros(1), np.zeros((1, 1)), np.ones((1, 1, 1))
    np.testing.assert_array_equal(network.gradient([0.0, 0.0], *slopes), 0.0)


def changed(name: str, array: object) -> Arrays:
    arrays = random_arrays()
    if array is None:
        del arrays[name]
    else:
        arrays[name] = np.asarray(array)
    return arrays


@pytest.mark.parametrize(
    ("name", "array", "told"),
    [
        ("trunk.0.weight", None, "trunk.0.weight: is missing"),
        ("trunk.1.bias", None, "trunk.1.bias: must be there"),
        ("trunk.1.weight", np.zeros((128, 5)), "trunk.1.weight: takes 5 inputs, but gets 128"),
        ("trunk.0.weight", np.zeros((128, 6)), "trunk.0.weight: must take 4 inputs"),
        ("means.0.weight", np.zeros((15, 64)), "means.0.weight: takes 64 inputs, but gets 128"),
        ("means.0.weight", np.zeros(15), r"means.0.weight: must be \(outputs, inputs\)"),
        ("factors.0.bias", np.full(30, np.nan), "factors.0.bias: must be finite numbers"),
        ("weights.0.bias", np.zeros(5, np.int64), "weights.0.bias: must be finite numbers"),
        ("weights.7.bias", np.zeros(5), "weights.7.bias: belongs to no layer"),
        ("input_scale", np.array([1.0, 0.0, 1.0, 1.0]), "input_scale: must be positive"),
        ("input_offset", None, "input_offset: is missing"),
        ("output_offset_mm", np.zeros(2), "means.0.weight: 15 outputs; must be 10"),
        ("output_scale_mm", np.array(-1.0), "output_scale_mm: must be one positive number"),
        ("input_scale", np.array([1.0, np.inf, 1.0, 1.0]), "input_scale: must be finite numbers"),
        ("output_scale_mm", np.array(np.inf), "output_scale_mm: must be finite numbers"),
        ("log_diagonal_limits", np.array([4.0, -3.0]), "log_diagonal_limits: must be two"),
    ],
)
def test_arrays_that_make_no_network_are_refused_by_name(
    name: str, array: object, told: str
) -> None:
    with pytest.raises(NetworkError, match=told):
        MixtureNetwork(changed(name, array), "relu")


def test_too_many_components_and_an_unknown_activation_are_refused() -> None:
    with pytest.raises(NetworkError, match="17 components"):
        MixtureNetwork(random_arrays(components=17), "relu")
    with pytest.raises(NetworkError, match="'gelu' is none of relu, tanh, silu"):
        MixtureNetwork(random_arrays(), "gelu")


# Inputs that come round.


TURN = np.array([0.0, 2.0 * np.pi, 0.0, 5.0])


def coming_round() -> tuple[Arrays, Arrays]:
    """A network whose second and fourth inputs come round; and one over all six features."""
    wide = random_arrays(6, (23, 11), (7,), 3, 4)
    wide["input_offset"][[1, 2, 4, 5]], wide["input_scale"][[1, 2, 4, 5]] = 0.0, 1.0
    arrays = dict(wide)
    for name in ("input_offset", "input_scale"):
        arrays[name] = np.array([wide[name][0], 0.0, wide[name][3], 0.0])
    arrays["input_scale"][[1, 3]] = 1.0
    return arrays | {"input_period": TURN}, wide


def features(u: FloatArray) -> FloatArray:
    turn, other = u[1], 2.0 * np.pi / 5.0 * u[3]
    return np.array([u[0], np.cos(turn), np.sin(turn), u[2], np.cos(other), np.sin(other)])


def test_an_input_that_comes_round_is_seen_as_its_cosine_and_sine() -> None:
    arrays, wide = coming_round()
    found = MixtureNetwork(arrays, "silu").mixture(U)
    wanted = MixtureNetwork(wide, "silu").mixture(features(U))
    assert found is not None
    assert wanted is not None
    for one, other in zip(
        (found.weights, found.means_mm, found.factors_per_mm),
        (wanted.weights, wanted.means_mm, wanted.factors_per_mm),
        strict=True,
    ):
        np.testing.assert_allclose(one, other, rtol=1e-6)


def test_after_a_period_the_mixture_is_the_same() -> None:
    network = MixtureNetwork(coming_round()[0], "silu")
    found, again = network.mixture(U), network.mixture(U + np.array([0.0, 1.0, 0.0, -2.0]) * TURN)
    assert found is not None
    assert again is not None
    np.testing.assert_allclose(found.means_mm, again.means_mm, atol=1e-4)


def test_the_derivative_by_an_input_that_comes_round_is_that_of_differences() -> None:
    arrays = {name: array.astype(np.float64) for name, array in coming_round()[0].items()}
    network = MixtureNetwork(arrays, "silu")
    random = np.random.default_rng(2)
    by = random.normal(size=3), random.normal(size=(3, 4)), np.triu(random.normal(size=(3, 4, 4)))

    def value(u: FloatArray) -> float:
        mixture = network.mixture(u)
        assert mixture is not None
        parts = mixture.weights, mixture.means_mm, mixture.factors_per_mm
        return float(sum((a * b).sum() for a, b in zip(by, parts, strict=True)))

    steps = 1e-5 * np.eye(4)
    wanted = [(value(U + step) - value(U - step)) / 2e-5 for step in steps]
    np.testing.assert_allclose(network.gradient(U, *by), wanted, rtol=1e-5)


@pytest.mark.parametrize(
    ("period", "told"),
    [
        (np.zeros(3), "input_period: must be one per input"),
        (np.array([0.0, -1.0, 0.0, 0.0]), "not below 0"),
        (np.array([1.0, 1.0, 1.0, 1.0]), "must take 8 inputs"),
        (np.zeros(4), "must take 4 inputs"),
    ],
)
def test_periods_that_do_not_fit_are_refused(period: FloatArray, told: str) -> None:
    with pytest.raises(NetworkError, match=told):
        MixtureNetwork(coming_round()[0] | {"input_period": period}, "relu")
