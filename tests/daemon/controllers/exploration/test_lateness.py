"""How late an unknown body's tip comes after its axes is found from its first motions."""

import numpy as np
import pytest

from daemon.controllers.exploration.lateness import Lateness
from drivers.pose import Vector

DT_S = 0.025
TRAVEL = np.full(4, 50.0)
NOISE_MM = 0.1


def tip_mm(u: Vector) -> Vector:
    """Of an arm that bends: the slopes double along the travel."""
    share = u / TRAVEL
    bent = share + share**2
    return np.asarray(40.0 * np.array([bent[0] - bent[1], bent[2] - bent[3], bent.sum()]))


def lines(t_s: float) -> Vector:
    """From place to place, five seconds each, with a swing."""
    places = np.random.default_rng(3).uniform(0.0, 50.0, (20, 4))
    places[0] = 0.0
    number, along = int(t_s / 5.0), t_s % 5.0 / 5.0
    swing = np.sin(t_s * np.array([2.1, 2.7, 1.7, 2.4])) if t_s > 0.0 else 0.0
    return np.asarray(places[number] + along * (places[number + 1] - places[number]) + swing)


def found_s(lag_s: float, duration_s: float, way: object = lines) -> float:
    """Half of the lag is dead time."""
    assert callable(way)
    lateness, random = Lateness(TRAVEL), np.random.default_rng(5)
    shown = tip_mm(way(0.0))
    for k in range(round(duration_s / DT_S)):
        t_s = k * DT_S
        due = tip_mm(way(max(t_s - 0.5 * lag_s, 0.0)))
        shown = shown + (DT_S / max(0.5 * lag_s, DT_S)) * (due - shown)
        lateness.add(t_s, way(t_s), shown + NOISE_MM * random.normal(size=3))
    return lateness.seconds


@pytest.mark.parametrize(("lag_s", "lowest", "highest"), [(0.1, 0, 0.2), (0.8, 0.5, 1.0)])
def test_it_is_known_after_two_lines(lag_s: float, lowest: float, highest: float) -> None:
    assert lowest <= found_s(lag_s, 12.0) <= highest


def test_nothing_is_told_before_enough_was_seen() -> None:
    assert found_s(0.8, 1.5) == 0.0


def test_who_stands_still_is_not_late() -> None:
    assert found_s(0.8, 10.0, lambda _: np.full(4, 20.0)) == 0.0
