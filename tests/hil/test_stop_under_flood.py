"""STOP comes through whatever the remote interface is flooded with, while the arm moves.

How long each takes is `python -m tests.experiments.stop_under_flood`: a busy machine's own pauses
are no matter of a test.
"""

import pytest

from tests.experiments.floods import FLOODS
from tests.experiments.stop_under_flood import flooded

_FIRST, *_OTHERS = FLOODS


@pytest.mark.parametrize(
    "flood", [_FIRST, *(pytest.param(one, marks=pytest.mark.long) for one in _OTHERS)]
)
def test_every_stop_comes_through_by_every_way(flood: str) -> None:
    outcomes = flooded(flood, stops=1, real_time=False)
    for way, outcome in outcomes.items():
        assert outcome.lost == [], way
        assert len(outcome.to_bus_ms) + len(outcome.at_rest) == 1
