"""Writes a recording: an MCAP file whose finished part is readable whatever happens afterwards."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from daemon.messages import Tip
from daemon.recording.format.channels import TIP_POSE, TOPICS, channel_format, tip_pose
from daemon.recording.format.mcap_file import McapChannel, McapFile, PatientFile, sync_folder
from daemon.recording.run_folder import unfinished

LIBRARY: Final = "tentacled"
HEADER: Final = "run"
"""Name of the metadata record that says what was recorded."""
ENDING: Final = "ending"
"""Name of the metadata record that only a recording that was ended properly has."""

DESCRIPTION: Final = "description"
"""Key of a channel's metadata: how its messages are to be read, where no schema says so."""
_HEADER_IN_CHANNEL: Final = "run."
_PENDING_AT_MOST: Final = 16 << 20
_TIP: Final = TOPICS[Tip]


class RunWriter:
    """One recording. A full disk raises nothing here: see `failed`.

    The same messages give the same bytes: there is no date, version or random number in the file
    but those handed in.
    """

    def __init__(self, path: Path, header: Mapping[str, str], wall_offset_ns: int) -> None:
        """path: of the finished file; until then it has `.part` added.

        wall_offset_ns: to be added to a monotonic time to get the date. Raises OSError.
        """
        self.path = path
        self.dropped = 0
        """Messages that were not kept because the disk did not take them."""
        self._wall_offset_ns = wall_offset_ns
        self._channels: dict[str, McapChannel] = {}
        self._file = PatientFile(unfinished(path))
        self._mcap = McapFile(self._file, LIBRARY, repeat=True)
        self._header = {**header, "wall_offset_ns": str(wall_offset_ns)}
        self._mcap.add_metadata(HEADER, self._header)

    @property
    def failed(self) -> str:
        """What keeps the file from being written; empty: all is well."""
        return self._file.failed

    @property
    def deleted(self) -> bool:
        """Whether somebody has removed the file meanwhile, as of the last `sync`."""
        return self._file.deleted

    @property
    def bytes_written(self) -> int:
        """Bytes that are in the file."""
        return self._file.written

    def write(self, topic: str, t_ns: int, payload: bytes) -> None:
        """Add a message. t_ns: monotonic. Raises ValueError where the topic is unknown."""
        file = self._file
        if file.failed and file.pending > _PENDING_AT_MOST:  # while it takes all, nothing waits
            self.dropped += 1
            return
        wall_ns = max(0, t_ns + self._wall_offset_ns)
        channel = self._channels.get(topic) or self._register(topic)
        channel.add(wall_ns, payload)
        if topic == _TIP and (pose := tip_pose(payload, wall_ns)) is not None:
            poses = self._channels.get(TIP_POSE) or self._register(TIP_POSE)
            poses.add(wall_ns, pose)

    def flush(self) -> None:
        """End the chunk: what was written so far can be read from now on, whatever happens."""
        self._mcap.flush()

    def sync(self) -> None:
        """Flush, and wait until the disk has it."""
        self.flush()
        self._file.sync()

    def finish(self, dropped_before: int = 0) -> bool:
        """Write the index and give the file its name. False: it did not all fit, and stays `.part`.

        dropped_before: messages that were lost on the way to here; the file tells how many.
        """
        self._mcap.flush()
        self._mcap.add_metadata(ENDING, {"dropped": str(dropped_before + self.dropped)})
        self._mcap.finish()
        self._file.flush()
        self._file.sync()
        complete = not self._file.failed
        if complete:
            unfinished(self.path).rename(self.path)
            sync_folder(self.path.parent)
        self._file.close()
        return complete

    def _register(self, topic: str) -> McapChannel:
        kind = channel_format(topic)
        schema = 0
        if kind.schema_name:
            schema = self._mcap.register_schema(kind.schema_name, "jsonschema", kind.schema)
        # Metadata records have no checksum, and this one is there once: chunks repeat it.
        about = {_HEADER_IN_CHANNEL + name: value for name, value in self._header.items()}
        if kind.description:
            about[DESCRIPTION] = kind.description
        channel = self._mcap.register_channel(topic, kind.message_encoding, schema, about)
        self._channels[topic] = channel
        return channel


def header_in_channel(metadata: Mapping[str, str]) -> dict[str, str]:
    """The recording's header as a channel's metadata repeat it."""
    return {
        key.removeprefix(_HEADER_IN_CHANNEL): value
        for key, value in metadata.items()
        if key.startswith(_HEADER_IN_CHANNEL)
    }
