"""The bank: sums that are kept up to date say what sums made anew would."""

import pickle
from math import exp, factorial, pi, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.learning.inverse.bank import BankControllers, BankPrecision
from daemon.learning.inverse.exact import BatchControllers
from daemon.learning.inverse.prior import Prior
from daemon.learning.samples.motion import MotionSample
from daemon.learning.samples.receptive_fields import ReceptiveFields
from tests.daemon.learning.exploring_arm import exploration, fields_over, settings_for

POSTURE = np.full(6, 10.0)
EXPLORED = exploration(1500)
FIELDS = fields_over(EXPLORED, 12.0)
SETTINGS = settings_for(EXPLORED)
CAPACITY = 150


def bank(precision: BankPrecision | None = None, **options: object) -> BankControllers:
    settings = settings_for(EXPLORED, **options)
    return BankControllers(FIELDS, settings, CAPACITY, POSTURE, precision=precision)


def errors(
    ours: BankControllers, exact: BatchControllers, samples: tuple[MotionSample, ...]
) -> list[float]:
    """Relative to the exact answer's length, one for each sample after it was added."""
    found = []
    for sample in samples:
        ours.add(sample)
        exact.add(sample)
        query = sample.delta_tip_mm, sample.tip_mm, sample.u
        expected = exact.command(*query).delta_u
        missed = ours.command(*query).delta_u - expected
        found.append(float(np.linalg.norm(missed) / np.linalg.norm(expected)))
    return found


@pytest.mark.parametrize(
    ("precision", "median", "worst"),
    [(BankPrecision.fine(), 1e-6, 1e-3), (BankPrecision.fast(), 1e-3, 3e-2)],
)
@pytest.mark.parametrize("pretrained", [True, False])
def test_it_is_as_precise_as_it_says(
    precision: BankPrecision, median: float, worst: float, pretrained: bool
) -> None:
    prior = Prior.of(EXPLORED, FIELDS, SETTINGS, POSTURE) if pretrained else None
    ours = BankControllers(FIELDS, SETTINGS, CAPACITY, POSTURE, prior, precision)
    exact = BatchControllers(FIELDS, SETTINGS, CAPACITY, POSTURE, prior)
    ours.refill(EXPLORED[:CAPACITY])
    exact.refill(EXPLORED[:CAPACITY])
    found = errors(ours, exact, exploration(120, seed=5))
    assert np.median(found) < median
    assert max(found) < worst


def test_after_many_steps_it_is_as_precise_as_at_first() -> None:
    """Thousands here; the benchmark does a million."""
    ours = bank()
    for sample in exploration(3000, seed=6):
        ours.add(sample)
        ours.solve()
    exact = BatchControllers(FIELDS, SETTINGS, CAPACITY, POSTURE)
    exact.refill(ours.window)
    found = errors(ours, exact, exploration(40, seed=7))
    assert np.median(found) < 1e-6


def test_sums_that_samples_went_in_and_out_of_are_those_of_the_samples_left() -> None:
    """Without being made anew in turn, which would hide it."""
    ours = bank()
    ours.refill(EXPLORED[:CAPACITY])
    ours._refresh_one = lambda: None  # type: ignore[method-assign]
    walk = exploration(3000, seed=6)
    for lap in range(6):
        for sample in walk[lap % 7 :]:
            ours.add(sample)
    kept = ours._moments
    whole = np.flatnonzero(~kept.broken & (kept.mass > 1e-3))
    assert len(whole) > 10
    ring = ours._ring
    weights = np.array([FIELDS.weights(s.tip_mm, s.u) for s in ours.window]).T
    weights *= weights > BankPrecision.fine().sample_cut
    order = np.roll(np.arange(CAPACITY), -ours.window.slot)
    assert kept.mass[whole] == pytest.approx(weights[whole].sum(axis=1), rel=1e-9)
    for i in whole:
        above = ring.cost[order] - kept.reference[i]
        rewarded = weights[i] * np.exp(-0.5 * kept.anchor[i] * above)
        for power, term in enumerate(kept.terms[i]):
            factors = rewarded * (-0.5 * above) ** power / factorial(power)
            summed = np.abs(factors) @ np.abs(ring.products)[order]
            missed = np.abs(term - factors @ ring.products[order])
            assert (missed <= 1e-9 * summed.max()).all()


