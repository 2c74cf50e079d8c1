"""STOP comes through whatever the remote interface is flooded with, while the arm moves.

How long each takes is `python -m tests.experiments.stop_under_flood`: a busy machine's own pauses
are no matter of a test. One client's flood is among the shorter tests, in `test_remote_access`.
"""

import pytest

from tests.experiments.floods import FLOODS
from tests.experiments.stop_under_flood import flooded

pytestmark = pytest.mark.long


@pytest.mark.parametrize("flood", FLOODS)
def test_every_stop_comes_through_by_every_way(flood: str) -> None:
    outcomes = flooded(flood, stops=1, real_time=False)
    for way, outcome in outcomes.items():
        assert outcome.lost == [], way
        assert len(outcome.to_bus_ms) + len(outcome.at_rest) == 1
