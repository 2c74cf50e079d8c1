"""How much of a gain is of use, by whether errors persist or turn round."""

import numpy as np
import pytest

from daemon.control.lag.persistence import Persistence
from drivers.pose import Vector

DT_S = 0.025
LAG_S = 0.15
NOISE_MM = 0.2


def closed_loop(
    gain_per_s: float, drift_mm_s: float, adapted: bool, seconds: float = 40.0
) -> tuple[Vector, float]:
    """(n,) mm by which a tip is truly off that is led back `LAG_S` late, by errors with noise in
    them, while it is driven off to and fro; and the share of the gain in the end."""
    random, persistence = np.random.default_rng(1), Persistence()
    waiting = round(LAG_S / DT_S) * [np.zeros(3)]
    tip, off, share, seen = np.zeros(3), [], 1.0, np.zeros(3)
    for k in range(round(seconds / DT_S)):
        t_s = k * DT_S
        drift = drift_mm_s * np.array([np.sin(0.7 * t_s), np.cos(0.7 * t_s), 0.0])
        tip = tip + waiting.pop(0) + drift * DT_S
        seen = seen + 0.4 * (tip + random.normal(0.0, NOISE_MM, 3) - seen)
        share = persistence.add(t_s, DT_S, -seen, LAG_S)
        waiting.append(gain_per_s * DT_S * (share if adapted else 1.0) * -seen)
        off.append(float(np.linalg.norm(tip)))
    return np.array(off[len(off) // 2 :]), persistence.share


def test_a_gain_that_is_too_high_for_the_noise_is_not_used_in_full() -> None:
    in_full, _ = closed_loop(8.0, 0.0, adapted=False)
    adapted, share = closed_loop(8.0, 0.0, adapted=True)
    assert share < 0.6
    assert adapted.mean() < 0.8 * in_full.mean()


def test_all_of_a_gain_is_used_while_something_takes_the_tip_off() -> None:
    in_full, _ = closed_loop(3.0, 3.0, adapted=False)
    adapted, share = closed_loop(3.0, 3.0, adapted=True)
    assert share > 0.9
    assert adapted.mean() == pytest.approx(in_full.mean(), rel=0.02)


@pytest.mark.parametrize("drift_mm_s", [0.0, 0.5, 2.0])
def test_no_gain_is_worse_with_it(drift_mm_s: float) -> None:
    for gain_per_s in (2.0, 4.0, 6.0, 8.0):
        in_full, _ = closed_loop(gain_per_s, drift_mm_s, adapted=False)
        adapted, _ = closed_loop(gain_per_s, drift_mm_s, adapted=True)
        assert adapted.mean() < 1.1 * in_full.mean()


def turning_round() -> Persistence:
    """Errors have come and gone, every quarter of a second."""
    persistence = Persistence()
    for k in range(2000):
        persistence.add(k * DT_S, DT_S, (-1.0 if k // 10 % 2 else 1.0) * np.ones(3), 0.0)
    assert persistence.share < 0.6
    return persistence


def test_an_error_far_above_the_usual_ones_meets_all_of_the_gain() -> None:
    persistence, t_s = turning_round(), 2000 * DT_S
    assert persistence.add(t_s, DT_S, np.array([0.0, 1.0, 1.0]), 0.0) < 0.6
    assert persistence.add(t_s + DT_S, DT_S, np.array([8.0, 0.0, 0.0]), 0.0) == 1.0


def test_motion_that_begins_anew_has_all_of_the_gain() -> None:
    persistence = turning_round()
    persistence.begin()
    assert persistence.share == 1.0
