"""The step is the best one, by an oracle that knows nothing of active sets."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from daemon.control.avoidance_kernels import UNSOLVED, Wanted, nearest_step, room_for
from drivers.pose import Vector

ROOM = room_for(8, 8)


def solved(wanted: Wanted) -> Vector:
    step = np.empty(wanted.unit.size)
    assert nearest_step(wanted, ROOM, step) != UNSOLVED
    return step


def drawn(seed: int) -> Wanted:
    """A problem of 2 to 7 axes, 1 to 6 parts, and three rows of a task."""
    random = np.random.default_rng(seed)
    axes, parts = int(random.integers(2, 8)), int(random.integers(1, 7))
    unit = random.uniform(0.2, 5.0, axes)
    return Wanted(
        unit * random.uniform(-0.5, 0.5, axes),
        -unit * random.uniform(0.5, 2.0, axes),
        unit * random.uniform(0.5, 2.0, axes),
        unit,
        random.normal(size=(parts, axes)) / unit,
        random.normal(size=parts) * 0.3,
        random.normal(size=(3, axes)) * 2.0 / unit,
    )


def cost(wanted: Wanted, step: Vector) -> float:
    """With what the rows miss, at the weight that the kernel gives it."""
    away = step - wanted.proposed
    own = (away / wanted.unit) @ (away / wanted.unit) + (wanted.task @ away) @ (wanted.task @ away)
    scaled = wanted.task * wanted.unit
    matrix = np.eye(step.size) + scaled.T @ scaled
    rows = wanted.slope * wanted.unit
    softness = 1e-4 * np.einsum("ij,ij->i", rows, np.linalg.solve(matrix, rows.T).T)
    missed = np.maximum(wanted.allowed - wanted.slope @ step, 0.0)
    return float(0.5 * own + 0.5 * (missed**2 / softness).sum())


@settings(max_examples=60)
@given(st.integers(0, 1_000_000))
def test_no_step_within_the_limits_is_better(seed: int) -> None:
    wanted = drawn(seed)
    step = solved(wanted)
    assert (step >= wanted.lowest - 1e-9).all()
    assert (step <= wanted.highest + 1e-9).all()
    bounds = list(zip(wanted.lowest, wanted.highest, strict=True))
    other = minimize(lambda x: cost(wanted, x), step, bounds=bounds, method="L-BFGS-B")
    random = np.random.default_rng(seed)
    near = np.clip(
        step
        + wanted.unit * random.normal(size=(200, step.size)) * random.choice([1e-3, 0.1], (200, 1)),
        wanted.lowest,
        wanted.highest,
    )
    least = min(other.fun, *(cost(wanted, one) for one in near))
    assert cost(wanted, step) <= least + 1e-6 * max(1.0, least)


def test_with_one_row_it_is_the_closed_form() -> None:
    wanted = drawn(5)._replace(slope=np.array([[1.0, 2.0, -1.0]]), allowed=np.array([0.3]))
    three = {name: getattr(wanted, name)[..., :3].copy() for name in ("proposed", "unit", "task")}
    far = np.full(3, 1e3)
    wanted = wanted._replace(**three, lowest=-far, highest=far)
    scaled = wanted.task * wanted.unit
    matrix = np.eye(3) + scaled.T @ scaled
    row = wanted.slope[0] * wanted.unit
    way = np.linalg.solve(matrix, row)
    missing = 0.3 - wanted.slope[0] @ wanted.proposed
    assert missing > 0.0
    expected = wanted.proposed + wanted.unit * way * missing / (row @ way * (1.0 + 1e-4))
    np.testing.assert_allclose(solved(wanted), expected, rtol=1e-9)


def test_a_step_that_leaves_room_enough_stays_as_it_is() -> None:
    wanted = drawn(7)
    wanted = wanted._replace(allowed=wanted.slope @ wanted.proposed - 0.1)
    np.testing.assert_array_equal(solved(wanted), wanted.proposed)


def test_what_the_tip_does_not_see_is_cheap() -> None:
    """Two axes, of which the second leaves the tip where it is."""
    wanted = Wanted(
        np.zeros(2),
        np.full(2, -9.0),
        np.full(2, 9.0),
        np.ones(2),
        np.array([[1.0, 0.5]]),
        np.array([1.0]),
        np.array([[10.0, 0.0]]),
    )
    first, second = solved(wanted).tolist()
    assert abs(first) < 0.05
    assert second == pytest.approx(2.0, rel=0.05)
    first, second = solved(wanted._replace(highest=np.array([9.0, 1.0]))).tolist()
    assert (first, second) == pytest.approx((0.5, 1.0), abs=0.01)


def test_rows_that_contradict_each_other_share_what_is_missing() -> None:
    rows = np.array([[1.0, 0.0], [-1.0, 0.0]])
    wanted = drawn(1)._replace(
        proposed=np.zeros(2),
        lowest=np.full(2, -5.0),
        highest=np.full(2, 5.0),
        unit=np.ones(2),
        slope=rows,
        allowed=np.array([1.0, 0.5]),
        task=np.zeros((3, 2)),
    )
    assert solved(wanted) == pytest.approx([0.25, 0.0], abs=1e-3)


def test_limits_hold_where_no_room_can_be_left() -> None:
    wanted = drawn(3)
    wanted = wanted._replace(allowed=np.full(wanted.allowed.size, 1e3))
    step = solved(wanted)
    assert (step >= wanted.lowest - 1e-9).all()
    assert (step <= wanted.highest + 1e-9).all()


@pytest.mark.parametrize("name", ["slope", "proposed", "allowed"])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_is_not_solved(name: str, bad: float) -> None:
    wanted = drawn(2)
    broken = getattr(wanted, name).copy()
    broken.flat[0] = bad
    step = np.zeros(wanted.unit.size)
    assert nearest_step(wanted._replace(**{name: broken}), ROOM, step) == UNSOLVED


def test_a_task_that_is_no_number_is_not_solved() -> None:
    wanted = drawn(2)
    wanted = wanted._replace(
        allowed=np.full(wanted.allowed.size, 5.0), task=np.full_like(wanted.task, np.nan)
    )
    assert nearest_step(wanted, ROOM, np.zeros(wanted.unit.size)) == UNSOLVED
