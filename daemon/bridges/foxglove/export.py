"""A recording as a file that Foxglove and Lichtblick draw: telemetry, and a scene made of it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import foxglove
import msgspec

from daemon.bridges.foxglove.scene import FoxgloveScene
from daemon.messages import SurroundingsChanged
from daemon.recording.format.channels import MESSAGES
from daemon.recording.run_folder import SURROUNDINGS_FILE
from daemon.recording.run_parts import RunParts

_DECODERS: Final = {topic: msgspec.json.Decoder(kind) for topic, kind in MESSAGES.items()}


@dataclass(frozen=True)
class Exported:
    """What has become of a recording."""

    messages: int
    """Of its telemetry, that were taken over."""
    unreadable: int
    """That could not be drawn: a message of another version, or a number that is none."""


def export_foxglove(run: Path, out: Path) -> Exported:
    """run: its folder, or one recording. Whatever was `out` before is replaced, whole or not at
    all. Raises UnreadableRunError, OSError."""
    parts, scene = RunParts(run), FoxgloveScene()
    folder = run if run.is_dir() else run.parent
    scene.set_surroundings(_mesh(folder, SURROUNDINGS_FILE))
    out.parent.mkdir(parents=True, exist_ok=True)
    partly = out.with_name(f".{out.name}.part")
    partly.unlink(missing_ok=True)
    try:
        with foxglove.open_mcap(partly, context=scene.context):
            exported = _carry_over(parts, scene, folder)
        partly.replace(out)
    finally:
        partly.unlink(missing_ok=True)
    return exported


def _carry_over(parts: RunParts, scene: FoxgloveScene, folder: Path) -> Exported:
    """Raises UnreadableRunError, OSError."""
    count = unreadable = 0
    around = SURROUNDINGS_FILE
    for message in parts.messages(MESSAGES):
        if not count:
            scene.show_surroundings(message.wall_ns)
        count += 1
        scene.copy(message.topic, message.data, message.wall_ns)
        try:
            told = _DECODERS[message.topic].decode(message.data)
        except msgspec.MsgspecError:
            unreadable += 1
            continue
        scene.draw(told, message.wall_ns)
        if isinstance(told, SurroundingsChanged) and told.file != around:
            around = told.file
            scene.set_surroundings(_mesh(folder, around))
            scene.show_surroundings(message.wall_ns)
    return Exported(count, unreadable)


def _mesh(folder: Path, name: str) -> bytes:
    """A file of the run's own; empty where there is none. Raises OSError."""
    path = folder / Path(name).name
    return path.read_bytes() if path.is_file() else b""
