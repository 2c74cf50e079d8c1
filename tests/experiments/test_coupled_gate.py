"""A little of `python -m tests.experiments.coupled_gate`."""

from pathlib import Path

import numpy as np
import pytest

from tests.experiments.coupled_gate import TUBES, OwnReading, faster, play


def test_of_random_proposals_nothing_outside_goes_on_the_bus(tmp_path: Path) -> None:
    found = play(faster(tmp_path), 2000, seed=2)
    assert found.outside == 0
    assert found.worst < 0.0
    assert found.places > 20_000
    assert found.cut["collar_clearance"] > 100
    assert found.cut["snap_guard"] > 5
    assert found.without_limits_outside > 5000, "the proposals lead nowhere"
    assert found.without_step < 20


def test_the_same_seed_is_the_same_play() -> None:
    assert play(TUBES, 200, seed=3) == play(TUBES, 200, seed=3)


@pytest.mark.parametrize(
    ("u", "outside"),
    [
        ((0.0, 0.0, 0.0, 0.0, 33.1), 0.1),
        ((0.0, 0.0, 0.0, 5.0, 38.1), 0.1),
        ((0.0, 0.0, 0.0, 0.0, -53.2), 0.2),
        ((0.0, 0.0, 3.1416, 0.0, -29.5), 1.0),
        ((1.0, 1.0, -2.1416, 0.0, -29.5), 1.0),
        ((0.0, 0.0, 1.9, 0.0, -34.5), -18.5),
    ],
)
def test_the_own_reading_of_the_file_knows_the_tubes(u: tuple[float, ...], outside: float) -> None:
    own = OwnReading(TUBES)
    counts = np.round(np.array(u) / own.units_per_count)
    assert own.outside(counts[None]) == pytest.approx(outside, abs=0.002)
