"""The recorder as a process of its own: killed, frozen, refused, and never in the loop's way."""

import asyncio
import os
import signal
import subprocess
import sys
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import msgspec
import pytest

from daemon.host.clock import run_in_real_time
from daemon.messages import Event
from daemon.recording import flight_recorder
from daemon.recording.flight_recorder import FlightRecorder, RecordingError
from daemon.recording.format.channels import read_can_payload, read_tracker_payload
from daemon.recording.recovery import Recovered, recover
from daemon.recording.run_parts import control_hash
from daemon.recording.run_reader import RunReader
from drivers.can.frame import CanFrame
from tests.daemon.recording.synthetic_run import (
    BOOT_NS,
    HEADER,
    WALL_NS,
    make_run,
    messages,
    record,
)

pytestmark = [pytest.mark.hil, pytest.mark.xdist_group("hil")]

WITHIN_S = 30.0
LOST_AT_MOST_S = 0.3
ATTEMPTS = 6


def event(number: int, detail: str = "") -> Event:
    return Event(
        sequence=number,
        t_ns=BOOT_NS + number,
        kind="note",
        name="beat",
        subject="test",
        present=True,
        text="",
        detail=detail,
    )


async def until(true: Callable[[], bool]) -> None:
    async with asyncio.timeout(WITHIN_S):
        while not true():
            await asyncio.sleep(0.01)


def recording(folder: Path, test: Callable[[FlightRecorder], Awaitable[None]]) -> FlightRecorder:
    """Run `test` with a recorder that records in `folder`. Returns the recorder, stopped."""

    async def whole() -> FlightRecorder:
        recorder = FlightRecorder()
        await recorder.start(folder, HEADER, BOOT_NS, WALL_NS)
        try:
            await test(recorder)
        finally:
            await recorder.stop()
        return recorder

    return run_in_real_time(whole())


def numbers(path: Path) -> list[int]:
    """Of the events in a recording."""
    found = RunReader(path).messages(["/event"])
    return [int(msgspec.json.decode(message.data)["sequence"]) for message in found]


def test_everything_handed_over_is_in_the_file(tmp_path: Path) -> None:
    telemetry = list(messages(cycles=1, cycle_s=4.0))

    async def test(recorder: FlightRecorder) -> None:
        assert recorder.status.recording
        assert recorder.status.folder == tmp_path
        record(recorder, telemetry)
        await until(lambda: recorder.status.bytes_written > 0)
        assert recorder.status.free_mb is not None

    recorder = recording(tmp_path, test)
    assert not recorder.status.recording
    assert recorder.status.folder is None
    assert recorder.status.failed == ""
    assert recorder.status.dropped == 0
    (tmp_path / "direct").mkdir()
    direct = make_run(tmp_path / "direct", cycles=1, cycle_s=4.0)
    assert control_hash(tmp_path / "run.mcap") == control_hash(direct)


def test_raw_traffic_can_be_replayed(tmp_path: Path) -> None:
    async def test(recorder: FlightRecorder) -> None:
        for number in range(1000):
            recorder.can_tap("can0").received(0x181, number.to_bytes(4, "little"), BOOT_NS + number)
            recorder.tracker_traffic("from_device", bytes([number % 256]), BOOT_NS + number)

    recording(tmp_path, test)
    reader = RunReader(tmp_path / "run.mcap")
    found = list(reader.messages())
    frames = [
        one
        for message in found
        if message.topic == "/raw/can/can0"
        for one in read_can_payload(message.data)
    ]
    assert frames == [
        (BOOT_NS + number, CanFrame(0x181, number.to_bytes(4, "little"))) for number in range(1000)
    ]
    line = b"".join(
        read_tracker_payload(message.data)[1]
        for message in found
        if message.topic == "/raw/tracker"
    )
    assert line == bytes(number % 256 for number in range(1000))


