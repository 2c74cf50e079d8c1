"""Unfinished recordings, damaged at random places and cut at random lengths, and their recovery.

`python -m tests.experiments.damaged_recordings` takes a minute. Prints one line per recording:
what was done to it, what was saved, what was lost, and whether the file is kept. Ends with exit
code 1 where a message is saved that was never written, where one is lost that no damage touched,
or where a file is gone of which not everything was saved.
"""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from daemon.recording.format.channels import (
    RAW_CAN,
    RAW_TRACKER,
    TOPICS,
    message_time_ns,
    telemetry_payload,
    tracker_payload,
)
from daemon.recording.recovery import recover
from daemon.recording.run_folder import unfinished
from daemon.recording.run_reader import RunMessage, RunReader
from daemon.recording.run_writer import RunWriter
from tests.daemon.recording.synthetic_run import BOOT_NS, HEADER, WALL_NS, messages

_FLUSH_EVERY_NS: Final = 150_000_000
"""As the recorder's process does."""
_LONGEST_DAMAGE: Final = 4096
"""Bytes: a page of a file."""


class Recording(NamedTuple):
    """An unfinished recording."""

    content: bytes
    messages: list[RunMessage]
    chunk_messages: int
    """In the fullest chunk."""


class Outcome(NamedTuple):
    """What became of a damaged one."""

    damage: str
    saved: int
    lost: int
    known_lost: int
    unreadable_bytes: int
    invented: int
    """Saved, and never written."""
    kept: bool
    """Whether the damaged file is still there, byte for byte."""
    complete: bool
    """What recovery says."""

    def sound(self, most_lost: int) -> bool:
        """Whether nothing was invented, and nothing lost in silence or without need."""
        honest = self.complete == (self.lost == 0 and not self.kept)
        return (
            not self.invented and self.lost <= most_lost and (self.kept or not self.lost) and honest
        )


def recorded(folder: Path, cycle_s: float) -> Recording:
    """A made-up run as a recorder that was killed leaves it."""
    writer = RunWriter(folder / "whole.mcap", HEADER, WALL_NS - BOOT_NS)
    random, flushed_ns, count, fullest = np.random.default_rng(7), BOOT_NS, 0, 0
    for message in messages(cycles=1, cycle_s=cycle_s):
        t_ns = message_time_ns(message)
        writer.write(TOPICS[type(message)], t_ns, telemetry_payload(message))
        writer.write(RAW_TRACKER, t_ns, tracker_payload("from_device", random.bytes(60)))
        writer.write(RAW_CAN + "can0", t_ns, random.bytes(24 * 5))
        count += 4
        if t_ns - flushed_ns >= _FLUSH_EVERY_NS:
            writer.flush()
            fullest, flushed_ns, count = max(fullest, count), t_ns, 0
    writer.flush()
    content = unfinished(writer.path).read_bytes()
    writer.finish()
    return Recording(content, list(RunReader(writer.path).messages()), max(fullest, count))


def damaged(content: bytes, random: np.random.Generator, cut: bool) -> tuple[bytes, str, int, int]:
    """Damaged bytes, in words, and the first and the end of what is not as it was."""
    place = int(random.integers(len(content)))
    if cut:
        return content[:place], f"cut to {place} bytes", place, len(content)
    length = min(2 ** int(random.integers(0, 13)), _LONGEST_DAMAGE, len(content) - place)
    fill = bytes(length) if random.random() < 0.25 else random.bytes(length)
    changed = content[:place] + fill + content[place + length :]
    kind = "zeros" if not any(fill) else "noise"
    return changed, f"{length} bytes of {kind} at {place}", place, place + length


def outcome(recording: Recording, content: bytes, damage: str, folder: Path) -> Outcome:
    """Recover a file with this content, and look at what is there afterwards."""
    path = folder / "run.mcap"
    unfinished(path).write_bytes(content)
    told = recover(path)
    assert told is not None
    saved = list(RunReader(path).messages()) if path.exists() else []
    written = set(recording.messages)
    kept = told.kept is not None and told.kept.read_bytes() == content
    return Outcome(
        damage,
        len(saved),
        len(written - set(saved)),
        told.lost_messages,
        told.lost_bytes,
        len(set(saved) - written) + len(saved) - len(set(saved)),
        kept,
        told.complete,
    )


def try_all(count: int, seed: int, cycle_s: float) -> list[tuple[Outcome, bool]]:
    """Half of them damaged, half of them cut; with each, whether its outcome is sound."""
    random = np.random.default_rng(seed)
    found = []
    with tempfile.TemporaryDirectory() as name:
        recording = recorded(Path(name), cycle_s)
        for number in range(count):
            cut = number % 2 == 1
            content, damage, first, end = damaged(recording.content, random, cut)
            folder = Path(name) / str(number)
            folder.mkdir()
            one = outcome(recording, content, damage, folder)
            found.append((one, one.sound(_most_lost(recording, first, end, cut))))
    return found


def _most_lost(recording: Recording, first: int, end: int, cut: bool) -> int:
    """Messages in the chunks that the damage can have touched, by the file's mean density.

    A cut loses what is behind it; damage loses its own chunk, and one more where it goes over a
    border.
    """
    density = len(recording.messages) / len(recording.content)
    behind = (end - first) * density if cut else 0.0
    return int(1.1 * behind) + (2 + (end - first) // 2048 * (not cut)) * recording.chunk_messages


def table(found: Sequence[tuple[Outcome, bool]]) -> str:
    """For people."""
    head = f"{'damage':34}{'saved':>7}{'lost':>6}{'known':>7}{'unread B':>10}  source"
    lines = [head]
    for one, sound in found:
        source = "kept" if one.kept else "deleted, all saved" if one.complete else "GONE"
        mark = "" if sound else "  NOT SOUND"
        lines.append(
            f"{one.damage:34}{one.saved:7}{one.lost:6}{one.known_lost:7}"
            f"{one.unreadable_bytes:10}  {source}{mark}"
        )
    outcomes = [one for one, _ in found]
    lines.append(
        f"{len(found)} recordings: {sum(one.saved for one in outcomes)} messages saved, "
        f"{sum(one.lost for one in outcomes)} lost, {sum(one.invented for one in outcomes)} "
        f"invented; {sum(one.kept for one in outcomes)} sources kept, "
        f"{sum(one.complete for one in outcomes)} saved whole, "
        f"{sum(not sound for _, sound in found)} not sound"
    )
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cycle-s", type=float, default=20.0, help="length of the recording")
    arguments = parser.parse_args()
    found = try_all(arguments.count, arguments.seed, arguments.cycle_s)
    print(table(found))
    return 0 if all(sound for _, sound in found) else 1


if __name__ == "__main__":
    sys.exit(main())
