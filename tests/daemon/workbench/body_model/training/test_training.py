"""The network while it learns: the same mixture as at run time, and learnt from what is known."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from scipy.stats import multivariate_normal

torch = pytest.importorskip("torch", reason="pip install '.[training]'")

from daemon.workbench.body_model.training.network import (  # noqa: E402
    Beginning,
    MixtureDensityNetwork,
    NetworkShape,
    Scaling,
)
from daemon.workbench.body_model.training.training import (  # noqa: E402
    Check,
    TrainingError,
    TrainingSettings,
    train,
)
from safety.risk.model.mixture import Mixture  # noqa: E402
from safety.risk.model.mixture_network import MixtureNetwork  # noqa: E402

INPUTS = 2


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    """Small networks on a busy machine: threads would only wait for each other."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


SMALL = TrainingSettings(steps=120, groups=32, samples=16, check_every=40, learning_rate=1e-2)


def scaling(d: int = 3) -> Scaling:
    offset = np.arange(1.0, d + 1.0) * 10.0
    return Scaling(
        np.array([1.0, -2.0]), np.array([3.0, 0.5]), offset, 40.0, (-2.0, 4.0), np.zeros(2)
    )


def beginning(k: int, d: int = 3) -> Beginning:
    random = np.random.default_rng(4)
    roots = random.normal(size=(k, d, d)) * 3.0 + 20.0 * np.eye(d)
    return Beginning(random.normal(size=(k, d)) * 30.0, roots @ roots.transpose(0, 2, 1))


def network(shape: NetworkShape, d: int = 3, shaken: float = 0.3) -> MixtureDensityNetwork:
    """With weights as they could be after a while."""
    torch.manual_seed(3)
    made = MixtureDensityNetwork(shape, scaling(d), beginning(shape.components, d))
    with torch.no_grad():
        for parameter in made.parameters():
            parameter.add_(torch.randn_like(parameter), alpha=shaken / parameter.shape[-1] ** 0.5)
    return made


def run_time(made: MixtureDensityNetwork, activation: str, u: Any) -> Mixture:
    mixture = MixtureNetwork(made.arrays(), activation).mixture(u)
    assert mixture is not None
    return mixture


@pytest.mark.parametrize("activation", ["relu", "tanh", "silu"])
@pytest.mark.parametrize(("heads", "components", "d"), [((), 5, 3), ((7,), 1, 3), ((9, 6), 3, 8)])
def test_its_likelihood_is_that_of_the_mixture_at_run_time(
    activation: str, heads: tuple[int, ...], components: int, d: int
) -> None:
    made = network(NetworkShape(components, (16, 12), heads, activation), d)
    random = np.random.default_rng(5)
    for u in random.normal(size=(3, INPUTS)):
        mixture = run_time(made, activation, u)
        places = mixture.sample(20, random)
        scaled = scaling(d)
        with torch.inference_mode():
            nll = made.negative_log_likelihood(scaled.inputs(u[None]), scaled.places(places[None]))
        np.testing.assert_allclose(
            nll[0].numpy() + made.in_mm, -mixture.log_density(places), rtol=2e-4, atol=2e-4
        )


def test_its_likelihood_has_the_constant_of_the_normal_distribution() -> None:
    made = network(NetworkShape(1, (8,)))
    u = np.array([0.4, -1.0])
    mixture, places = run_time(made, "silu", u), np.random.default_rng(1).normal(size=(6, 3)) * 20
    covariance = np.linalg.inv(mixture.factors_per_mm[0].T @ mixture.factors_per_mm[0])
    expected = -multivariate_normal(mixture.means_mm[0], covariance).logpdf(places)
    with torch.inference_mode():
        nll = made.negative_log_likelihood(
            scaling().inputs(u[None]), scaling().places(places[None])
        )
    np.testing.assert_allclose(nll[0].numpy() + made.in_mm, expected, rtol=1e-4)


def test_it_begins_as_it_is_told_to() -> None:
    made = network(NetworkShape(4, (16,)), shaken=0.0)
    with torch.no_grad():
        for head in (made.means, made.factors, made.weights):
            head[-1].weight.zero_()  # type: ignore[operator]
    wanted, mixture = beginning(4), run_time(made, "silu", [1.0, 1.0])
    np.testing.assert_allclose(mixture.means_mm, wanted.means_mm, atol=1e-4)
    covariances = np.linalg.inv(mixture.factors_per_mm.transpose(0, 2, 1) @ mixture.factors_per_mm)
    np.testing.assert_allclose(covariances, wanted.covariances_mm2, rtol=1e-3, atol=0.1)
    np.testing.assert_allclose(mixture.weights, 0.25)


