"""What a locally weighted regression does for its users: learn, answer, be kept, refuse."""

import io
import resource
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from daemon.learning.lwpr.learning_kernels import adapt, close, learn
from daemon.learning.lwpr.model import FloatArray, Lwpr, warm_up
from daemon.learning.lwpr.query_kernels import (
    activate,
    blend_confidence,
    blend_slopes,
    derivative,
    predict,
)
from daemon.learning.lwpr.settings import LwprSettings
from tests.daemon.learning.streams import arm, cross, cross_of

_KERNELS = (activate, predict, learn, close, adapt, blend_slopes, blend_confidence, derivative)

TURN = 2.0 * np.pi

SHARED = LwprSettings(3, 2, (8.0, 6.0), localisation=(2, 0), norm_in=(1.0, 2.0, 1.0))
ADAPTING = LwprSettings(
    2, 1, (25.0, 25.0), diagonal_only=False, adapt_metric=True, init_learning_rate=250.0, meta=True
)
COMPAT = LwprSettings(
    3, 2, (8.0, 6.0, 3.0), adapt_metric=True, init_s2=1e-10, prune_above=0.8, compat=True
)
PERIODIC = LwprSettings(2, 1, (6.0, 8.0), periods=(TURN, None))
ALL = pytest.mark.parametrize("settings", [SHARED, ADAPTING, COMPAT, PERIODIC])


def _samples(settings: LwprSettings, count: int, seed: int = 0) -> tuple[FloatArray, FloatArray]:
    random = np.random.default_rng(seed)
    x = random.uniform(-1.0, 1.0, (count, settings.inputs))
    mix = np.linspace(1.0, -2.0, settings.inputs * settings.outputs).reshape(settings.inputs, -1)
    return x, np.sin(2.0 * x @ mix) + random.normal(0.0, 0.03, (count, settings.outputs))


def _taught(settings: LwprSettings, count: int = 600, seed: int = 0) -> Lwpr:
    model = Lwpr(settings)
    for x, y in zip(*_samples(settings, count, seed), strict=True):
        model.update(x, y)
    return model


def _predictions(model: Lwpr, queries: FloatArray) -> FloatArray:
    return np.array([model.predict(query) for query in queries])


def _nmse(model: Lwpr, x: FloatArray, y: FloatArray) -> FloatArray:
    """Mean squared error by output, in units of the output's variance."""
    nmse: FloatArray = ((_predictions(model, x) - y) ** 2).mean(axis=0) / y.var(axis=0)
    return nmse


def _same_bits(one: dict[str, NDArray[Any]], other: dict[str, NDArray[Any]]) -> bool:
    return one.keys() == other.keys() and all(
        one[name].tobytes() == other[name].tobytes() for name in one
    )


# What it learns


def test_a_linear_function_is_learnt_as_it_is() -> None:
    random = np.random.default_rng(0)
    matrix = random.normal(size=(2, 3))
    model = Lwpr(LwprSettings(3, 2, (1.0,) * 3, add_threshold=1.0, forgetting_initial=0.99))
    for x in random.uniform(-1.0, 1.0, (3000, 3)):
        model.update(x, matrix @ x + 5.0)
    query = np.array([0.1, -0.3, 0.2])
    assert model.predict(query) == pytest.approx(matrix @ query + 5.0, rel=1e-3)
    assert model.slopes(query) == pytest.approx(matrix, abs=5e-3)


def test_learning_the_shape_of_fields_brings_the_cross_below_three_halves_of_a_percent() -> None:
    settings = LwprSettings(
        2, 1, (25.0, 25.0), generate_below=0.2, kernel="bisquare", diagonal_only=False,
        adapt_metric=True, init_learning_rate=250.0, meta=True,
    )  # fmt: skip
    model = Lwpr(settings)
    model.fit(*cross(50_000, seed=0))
    side = np.linspace(-1.0, 1.0, 41)
    grid = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    assert _nmse(model, grid, cross_of(grid))[0] < 0.015
    assert model.count < 70