def test_a_recording_that_cannot_be_made_is_refused_with_a_reason(tmp_path: Path) -> None:
    async def test() -> None:
        recorder = FlightRecorder()
        with pytest.raises(RecordingError, match="cannot write the recording: No such file"):
            await recorder.start(tmp_path / "nothing", HEADER, BOOT_NS, WALL_NS)
        assert not recorder.status.recording
        await recorder.start(tmp_path, HEADER, BOOT_NS, WALL_NS)
        with pytest.raises(RecordingError, match="already recording"):
            await recorder.start(tmp_path, HEADER, BOOT_NS, WALL_NS)
        recorder.message(event(1))
        await recorder.stop()
        (tmp_path / "run.mcap.part").touch()
        with pytest.raises(RecordingError, match="File exists"):
            await recorder.start(tmp_path, HEADER, BOOT_NS, WALL_NS)

    run_in_real_time(test())
    assert numbers(tmp_path / "run.mcap") == [1]


def test_one_recorder_makes_one_recording_after_the_other(tmp_path: Path) -> None:
    async def test() -> None:
        recorder = FlightRecorder()
        for name in ("a", "b"):
            (tmp_path / name).mkdir()
            await recorder.start(tmp_path / name, HEADER, BOOT_NS, WALL_NS)
            recorder.message(event(ord(name)))
            await recorder.stop()
        recorder.message(event(0))
        await recorder.stop()

    run_in_real_time(test())
    assert numbers(tmp_path / "a" / "run.mcap") == [ord("a")]
    assert numbers(tmp_path / "b" / "run.mcap") == [ord("b")]


def test_signals_to_the_whole_group_do_not_end_a_recording(tmp_path: Path) -> None:
    async def test(recorder: FlightRecorder) -> None:
        assert recorder.pid is not None
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            os.kill(recorder.pid, number)
        recorder.message(event(1))
        before = recorder.status.bytes_written
        await until(lambda: recorder.status.bytes_written > before)
        recorder.message(event(2))

    assert recording(tmp_path, test).status.failed == ""
    assert numbers(tmp_path / "run.mcap") == [1, 2]


def test_urgent_brings_the_last_messages_to_the_disk(tmp_path: Path) -> None:
    async def test(recorder: FlightRecorder) -> None:
        recorder.message(event(1))
        recorder.can_tap("can0").received(1, b"", BOOT_NS)
        recorder.urgent()
        part = tmp_path / "run.mcap.part"
        await until(lambda: len(list(RunReader(part).messages())) == 2)

    recording(tmp_path, test)


def test_a_killed_recorder_is_noticed_and_disturbs_nobody(tmp_path: Path) -> None:
    async def test(recorder: FlightRecorder) -> None:
        assert recorder.pid is not None
        recorder.message(event(1))
        recorder.urgent()
        part = tmp_path / "run.mcap.part"
        await until(lambda: len(list(RunReader(part).messages())) == 1)
        os.kill(recorder.pid, signal.SIGKILL)
        await until(lambda: not recorder.status.recording)
        assert recorder.status.failed == "the recorder process has ended by itself"
        for number in range(2, 100):
            recorder.message(event(number))
            recorder.urgent()
        assert recorder.status.dropped == 98

    recorder = recording(tmp_path, test)
    assert recorder.status.failed == "the recorder process has ended by itself"
    assert recovered(tmp_path / "run.mcap").messages == 1
    assert numbers(tmp_path / "run.mcap") == [1]