def data(n: int = 400, samples: int = 24, seed: int = 1) -> tuple[Any, Any]:
    """Two bumps whose places, spreads and weights depend on u."""
    random = np.random.default_rng(seed)
    u = random.uniform([-2.0, -3.0], [4.0, -1.0], (n, INPUTS))
    return u, np.stack([truth(one).sample(samples, random) for one in u])


def truth(u: Any) -> Mixture:
    bend = 10.0 * u[0]
    factors = [np.diag([0.2, 0.2, 0.1]), np.diag([0.1, 0.2, 0.3])]
    factors[0][0, 1] = 0.05 * u[0]
    share = 1.0 / (1.0 + np.exp(-u[1] - 2.0))
    means = [[bend, 0.0, 10.0], [2.0 * bend, 5.0 * u[1], 60.0]]
    return Mixture.checked([share, 1.0 - share], means, factors)


def spread_beginning(k: int) -> Beginning:
    means = np.column_stack([np.zeros((k, 2)), np.linspace(0.0, 80.0, k)])
    return Beginning(means, np.repeat(np.eye(3)[None] * 400.0, k, axis=0))


def learnt(settings: TrainingSettings = SMALL, **more: Any) -> Any:
    return train(
        *data(), NetworkShape(2, (32, 32)), scaling(), spread_beginning(2), settings, **more
    )


def test_it_learns_a_mixture_that_depends_on_its_inputs() -> None:
    found = learnt(TrainingSettings(steps=500, groups=40, samples=24, learning_rate=1e-2))
    u, samples = data(100, seed=9)
    model = MixtureNetwork(found.arrays, found.activation)
    lost = []
    for one, places in zip(u, samples, strict=True):
        mixture = model.mixture(one)
        assert mixture is not None
        lost.append((truth(one).log_density(places) - mixture.log_density(places)).mean())
    assert np.mean(lost) < 0.08
    assert found.best.kept_back < found.checks[0].kept_back


def test_a_seed_is_a_training() -> None:
    one, same = learnt(), learnt()
    other = learnt(TrainingSettings(**{**vars(SMALL), "seed": 2}))
    for name, array in one.arrays.items():
        np.testing.assert_array_equal(array, same.arrays[name])
    assert one.checks == same.checks != other.checks


def test_the_best_weights_are_kept_and_it_stops_when_nothing_gets_better() -> None:
    heard: list[Check] = []
    few = (np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 0.5], [3.0, 1.5]]), data(4, 6)[1])
    settings = TrainingSettings(
        steps=4000,
        groups=4,
        samples=6,
        learning_rate=1e-2,
        validation_share=0.5,
        check_every=25,
        patience=3,
    )
    found = train(
        *few,
        NetworkShape(2, (32,)),
        scaling(),
        spread_beginning(2),
        settings,
        heard.append,
    )
    assert found.checks[-1].step < 4000
    assert found.best == min(found.checks, key=lambda check: check.kept_back)
    assert heard == list(found.checks)


def test_a_thin_cloud_does_not_make_it_explode() -> None:
    u, samples = data(60, 8)
    samples[:, :, 2] = 17.0
    found = train(u, samples, NetworkShape(1, (16,)), scaling(), spread_beginning(1), SMALL)
    mixture = MixtureNetwork(found.arrays, found.activation).mixture(u[0])
    assert mixture is not None
    assert mixture.factors_per_mm[0, 2, 2] <= np.exp(4.0) / 40.0 * (1.0 + 1e-6)


def test_what_is_taken_is_as_good_as_its_check_said() -> None:
    found, (u, samples) = learnt(), data()
    model = MixtureNetwork(found.arrays, found.activation)
    nll = []
    for i in found.kept_back:
        mixture = model.mixture(u[i])
        assert mixture is not None
        nll.append(-mixture.log_density(samples[i]).mean())
    assert len(nll) == 40
    assert np.mean(nll) == pytest.approx(found.best.kept_back, abs=1e-3)


def strewn(n: int = 300, samples: int = 12) -> tuple[Any, Any]:
    """Eight coordinates that follow u, and in each sample miss it all to one side or the other."""
    random = np.random.default_rng(8)
    u = random.uniform(-1.0, 1.0, (n, INPUTS))
    middle = np.concatenate([u, u**2, np.sin(2.0 * u), u[:, ::-1] * u], axis=1) * 20.0
    side = random.choice([-1.0, 1.0], (n, samples, 1)) * np.r_[3.0, 3.0, np.zeros(6)]
    return u, middle[:, None] + side + 0.5 * random.standard_normal((n, samples, 8))