def test_a_field_that_lost_its_samples_is_exactly_empty() -> None:
    """What rounding leaves of sums that were taken apart would look like a model."""
    ours = bank(BankPrecision(sample_cut=1e-2, field_cut=1e-6, order=3, tolerance=0.05))
    ours.refill(EXPLORED[:CAPACITY])
    visited = np.flatnonzero(ours._moments.samples)
    there = ours.fields.centres[visited[0]] * ours.fields.scale
    near = tuple(
        sample._replace(tip_mm=there[:3], u=there[3:]) for sample in EXPLORED[: CAPACITY + 1]
    )
    for sample in near:
        ours.add(sample)
    moments = ours._moments
    left = np.setdiff1d(visited, np.flatnonzero(ours.fields.weights(there[:3], there[3:]) > 1e-2))
    assert len(left) > 3
    for kept in (
        moments.terms,
        moments.squares,
        moments.mass,
        moments.square,
        moments.cost,
        moments.samples,
    ):
        assert (kept[left] == 0.0).all()
    assert (ours.parameters[left] == 0.0).all()


def one_field(capacity: int, **options: object) -> tuple[BankControllers, BatchControllers]:
    """A field round the origin, as bank and exactly. No turns: what is tested must do alone."""
    d = len(FIELDS.scale)
    fields = ReceptiveFields(np.zeros((1, d)), np.eye(d)[None], FIELDS.scale)
    settings = settings_for(EXPLORED, **options)
    ours = BankControllers(fields, settings, capacity, np.zeros(6))
    ours._refresh_one = lambda: None  # type: ignore[method-assign]
    return ours, BatchControllers(fields, settings, capacity, np.zeros(6))


def placed(sample: MotionSample, away: float, cost: float) -> MotionSample:
    """The same motion near a place `away` · (1, …, 1) · scale, so long that it costs `cost`."""
    place = FIELDS.place(sample.tip_mm, sample.u) * 0.1 + away
    step = sample.delta_u / SETTINGS.axis_steps
    longer = np.sqrt(6.0 * cost / float(step @ step))
    return MotionSample(
        place[:3] * FIELDS.scale[:3],
        place[3:] * FIELDS.scale[3:],
        sample.delta_u * longer,
        sample.delta_tip_mm * longer,
    )


def test_a_field_whose_mass_has_shrunk_is_made_anew() -> None:
    """A crowd at the centre goes, a few far out stay: beside them, what rounding left is much."""
    ours, exact = one_field(60, attractor_gain=0.0, minimum_mass=1e-12)
    crowd = [placed(sample, 0.0, 1.0) for sample in EXPLORED[:2000]]
    few = [placed(sample, 2.0, 1.0) for sample in EXPLORED[:60]]
    for sample in crowd:
        ours.add(sample)
    ours.solve()
    for sample in few:
        ours.add(sample)
    exact.refill(few)
    assert 0.0 < ours._moments.mass[0] < 1e-5
    assert ours.parameters == pytest.approx(exact.parameters, rel=1e-8, abs=1e-8)


def test_a_sample_that_outweighs_all_others_leaves_no_trace() -> None:
    """It costs so little that its reward is e³⁰⁰ times theirs; then it goes."""
    ours, exact = one_field(30, sigma_rule="printed", attractor_gain=0.0)
    expensive = [placed(sample, 0.0, 25.0) for sample in EXPLORED[:30]]
    ours.refill(expensive)
    for sample in [placed(EXPLORED[30], 0.0, 1.0), *expensive]:
        ours.add(sample)
    exact.refill(expensive)
    assert ours.parameters == pytest.approx(exact.parameters, rel=1e-6, abs=1e-8)


def test_the_series_follows_the_samples_that_weigh_most() -> None:
    """The mean cost, and so σ², stays nearly what it was; the cheapest samples go."""
    ours, exact = one_field(60, kappa=30.0, attractor_gain=0.0)
    ours.refill([placed(s, 0.0, 0.1 + 1.8 * (n % 2)) for n, s in enumerate(EXPLORED[:60])])
    alike = [placed(s, 0.0, 0.91 + 0.15 * (n % 3)) for n, s in enumerate(EXPLORED[60:120])]
    for sample in alike:
        ours.add(sample)
    exact.refill(alike)
    assert ours.parameters == pytest.approx(exact.parameters, rel=1e-6, abs=1e-8)


