"""The trajectory's own clock, slowed: whatever was foretold comes, and nothing jumps."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from config.tasks.trajectory import load_trajectory_options
from daemon.reference.pacing import AGREED_S, Pacing
from daemon.reference.reference import TrajectoryReference
from daemon.reference.trajectories import make_trajectory

DT_S = 0.025
PACES = st.lists(st.floats(0.05, 1.0), min_size=1, max_size=150)


def circle(speed_mm_s: float = 20.0, cycles: int = 2) -> TrajectoryReference:
    options = load_trajectory_options(
        {
            "kind": "circle",
            "center_mm": [0.0, 0.0, 185.0],
            "radius_mm": 30.0,
            "cycle_s": 2.0 * np.pi * 30.0 / speed_mm_s,
            "cycles": cycles,
        }
    )
    return TrajectoryReference(make_trajectory(options, Path()), blend_speed_mm_s=20.0)


@given(PACES)
def test_time_goes_at_the_pace_that_was_asked_for_so_long_before(paces: list[float]) -> None:
    pacing, along_s, agreed = Pacing(), 0.0, round(AGREED_S / DT_S)
    for pace in paces:
        pacing.ask(pace)
        along_s += pacing.along(0.0, DT_S)
        pacing.advance(DT_S)
    came = [1.0] * agreed + paces
    assert along_s == pytest.approx(DT_S * sum(came[: len(paces)]))
    # What was asked last counts after all that is agreed, and for ever.
    assert pacing.at(AGREED_S + 1.0) == paces[-1]
    assert pacing.along(AGREED_S, AGREED_S + 10.0) == pytest.approx(10.0 * paces[-1])


@given(PACES, st.floats(0.0, AGREED_S), st.floats(0.0, AGREED_S), st.floats(0.0, AGREED_S))
def test_times_between_add_up(paces: list[float], first: float, then: float, last: float) -> None:
    pacing = Pacing()
    for pace in paces:
        pacing.ask(pace)
        pacing.advance(DT_S)
    a, b, c = sorted([first, then, last])
    assert pacing.along(a, b) + pacing.along(b, c) == pytest.approx(pacing.along(a, c))
    assert 0.0 <= pacing.along(a, b) <= (b - a) * (1.0 + 1e-9)


def test_who_never_asks_has_the_time_of_everybody() -> None:
    pacing = Pacing()
    pacing.ask(1.0)
    pacing.advance(DT_S)
    assert pacing.along(0.1, 0.7) == 0.7 - 0.1
    assert pacing.at(0.0) == 1.0


@given(PACES, st.integers(1, round(AGREED_S / DT_S) - 1), st.integers(0, 400))
def test_a_reference_comes_to_where_it_was_foretold_whatever_is_asked_meanwhile(
    paces: list[float], lead: int, before: int
) -> None:
    reference = circle()
    reference.begin(np.array([25.0, 5.0, 190.0]))
    for k in range(before):
        reference.go_at(paces[k % len(paces)])
        reference.advance(0, DT_S)
    position, _ = reference.ahead(lead * DT_S)
    for pace in (paces * lead)[:lead]:
        reference.go_at(pace)
        aim = reference.advance(0, DT_S)
    assert aim.position_mm == pytest.approx(position, abs=1e-6)


def test_a_slowed_reference_goes_the_same_way_at_less_speed_and_its_velocity_says_so() -> None:
    reference = circle(speed_mm_s=20.0, cycles=1)
    reference.begin(np.array([30.0, 0.0, 185.0]))
    reference.go_at(0.5)
    before, steps = None, 0
    while not reference.finished:
        aim = reference.advance(0, DT_S)
        steps += aim.cycle >= 0
        if before is not None and aim.cycle == before.cycle == 0 and not reference.finished:
            came = (aim.position_mm - before.position_mm) / DT_S
            assert np.linalg.norm(came - aim.velocity_mm_s) < 0.2
            assert aim.pace == 0.5
            assert np.linalg.norm(aim.position_mm[:2]) == pytest.approx(30.0, abs=1e-6)
        before = aim
    assert steps * DT_S == pytest.approx(2.0 * reference.trajectory.duration_s, abs=2.0 * DT_S)


def test_the_way_to_the_path_is_not_slowed() -> None:
    ways = []
    for pace in (1.0, 0.25):
        reference = circle()
        reference.begin(np.array([0.0, 0.0, 160.0]))
        reference.go_at(pace)
        ways.append([reference.advance(0, DT_S).position_mm for _ in range(80)])
    hurried, slowed = ways
    assert np.array_equal(hurried, slowed)
