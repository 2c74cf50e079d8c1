"""Recordings that a crash has left unfinished are made whole again."""

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Final

from mcap.records import Channel, Message, Metadata, Schema

from daemon.recording.mcap_file import McapChannel, McapFile
from daemon.recording.patient_file import PatientFile, sync_folder
from daemon.recording.run_files import RUN_FILE, unfinished
from daemon.recording.run_reader import RunReader, UnreadableRunError
from daemon.recording.run_writer import LIBRARY

RECOVERY: Final = "recovery"
"""Name of the metadata record that a recovered recording has."""


@dataclass(frozen=True)
class Recovered:
    """What became of one unfinished recording."""

    folder: Path
    messages: int
    """That were saved."""
    lost_bytes: int
    """At the end of the file, after the last whole record."""
    problem: str = ""
    """Why it could not be made whole; empty: it is."""

    def __str__(self) -> str:
        if self.problem:
            return f"{self.folder}: {self.problem}"
        cut = f", {self.lost_bytes} bytes at the end were cut short" if self.lost_bytes else ""
        return f"{self.folder}: {self.messages} messages saved{cut}"


def recover_unfinished(root: Path) -> list[Recovered]:
    """Make every unfinished recording under `root` whole, or the one in it. Never raises.

    Recordings that are still being written are left alone.
    """
    name = unfinished(Path(RUN_FILE)).name
    found = sorted([*root.glob(name), *root.glob(f"*/{name}")])
    outcomes = (recover(path.with_name(RUN_FILE)) for path in found)
    return [outcome for outcome in outcomes if outcome is not None]


def recover(path: Path) -> Recovered | None:
    """Make the recording whole that shall be at `path`. None: it is being written. Never raises."""
    part = unfinished(path)
    try:
        with part.open("r+b") as file:
            if not _abandoned(file):
                return None
            return _rewrite(part, path)
    except UnreadableRunError as error:
        return Recovered(path.parent, 0, 0, f"left as it is: {error}")
    except OSError as error:
        return Recovered(path.parent, 0, 0, f"cannot be recovered now: {error.strerror}")


def _abandoned(file: IO[bytes]) -> bool:
    """Whether nobody holds the writer's lock. Holds it from now on, against a second recovery."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _rewrite(part: Path, path: Path) -> Recovered:
    reader = RunReader(part)
    with _new_file(path.with_name(f".{path.name}.recovered")) as (beside, file):
        writer = McapFile(file, LIBRARY)
        messages = _copy(reader, writer)
        lost = part.stat().st_size - reader.read_bytes
        if not reader.whole:
            writer.add_metadata(
                RECOVERY, {"lost_bytes": str(lost), "damaged_records": str(reader.damaged)}
            )
        writer.finish()
        file.flush()
        file.sync()
        if file.failed:
            raise OSError(0, file.failed)
        beside.rename(path)
    sync_folder(path.parent)
    part.unlink()
    return Recovered(path.parent, messages, lost)


def _copy(reader: RunReader, writer: McapFile) -> int:
    """All records from one file to the other. Returns the number of messages."""
    schemas, channels = {0: 0}, dict[int, McapChannel]()
    messages = 0
    for record in reader.records():
        if isinstance(record, Schema) and record.id not in schemas:
            schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel) and record.id not in channels:
            schema = schemas.get(record.schema_id, 0)  # it may have been in a damaged chunk
            channels[record.id] = writer.register_channel(
                record.topic, record.message_encoding, schema, record.metadata
            )
        elif isinstance(record, Message):
            messages += 1
            channel = channels[record.channel_id]
            channel.sequence = record.sequence  # where some are lost, the others keep theirs
            channel.add(record.log_time, record.data)
        elif isinstance(record, Metadata):
            writer.add_metadata(record.name, record.metadata)
    return messages


@contextmanager
def _new_file(path: Path) -> Iterator[tuple[Path, PatientFile]]:
    """A new file, in the place of what an interrupted recovery may have left."""
    path.unlink(missing_ok=True)
    file = PatientFile(path)
    try:
        yield path, file
    finally:
        file.close()
        with suppress(OSError):
            path.unlink(missing_ok=True)