@pytest.mark.parametrize("components", [2, 5])
def test_one_component_learns_alone_and_is_split_as_it_misses(components: int) -> None:
    whole = Beginning(np.zeros((1, 8)), np.eye(8)[None] * 400.0)
    scale = Scaling(np.zeros(2), np.ones(2), np.zeros(8), 5.0, (-4.0, 4.0), np.zeros(2))
    settings = TrainingSettings(
        steps=400, groups=64, samples=12, learning_rate=1e-2, check_every=40, alone=0.5
    )
    found = train(*strewn(), NetworkShape(components, (32, 32)), scale, whole, settings)
    steps = [check.step for check in found.checks]
    assert steps == sorted(steps)
    assert steps[-1] == 400
    before = [check.kept_back for check in found.checks if check.step <= 200]
    after = [check.kept_back for check in found.checks if check.step > 200]
    assert after[0] < before[-1] - 0.2
    mixture = MixtureNetwork(found.arrays, "silu").mixture([0.3, -0.2])
    assert mixture is not None
    assert mixture.components == components
    at_0 = mixture.means_mm[:, 0] - 0.3 * 20.0
    left, right = mixture.weights[at_0 < 0.0].sum(), mixture.weights[at_0 > 0.0].sum()
    assert left == pytest.approx(0.5, abs=0.15)
    assert right == pytest.approx(0.5, abs=0.15)
    assert mixture.weights @ np.abs(at_0) == pytest.approx(3.0, abs=0.8)


def test_few_groups_that_are_learnt_by_heart_stay_one_component() -> None:
    whole = Beginning(np.zeros((1, 8)), np.eye(8)[None] * 400.0)
    scale = Scaling(np.zeros(2), np.ones(2), np.zeros(8), 5.0, (-4.0, 4.0), np.zeros(2))
    settings = TrainingSettings(
        steps=300, groups=10, samples=12, learning_rate=1e-2, check_every=50, alone=0.5
    )
    found = train(*strewn(10), NetworkShape(2, (32, 32)), scale, whole, settings)
    after = [check.kept_back for check in found.checks if check.step > 150]
    assert after == sorted(after), "the longer, the worse"
    assert found.best == min(found.checks, key=lambda check: check.kept_back)
    assert found.best.step <= 150
    mixture = MixtureNetwork(found.arrays, "silu").mixture([0.3, -0.2])
    assert mixture is not None
    assert mixture.components == 1


def test_too_few_samples_cannot_say_how_to_split() -> None:
    settings = TrainingSettings(steps=20, groups=4, samples=2, alone=0.5)
    with pytest.raises(TrainingError, match="too few for 8 components"):
        train(*data(8, 2), NetworkShape(8, (8,)), scaling(), spread_beginning(1), settings)


def test_without_a_beginning_it_begins_as_chance_has_it() -> None:
    plain = [learnt_plainly(TrainingSettings(**{**vars(SMALL), "seed": seed})) for seed in (1, 1)]
    for name, array in plain[0].arrays.items():
        np.testing.assert_array_equal(array, plain[1].arrays[name])
    assert plain[0].best.kept_back < plain[0].checks[0].kept_back


def learnt_plainly(settings: TrainingSettings) -> Any:
    return train(*data(), NetworkShape(2, (32, 32)), scaling(), None, settings)


def test_one_group_is_too_few() -> None:
    u, samples = data(1)
    with pytest.raises(TrainingError, match="1 groups of samples"):
        train(u, samples, NetworkShape(1, (4,)), scaling(), spread_beginning(1), SMALL)


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: NetworkShape(0), "1 to 16 components"),
        (lambda: NetworkShape(17), "1 to 16 components"),
        (lambda: NetworkShape(2, ()), "a trunk has one layer"),
        (lambda: NetworkShape(2, activation="sine"), "no activation 'sine'"),
        (lambda: TrainingSettings(steps=0), "must be 1 or more"),
        (lambda: TrainingSettings(validation_share=1.0), "between 0 and 1"),
        (lambda: TrainingSettings(alone=1.0), "and less than 1"),
    ],
)
def test_settings_that_cannot_be_are_refused(make: Any, told: str) -> None:
    with pytest.raises(ValueError, match=told):
        make()