def test_fields_shared_by_all_outputs_are_worth_more_than_as_many_shared_out() -> None:
    scales: dict[str, Any] = {"norm_in": (1.0,) * 6 + (0.1,) * 6, "norm_out": (12.0,) * 3}
    apart = LwprSettings(12, 3, (15.5,) * 6 + (1e-6,) * 6, init_s2=1e-10, compat=True, **scales)
    shared = LwprSettings(12, 3, (26.0,) * 6, localisation=tuple(range(6)), **scales)
    models = [Lwpr(settings) for settings in (apart, shared)]
    x, y = arm(4000, seed=0)
    for model in models:
        for sample in zip(x, y, strict=True):
            model.update(*sample)
    queries, truth = arm(400, seed=1)
    assert models[1].count <= models[0].count
    assert (_nmse(models[1], queries, truth) < _nmse(models[0], queries, truth)).all()


def test_a_field_born_among_others_goes_on_with_their_slope() -> None:
    settings = LwprSettings(1, 1, (30.0,))
    model = Lwpr(settings)
    for x in np.random.default_rng(0).uniform(-0.3, 0.3, 300):
        model.update([x], [2.0 * x])
    before = model.count
    edge = 0.31 + np.sqrt(-2.0 * np.log(settings.generate_below) / 30.0)
    model.update([edge], [2.0 * edge])
    assert model.count == before + 1
    assert model.predict([edge + 0.1]) == pytest.approx([2.0 * (edge + 0.1)], abs=0.02)


def test_told_to_make_no_new_fields_it_learns_with_those_it_has() -> None:
    settings = LwprSettings(2, 1, (40.0, 40.0), kernel="bisquare")
    arrays = _taught(settings).to_arrays()
    model = Lwpr.from_arrays(replace(settings, generate_below=0.0), arrays)
    fields, before = model.count, model.predict([0.0, 0.0])
    for x in np.random.default_rng(1).uniform(-3.0, 3.0, (500, 2)):
        model.update(x, [5.0])
    assert model.count == fields
    assert model.predict([0.0, 0.0]) > before


@pytest.mark.parametrize("compat", [False, True])
def test_the_same_sample_for_ever_leaves_a_model_that_is_finite(compat: bool) -> None:
    model = Lwpr(
        LwprSettings(
            2, 1, (10.0, 10.0), forgetting_initial=0.9, forgetting_final=0.9, adapt_metric=True,
            compat=compat,
        )
    )  # fmt: skip
    for x, y in zip(*cross(300, seed=0), strict=True):
        model.update(x, y)
    for _ in range(20_000):
        model.update([0.1, 0.2], [0.7])
    assert model.predict([0.1, 0.2]) == pytest.approx([0.7], abs=1e-3)
    assert np.isfinite(model.slopes([0.1, 0.2])).all()
    assert np.isfinite(model.metrics).all()


def test_forgetting_sets_how_fast_a_changed_world_is_learnt() -> None:
    errors = []
    for forgetting in (0.9999, 0.97):
        settings = LwprSettings(
            1, 1, (60.0,), forgetting_initial=forgetting, forgetting_final=forgetting
        )
        model, random = Lwpr(settings), np.random.default_rng(0)
        for x in random.uniform(-1.0, 1.0, (2000, 1)):
            model.update(x, np.sin(3.0 * x))
        for x in random.uniform(-1.0, 1.0, (300, 1)):
            model.update(x, np.sin(3.0 * x) + 1.0)
        queries = np.linspace(-0.9, 0.9, 50)[:, None]
        errors.append(np.abs(_predictions(model, queries) - np.sin(3.0 * queries) - 1.0).mean())
    assert errors[1] < 0.1 < 0.5 < errors[0]


def test_a_rate_far_too_high_neither_shatters_the_fields_nor_loses_the_model() -> None:
    settings = LwprSettings(
        12, 3, (24.0,) * 6, localisation=tuple(range(6)), norm_in=(1.0,) * 6 + (0.1,) * 6,
        norm_out=(12.0,) * 3, diagonal_only=False, adapt_metric=True, init_learning_rate=1e4,
    )  # fmt: skip
    model = Lwpr(settings)
    model.fit(*arm(2000, seed=0))
    assert np.isfinite(model.metrics).all()
    assert (np.linalg.eigvalsh(model.metrics) > -1e-6).all()
    assert (_nmse(model, *arm(200, seed=1)) < 1.0).all()


