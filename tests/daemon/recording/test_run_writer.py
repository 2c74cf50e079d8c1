"""A recording is readable up to the last flush, equal for equal input, and outlives a full disk."""

import errno
import os
from pathlib import Path

import msgspec
import pytest
from mcap.reader import make_reader

from daemon.recording import run_writer
from daemon.recording.run_parts import control_hash
from daemon.recording.run_reader import RunReader, UnreadableRunError
from daemon.recording.run_writer import ENDING, HEADER, RunWriter
from tests.daemon.recording.synthetic_run import BOOT_NS, WALL_NS, make_run

OFFSET_NS = WALL_NS - BOOT_NS


def write(path: Path, count: int, flush_every: int = 10**9) -> RunWriter:
    writer = RunWriter(path, {"robot": "soft_arm"}, OFFSET_NS)
    for number in range(count):
        writer.write("/axes", BOOT_NS + number, b'{"sequence":%d}' % number)
        writer.write("/risk", BOOT_NS + number, b'{"scale":%d}' % number)
        if number % flush_every == flush_every - 1:
            writer.flush()
    return writer


def test_a_standard_reader_reads_everything(tmp_path: Path) -> None:
    path = make_run(tmp_path, cycles=1, cycle_s=5.0)
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        topics = {channel.topic for channel in summary.channels.values()}
        assert topics == {
            "/state",
            "/tip",
            "/tip_pose",
            "/axes",
            "/risk",
            "/body",
            "/loop",
            "/event",
            "/raw/tracker",
            "/raw/can/can0",
        }
        found = list(reader.iter_messages("/tip"))
        assert [message.sequence for _, _, message in found] == list(range(len(found)))
        for schema, _, message in found:
            assert schema is not None
            assert schema.name == "tentacled.tip/1"
            t_ns = msgspec.json.decode(message.data)["t_ns"]
            assert message.log_time == t_ns + OFFSET_NS
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
    assert metadata[HEADER]["robot"] == "soft_arm"
    assert metadata[HEADER]["wall_offset_ns"] == str(OFFSET_NS)
    assert metadata[ENDING] == {"dropped": "0"}


def test_the_same_messages_give_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        make_run(tmp_path / name, cycles=1, cycle_s=5.0)
    one, other = ((tmp_path / name / "run.mcap").read_bytes() for name in ("a", "b"))
    assert one == other


def test_the_control_hash_sees_content_and_not_chunks(tmp_path: Path) -> None:
    hashes = []
    for name, count, flush_every in (("a", 50, 10**9), ("b", 50, 7), ("c", 49, 7)):
        path = tmp_path / f"{name}.mcap"
        assert write(path, count, flush_every).finish()
        hashes.append(control_hash(path))
    assert hashes[0] == hashes[1]
    assert hashes[1] != hashes[2]
    assert control_hash(tmp_path / "a.mcap", ["/event"]) == control_hash(
        tmp_path / "c.mcap", ["/event"]
    )


def test_an_unfinished_recording_has_another_name(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    writer = write(path, 3)
    assert [file.name for file in tmp_path.iterdir()] == ["run.mcap.part"]
    assert writer.finish()
    assert [file.name for file in tmp_path.iterdir()] == ["run.mcap"]


def test_what_was_flushed_is_readable_before_the_end(tmp_path: Path) -> None:
    writer = write(tmp_path / "run.mcap", 20, flush_every=10)
    writer.write("/axes", BOOT_NS, b"{}")
    reader = RunReader(tmp_path / "run.mcap.part")
    assert len(list(reader.messages())) == 40
    assert not reader.whole
    writer.finish()
    reader = RunReader(tmp_path / "run.mcap")
    assert len(list(reader.messages())) == 41
    assert reader.whole


def test_an_existing_recording_is_not_written_over(tmp_path: Path) -> None:
    writer = write(tmp_path / "run.mcap", 1)
    with pytest.raises(FileExistsError):
        RunWriter(tmp_path / "run.mcap", {}, 0)
    writer.finish()


def test_a_file_that_is_no_recording_is_named(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("these are notes, not messages")
    with pytest.raises(UnreadableRunError, match=r"notes\.txt is not a recording"):
        control_hash(path)


class FullDisk:
    """Stands in for os.write, and takes only so many bytes until it is emptied."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, room: int) -> None:
        self.room = room
        self._write = os.write
        monkeypatch.setattr("daemon.recording.format.mcap_file.os.write", self.write)

    def write(self, fd: int, data: bytes) -> int:
        if self.room <= 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        taken = self._write(fd, bytes(data[: self.room]))
        self.room -= taken
        return taken


def test_a_disk_that_was_full_for_a_while_costs_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer = write(tmp_path / "run.mcap", 10, flush_every=5)
    disk = FullDisk(monkeypatch, room=100)
    for number in range(200):
        writer.write("/axes", BOOT_NS + number, os.urandom(100))
        writer.flush()
    assert writer.failed == "No space left on device"
    assert writer.dropped == 0
    disk.room = 10**9
    writer.flush()
    assert writer.failed == ""
    assert writer.finish()
    reader = RunReader(tmp_path / "run.mcap")
    assert len(list(reader.messages())) == 220
    assert reader.whole


def test_a_disk_that_stays_full_drops_and_counts_and_leaves_a_sound_beginning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_writer, "_PENDING_AT_MOST", 10_000)
    writer = write(tmp_path / "run.mcap", 10, flush_every=5)
    FullDisk(monkeypatch, room=1000)
    for number in range(300):
        writer.write("/axes", BOOT_NS + number, os.urandom(100))
        writer.flush()
    assert writer.dropped > 100
    assert not writer.finish()
    assert [file.name for file in tmp_path.iterdir()] == ["run.mcap.part"]
    assert len(list(RunReader(tmp_path / "run.mcap.part").messages())) >= 20
