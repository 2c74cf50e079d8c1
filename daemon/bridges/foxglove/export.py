"""A recording as a file that Foxglove and Lichtblick draw: telemetry, and a scene made of it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import foxglove
import msgspec

from daemon.bridges.foxglove.scene import FoxgloveScene
from daemon.messages import SurroundingsChanged
from daemon.recording.format.channels import MESSAGES
from daemon.recording.recorded_surroundings import (
    RecordedSurroundings,
    surroundings_at_first,
    surroundings_told,
)
from daemon.recording.run_parts import RunParts
from daemon.recording.run_reader import UnreadableRunError

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
    out.parent.mkdir(parents=True, exist_ok=True)
    partly = out.with_name(f".{out.name}.part")
    partly.unlink(missing_ok=True)
    try:
        with foxglove.open_mcap(partly, context=scene.context):
            exported = _carry_over(parts, scene, folder)
        if not exported.messages:
            raise UnreadableRunError(f"{run}: there is no message in it")
        partly.replace(out)
    finally:
        partly.unlink(missing_ok=True)
    return exported


def _carry_over(parts: RunParts, scene: FoxgloveScene, folder: Path) -> Exported:
    """Raises UnreadableRunError, OSError."""
    count = unreadable = 0
    around = surroundings_at_first(folder)
    _surround(scene, folder, around)
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
        if isinstance(told, SurroundingsChanged):
            before, around = around, surroundings_told(folder, told)
            if (around.file, around.regions) == (before.file, before.regions):
                continue  # it tells of them as it begins, too
            _surround(scene, folder, around)
            scene.show_surroundings(message.wall_ns)
    return Exported(count, unreadable)


def _surround(scene: FoxgloveScene, folder: Path, around: RecordedSurroundings) -> None:
    """Raises OSError."""
    mesh = (folder / around.file).read_bytes() if around.file else b""
    scene.set_surroundings(mesh, around.regions)