def test_two_fields_in_one_place_become_one_and_the_better_one_stays() -> None:
    kept = {}
    for prune_above in (0.6, 1.0):
        settings = LwprSettings(
            2, 1, (25.0, 25.0), generate_below=0.3, prune_above=prune_above, adapt_metric=True,
            init_learning_rate=250.0, penalty=1e-4,
        )  # fmt: skip
        model = Lwpr(settings)
        model.fit(*cross(4000, seed=1))
        kept[prune_above] = model
    assert kept[0.6].pruned > (0,) == kept[1.0].pruned
    assert kept[0.6].count < kept[1.0].count
    x, _ = cross(400, seed=2)
    errors = {limit: _nmse(model, x, cross_of(x))[0] for limit, model in kept.items()}
    assert errors[0.6] < 1.5 * errors[1.0]


def test_epochs_go_through_the_batch_in_another_order_each_time() -> None:
    x, y = cross(500, seed=0)
    seen: list[float] = []
    model = Lwpr(ADAPTING)
    queries, _ = cross(300, seed=1)

    def after_epoch(epoch: int) -> None:
        assert epoch == len(seen)
        seen.append(float(_nmse(model, queries, cross_of(queries))[0]))

    model.fit(x, y, epochs=20, seed=3, after_epoch=after_epoch)
    assert len(seen) == 20
    assert seen[-1] < 0.7 * seen[0]


# What it answers


def test_where_no_field_is_near_it_says_nothing_and_has_no_confidence() -> None:
    model = _taught(SHARED)
    far = [50.0, 0.0, -50.0]
    assert not model.predict(far).any()
    assert not model.slopes(far).any()
    assert not model.jacobian(far).any()
    assert np.isinf(model.confidence(far)).all()
    assert model.activation(far) == 0.0


def test_before_the_first_sample_it_knows_nothing() -> None:
    model = Lwpr(SHARED)
    assert model.count == 0
    assert model.predict([0.0, 0.0, 0.0]).tolist() == [0.0, 0.0]
    assert np.isinf(model.confidence([0.0, 0.0, 0.0])).all()
    assert model.weights([0.0, 0.0, 0.0]).shape == (0,)
    assert model.activation([0.0, 0.0, 0.0]) == 0.0
    assert model.centres.shape == (0, 2)
    assert model.metrics.shape == (0, 2, 2)


@ALL
def test_the_jacobian_is_the_derivative_of_the_prediction(settings: LwprSettings) -> None:
    model = _taught(settings)
    for query in np.random.default_rng(5).uniform(-0.8, 0.8, (5, settings.inputs)):
        numeric = np.empty((settings.outputs, settings.inputs))
        for i, step in enumerate(1e-6 * np.eye(settings.inputs)):
            rise = model.predict(query + step) - model.predict(query - step)
            numeric[:, i] = rise / 2e-6
        assert model.jacobian(query) == pytest.approx(numeric, abs=1e-6, rel=1e-6)


def test_slopes_are_the_fields_slopes_by_weight() -> None:
    model = _taught(SHARED)
    alone = model.centres[3]
    query = np.array([alone[1], 0.0, alone[0]])
    weights = model.weights(query)
    assert weights[3] == pytest.approx(1.0)
    assert model.activation(query) == weights.max()
    step = np.array([0.0, 1e-3, 0.0])
    rise = (model.predict(query + step) - model.predict(query - step)) / 2e-3
    assert model.slopes(query)[:, 1] == pytest.approx(rise, rel=1e-9)


def test_weights_follow_from_centres_and_metrics() -> None:
    model = _taught(ADAPTING)
    query = np.array([0.2, -0.4])
    away = query - model.centres
    squared = np.einsum("fa,fab,fb->f", away, model.metrics, away)
    assert model.weights(query) == pytest.approx(np.exp(-0.5 * squared))


def test_confidence_is_about_the_noise_where_there_are_data_and_grows_beyond_them() -> None:
    random = np.random.default_rng(0)
    model = Lwpr(LwprSettings(2, 1, (10.0, 10.0)))
    for x in random.uniform(-1.0, 1.0, (4000, 2)):
        model.update(x, [x.sum() + random.normal(0.0, 0.2)])
    inside, outside = model.confidence([0.0, 0.0])[0], model.confidence([1.35, 1.35])[0]
    assert 0.05 < inside < 0.4
    assert outside > 2.0 * inside


@ALL
def test_confidence_is_never_less_than_nothing_nor_undefined(settings: LwprSettings) -> None:
    model = Lwpr(settings)
    queries = np.random.default_rng(9).uniform(-1.2, 1.2, (10, settings.inputs))
    for i, (x, y) in enumerate(zip(*_samples(settings, 400), strict=True)):
        model.update(x, y)
        if i % 20 == 0:
            assert all((model.confidence(query) >= 0.0).all() for query in queries)


