"""Whether a measured tip fits the model: the mixture's tail, and the sequential test over it."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from scipy.stats import chi2

from safety.risk import tip_consistency
from safety.risk.model.mixture import FloatArray, Mixture
from safety.risk.model.risk_model import RiskModel, risk_model
from safety.risk.tip_consistency import (
    LIMIT_S,
    REFERENCE,
    RENEWED_S,
    TipConsistency,
    TipModel,
    false_alarms_per_hour,
)
from safety.risk.tip_kernels import tail
from tests.safety.risk.test_body_risk import arrays

FRAME_NS = 25_000_000
HOPELESS = 1e-12
AT_THE_REFERENCE = float(np.exp(-REFERENCE))


class Stream:
    """Frames, one after the other."""

    def __init__(self) -> None:
        self.test = TipConsistency()
        self.t_ns = 0
        self.add(0.5, 1)

    def add(self, probability: float, frames: int) -> int:
        """How many frames it took for the test to change its mind; all, if it did not."""
        before = self.test.consistent
        for number in range(1, frames + 1):
            self.t_ns += FRAME_NS
            if self.test.add(probability, self.t_ns) is not before:
                return number
        return frames


def mixture(random: np.random.Generator, components: int, d: int) -> Mixture:
    weights = random.dirichlet(np.ones(components))
    factors = np.triu(0.2 * random.normal(size=(components, d, d)), 1)
    factors += np.eye(d) * random.uniform(0.3, 1.0, (components, 1, d))
    return Mixture(weights, random.normal(size=(components, d)), factors)


@pytest.mark.parametrize("d", [3, 8])
def test_the_tail_is_that_of_each_component_beyond_its_ellipsoid_through_the_tip(d: int) -> None:
    random = np.random.default_rng(d)
    one, modes, base = mixture(random, 4, d), random.normal(size=(d, 3)), random.normal(size=3)
    variance = np.array([0.5, 1.0, 2.0])
    for place in random.normal(scale=6.0, size=(20, 3)):
        expected = 0.0
        for weight, mean, factor in zip(one.weights, one.means_mm, one.factors_per_mm, strict=True):
            covariance = modes.T @ np.linalg.inv(factor.T @ factor) @ modes + np.diag(variance)
            off = place - base - mean @ modes
            expected += weight * chi2.sf(off @ np.linalg.solve(covariance, off), 3)
        parts = one.weights, one.means_mm, one.factors_per_mm
        found = tail(*parts, base, modes, variance, place)
        assert found == pytest.approx(expected, rel=1e-9, abs=1e-14)


def test_a_tip_far_out_raises_the_alarm_in_seven_frames_and_not_in_six() -> None:
    stream = Stream()
    assert stream.add(HOPELESS, 20) == 7
    assert stream.test.consistent is False
    assert stream.test.statistic >= 1.0


def test_six_frames_of_an_outlier_are_forgotten() -> None:
    stream = Stream()
    for _ in range(100):
        stream.add(HOPELESS, 6)
        assert stream.test.consistent
        assert 0.8 < stream.test.statistic < 1.0
        stream.add(0.5, 20)
    assert stream.test.statistic == 0.0


def test_what_one_body_in_three_hundred_does_never_adds_up() -> None:
    stream = Stream()
    assert stream.add(AT_THE_REFERENCE, 100_000) == 100_000
    assert stream.test.consistent


def test_a_little_less_likely_takes_its_time() -> None:
    stream = Stream()
    frames = stream.add(AT_THE_REFERENCE * np.exp(-1.0), 1000)
    assert frames * FRAME_NS * 1e-9 == pytest.approx(LIMIT_S, abs=0.03)


def test_it_takes_four_good_seconds_to_take_the_alarm_back() -> None:
    stream = Stream()
    stream.add(HOPELESS, 7)
    stream.add(HOPELESS, 2000)
    assert stream.test.statistic == 2.0
    frames = stream.add(0.9, 1000)
    assert frames * FRAME_NS * 1e-9 == pytest.approx(2.0 * LIMIT_S, abs=0.03)
    assert stream.test.consistent
    assert stream.test.statistic == 0.0


def test_an_alarm_stays_while_the_tip_is_only_just_not_far_enough_out() -> None:
    stream = Stream()
    stream.add(HOPELESS, 7)
    assert stream.add(AT_THE_REFERENCE, 5000) == 5000
    assert not stream.test.consistent


def test_the_limit_itself_raises_the_alarm(monkeypatch: pytest.MonkeyPatch) -> None:
    frame_s = FRAME_NS * 1e-9
    monkeypatch.setattr(tip_consistency, "LIMIT_S", 12.0 * frame_s)
    stream = Stream()
    assert stream.add(HOPELESS, 1) == 1
    assert stream.test.statistic == 1.0
    assert not stream.test.consistent


def test_a_gap_says_nothing_of_what_was_in_it() -> None:
    test = TipConsistency()
    for frame in range(2):
        assert test.add(HOPELESS, frame * 60_000_000_000)
    assert test.statistic == pytest.approx(12.0 * 0.1 / LIMIT_S)


@pytest.mark.parametrize("nothing", [np.nan, np.inf])
def test_what_is_no_number_is_no_evidence(nothing: float) -> None:
    stream = Stream()
    stream.add(HOPELESS, 3)
    before = stream.test.statistic
    stream.add(nothing, 1000)
    assert stream.test.statistic == before


def test_a_frame_that_goes_back_in_time_counts_nothing() -> None:
    test = TipConsistency()
    test.add(0.5, 10 * FRAME_NS)
    assert test.add(HOPELESS, 0)
    assert test.statistic == 0.0


def test_there_is_at_most_one_false_alarm_in_an_hour_of_a_body_as_modelled() -> None:
    """What is promised, and what comes of bodies that stay as they are for a while."""
    assert false_alarms_per_hour() == pytest.approx(360.0 * np.exp(-0.2) / 300.0)
    assert false_alarms_per_hour() <= 1.0
    random, alarms, hours = np.random.default_rng(0), 0, 100.0
    stream = Stream()
    for _ in range(round(hours * 3600.0 / RENEWED_S)):
        probability = float(random.random())
        if probability > AT_THE_REFERENCE and stream.test.statistic == 0.0:
            stream.t_ns += round(RENEWED_S * 1e9)  # nothing happens
            continue
        alarmed = False
        for _ in range(round(RENEWED_S * 1e9 / FRAME_NS)):
            before = stream.test.consistent
            stream.add(probability, 1)
            alarmed |= before and not stream.test.consistent
        alarms += alarmed
    assert 0.5 < alarms / hours < 1.3
    assert alarms / hours == pytest.approx(false_alarms_per_hour(), rel=0.3)


# The model's tip.


@pytest.fixture(scope="module")
def model() -> RiskModel:
    """Its tip goes along x, 10 mm per unit of the first input."""
    return risk_model(arrays(), "silu", "relu")


def test_the_tip_is_looked_for_where_the_axes_lately_were(model: RiskModel) -> None:
    tip, now, before = TipModel(model, 1.0), np.array([2.0, 0, 0, 0]), np.array([1.0, 0, 0, 0])
    middle = tip.place([now], np.zeros(3))
    assert middle is not None
    mean_mm = model.basis.base_mm[-1] + np.array([10.0, 0.0, 0.0])
    alone, lately = tip.place([now], mean_mm), tip.place([now, before], mean_mm)
    assert alone is not None
    assert lately is not None
    assert alone.probability < lately.probability
    assert lately.off_mm < alone.off_mm
    turned_round = tip.place([before, now], mean_mm)
    assert turned_round is not None
    assert turned_round.probability == lately.probability
    assert turned_round.off_mm == lately.off_mm


def test_of_two_places_as_likely_the_one_that_is_told_first_counts(model: RiskModel) -> None:
    right, left = np.array([1.0, 0, 0, 0]), np.array([-1.0, 0, 0, 0])
    middle_mm = model.basis.base_mm[-1]
    place = TipModel(model, 1.0).place([right, left], middle_mm)
    assert place is not None
    assert (place.shift @ model.basis.modes[:, -1])[0] < 0.0


def test_of_one_place_of_the_axes_the_probability_is_the_same(model: RiskModel) -> None:
    tip, at = TipModel(model, 1.0), np.array([2.0, 0, 0, 0])
    seen = model.basis.base_mm[-1] + np.array([21.0, -2.0, 1.0])
    place = tip.place([at], seen)
    assert place is not None
    assert tip.probability(at, seen) == place.probability
    assert tip.probability(np.full(4, 1e6), seen) is None


def test_nothing_is_said_where_the_model_knows_nothing(model: RiskModel) -> None:
    tip = TipModel(model, 1.0)
    known, strange = np.zeros(4), np.array([50.0, 0.0, 0.0, 0.0])
    assert tip.place([known, strange], np.zeros(3)) is None
    assert tip.place([], np.zeros(3)) is None


def test_how_far_the_shape_is_off_goes_with_the_tip(model: RiskModel) -> None:
    at = np.zeros(4)
    tip = TipModel(model, 1e-3)
    place = tip.place([at], model.basis.base_mm[-1] + np.array([3.0, -2.0, 0.0]))
    assert place is not None
    assert place.off_mm == pytest.approx(np.hypot(3.0, 2.0), abs=0.5)
    assert place.shift @ model.basis.modes[:, -1] == pytest.approx([3.0, -2.0, 0.0], abs=0.01)


def test_the_shape_moves_with_the_tip_as_shapes_drawn_from_the_mixture_do() -> None:
    """By regression: of 400 000 drawn shapes on their tips, as a tracker would measure them."""
    random = np.random.default_rng(5)
    one, modes_mm, base_mm = mixture(random, 3, 4), random.normal(size=(4, 2, 3)), np.ones((2, 3))
    accuracy_mm, seen_mm = 3.0, np.array([4.0, -1.0, 2.0])
    model = SimpleNamespace(
        basis=SimpleNamespace(base_mm=base_mm, modes=modes_mm),
        shapes=SimpleNamespace(mixture=lambda u: one),
        knows=lambda u: True,
    )
    place = TipModel(cast(RiskModel, model), accuracy_mm).place([np.zeros(4)], seen_mm)
    assert place is not None
    which = random.choice(3, size=400_000, p=one.weights)
    drawn = one.means_mm[which] + np.einsum(
        "nij,nj->ni", np.linalg.inv(one.factors_per_mm)[which], random.normal(size=(400_000, 4))
    )
    tips = base_mm[-1] + drawn @ modes_mm[:, -1]
    measured = tips + random.normal(scale=accuracy_mm, size=tips.shape)
    slope, *_ = np.linalg.lstsq(measured - measured.mean(0), drawn - drawn.mean(0))
    off_mm = seen_mm - measured.mean(0)
    assert place.off_mm == pytest.approx(float(np.linalg.norm(off_mm)), abs=0.03)
    assert place.shift == pytest.approx(off_mm @ slope, abs=0.03)


def test_a_less_accurate_tip_is_less_of_a_surprise_and_moves_the_shape_less(
    model: RiskModel,
) -> None:
    at, place = np.zeros(4), model.basis.base_mm[-1] + np.array([8.0, 0.0, 0.0])
    fine, coarse = (TipModel(model, accuracy).place([at], place) for accuracy in (0.1, 10.0))
    assert fine is not None
    assert coarse is not None
    assert fine.probability < coarse.probability
    assert np.linalg.norm(fine.shift) > np.linalg.norm(coarse.shift)


def test_places_that_are_asked_for_again_are_not_worked_out_again() -> None:
    random = np.random.default_rng(6)
    one = mixture(random, 2, 4)
    asked: list[tuple[float, ...]] = []

    def of(u: FloatArray) -> Mixture:
        asked.append(tuple(u))
        return one

    model = SimpleNamespace(
        basis=SimpleNamespace(base_mm=np.ones((2, 3)), modes=random.normal(size=(4, 2, 3))),
        shapes=SimpleNamespace(mixture=of),
        knows=lambda u: u[0] < 1000.0,
    )
    tip = TipModel(cast(RiskModel, model), 1.0)
    ring = [np.array([float(k), 0.0]) for k in range(100)]
    for k in range(3, 100):
        assert tip.place([ring[k], ring[k - 1], ring[k - 2], ring[k - 3]], np.zeros(3)) is not None
    assert len(asked) == len(set(asked)) == 100
    assert tip.place([np.array([2000.0, 0.0])], np.zeros(3)) is None
    assert tip.place([np.array([2000.0, 0.0])], np.zeros(3)) is None
    assert len(tip._kept) == 64
