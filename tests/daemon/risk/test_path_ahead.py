"""The risk of the rest of a path: one body per draw, however many places the file has."""

from collections.abc import Sequence
from time import perf_counter
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from daemon.risk.path_ahead import PathAhead
from daemon.workbench.body_model.evaluation.shapes import box
from safety.risk.body_risk import BodyRisk
from safety.risk.contact import ContactModel
from safety.risk.contact_figures import upper_limit
from safety.risk.model.risk_model import RiskModel, risk_model
from safety.risk.seen_tip import TipConditioning
from safety.risk.surroundings.distance_grid import DistanceGrid, distance_grid
from safety.risk.surroundings.environment import Environment, environment
from tests.safety.risk.test_body_risk import arrays, at

SAMPLES = 500


@pytest.fixture(scope="module")
def model() -> RiskModel:
    return risk_model(arrays(), "silu", "relu")


@pytest.fixture(scope="module")
def block() -> Environment:
    """From x = 40 mm on, near the body's end, which the first input moves 10 mm per unit."""
    return environment(*box((40.0, 60.0, 60.0), (60.0, 0.0, 200.0), 4))


@pytest.fixture(scope="module")
def grid(block: Environment) -> DistanceGrid:
    return distance_grid(block, 2.0, 20.0)


@pytest.fixture
def risk(model: RiskModel, block: Environment, grid: DistanceGrid) -> BodyRisk:
    given = TipConditioning(model.basis, 0.5, None)
    return BodyRisk(model, block, grid, samples=SAMPLES, given=given)


def there_and_back(far: float = 2.9, places: int = 31) -> tuple[list[float], list[list[float]]]:
    """From 0 towards the block, and away again, in ten seconds."""
    t_s = np.linspace(0.0, 10.0, places)
    first = np.interp(t_s, [0.0, 5.0, 10.0], [0.0, far, -1.0])
    return t_s.tolist(), [list(at(float(one))) for one in first]


def looked_at(path: PathAhead) -> PathAhead:
    for _ in range(path.pieces):
        path.look()
    return path


def test_what_is_not_looked_at_counts_as_touched(risk: BodyRisk) -> None:
    path = PathAhead(risk, *there_and_back())
    assert path.left(0.0) == 1.0
    for _ in range(path.pieces - 1):
        path.look()
        assert path.left(0.0) == 1.0
    path.look()
    assert path.left(0.0) < 0.5


def test_it_is_the_share_of_bodies_that_touch_anywhere_on_the_whole_way(
    risk: BodyRisk, model: RiskModel, block: Environment, grid: DistanceGrid
) -> None:
    t_s, u = there_and_back(places=101)
    path = looked_at(PathAhead(risk, t_s, u))
    swept = ContactModel(model.basis, grid, None, SAMPLES)
    mixtures = [model.shapes.mixture(one) for one in u]
    whole = swept.along([one for one in mixtures if one is not None]).on_the_way
    assert len(mixtures) == 101
    assert 0.02 < whole.upper_limit < 0.5
    assert path.left(0.0) == pytest.approx(whole.upper_limit, abs=0.01)


def test_twice_as_many_places_are_the_same_risk(risk: BodyRisk) -> None:
    few, many = (looked_at(PathAhead(risk, *there_and_back(places=n))) for n in (21, 161))
    assert few.left(0.0) == pytest.approx(many.left(0.0), abs=0.015)
    assert many.pieces < 100


def test_behind_the_narrow_place_little_is_left(risk: BodyRisk) -> None:
    path = looked_at(PathAhead(risk, *there_and_back()))
    left = [path.left(elapsed_s) for elapsed_s in (0.0, 2.0, 5.0, 7.0, 10.0, 99.0)]
    assert left[0] == left[1] > 0.05
    assert left == sorted(left, reverse=True)
    assert left[-1] == left[-2] == upper_limit(0, SAMPLES)


def test_where_nothing_is_known_it_is_certain_and_says_where(risk: BodyRisk) -> None:
    t_s, u = there_and_back()
    path = looked_at(PathAhead(risk, t_s, [*u[:-1], list(at(50.0))]))
    assert path.left(0.0) == 1.0
    assert "outside what the model has learned" in path.worst()


def test_the_worst_place_is_told_in_words(risk: BodyRisk) -> None:
    words = looked_at(PathAhead(risk, *there_and_back())).worst()
    assert words.startswith(("at 4.", "at 5."))
    assert "200 mm along the body, nearest to (40, " in words


def test_what_the_tip_tells_counts_for_the_rest_of_the_path(
    risk: BodyRisk, model: RiskModel, block: Environment, grid: DistanceGrid
) -> None:
    """A body that is nearer to the block than its model, where it begins, will be so there."""
    seeing = risk.among(block, grid)
    mixture = model.shapes.mixture(at(0.0))
    assert mixture is not None
    risks = []
    for off_mm in (-6.0, 6.0):
        tip = model.basis.base_mm[-1] + np.array([off_mm, 0.0, 0.0])
        seeing.see(mixture, tip, None, agrees=False)
        seeing.take_as_shifted(np.array([off_mm, 0.0]))
        path = PathAhead(risk, *there_and_back(1.5))
        for _ in range(path.pieces):
            path.look(seeing)
        risks.append(path.left(0.0))
    assert risks[0] < 0.05 < risks[1]


class ByChance:
    """Answers like a `BodyRisk`, for draws that touch here and there."""

    samples = 100
    model = SimpleNamespace(scale=np.ones(1))

    def __init__(self) -> None:
        self._random = np.random.default_rng(0)

    def of_way(self, u_from: Sequence[float], u_to: Sequence[float]) -> object:
        del u_from, u_to
        if self._random.random() < 0.05:
            return "nothing is known"
        often = 0.3 if self._random.random() < 0.2 else 0.01
        return SimpleNamespace(touching=self._random.random(self.samples) < often)


@pytest.mark.parametrize("places", [2, 3, 40])
def test_all_that_was_seen_of_what_is_left_counts_and_nothing_behind(places: int) -> None:
    risk: Any = ByChance()
    t_s = np.arange(float(places))
    path = PathAhead(risk, t_s.tolist(), t_s[:, None].tolist())
    answers = ByChance()
    seen = np.ones((path.pieces, risk.samples), np.bool_)
    for number in range(4 * path.pieces):
        path.look()
        found: Any = answers.of_way((), ())
        seen[number % path.pieces] = True if isinstance(found, str) else found.touching
        for here in range(places):
            touching = int(seen[here:].any(axis=0).sum())
            assert path.left(float(here)) == upper_limit(touching, risk.samples)


def test_a_look_takes_no_longer_on_a_long_path() -> None:
    took_s = []
    for places in (100, 10_000):
        risk: Any = ByChance()
        t_s = np.arange(float(places))
        path = looked_at(PathAhead(risk, t_s.tolist(), t_s[:, None].tolist()))
        each = []
        for _ in range(50):
            began_s = perf_counter()
            path.look()
            each.append(perf_counter() - began_s)
        took_s.append(float(np.median(each)))
    assert took_s[1] < 10.0 * took_s[0]


def test_a_path_of_two_places_has_one_piece(risk: BodyRisk) -> None:
    path = looked_at(PathAhead(risk, [0.0, 1.0], [at(0.0), at(0.01)]))
    assert path.pieces == 1
    assert path.left(0.0) == path.left(2.0) == upper_limit(0, SAMPLES)
