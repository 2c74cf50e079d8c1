"""What an axis may be told, whatever it was meant to be told."""

from dataclasses import replace
from math import inf, nan

import pytest

from safety.limits import CountLimits, velocity_within

LIMITS = CountLimits(
    lowest=0, highest=100_000, max_velocity=20_000, max_acceleration=200_000, max_lag=2_000
)
GOES_ON = replace(LIMITS, goes_on_s=0.1)
CYCLE_S = 0.01


@pytest.mark.parametrize(
    ("wanted", "before", "velocity"),
    [
        (1000.0, 0.0, 1000.0),
        (5000.0, 0.0, 2000.0),
        (-5000.0, 0.0, -2000.0),
        (5000.0, 4000.0, 5000.0),
        (0.0, 4000.0, 2000.0),
        (90_000.0, 19_000.0, 20_000.0),
        (-90_000.0, -19_000.0, -20_000.0),
    ],
)
def test_a_velocity_is_neither_too_high_nor_too_soon(
    wanted: float, before: float, velocity: float
) -> None:
    assert velocity_within(wanted, before, 50_000, LIMITS, CYCLE_S) == velocity


@pytest.mark.parametrize(
    ("limits", "room", "velocity"),
    [
        (LIMITS, 0, 0.0),
        (LIMITS, 1400, 20_000.0),  # 20000 · 0.02 s + 20000² / 400000
        (LIMITS, 50, 2000.0),
        (GOES_ON, 3400, 20_000.0),
        (GOES_ON, 250, 2000.0),
        (replace(GOES_ON, lowest=20_000), 250, 2000.0),
    ],
)
@pytest.mark.parametrize("upwards", [True, False])
def test_a_velocity_is_one_from_which_the_axis_stops_inside(
    limits: CountLimits, room: int, velocity: float, upwards: bool
) -> None:
    direction = 1 if upwards else -1
    position = limits.highest - room if upwards else limits.lowest + room
    found = velocity_within(direction * 90_000.0, direction * 20_000.0, position, limits, CYCLE_S)
    assert direction * found == pytest.approx(velocity, rel=1e-3)
    assert abs(found) * (0.02 + limits.goes_on_s) + found**2 / 400_000 <= room + 1e-6


@pytest.mark.parametrize("outside", [-10, 100_010])
def test_a_velocity_outside_the_travel_leads_back(outside: int) -> None:
    away = 20_000.0 if outside > 0 else -20_000.0
    assert velocity_within(away, away, outside, LIMITS, CYCLE_S) == 0.0
    assert velocity_within(-away, 0.0, outside, LIMITS, CYCLE_S) == -away / 10.0


def test_an_axis_goes_on_for_a_time_that_is_one() -> None:
    for none in (-0.1, inf, nan):
        with pytest.raises(ValueError, match="does not go on"):
            replace(LIMITS, goes_on_s=none)