def test_rewards_neither_vanish_nor_overflow_when_costs_are_large_and_then_small() -> None:
    """The printed rule squares the costs: the first samples' rewards are exp(−10⁵) and less."""
    settings = settings_for(EXPLORED, sigma_rule="printed", weighting=np.full(6, 30.0))
    everything = BankPrecision(sample_cut=1e-300, field_cut=1e-12, order=4, tolerance=0.05)
    ours = BankControllers(FIELDS, settings, CAPACITY, POSTURE, precision=everything)
    ours._refresh_one = lambda: None  # type: ignore[method-assign]
    exact = BatchControllers(FIELDS, settings, CAPACITY, POSTURE)
    walk = exploration(200, seed=8)
    expensive = [s._replace(delta_u=3.0 * s.delta_u) for s in walk[:100]]
    for sample in [*expensive, *walk[100:]]:
        ours.add(sample)
        exact.add(sample)
        query = sample.delta_tip_mm, sample.tip_mm, sample.u
        expected = exact.command(*query).delta_u
        assert ours.command(*query).delta_u == pytest.approx(expected, rel=1e-4, abs=1e-4)


def test_every_field_is_made_anew_in_turn() -> None:
    ours, healthy = bank(), bank()
    for one in (ours, healthy):
        one.refill(EXPLORED[:CAPACITY])
    ours._moments.terms[:] += 1.0
    for number, sample in enumerate(EXPLORED[: FIELDS.count]):
        for one in (ours, healthy):
            one.add(sample)
            one.solve()
        same = np.isclose(ours.parameters, healthy.parameters, rtol=1e-6, atol=1e-8)
        assert same[: number + 1].all()
        assert number > 3 or not same.all()


def test_it_solves_no_more_than_asked_and_no_field_twice() -> None:
    ours = bank()
    ours.refill(EXPLORED[:CAPACITY])
    ours.add(EXPLORED[CAPACITY])
    stale = int(ours._moments.stale.sum())
    assert stale > 8
    ours.solve(5)
    assert ours._moments.stale.sum() == stale - 5
    ours.solve()
    assert not ours._moments.stale.any()
    made_anew = ours.made_anew
    ours.solve()
    assert ours.made_anew == made_anew


def test_a_command_solves_only_what_has_a_share_in_it() -> None:
    ours = bank(BankPrecision(sample_cut=1e-9, field_cut=1e-2, order=3, tolerance=0.05))
    ours.refill(EXPLORED[:CAPACITY])
    query = EXPLORED[CAPACITY]
    ours.add(query)
    ours.command(query.delta_tip_mm, query.tip_mm, query.u)
    weights = FIELDS.weights(query.tip_mm, query.u)
    stale = ours._moments.stale
    assert not stale[weights > 1.001e-2 * weights.max()].any()
    assert stale[weights < 0.999e-2 * weights.max()].any()


def test_what_is_kept_does_not_grow() -> None:
    ours = bank()
    walk = exploration(3000, seed=6)

    def kept_bytes(samples: tuple[MotionSample, ...]) -> int:
        for sample in samples:
            ours.add(sample)
            ours.command(sample.delta_tip_mm, sample.tip_mm, sample.u)
        return len(pickle.dumps(ours))

    assert kept_bytes(walk[: 2 * CAPACITY]) == kept_bytes(walk[2 * CAPACITY :])


@given(
    order=st.integers(1, 6),
    epsilon=st.floats(-0.5, 0.5),
    x=st.floats(0.0, 200.0),
)
def test_what_the_series_leaves_out_is_bounded_whatever_the_cost(
    order: int, epsilon: float, x: float
) -> None:
    """Of exp(−½ s C) at s = s₀ (1 + ε), with x = ½ s₀ C."""
    terms = sum((-epsilon * x) ** j / factorial(j) for j in range(order + 1))
    missed = abs(exp(-x * (1.0 + epsilon)) - exp(-x) * terms)
    distance = abs(epsilon) / (1.0 - abs(epsilon))
    assert missed <= distance ** (order + 1) / sqrt(2.0 * pi * (order + 1)) + 1e-12


@pytest.mark.parametrize(
    "wrong", [{"order": 0}, {"sample_cut": 0.0}, {"tolerance": 1.5}, {"field_cut": np.nan}]
)
def test_a_precision_that_makes_no_sense_is_refused(wrong: dict[str, float]) -> None:
    parts = {"sample_cut": 1e-6, "field_cut": 1e-6, "order": 2, "tolerance": 0.1} | wrong
    with pytest.raises(ValueError, match="must be"):
        BankPrecision(**parts)  # type: ignore[arg-type]
