"""What the operating system and the interpreter are asked for, so that the loop keeps its time."""

import gc
import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from typing import Final

from daemon.host.resident_memory import give_back_compiler, lock_memory

_PRIORITY: Final = 50
_NEW_ONES_ORDINARY: Final = os.SCHED_RESET_ON_FORK
"""Threads and processes made later stay ordinary: only this thread is in a hurry. Whoever is not
root can ask for this, and not take it back (sched_setscheduler(2))."""
CPU_LATENCY: Final = Path("/dev/cpu_dma_latency")
"""Whoever holds this file open tells Linux how many microseconds a processor may take to wake up
(PM QoS). With none it does not sleep, so that it neither has to wake up when a frame comes, nor has
served another virtual machine meanwhile, which would have emptied its caches."""


class RealTime:
    """Memory kept in RAM, no surprise garbage collection, and a priority above other programs.

    Memory is locked once, before any device is connected and after all that a step needs was
    compiled and run. Priority and collector change whenever drives are energised, and processors
    are kept awake then, where that is permitted. Where it is not, some steps take longer, which
    is no reason to warn an operator: `tentacled doctor` tells it.
    """

    def __init__(self, cpu_latency: Path = CPU_LATENCY) -> None:
        self._cpu_latency = cpu_latency
        self._kept_awake: int | None = None
        """The open file."""
        self.refused: list[str] = []
        """What this machine does not permit, with the remedy."""
        self._memory_locked = False
        self._hurrying = self._has_priority = False

    def prepare(self) -> None:
        """Before the devices are connected. What was made until now is never collected again."""
        gc.collect()
        gc.freeze()
        give_back_compiler()
        reason = lock_memory()
        self._memory_locked = not reason
        if reason:
            self.refused.append(f"memory is not locked ({reason}): LimitMEMLOCK=infinity")

    def enter(self) -> None:
        """Drives are about to be energised."""
        gc.collect()
        gc.freeze()
        gc.disable()
        self._hurrying = True
        policy = os.SCHED_FIFO | _NEW_ONES_ORDINARY
        try:
            os.sched_setscheduler(0, policy, os.sched_param(_PRIORITY))
        except OSError as error:
            refused = f"no real-time priority ({error.strerror}): LimitRTPRIO=80"
            if refused not in self.refused:
                self.refused.append(refused)
        else:
            self._has_priority = True
        self._keep_awake()

    def _keep_awake(self) -> None:
        if self._kept_awake is not None:
            return
        try:
            opened = os.open(self._cpu_latency, os.O_WRONLY | os.O_CLOEXEC)
        except OSError:
            return
        try:
            os.write(opened, struct.pack("=i", 0))
        except OSError:
            os.close(opened)
        else:
            self._kept_awake = opened

    def collect_young(self) -> None:
        """Collect what was made lately; costs microseconds. For a moment with nothing to do."""
        if self._hurrying:
            gc.collect(0)

    def leave(self) -> None:
        """Drives are off. Safe to call at any time."""
        if not self._hurrying:
            return
        self._hurrying = False
        if self._has_priority:
            self._has_priority = False
            policy = os.SCHED_OTHER | _NEW_ONES_ORDINARY
            os.sched_setscheduler(0, policy, os.sched_param(0))
        gc.enable()
        if self._kept_awake is not None:
            os.close(self._kept_awake)
            self._kept_awake = None

    def __str__(self) -> str:
        return ", ".join(
            word
            for word, true in (
                ("memory locked", self._memory_locked),
                ("garbage collector off", self._hurrying),
                (f"SCHED_FIFO {_PRIORITY}", self._has_priority),
                ("processors kept awake", self._kept_awake is not None),
            )
            if true
        )


def why_no_priority() -> str:
    """Why drives would move without it; empty: they would not. A thread tries, and ends with it."""
    refused: list[str] = []

    def ask() -> None:
        policy = os.SCHED_FIFO | _NEW_ONES_ORDINARY
        try:
            os.sched_setscheduler(0, policy, os.sched_param(_PRIORITY))
        except OSError as error:
            refused.append(error.strerror or str(error))

    thread = Thread(target=ask)
    thread.start()
    thread.join()
    return "".join(refused)


# Times at which much is made that stays: to look through it for garbage, over and over, is a
# tenth or more of what it takes to make it.


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
