"""Times at which much is made that stays: to look through it for garbage, over and over, is a tenth
or more of what it takes to make it."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

_RARELY: Final = 50_000
"""So many new objects between two looks, instead of some hundreds."""


@contextmanager
def collector_paused() -> Iterator[None]:
    """Within it nothing that refers to itself is collected."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


@contextmanager
def imported_for_good() -> Iterator[None]:
    """What is there at its end is not looked through any more."""
    with collector_paused():
        yield
        gc.freeze()


@contextmanager
def collector_rarely() -> Iterator[None]:
    """Within it there is a look now and then, at what has come since; for work without an end."""
    thresholds = gc.get_threshold()
    gc.freeze()
    gc.set_threshold(_RARELY, *thresholds[1:])
    try:
        yield
    finally:
        gc.set_threshold(*thresholds)
        gc.unfreeze()
