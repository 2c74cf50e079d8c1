"""Every condition that a driver can tell of raises a cause that is in the table."""

from types import ModuleType

import pytest

from daemon.supervision.condition_causes import CAUSE_OF_CONDITION
from drivers.aurora import conditions as tracker
from drivers.can import conditions as bus
from drivers.cia402 import conditions as drive
from drivers.conditions import Condition
from safety.causes import cause


def conditions_in(module: ModuleType) -> list[Condition]:
    return [value for value in vars(module).values() if isinstance(value, Condition)]


@pytest.mark.parametrize("module", [tracker, bus, drive])
def test_no_condition_is_left_out(module: ModuleType) -> None:
    missing = [c.name for c in conditions_in(module) if c not in CAUSE_OF_CONDITION]
    assert missing == []


@pytest.mark.parametrize("name", sorted(set(CAUSE_OF_CONDITION.values())))
def test_every_cause_is_in_the_table(name: str) -> None:
    assert cause(name) is name


def test_what_is_over_at_once_needs_no_debounce() -> None:
    """A reset or an error frame is told once and is gone: it must fire all the same."""
    for condition in (drive.RESET, drive.FOLLOWING_ERROR, drive.EMERGENCY):
        assert cause(CAUSE_OF_CONDITION[condition]).debounce_s == 0.0
