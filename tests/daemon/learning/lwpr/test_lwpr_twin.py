"""The compiled regression and its twin in plain numpy, over all that can be set."""

from functools import cache
from typing import Any

import numpy as np
import pytest

from daemon.learning.lwpr.model import FloatArray, Lwpr
from daemon.learning.lwpr.settings import LwprSettings
from tests.daemon.learning.lwpr.lwpr_twin import Twin

pytestmark = pytest.mark.xdist_group("lwpr_twin")  # which learns once for all tests

SAMPLES = 700
TOLERANCE = 1e-9
"""Rounding alone is 1e-15; learning of metrics and rates feeds on it."""

ADAPTING: dict[str, Any] = {"adapt_metric": True, "init_learning_rate": 60}
CONFIGURATIONS: dict[str, dict[str, Any]] = {
    "fixed": {"inputs": 3, "outputs": 2, "init_metric": (6.0, 4.0, 5.0)},
    "one input": {"inputs": 1, "outputs": 2, "init_metric": (40.0,), "meta": True, **ADAPTING},
    "diagonal": {"inputs": 2, "outputs": 2, "init_metric": (12.0, 8.0), **ADAPTING},
    "diagonal, meta": {
        "inputs": 2, "outputs": 1, "init_metric": (12.0, 8.0), "meta": True, **ADAPTING,
    },
    "full, meta": {
        "inputs": 2, "outputs": 2, "init_metric": ((12.0, 2.0), (2.0, 8.0)), "meta": True,
        "diagonal_only": False, **ADAPTING,
    },
    "bisquare": {
        "inputs": 2, "outputs": 2, "init_metric": (12.0, 8.0), "kernel": "bisquare",
        "diagonal_only": False, "meta": True, **ADAPTING,
    },
    "localised elsewhere": {
        "inputs": 4, "outputs": 3, "init_metric": (5.0, 7.0), "localisation": (3, 0),
        "regression": (1, 2, 0), "norm_in": (1.0, 2.0, 0.5, 1.5), "norm_out": (1.0, 9.0, 0.3),
        "add_threshold": 0.99, "forgetting_initial": 0.99, **ADAPTING,
    },
    "many directions": {
        "inputs": 5, "outputs": 2, "init_metric": (2.0,), "localisation": (4,),
        "add_threshold": 1.0, "forgetting_initial": 0.97, "forgetting_final": 0.99,
        "forgetting_tau": 0.9,
    },
    "periodic": {
        "inputs": 3, "outputs": 2, "init_metric": (3.0, 8.0, 5.0), "periods": (None, 1.0, 0.7),
        "diagonal_only": False, **ADAPTING,
    },
    "pruning": {
        "inputs": 2, "outputs": 2, "init_metric": (12.0, 8.0), "prune_above": 0.4,
        "penalty": 1e-3, "generate_below": 0.3, **ADAPTING,
    },
    "compat, pruning": {
        "inputs": 2, "outputs": 1, "init_metric": (12.0, 8.0), "prune_above": 0.5, "compat": True,
        "penalty": 1e-4, "meta": True, "generate_below": 0.3, "init_s2": 1e-10, **ADAPTING,
    },
    "compat, long steps": {
        "inputs": 2, "outputs": 1, "init_metric": (12.0, 8.0), "compat": True,
        "adapt_metric": True, "init_learning_rate": 2000, "diagonal_only": False,
    },
}  # fmt: skip


def _stream(settings: LwprSettings, seed: int = 0) -> tuple[FloatArray, FloatArray]:
    random = np.random.default_rng(seed)
    x = random.uniform(-1.0, 1.0, (SAMPLES, settings.inputs)) * settings.norm_in
    mix = random.normal(size=(settings.inputs, settings.outputs))
    z = x / settings.norm_in
    y = np.sin(2.0 * z @ mix) + 0.3 * z @ mix + random.normal(0.0, 0.05, (SAMPLES, mix.shape[1]))
    return x, y * settings.norm_out


def _far_apart(ours: FloatArray, theirs: FloatArray) -> float:
    """Relative to the largest; where something is infinite both must be."""
    known = np.isfinite(theirs)
    np.testing.assert_array_equal(np.isfinite(ours), known)
    largest = np.abs(theirs[known]).max(initial=1e-12)
    return float(np.abs(ours[known] - theirs[known]).max(initial=0.0) / largest)


@cache
def _twin(name: str) -> tuple[Twin, FloatArray]:
    """Once it has learnt, and what it said of each sample before."""
    settings = LwprSettings(**CONFIGURATIONS[name])
    twin = Twin(settings)
    said = [twin.update(*sample) for sample in zip(*_stream(settings), strict=True)]
    return twin, np.array(said)


@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_the_compiled_one_is_its_twin(name: str) -> None:
    settings = LwprSettings(**CONFIGURATIONS[name])
    x, y = _stream(settings)
    model, (twin, theirs) = Lwpr(settings), _twin(name)
    ours = np.array([model.update(*sample) for sample in zip(x, y, strict=True)])
    assert model.counts == (len(twin.fields),)
    assert model.pruned == (twin.pruned,)
    assert _far_apart(ours, theirs) < TOLERANCE
    assert _far_apart(model.centres, twin.centres) < TOLERANCE
    assert _far_apart(model.metrics, twin.metrics) < TOLERANCE
    queries = np.random.default_rng(1).uniform(-1.5, 1.5, (40, settings.inputs))
    queries *= settings.norm_in
    for ask in ("predict", "confidence", "slopes"):
        answers = [[getattr(m, ask)(query) for query in queries] for m in (model, twin)]
        assert _far_apart(np.array(answers[0]), np.array(answers[1])) < TOLERANCE, ask


def test_the_configurations_reach_what_they_are_named_for() -> None:
    def twin(name: str) -> Twin:
        return _twin(name)[0]

    assert twin("pruning").pruned > 3
    assert twin("compat, pruning").pruned > 3
    assert any(field.slope_at_birth is not None for field in twin("fixed").fields)
    assert max(len(f.models[0].directions) for f in twin("many directions").fields) >= 4
    start = CONFIGURATIONS["compat, long steps"]["init_learning_rate"]
    assert any(field.alpha.min() < start for field in twin("compat, long steps").fields)
