"""Recordings that a crash has left unfinished are made whole again.

What is whole is copied into a new file, also from behind damage. The unfinished file is deleted
only when everything in it is in the new one; otherwise it is kept beside it.
"""

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import IO, Final

from mcap.records import Channel, Message, Metadata, Schema

from daemon.recording.format.channels import channel_format
from daemon.recording.format.mcap_file import McapChannel, McapFile, PatientFile, sync_folder
from daemon.recording.run_folder import RUN_FILE, RUN_FILES, finished, unfinished
from daemon.recording.run_reader import RunReader, UnreadableRunError
from daemon.recording.run_writer import HEADER, LIBRARY, header_in_channel

RECOVERY: Final = "recovery"
"""Name of the metadata record that a recording has of which something was lost."""
_DAMAGED: Final = ".damaged"
"""What is added to the name of a recording that was not saved whole."""
_PLACES_TOLD: Final = 3


@dataclass(frozen=True)
class Recovered:
    """What became of one unfinished recording."""

    path: Path
    """Of the file that was to be made whole."""
    messages: int = 0
    """That were saved."""
    lost_messages: int = 0
    """That are known to be missing, by the count of each channel."""
    damage: tuple[tuple[int, int], ...] = ()
    """First byte and end of each stretch that nothing could be read from."""
    kept: Path | None = None
    """Where the unfinished file is now; None: everything in it was saved."""
    problem: str = ""
    """Why it could not be made whole; empty: what could be read was saved."""

    @property
    def complete(self) -> bool:
        """Whether everything was saved."""
        return not self.problem and self.kept is None

    @property
    def lost_bytes(self) -> int:
        """That nothing could be read from."""
        return sum(end - start for start, end in self.damage)

    def __str__(self) -> str:
        where = self.path.parent if self.path == self.path.parent / RUN_FILE else self.path
        if self.problem:
            return f"{where}: {self.problem}"
        saved = f"{where}: {self.messages} messages saved"
        if self.kept is None:
            return saved
        places = [f"{start} to {end}" for start, end in self.damage[:_PLACES_TOLD]]
        more = len(self.damage) - len(places)
        if more > 0:
            places.append(f"{more} more")
        unread = f"; {self.lost_bytes} bytes cannot be read ({', '.join(places)})" if places else ""
        lost = f", {self.lost_messages} known to be lost" if self.lost_messages else ""
        return f"{saved}{lost}{unread}; the damaged file is kept as {self.kept.name}"


def recover_unfinished(root: Path) -> list[Recovered]:
    """Make every unfinished recording under `root` whole, or those in it. Never raises.

    Recordings that are still being written are left alone.
    """
    name = unfinished(Path(RUN_FILES)).name
    found = sorted([*root.glob(name), *root.glob(f"*/{name}")])
    outcomes = (recover(finished(path)) for path in found)
    return [outcome for outcome in outcomes if outcome is not None]


def recover(path: Path) -> Recovered | None:
    """Make the recording whole that shall be at `path`. None: it is being written. Never raises."""
    part = unfinished(path)
    try:
        with part.open("r+b") as file:
            if not _abandoned(file):
                return None
            return _recover(part, path)
    except UnreadableRunError as error:
        return Recovered(path, problem=f"left as it is: {error}")
    except OSError as error:
        return Recovered(path, problem=f"cannot be recovered now: {error.strerror or error}")