def test_a_localisation_input_alone_moves_the_weights() -> None:
    model = _taught(SHARED)
    query = np.array([0.1, 0.2, 0.3])
    elsewhere = query + np.array([0.0, 5.0, 0.0])
    assert (model.weights(query) == model.weights(elsewhere)).all()
    assert (model.weights(query) != model.weights(query + np.array([0.1, 0.0, 0.0]))).all()


@ALL
def test_asking_changes_nothing(settings: LwprSettings) -> None:
    model = _taught(settings)
    before = model.to_arrays()
    for query in np.random.default_rng(2).uniform(-2.0, 2.0, (20, settings.inputs)):
        model.predict(query)
        model.confidence(query)
        model.jacobian(query)
        model.slopes(query)
        model.weights(query)
        model.activation(query)
    assert _same_bits(before, model.to_arrays())


# Inputs that come round


def _round_samples(start: float, count: int = 1500) -> tuple[FloatArray, FloatArray]:
    """A smooth function of an angle, which is told within one turn from `start` on."""
    random = np.random.default_rng(0)
    angle, other = random.uniform(0.0, TURN, count), random.uniform(-0.5, 0.5, count)
    y = np.sin(angle) + 0.5 * np.cos(2.0 * angle) * other
    told = start + np.mod(angle - start, TURN)
    return np.stack([told, other], axis=1), y[:, None]


def test_a_periodic_input_has_no_seam() -> None:
    models = []
    for start in (0.0, -np.pi, 2.0):
        model = Lwpr(PERIODIC)
        for x, y in zip(*_round_samples(start), strict=True):
            model.update(x, y)
        models.append(model)
    assert models[0].count == models[1].count == models[2].count
    around = np.stack([np.linspace(0.0, TURN, 60), np.full(60, 0.1)], axis=1)
    expected = _predictions(models[0], around)
    for model in models[1:]:
        assert _predictions(model, around) == pytest.approx(expected, abs=1e-9)
        turned = around + np.array([7 * TURN, 0.0])
        assert _predictions(model, turned) == pytest.approx(expected, abs=1e-9)
    just_below, just_above = models[0].predict([-1e-9, 0.1]), models[0].predict([1e-9, 0.1])
    assert just_below == pytest.approx(just_above, abs=1e-6)
    truth = np.sin(around[:, :1]) + 0.05 * np.cos(2.0 * around[:, :1])
    assert np.abs(expected - truth).max() < 0.1


def test_a_periodic_input_needs_no_fields_on_both_sides_of_its_seam() -> None:
    for periods, fields in (((TURN, None), 1), (None, 2)):
        model = Lwpr(LwprSettings(2, 1, (3.0, 8.0), periods=periods))
        model.update([0.1, 0.0], [1.0])
        model.update([TURN - 0.1, 0.0], [1.0])
        assert model.count == fields


# What is kept


@ALL
def test_a_kept_model_goes_on_to_the_last_bit(settings: LwprSettings) -> None:
    model = _taught(settings)
    file = io.BytesIO()
    np.savez(file, **model.to_arrays())  # type: ignore[arg-type]
    file.seek(0)
    with np.load(file) as arrays:
        again = Lwpr.from_arrays(settings, dict(arrays))
    assert _same_bits(model.to_arrays(), again.to_arrays())
    assert again.counts == model.counts
    assert again.pruned == model.pruned
    for x, y in zip(*_samples(settings, 300, seed=7), strict=True):
        assert model.update(x, y).tobytes() == again.update(x, y).tobytes()
    assert _same_bits(model.to_arrays(), again.to_arrays())


@ALL
def test_the_same_seed_gives_the_same_bits(settings: LwprSettings) -> None:
    models = [Lwpr(settings) for _ in range(3)]
    for model, seed in zip(models, (4, 4, 5), strict=True):
        model.fit(*_samples(settings, 300), epochs=2, seed=seed)
    first, same, other = (model.to_arrays() for model in models)
    assert _same_bits(first, same)
    assert not _same_bits(first, other)