def test_a_frozen_recorder_costs_messages_but_never_makes_the_loop_wait(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(flight_recorder, "_SILENT_TICKS", 20)
    sent = 3000

    async def test(recorder: FlightRecorder) -> None:
        assert recorder.pid is not None
        os.kill(recorder.pid, signal.SIGSTOP)
        try:
            for number in range(sent):
                recorder.message(event(number, "x" * 10_000))
                if number % 100 == 0:
                    recorder.urgent()
                    await asyncio.sleep(0)
            assert recorder.status.dropped > 0
            await until(lambda: recorder.status.failed != "")
            assert recorder.status.failed == "the recorder process does not answer"
            assert recorder.status.recording
        finally:
            os.kill(recorder.pid, signal.SIGCONT)
        await until(lambda: recorder.status.failed == "")

    recorder = recording(tmp_path, test)
    reader = RunReader(tmp_path / "run.mcap")
    kept = len(list(reader.messages()))
    assert kept + recorder.status.dropped == sent
    assert reader.metadata["ending"] == {"dropped": str(recorder.status.dropped)}
    assert kept * 10_000 >= 8_000_000
    assert numbers(tmp_path / "run.mcap") == list(range(kept)), "the newest are dropped"


def test_a_recorder_that_a_busy_disk_keeps_silent_for_twenty_seconds_is_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sends = int(20.0 / flight_recorder._SEND_EVERY_S)
    monkeypatch.setattr(flight_recorder, "_SEND_EVERY_S", 1e-4)

    async def test(recorder: FlightRecorder) -> None:
        assert recorder.pid is not None
        os.kill(recorder.pid, signal.SIGSTOP)
        try:
            silent = 0
            while silent < sends:
                recorder.message(event(silent))
                await asyncio.sleep(1e-4)  # at most one send
                silent += 1
            assert recorder.status.failed == ""
            assert not recorder.status.lost
        finally:
            os.kill(recorder.pid, signal.SIGCONT)

    recorder = recording(tmp_path, test)
    assert recorder.status.dropped == 0
    assert numbers(tmp_path / "run.mcap") == list(range(sends)), "and nothing is lost"


def test_stopping_a_frozen_recorder_ends_in_time_and_the_file_can_be_recovered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(flight_recorder, "_ENDS_WITHIN_S", 0.5)

    async def test(recorder: FlightRecorder) -> None:
        assert recorder.pid is not None
        recorder.message(event(1))
        recorder.urgent()
        part = tmp_path / "run.mcap.part"
        await until(lambda: len(list(RunReader(part).messages())) == 1)
        os.kill(recorder.pid, signal.SIGSTOP)

    recorder = recording(tmp_path, test)
    assert "did not finish the file" in recorder.status.failed
    assert recovered(tmp_path / "run.mcap").messages == 1
    assert numbers(tmp_path / "run.mcap") == [1]


def recovered(path: Path) -> Recovered:
    """The outcome, once the killed recorder is gone and with it its lock."""
    deadline = time.monotonic() + WITHIN_S
    while time.monotonic() < deadline:
        outcome = recover(path)
        if outcome is not None:
            return outcome
        time.sleep(0.02)
    raise AssertionError("the recording is still locked")


class Writing:
    """A process that records, and how far it has come."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir()
        self.path = folder / "run.mcap"
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.hil.recording_process", str(folder)],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        self._lines = self.process.stdout
        self.recorder_pid = int(self._lines.readline())
        self._last = 0

    def read_until(self, number: int) -> None:
        while self._last < number:
            self._last = int(self._lines.readline())

    def kill(self, *, recorder_too: bool) -> None:
        if recorder_too:
            os.kill(self.recorder_pid, signal.SIGKILL)
        self.process.kill()
        self.process.wait()

    def last_number(self) -> int:
        """Of what the process has written before its end."""
        rest = [int(line) for line in self._lines if line.endswith("\n")]
        return max([self._last, *rest])

    def close(self) -> None:
        with suppress(ProcessLookupError):
            os.kill(self.recorder_pid, signal.SIGKILL)
        self.process.kill()
        self.process.wait()
        self._lines.close()


@contextmanager
def writing(folder: Path) -> Iterator[Writing]:
    one = Writing(folder)
    try:
        yield one
    finally:
        one.close()


def test_when_the_daemon_is_killed_the_recorder_finishes_the_file(tmp_path: Path) -> None:
    with writing(tmp_path / "run") as one:
        one.read_until(200)
        one.kill(recorder_too=False)
        last = one.last_number()
        deadline = time.monotonic() + WITHIN_S
        while not one.path.exists() and time.monotonic() < deadline:
            time.sleep(0.02)
        kept = numbers(one.path)
    assert kept == list(range(1, len(kept) + 1))
    # Sent 20 times a second, by the same loop that makes 200 messages a second.
    assert last - len(kept) <= LOST_AT_MOST_S * 200


def test_when_both_are_killed_at_most_the_last_instant_is_lost(tmp_path: Path) -> None:
    """Other work may keep the recorder from running: the best of some tries counts."""
    lost_s = []
    for attempt in range(ATTEMPTS):
        with writing(tmp_path / str(attempt)) as one:
            one.read_until(200)
            one.kill(recorder_too=True)
            last = one.last_number()
            assert recovered(one.path).problem == ""
            kept = numbers(one.path)
        assert kept == list(range(1, len(kept) + 1))
        assert kept
        lost_s.append((last - len(kept)) / 200)
        if lost_s[-1] <= LOST_AT_MOST_S:
            return
    raise AssertionError(f"always lost more than {LOST_AT_MOST_S} s: {lost_s}")
