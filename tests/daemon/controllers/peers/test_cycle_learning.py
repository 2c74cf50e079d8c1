"""What a path that repeats teaches, on a loop with dead time and lag."""

from collections import deque

import numpy as np
import pytest

from daemon.control.controller import Phase
from daemon.controllers.peers.cycle_learning import ClosedLoop, CycleLearning
from drivers.pose import Vector

DT_S = 0.025
CYCLE_S = 10.0
LOOP = ClosedLoop(gain_per_s=1.5, dead_s=0.1, lag_s=0.2, feed_forward=True)


def reference(t_s: float, radius_mm: float = 30.0) -> tuple[Vector, Vector]:
    """A circle."""
    rate = 2.0 * np.pi / CYCLE_S
    c, s = np.cos(rate * t_s), np.sin(rate * t_s)
    return radius_mm * np.array([c, s, 0.0]), radius_mm * rate * np.array([-s, c, 0.0])


def errors_by_cycle(
    learning: CycleLearning, cycles: int, noise_mm: float = 0.0, gain: float = 0.9
) -> Vector:
    """(cycles,) mean mm. gain: how much of what is told the body does."""
    random = np.random.default_rng(1)
    tip = told = reference(0.0)[0]
    under_way = deque([told] * round(LOOP.dead_s / DT_S))
    found = []
    for k in range(round(cycles * CYCLE_S / DT_S)):
        t_s = k * DT_S
        aim, velocity = reference(t_s)
        measured = tip + noise_mm * random.normal(size=3)
        phase = Phase(t_s % CYCLE_S, CYCLE_S)
        learning.take(phase, aim, aim - measured, LOOP)
        correction, changes = learning.at(phase.seconds)
        wanted = LOOP.gain_per_s * (aim + correction - measured) + velocity + changes
        told = told + gain * DT_S * wanted
        under_way.append(told)
        found.append(np.linalg.norm(aim - tip))
        tip = tip + DT_S / LOOP.lag_s * (under_way.popleft() - tip)
    return np.asarray(np.reshape(found, (cycles, -1)).mean(axis=1))


def test_from_cycle_to_cycle_less_is_left() -> None:
    errors = errors_by_cycle(CycleLearning(CYCLE_S, caution=0.3, cutoff_hz=1.0), 6)
    assert errors[0] > 2.0
    assert errors[1] < 0.45 * errors[0]
    assert errors[-1] < 0.15


def test_a_cautious_one_learns_less_from_one_cycle() -> None:
    bold, cautious = (errors_by_cycle(CycleLearning(CYCLE_S, c, 1.0), 2) for c in (0.0, 3.0))
    assert bold[1] < 0.5 * cautious[1]


def test_noise_is_not_followed() -> None:
    """Of the tracker's noise there is in the correction what a few harmonics have of it."""
    learning = CycleLearning(CYCLE_S, caution=0.3, cutoff_hz=0.5)
    errors_by_cycle(learning, 3, noise_mm=0.3)
    quiet = CycleLearning(CYCLE_S, caution=0.3, cutoff_hz=0.5)
    errors_by_cycle(quiet, 3)
    away = [learning.at(t_s)[0] - quiet.at(t_s)[0] for t_s in np.arange(0.0, CYCLE_S, 0.1)]
    assert float(np.std(away)) < 0.15


def test_the_correction_and_its_speed_belong_together() -> None:
    learning = CycleLearning(CYCLE_S, caution=0.3, cutoff_hz=1.0)
    errors_by_cycle(learning, 3)
    for t_s in (0.11, 0.36, 4.06):
        here, change = learning.at(t_s)
        np.testing.assert_allclose(learning.at(t_s + 1e-4)[0] - here, 1e-4 * change, atol=1e-4)
    np.testing.assert_allclose(learning.at(CYCLE_S - 1e-6)[0], learning._corrections[0], atol=1e-3)


def test_half_a_cycle_teaches_nothing() -> None:
    learning = CycleLearning(CYCLE_S, caution=0.3, cutoff_hz=1.0)
    for k in range(round(1.1 * CYCLE_S / DT_S)):
        phase = Phase(k * DT_S % CYCLE_S, CYCLE_S)
        error = np.ones(3) if phase.seconds < 0.5 * CYCLE_S else None
        learning.take(phase, reference(k * DT_S)[0], error, LOOP)
    assert learning.cycles == 0
    assert not learning.at(3.0)[0].any()


@pytest.mark.parametrize("where", ["elsewhere", "longer"])
def test_another_path_is_another_one(where: str) -> None:
    learning = CycleLearning(CYCLE_S, caution=0.3, cutoff_hz=1.0)
    errors_by_cycle(learning, 2)
    same = Phase(3.0, CYCLE_S)
    assert learning.path.fits(same, reference(3.0)[0])
    if where == "elsewhere":
        assert not learning.path.fits(same, reference(3.0, radius_mm=20.0)[0])
    else:
        assert not learning.path.fits(Phase(3.0, 2.0 * CYCLE_S), reference(3.0)[0])
