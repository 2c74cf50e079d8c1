"""The garbage collector is spared work, and is afterwards as it was."""

import gc
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager

import pytest

from daemon.host.real_time import collector_paused, collector_rarely, imported_for_good

PAUSES = [collector_paused, collector_rarely, imported_for_good]
Pause = Callable[[], AbstractContextManager[None]]


@pytest.fixture(autouse=True)
def nothing_frozen() -> Iterator[None]:
    yield
    gc.unfreeze()


class Loop:
    """Refers to itself: only the collector can end it."""

    def __init__(self) -> None:
        self.me = self


@pytest.mark.parametrize("pause", PAUSES)
def test_afterwards_the_collector_is_as_it_was(pause: Pause) -> None:
    before = gc.isenabled(), gc.get_threshold()
    with pytest.raises(ValueError, match="inside"), pause():
        raise ValueError("inside")
    assert (gc.isenabled(), gc.get_threshold()) == before


@pytest.mark.parametrize("pause", [collector_paused, imported_for_good])
def test_one_that_was_off_stays_off(pause: Pause) -> None:
    gc.disable()
    try:
        with pause():
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()


def test_long_work_is_still_collected_after() -> None:
    gc.collect()
    with collector_rarely():
        for _ in range(200_000):
            Loop()
        assert gc.get_count()[0] < 100_000, "there was a look in between"
    assert gc.get_freeze_count() == 0


def test_what_was_imported_is_not_looked_through() -> None:
    with imported_for_good():
        kept = [Loop()]
    assert gc.get_freeze_count() > 0
    assert not any(one is kept for one in gc.get_objects())
