"""A step that leads too near to something goes along it, and nothing else is changed."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from config.coupling.sums import AxesCondition, AxesLimit, AxesSum
from daemon.control.avoidance import Aside, Avoidance
from daemon.control.avoidance_kernels import turn_aside
from daemon.robot.axes import AxisRanges
from daemon.robot.coupled_axes import CoupledAxes
from drivers.pose import Vector
from safety.risk_source import Clearance, PartClearance

DT_S = 0.025
FAST = np.array([5.0, 5.0])
HERE = np.zeros(2)


def avoid(
    step: Vector, targets: Vector, clearance: Clearance, fast: Vector, dt_s: float
) -> Vector | None:
    """The step by the clearance of the whole body alone."""
    none = np.zeros(fast.size)
    names = tuple(map(str, range(fast.size)))
    axes = AxisRanges(names, none - 10.0, none + 10.0, fast, none + 20.0, none)
    whole = replace(clearance, parts=(), tip_slope=())
    aside = Avoidance(axes).aside(step, targets, whole, dt_s)
    return None if aside is None else aside.delta_u


def towards_x(clearance_mm: float) -> Clearance:
    """A wall that the first axis leads to."""
    return Clearance((0.0, 0.0), clearance_mm, (-2.0, 0.0))


def test_far_from_everything_a_step_stays_as_it_is() -> None:
    assert avoid(np.array([0.1, 0.1]), HERE, towards_x(9.0), FAST, DT_S) is None


def test_away_from_it_a_step_stays_as_it_is_however_near_it_is() -> None:
    assert avoid(np.array([-0.1, 0.1]), HERE, towards_x(0.6), FAST, DT_S) is None


def test_near_it_what_leads_along_is_left_and_what_leads_there_is_not() -> None:
    step = avoid(np.array([0.1, 0.1]), HERE, towards_x(0.5), FAST, DT_S)
    assert step == pytest.approx([0.0, 0.1])


def test_there_is_always_a_tenth_of_the_room_left_to_come_nearer() -> None:
    step = avoid(np.array([1.0, 0.0]), HERE, towards_x(2.5), FAST, DT_S)
    assert step == pytest.approx([0.1 * 2.0 / 2.0, 0.0])


def test_where_it_is_too_near_it_is_led_away() -> None:
    step = avoid(np.array([0.0, 0.1]), HERE, towards_x(-0.5), FAST, DT_S)
    assert step == pytest.approx([-0.1 * 1.0 / 2.0, 0.1])


def test_the_room_is_that_of_the_place_where_the_step_begins() -> None:
    further = avoid(np.array([0.1, 0.0]), np.array([0.5, 0.0]), towards_x(1.5), FAST, DT_S)
    assert further == pytest.approx([0.0, 0.0])


def test_the_faster_axis_is_turned_aside_more() -> None:
    clearance = Clearance((0.0, 0.0), 0.5, (-1.0, -1.0))
    step = avoid(np.array([0.1, 0.1]), HERE, clearance, np.array([10.0, 5.0]), DT_S)
    assert step is not None
    assert step - 0.1 == pytest.approx([-0.16, -0.04])


def slid(avoidance: Avoidance) -> float:
    """How far the first axis still goes towards a wall 2.5 mm away."""
    wall = replace(towards_x(2.5))  # another one, as of another step
    aside = avoidance.aside(np.array([1.0, 0.0]), HERE, wall, DT_S)
    assert aside is not None
    return float(aside.delta_u[0])


def of_two_axes() -> Avoidance:
    return Avoidance(AxisRanges(("a", "b"), HERE - 10.0, HERE + 10.0, FAST, HERE + 20.0, HERE))


def test_after_a_refused_step_more_is_kept_and_with_those_of_low_risk_less_again() -> None:
    avoidance = of_two_axes()
    before = slid(avoidance)
    avoidance.take_judgement(0.04, 0.05, reduced=True)
    kept = slid(avoidance)
    assert before - kept == pytest.approx(0.1 * 0.5 / 2.0)
    for _ in range(23):  # 0.6 s at 40 Hz
        avoidance.take_judgement(0.01, 0.05, reduced=False)
    assert before - slid(avoidance) == pytest.approx(0.5 * (before - kept), rel=0.02)


def test_more_is_kept_before_a_step_is_refused() -> None:
    avoidance = of_two_axes()
    before = slid(avoidance)
    avoidance.take_judgement(0.024, 0.05, reduced=False)
    assert slid(avoidance) == before
    avoidance.take_judgement(0.026, 0.05, reduced=False)
    assert before - slid(avoidance) == pytest.approx(0.1 * 0.1 / 2.0)


def test_what_is_kept_has_an_end() -> None:
    avoidance = of_two_axes()
    before = slid(avoidance)
    for _ in range(100):
        avoidance.take_judgement(1.0, 0.05, reduced=True)
    assert before - slid(avoidance) == pytest.approx(0.1 * 1.5 / 2.0)


def test_where_no_axis_gains_room_the_gate_alone_decides() -> None:
    nowhere = Clearance((0.0, 0.0), 0.1, (-0.1, 0.0))
    assert avoid(np.array([0.1, 0.0]), HERE, nowhere, FAST, DT_S) is None


numbers = st.floats(-1.0, 1.0)


@given(
    arrays(float, 3, elements=numbers),
    arrays(float, 3, elements=st.floats(-5.0, 5.0)),
    st.floats(-2.0, 10.0),
)
def test_room_never_gets_less_faster_than_it_may(
    delta_u: Vector, slope: Vector, clearance_mm: float
) -> None:
    clearance = Clearance((0.0, 0.0, 0.0), clearance_mm, tuple(slope.tolist()))
    step = avoid(delta_u, np.zeros(3), clearance, np.full(3, 5.0), DT_S)
    least = -0.1 * (clearance_mm - 0.5)
    if step is not None:
        assert float(slope @ step) == pytest.approx(least, abs=1e-9)
        assert float(slope @ delta_u) < least
    elif np.linalg.norm(slope) > 0.2:
        assert float(slope @ delta_u) >= least


# With the parts of the body, and the tip's task in view. Three axes; the first leads the tip along
# x and the second along y by 3 mm each; the third, and what is left of the second, only the body.

THREE = AxisRanges(
    ("a", "b", "c"),
    np.full(3, -10.0),
    np.full(3, 10.0),
    np.full(3, 5.0),
    np.full(3, 20.0),
    np.zeros(3),
)
TIP = ((3.0, 0.0, 0.0), (0.0, 3.0, 0.0), (0.0,) * 3, (0.02, 0.0, 0.0), (0.0,) * 3, (0.0, 0.0, 1.0))
AT = np.zeros(3)


def near(
    *parts: tuple[float, float, tuple[float, ...]], tip: tuple[tuple[float, ...], ...] = TIP
) -> Clearance:
    """parts: where along the body, clearance, slope; the whole is the nearest."""
    told = tuple(PartClearance(*part) for part in parts)
    nearest = min(told, key=lambda part: part.clearance_mm)
    return Clearance((0.0,) * 3, nearest.clearance_mm, nearest.slope, told, tip)


def taken(step: list[float], clearance: Clearance, **asked: object) -> Aside | None:
    return Avoidance(THREE).aside(np.array(step), AT, clearance, DT_S, **asked)  # type: ignore[arg-type]


def test_a_body_gives_way_where_the_tip_does_not_see_it() -> None:
    clearance = near((80.0, 0.5, (-1.0, 0.0, -0.5)))
    aside = taken([0.05, 0.0, 0.0], clearance)
    assert aside is not None
    assert aside.delta_u == pytest.approx([0.05, 0.0, -0.1], abs=0.01)
    assert (aside.arc_mm, aside.clearance_mm) == (80.0, 0.5)
    assert aside.given_up_mm is not None
    assert aside.given_up_mm < 0.02
    blind = avoid(np.array([0.05, 0.0, 0.0]), AT, clearance, THREE.max_velocity, DT_S)
    assert blind is not None
    assert 3.0 * (0.05 - blind[0]) > 0.1


def test_where_only_the_tip_can_give_way_the_step_is_that_by_the_whole_body() -> None:
    clearance = near((200.0, 0.5, (-3.0, 0.0, -0.05)))
    step = [0.1, 0.05, 0.0]
    aside = taken(step, clearance)
    blind = avoid(np.array(step), AT, clearance, THREE.max_velocity, DT_S)
    assert aside is not None
    assert blind is not None
    np.testing.assert_array_equal(aside.delta_u, blind)
    assert aside.given_up_mm == pytest.approx(3.0 * (0.1 - blind[0]))


def test_a_part_that_is_not_the_nearest_has_its_room_too() -> None:
    clearance = near((60.0, 0.6, (0.0, 0.0, 1.0)), (120.0, 1.0, (-1.0, 0.0, -0.5)))
    aside = taken([0.12, 0.0, 0.0], clearance)
    assert aside is not None
    for part in clearance.parts:
        least = -0.1 * (part.clearance_mm - 0.5)
        assert np.array(part.slope) @ aside.delta_u >= least - 1e-3


def test_no_axis_is_asked_for_more_than_it_can_do() -> None:
    aside = taken([0.1, 0.0, 0.0], near((80.0, -5.0, (-1.0, 0.0, -0.5))))
    assert aside is not None
    assert np.abs(aside.delta_u).max() <= 5.0 * DT_S + 1e-12
    at_its_end = Avoidance(THREE).aside(
        np.array([0.05, 0.0, 0.0]),
        np.array([0.0, 0.0, -10.0]),
        Clearance(
            (0.0, 0.0, -10.0),
            0.5,
            (-1.0, 0.0, -0.5),
            (PartClearance(80.0, 0.5, (-1.0, 0.0, -0.5)),),
            TIP,
        ),
        DT_S,
    )
    assert at_its_end is not None
    assert at_its_end.delta_u[2] == pytest.approx(0.0, abs=0.06)


def test_a_direction_that_matters_is_not_turned_for_it() -> None:
    """The third axis turns the tip where it stands."""
    clearance = near((80.0, 0.5, (-1.0, 0.0, -0.5)), tip=(*TIP[:5], (0.0, 0.0, 3.0)))
    free, bound = (taken([0.05, 0.0, 0.0], clearance, points=points) for points in (False, True))
    assert free is not None
    assert bound is not None
    assert abs(bound.delta_u[2]) < 0.5 * abs(free.delta_u[2])


TENSIONS = ((0.0, 10.0), (0.0, 10.0), (0.0, 10.0))


@pytest.mark.parametrize(
    ("tension_n", "lets_out"),
    [(5.0, True), (0.5, False), (9.5, True), (None, True)],
    ids=["middle", "slack", "tight", "unknown"],
)
def test_a_tendon_that_hardly_pulls_is_not_let_out(tension_n: float, lets_out: bool) -> None:
    clearance = near((80.0, 0.5, (-1.0, 0.0, -0.5)))
    aside = Avoidance(THREE, TENSIONS).aside(
        np.array([0.05, 0.0, 0.0]), AT, clearance, DT_S, tensions_n=[5.0, 5.0, tension_n]
    )
    assert aside is not None
    assert (aside.delta_u[2] < -0.05) == lets_out


def test_nor_is_it_let_out_as_was_proposed() -> None:
    clearance = near((80.0, 0.5, (-1.0, 0.0, -0.5)))
    for tension_n, lets_out in ((5.0, True), (0.5, False)):
        aside = Avoidance(THREE, TENSIONS).aside(
            np.array([0.05, 0.0, -0.02]), AT, clearance, DT_S, tensions_n=[5.0, 5.0, tension_n]
        )
        assert aside is not None
        assert (aside.delta_u[2] < 0.0) == lets_out


def test_a_tendon_that_pulls_nearly_as_much_as_it_may_pulls_no_more() -> None:
    clearance = near((80.0, 0.5, (-1.0, 0.0, 0.5)))
    for tension_n, pulls in ((5.0, True), (9.5, False), (0.5, True)):
        aside = Avoidance(THREE, TENSIONS).aside(
            np.array([0.05, 0.0, 0.0]), AT, clearance, DT_S, tensions_n=[5.0, 5.0, tension_n]
        )
        assert aside is not None
        assert (aside.delta_u[2] > 0.05) == pulls


def test_without_tension_limits_a_tension_limits_nothing() -> None:
    clearance = near((80.0, 0.5, (-1.0, 0.0, -0.5)))
    aside = Avoidance(THREE, (None,) * 3).aside(
        np.array([0.05, 0.0, 0.0]), AT, clearance, DT_S, tensions_n=[0.0, 0.0, 0.0]
    )
    assert aside is not None
    assert aside.delta_u[2] < -0.05


def test_who_knows_no_parts_is_turned_aside_by_the_whole() -> None:
    told = near((80.0, 0.5, (-1.0, 0.0, -0.5)))
    step = np.array([0.05, 0.0, 0.0])
    blind = avoid(step, AT, told, THREE.max_velocity, DT_S)
    assert blind is not None
    for clearance in (
        Clearance(told.u, told.clearance_mm, told.slope),
        Clearance(told.u, told.clearance_mm, told.slope, told.parts),
        Clearance(told.u, told.clearance_mm, told.slope, (), TIP),
    ):
        aside = taken(step.tolist(), clearance)
        assert aside is not None
        np.testing.assert_array_equal(aside.delta_u, blind)
        assert (aside.arc_mm, aside.given_up_mm) == (None, None)


NEVER = AxesCondition(AxesSum(np.array([0.0, 1.0, 0.0])), 5.0, 1.0, None)
"""The second axis stands at 0."""


def turned_aside(lowest: float, *only_while: AxesCondition, third: float = -0.5) -> Aside | None:
    """Where the first and the third axis together may not be below something.

    third: what the third one does to the clearance.
    """
    limit = AxesLimit("ac", "", AxesSum(np.array([1.0, 0.0, 1.0])), lowest, np.inf, only_while)
    axes = replace(THREE, coupled=CoupledAxes((limit,)))
    clearance = near((80.0, 0.5, (-1.0, 0.0, third)))
    return Avoidance(axes).aside(np.array([0.05, 0.0, 0.0]), AT, clearance, DT_S)


def test_what_axes_may_not_do_together_is_not_asked_of_them() -> None:
    free, bound = turned_aside(-5.0), turned_aside(-0.02)
    assert free is not None
    assert bound is not None
    assert free.delta_u[0] + free.delta_u[2] == pytest.approx(-0.05, abs=0.01)
    assert bound.delta_u[0] + bound.delta_u[2] >= -0.02 - 1e-3
    assert -bound.delta_u[0] - 0.5 * bound.delta_u[2] >= -1e-3


def test_a_coupled_limit_binds_only_while_it_counts() -> None:
    free, unbound = turned_aside(-5.0), turned_aside(-0.02, NEVER)
    assert free is not None
    assert unbound is not None
    np.testing.assert_array_equal(free.delta_u, unbound.delta_u)


def test_axes_that_are_beyond_a_coupled_limit_need_not_come_back_at_once() -> None:
    free, beyond = turned_aside(-5.0, third=0.5), turned_aside(1.0, third=0.5)
    assert free is not None
    assert beyond is not None
    np.testing.assert_allclose(free.delta_u, beyond.delta_u, atol=1e-3)


def test_what_is_compiled_beforehand_is_all_that_a_step_needs() -> None:
    avoidance = Avoidance(THREE)
    avoidance.warm_up()
    known = len(turn_aside.signatures)
    avoidance.aside(np.array([0.05, 0.0, 0.0]), AT, near((80.0, 0.5, (-1.0, 0.0, -0.5))), DT_S)
    assert len(turn_aside.signatures) == known


def test_far_from_everything_no_part_asks_for_anything() -> None:
    assert taken([0.1, 0.1, 0.1], near((80.0, 9.0, (-1.0, 0.0, -0.5)))) is None


def test_a_part_that_no_axis_moves_asks_for_nothing() -> None:
    assert taken([0.1, 0.0, 0.0], near((10.0, -1.0, (-0.05, 0.0, 0.0)))) is None


@given(st.integers(0, 10_000))
def test_what_was_prepared_in_spare_time_is_the_same_to_the_last_bit(seed: int) -> None:
    random = np.random.default_rng(seed)
    parts = tuple(
        PartClearance(float(arc), float(random.normal(1.0)), tuple(random.normal(size=3).tolist()))
        for arc in range(int(random.integers(0, 7)))
    )
    slopes = random.normal(size=(6, 3)).tolist()
    one, other = (
        Clearance((0.0,) * 3, float(random.normal(1.0)), tuple(random.normal(size=3).tolist()))
        for _ in range(2)
    )
    near = replace(one, parts=parts, tip_slope=tuple(map(tuple, slopes)))
    step, points = random.normal(scale=0.1, size=3), bool(random.random() < 0.5)
    fresh, prepared = Avoidance(THREE), Avoidance(THREE)
    prepared.prepare(near)
    for clearance in (near, other, near):
        found = [a.aside(step, np.zeros(3), clearance, DT_S, points) for a in (fresh, prepared)]
        assert (found[0] is None) == (found[1] is None)
        if found[0] is not None and found[1] is not None:
            assert found[0].delta_u.tolist() == found[1].delta_u.tolist()
            assert found[0][1:] == found[1][1:]
        fresh = Avoidance(THREE)