def test_arrays_of_another_model_are_refused() -> None:
    arrays = _taught(SHARED).to_arrays()
    with pytest.raises(ValueError, match="does not fit"):
        Lwpr.from_arrays(ADAPTING, arrays)
    with pytest.raises(ValueError, match="missing"):
        Lwpr.from_arrays(SHARED, {k: v for k, v in arrays.items() if "mean" not in k})
    poisoned = {name: array.copy() for name, array in arrays.items()}
    poisoned["set0/slope"][0, 0, 0] = np.nan
    with pytest.raises(ValueError, match="not finite"):
        Lwpr.from_arrays(SHARED, poisoned)


# What is refused


@ALL
@pytest.mark.parametrize("poison", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("place", ["first input", "last input", "first output", "last output"])
def test_what_is_not_finite_is_refused_and_changes_nothing(
    settings: LwprSettings, poison: float, place: str
) -> None:
    model = _taught(settings, 60)
    before = model.to_arrays()
    x, y = np.zeros(settings.inputs), np.zeros(settings.outputs)
    which, kind = place.split()
    {"input": x, "output": y}[kind][0 if which == "first" else -1] = poison
    with pytest.raises(ValueError, match="finite"):
        model.update(x, y)
    with pytest.raises(ValueError, match="finite"):
        model.fit([x], [y])
    if kind == "input":
        for ask in (model.predict, model.confidence, model.jacobian, model.slopes):
            with pytest.raises(ValueError, match="finite"):
                ask(x)
        with pytest.raises(ValueError, match="finite"):
            model.activation(x)
    assert _same_bits(before, model.to_arrays())


@ALL
def test_vectors_of_another_size_are_refused_and_change_nothing(settings: LwprSettings) -> None:
    model = _taught(settings, 60)
    before = model.to_arrays()
    x, y = np.zeros(settings.inputs), np.zeros(settings.outputs)
    for bad_x, bad_y in [(x[:-1], y), (np.r_[x, 0.0], y), (x, y[:0]), (x, np.r_[y, 0.0])]:
        with pytest.raises(ValueError, match=r"element|size"):
            model.update(bad_x, bad_y)
    with pytest.raises(ValueError, match="one vector"):
        model.predict(x[None])
    with pytest.raises(ValueError, match="elements"):
        model.predict(x[:-1])
    with pytest.raises(ValueError, match="row"):
        model.fit(x, y)
    assert _same_bits(before, model.to_arrays())


def test_whatever_holds_numbers_is_taken() -> None:
    one, other = _taught(SHARED, 60), _taught(SHARED, 60)
    x, y = np.array([0.1, 0.2, 0.3]), np.array([0.5, -0.5])
    frozen = np.repeat(x, 2).astype(np.float64)
    frozen.flags.writeable = False
    assert (one.update(x, y) == other.update(frozen[::2], [0.5, -0.5])).all()
    assert (one.predict(x) == other.predict((0.1, 0.2, 0.3))).all()


# What it costs


def test_memory_stays_what_it_is_once_no_fields_come() -> None:
    warm_up()
    model = _taught(SHARED, 3000)
    held, fields = model.nbytes, model.count
    x, y = _samples(SHARED, 1000)
    before = _resident_bytes()
    for i in range(60_000):
        model.update(x[i % 1000], y[i % 1000])
        model.predict(x[i % 1000])
    assert model.count == fields
    assert model.nbytes == held
    assert _resident_bytes() - before < 3_000_000


def test_after_warming_up_nothing_is_compiled_any_more() -> None:
    warm_up()
    compiled = {kernel: len(kernel.signatures) for kernel in _KERNELS}
    assert all(count == 1 for count in compiled.values())
    for settings in (SHARED, ADAPTING, COMPAT, PERIODIC):
        model = _taught(settings, 30)
        query = np.arange(settings.inputs)
        for ask in (model.predict, model.confidence, model.jacobian, model.slopes):
            ask(query)
    assert compiled == {kernel: len(kernel.signatures) for kernel in _KERNELS}


def _resident_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()


def test_room_that_was_reserved_is_not_grown_into() -> None:
    settings = LwprSettings(2, 2, (80.0, 80.0))
    model, plain = Lwpr(settings), _taught(settings)
    model.reserve(plain.count + 1)
    held = model.nbytes
    for x, y in zip(*_samples(settings, 600), strict=True):
        model.update(x, y)
    assert model.count > 40
    assert model.nbytes == held
    assert _same_bits(model.to_arrays(), plain.to_arrays())