def _abandoned(file: IO[bytes]) -> bool:
    """Whether nobody holds the writer's lock. Holds it from now on, against a second recovery."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _recover(part: Path, path: Path) -> Recovered:
    known = RunReader(part)
    found = sum(isinstance(record, Message) for record in known.records())
    size = part.stat().st_size
    damage = tuple(known.damage)
    if known.in_data and known.read_bytes < size:
        damage = (*damage, (known.read_bytes, size))
    if not found and damage:
        kept = _set_aside(part)
        return Recovered(
            path,
            damage=damage,
            kept=kept,
            problem=f"no message in it can be read; it is kept as {kept.name}",
        )
    # What was declared anywhere is known from the beginning in the second pass.
    reader = RunReader(part, schemas=dict(known.schemas), channels=dict(known.channels))
    messages = _rewrite(reader, path, known, damage)
    if reader.lost or damage or reader.orphans:
        kept = _set_aside(part)
        return Recovered(path, messages, reader.lost + reader.orphans, damage, kept)
    part.unlink()
    return Recovered(path, messages)


def _set_aside(part: Path) -> Path:
    """Where an unfinished file is kept, so that it is not taken for one again."""
    path = finished(part)
    for number in count(1):
        kept = path.with_name(path.name + _DAMAGED + ("" if number == 1 else f".{number}"))
        if not kept.exists():
            part.rename(kept)
            return kept
    raise AssertionError("there are more numbers than files")


def _rewrite(
    reader: RunReader, path: Path, known: RunReader, damage: tuple[tuple[int, int], ...]
) -> int:
    """Returns how many messages are in the new file, counted there. Raises OSError."""
    with _new_file(path.with_name(f".{path.name}.recovered")) as (beside, file):
        writer = McapFile(file, LIBRARY, repeat=True)
        header = known.metadata.get(HEADER) or _repeated_header(known)
        if header:
            writer.add_metadata(HEADER, header)
        messages = _copy(reader, writer)
        if damage or reader.lost or reader.orphans:
            about = {
                "lost_messages": str(reader.lost + reader.orphans),
                "lost_bytes": str(sum(end - start for start, end in damage)),
                "damage": " ".join(f"{start}-{end}" for start, end in damage),
            }
            writer.add_metadata(RECOVERY, about)
        writer.finish()
        file.flush()
        file.sync()
        if file.failed:
            raise OSError(0, file.failed)
        _check(beside, messages)
        beside.rename(path)
    sync_folder(path.parent)
    return messages


def _check(path: Path, messages: int) -> None:
    """That the file can be read to its end, before the one that it replaces is given up."""
    written = RunReader(path)
    count_there = sum(1 for _ in written.messages())
    if count_there != messages or not written.whole:
        raise OSError(0, f"{count_there} of {messages} messages came to the disk: try again")


def _repeated_header(reader: RunReader) -> dict[str, str]:
    """The recording's header, from any channel that repeats it."""
    headers = (header_in_channel(channel.metadata) for channel in reader.channels.values())
    return next(filter(None, headers), {})


def _copy(reader: RunReader, writer: McapFile) -> int:
    """All messages from one file to the other, and metadata. Returns the number of messages."""
    schemas, channels = {0: 0}, dict[int, McapChannel]()
    messages = 0
    for record in reader.records():
        if isinstance(record, Message):
            messages += 1
            channel = channels.get(record.channel_id)
            if channel is None:
                declared = reader.channels[record.channel_id]
                channel = channels[record.channel_id] = _declared(declared, reader, writer, schemas)
            channel.sequence = record.sequence  # where some are lost, the others keep theirs
            channel.add(record.log_time, record.data)
        elif isinstance(record, Metadata) and record.name != HEADER:
            writer.add_metadata(record.name, record.metadata)
    return messages


def _declared(
    channel: Channel, reader: RunReader, writer: McapFile, schemas: dict[int, int]
) -> McapChannel:
    """The channel in the new file. Its schema may be lost: those of this version are known."""
    number = channel.schema_id
    if number not in schemas:
        schema = reader.schemas.get(number) or _schema_of(channel)
        schemas[number] = (
            0
            if schema is None
            else writer.register_schema(schema.name, schema.encoding, schema.data)
        )
    return writer.register_channel(
        channel.topic, channel.message_encoding, schemas[number], channel.metadata
    )


def _schema_of(channel: Channel) -> Schema | None:
    try:
        known = channel_format(channel.topic)
    except ValueError:
        return None
    return Schema(
        id=channel.schema_id, data=known.schema, encoding="jsonschema", name=known.schema_name
    )


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
