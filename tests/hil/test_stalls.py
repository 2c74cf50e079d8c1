"""A computer that gives its programs no turn for a while: the tour goes on, or says why not."""

import asyncio
import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from daemon.commands.terminal.tour import Tour
from safety.states import OperatingState
from tests import SOFT_ARM
from tests.hil.daemon_rig import MODEL, Rig, short_folder
from tests.hil.processes import PATIENCE_S

pytestmark = [pytest.mark.long, pytest.mark.hil, pytest.mark.xdist_group("stalls")]

S = OperatingState

STALL_S = 0.3
STALLS = 4
STALLED = {"loop_stalled", "loop_late"}
CYCLE_S = 12.0


@contextmanager
def stood_still(pid: int) -> Iterator[None]:
    """The process gets no turn meanwhile."""
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(pid, signal.SIGCONT)


@contextmanager
def as_shipped() -> Iterator[Rig]:
    """What `make run` starts."""
    with short_folder() as folder:
        one = Rig(folder, SOFT_ARM)
        try:
            yield one
        finally:
            one.leave()


class Touring(threading.Thread):
    """A visitor, once round the rectangle."""

    def __init__(self, folder: Path) -> None:
        super().__init__(daemon=True)
        self._tour = Tour(folder, CYCLE_S, MODEL)
        self.recording = ""
        self.error: BaseException | None = None

    def run(self) -> None:
        try:
            self.recording = asyncio.run(self._tour.run())
        except BaseException as error:
            self.error = error


@pytest.mark.parametrize("whose", ["daemon", "lab", "both"])
def test_the_tour_goes_on_after_stalls_of_a_third_of_a_second(whose: str) -> None:
    with as_shipped() as one:
        pids = {"daemon": [one.daemon.pid], "lab": [one.lab.process.pid]}
        pids["both"] = pids["daemon"] + pids["lab"]
        touring = Touring(one.folder)
        touring.start()
        one.until_it_was(S.RUNNING, within_s=PATIENCE_S)
        for _ in range(STALLS):
            time.sleep(1.5)
            for pid in pids[whose]:
                os.kill(pid, signal.SIGSTOP)
            time.sleep(STALL_S)
            for pid in pids[whose]:
                os.kill(pid, signal.SIGCONT)
        touring.join(PATIENCE_S)
        assert touring.error is None
        assert Path(touring.recording).is_dir()
        assert not one.events("state", S.FAULT.value)


@pytest.mark.parametrize(
    ("whose", "for_s"), [("daemon", 1.2), ("lab", 1.2), ("lab", 3.0)], ids=["daemon", "lab", "gone"]
)
def test_after_a_long_stall_one_cause_leads_and_clear_and_arm_lead_back(
    whose: str, for_s: float
) -> None:
    with as_shipped() as one:
        one.running()
        with stood_still(one.daemon.pid if whose == "daemon" else one.lab.process.pid):
            time.sleep(for_s)
        one.until(lambda: one.state is S.FAULT)  # its events may have had no way to us
        leads = {r.name for r in one.status().reasons if not r.follows_from}
        assert not {name for name in leads if name.startswith("drive_")}
        if whose == "daemon":
            assert leads <= {"loop_stalled", "loop_slow", "tracker_warning"}
            assert "loop_stalled" in leads
        elif not leads & STALLED:  # else a busy machine has kept the daemon from its turn as well
            # Nothing but their silence says that drives and tracker have one origin.
            assert len(leads & {"bus_not_open", "bus_queue_full", "node_lost"}) == 1, leads
        for command in (one.client.clear, one.client.arm):
            one._acquire()  # the lease may have run out meanwhile
            one.user.do(command())
        assert one.state is S.ARMED
