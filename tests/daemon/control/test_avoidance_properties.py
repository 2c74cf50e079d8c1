"""Whatever the axes, the parts and the limits are: a step that is turned aside is the best one, by
the conditions of Karush, Kuhn and Tucker, and asks no more of the tip than the one by the whole."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from config.coupling.sums import AxesCondition, AxesLimit, AxesSum
from daemon.control.avoidance import Aside, Avoidance
from daemon.robot.axes import AxisRanges
from daemon.robot.coupled_axes import CoupledAxes
from drivers.pose import Vector
from safety.risk_source import Clearance, PartClearance

DT_S = 0.025
CLOSER = 4.0 * DT_S
RESERVE_MM = 0.5
LEAST_SLOPE_MM_S = 1.0
SOFT = 1e-4


class Situation(NamedTuple):
    """A robot, what is near it, and what is asked of it."""

    axes: AxisRanges
    tensions_n: tuple[tuple[float, float] | None, ...]
    clearance: Clearance
    step: Vector
    at: Vector
    pulls_n: list[float | None]
    points: bool

    def aside(self) -> Aside | None:
        told = self.step, self.at, self.clearance, DT_S, self.points, self.pulls_n
        return Avoidance(self.axes, self.tensions_n).aside(*told)

    def by_the_whole(self) -> Aside | None:
        whole = replace(self.clearance, parts=(), tip_slope=())
        return self._replace(clearance=whole).aside()


class Rows(NamedTuple):
    """(p, m) and (p,): rows times the step are at least so much."""

    slope: Vector
    least: Vector


def drawn(seed: int) -> Situation:
    """1 to 7 axes, 0 to 8 parts, 0 to 2 coupled limits that count or not, tendons or none."""
    random = np.random.default_rng(seed)
    count, parts = int(random.integers(1, 8)), int(random.integers(0, 9))
    speeds = random.uniform(0.5, 20.0, count)
    at = random.uniform(-1.0, 1.0, count)
    limits = tuple(limit_near(random, at) for _ in range(int(random.integers(0, 3))))
    axes = AxisRanges(
        tuple(map(str, range(count))),
        at - random.choice([1e-3, 1.0, 10.0], count),
        at + random.choice([1e-3, 1.0, 10.0], count),
        speeds,
        np.full(count, 20.0),
        np.zeros(count),
        CoupledAxes(limits),
    )
    told = tuple(
        PartClearance(10.0 * arc, float(random.normal(0.7)), tuple(slope))
        for arc, slope in enumerate((random.normal(size=(parts, count)) * 4.0).tolist())
    )
    whole_mm = min((part.clearance_mm for part in told), default=float(random.normal(0.7)))
    slope = told[0].slope if told else tuple(random.normal(size=count).tolist())
    u = at + random.normal(scale=0.02, size=count)
    tip = tuple(map(tuple, random.normal(size=(6, count)).tolist()))
    return Situation(
        axes,
        tuple((0.0, 10.0) if random.random() < 0.5 else None for _ in range(count)),
        Clearance(tuple(u.tolist()), whole_mm, slope, told, tip),
        speeds * DT_S * random.uniform(-1.2, 1.2, count),
        at,
        [None if random.random() < 0.3 else float(random.uniform(0, 10)) for _ in range(count)],
        bool(random.random() < 0.5),
    )


def limit_near(random: np.random.Generator, at: Vector) -> AxesLimit:
    """One that a step may reach, or may not."""
    one = AxesSum(random.normal(size=at.size), float(random.normal()))
    period = None if random.random() < 0.5 else 0.5
    condition = AxesCondition(AxesSum(random.normal(size=at.size)), 0.1, 0.2, period)
    low, high = one.at(at) - random.uniform(-0.1, 1.0), one.at(at) + random.uniform(0.0, 1.0)
    conditions = (condition,) if random.random() < 0.5 else ()
    return AxesLimit("limit", "", one, float(low), float(max(low, high)), conditions)


def rows_of(asked: Situation) -> Rows:
    """Of the parts for which there is a way along."""
    slopes = np.array([part.slope for part in asked.clearance.parts]).reshape(-1, asked.at.size)
    here = np.array([part.clearance_mm for part in asked.clearance.parts])
    here = here + slopes @ (asked.at - np.array(asked.clearance.u))
    steep = np.linalg.norm(slopes * asked.axes.max_velocity, axis=1) >= LEAST_SLOPE_MM_S
    return Rows(slopes[steep], -CLOSER * (here[steep] - RESERVE_MM))


def coupled_rows(asked: Situation) -> Rows:
    """Of the limits that a step at full speed comes too near to, whatever each is kept by."""
    slopes, least = [], []
    for limit in asked.axes.coupled.limits:
        value, factors = float(limit.sum.at(asked.at)), limit.sum.factors
        own = [(factors, value - limit.lowest), (-factors, limit.highest - value)]
        holds = [own] if min(room for _, room in own) >= 0.0 else []
        holds += [[beside] for one in limit.only_while if (beside := beside_of(one, asked.at))]
        if any(not reached(rows, asked) for rows in holds):
            continue
        kept = max(holds, key=lambda rows: share_left(rows, asked), default=own)
        for slope, room in reached(kept, asked):
            slopes.append(slope)
            least.append(-CLOSER * max(room, 0.0))
    return Rows(np.array(slopes).reshape(-1, asked.at.size), np.array(least))


def beside_of(condition: AxesCondition, at: Vector) -> tuple[Vector, float] | None:
    """Which way leads away from the places where it is met, and how far they are; None: it is."""
    off = float(condition.sum.at(at)) - condition.near
    if condition.period is not None:
        off -= condition.period * np.floor(off / condition.period + 0.5)
    room = abs(off) - condition.within
    return (np.sign(off) * condition.sum.factors, room) if room >= 0.0 else None


def reached(rows: list[tuple[Vector, float]], asked: Situation) -> list[tuple[Vector, float]]:
    """Of slopes, and how far what they lead away from is: those that a step could come near to."""
    speeds = asked.axes.max_velocity * DT_S
    return [(slope, room) for slope, room in rows if CLOSER * room < np.abs(slope) @ speeds]


def share_left(rows: list[tuple[Vector, float]], asked: Situation) -> float:
    """Of the proposed step."""
    left = 1.0
    for slope, room in rows:
        change = float(slope @ asked.step)
        left = min(left, 1.0 if change >= -CLOSER * room else CLOSER * room / -change)
    return left


def bounds_of(asked: Situation) -> tuple[Vector, Vector]:
    """(m,) lowest and highest step: travel and speed, and never less than what was proposed; and
    tendons at the ends of what they may pull."""
    most = asked.axes.max_velocity * DT_S
    low, high = asked.axes.step_range(asked.at)
    low = np.minimum(np.maximum(low, -most), asked.step)
    high = np.maximum(np.minimum(high, most), asked.step)
    for k, (limits, pull) in enumerate(zip(asked.tensions_n, asked.pulls_n, strict=True)):
        if limits is not None and pull is not None:
            low[k] = 0.0 if pull < 1.0 else low[k]
            high[k] = 0.0 if pull > 9.0 else high[k]
    return low, high


def strains(asked: Situation, step: Vector) -> bool:
    """Whether it lets a tendon out that hardly pulls, or pulls one that pulls nearly as much as it
    may."""
    for limits, pull, way in zip(asked.tensions_n, asked.pulls_n, step, strict=True):
        if limits is None or pull is None:
            continue
        if (pull < 1.0 and way < 0.0) or (pull > 9.0 and way > 0.0):
            return True
    return False


def task_of(asked: Situation) -> Vector:
    """(k, m) what the tip does, in what it shall not be asked to give up."""
    slope = np.array(asked.clearance.tip_slope)
    task = np.concatenate([slope[:3], 25.0 * slope[3:]]) if asked.points else slope[:3]
    reach = ((task * asked.axes.max_velocity) ** 2).sum() / len(task)
    return np.asarray(task * np.sqrt(30.0 / reach))


def given_up(asked: Situation, step: Vector) -> float:
    return float(np.linalg.norm(task_of(asked) @ (step - asked.step)))


def by_parts(asked: Situation, found: Aside) -> bool:
    """Whether the step is not that by the whole body."""
    whole = asked.by_the_whole()
    return whole is None or not np.array_equal(whole.delta_u, found.delta_u)


@settings(max_examples=400)
@given(st.integers(0, 10_000_000))
def test_a_step_that_is_turned_aside_keeps_the_conditions_of_the_best_one(seed: int) -> None:
    asked = drawn(seed)
    found = asked.aside()
    if found is None or not asked.clearance.parts or not by_parts(asked, found):
        return
    unit, step = asked.axes.max_velocity, found.delta_u
    low, high = bounds_of(asked)
    assert (step >= low - 1e-9).all()
    assert (step <= high + 1e-9).all()
    parts, coupled = rows_of(asked), coupled_rows(asked)
    slope, least = np.concatenate([parts.slope, coupled.slope]), [*parts.least, *coupled.least]
    scaled, rows = task_of(asked) * unit, slope * unit
    matrix = np.eye(step.size) + scaled.T @ scaled
    soft = SOFT * np.einsum("ij,ij->i", rows, np.linalg.solve(matrix, rows.T).T)
    prices = np.maximum(np.array(least) - slope @ step, 0.0) / soft
    pulled = prices[:, None] * rows
    residual = matrix @ ((step - asked.step) / unit) - pulled.sum(axis=0)
    missed_at_most = 2e-9 / soft  # what the kernel does not look at, as a price
    tolerance = 1e-6 * (1.0 + np.abs(pulled).sum(axis=0)) + missed_at_most @ np.abs(rows)
    # What is left over is a limit's, and pushes inwards.
    assert (residual[step > low + 1e-9] <= tolerance[step > low + 1e-9]).all()
    assert (residual[step < high - 1e-9] >= -tolerance[step < high - 1e-9]).all()


@settings(max_examples=400)
@given(st.integers(0, 10_000_000))
def test_no_step_asks_more_of_the_tip_than_the_one_by_the_whole_body(seed: int) -> None:
    asked = drawn(seed)
    found, whole = asked.aside(), asked.by_the_whole()
    if whole is None or not asked.clearance.parts:
        return
    assert found is not None
    if by_parts(asked, found) and strains(asked, whole.delta_u):
        return  # what strains a tendon is no way at all
    blind = given_up(asked, whole.delta_u)
    assert given_up(asked, found.delta_u) <= blind * (0.5 if by_parts(asked, found) else 1.0) + 1e-9
    place = np.array(asked.clearance.tip_slope)[:3] @ (found.delta_u - asked.step)
    assert found.given_up_mm == pytest.approx(float(np.linalg.norm(place)), abs=1e-12)


@settings(max_examples=400)
@given(st.integers(0, 10_000_000))
def test_a_step_stays_as_it_is_only_where_it_leaves_all_parts_their_room(seed: int) -> None:
    asked = drawn(seed)
    parts = rows_of(asked)
    short = parts.least - parts.slope @ asked.step
    if np.abs(short).min(initial=1.0) > 1e-9:
        turned = asked.aside() is not None
        assert turned == (bool((short > 0.0).any()) or asked.by_the_whole() is not None)
