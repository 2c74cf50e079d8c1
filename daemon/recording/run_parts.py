"""All recordings of one run, in order: where a recorder was lost, the next one began another file.

Each is read as `run_reader` reads one. A part that was never finished, or is damaged, hides none of
the others.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Final

from daemon.recording.format.channels import CONTROL_TOPICS
from daemon.recording.run_folder import (
    RUN_FILE,
    RUN_FILES,
    finished,
    segment_file,
    unfinished,
)
from daemon.recording.run_reader import (
    Fingerprint,
    MissingRunError,
    RunMessage,
    RunReader,
    UnreadableRunError,
)
from daemon.recording.run_writer import ENDING

_NUMBER: Final = re.compile(r"run-(\d+)\.mcap")


def segment_number(path: Path) -> int | None:
    """Which of a run's recordings this is, by its name, finished or not. None: it is none."""
    name = finished(path).name
    if name == RUN_FILE:
        return 1
    told = _NUMBER.fullmatch(name)
    number = None if told is None else int(told[1])
    return number if number is not None and segment_file(number) == name else None


def run_files(path: Path) -> list[Path]:
    """The recordings that are meant by a run's folder, in order, or by a file: that one alone.

    Raises UnreadableRunError where there is none.
    """
    if not path.is_dir():
        if not path.exists():
            raise MissingRunError(f"{path}: there is no such file or folder")
        return [path]
    found: dict[int, Path] = {}
    for pattern in (unfinished(Path(RUN_FILES)).name, RUN_FILES):
        for candidate in path.glob(pattern):
            number = segment_number(candidate)
            if number is not None:
                found[number] = candidate  # where both are there, the finished one
    if not found:
        raise UnreadableRunError(f"{path}: there is no {RUN_FILE} in this folder")
    return [found[number] for number in sorted(found)]


@dataclass
class Span:
    """What one of the recordings covers, by the dates of its messages."""

    path: Path
    first_ns: int
    last_ns: int


class RunParts:
    """One pass over all recordings of a run.

    Where the last one has grown since, or another one was begun, another pass goes on from there.
    """

    def __init__(self, path: Path) -> None:
        """path: as for `run_files`; there may not be anything yet."""
        self.path = path
        self.readers: dict[int, RunReader] = {}
        """By number of the recording, in order."""
        self.spans: dict[int, Span] = {}
        """Of those with a message that was read."""
        self.problems: dict[int, str] = {}
        """Of those that are no recordings, beside others that are."""

    def messages(self, topics: Iterable[str] | None = None) -> Iterator[RunMessage]:
        """The messages of some topics, or of all, in the order of writing. topics: the same ones in
        each pass. Raises UnreadableRunError, OSError.
        """
        wanted = None if topics is None else frozenset(topics)
        files = run_files(self.path)
        for file in files:
            number = segment_number(file) or 1
            reader = self.readers.setdefault(number, RunReader(file))
            reader.path = file
            try:
                for message in reader.messages(wanted):
                    self._cover(number, file, message.wall_ns)
                    yield message
            except UnreadableRunError as error:
                self.problems[number] = str(error)
        if len(self.problems) == len(files):
            raise UnreadableRunError(min(self.problems.items())[1])

    def _cover(self, number: int, file: Path, wall_ns: int) -> None:
        span = self.spans.get(number)
        if span is None:
            self.spans[number] = Span(file, wall_ns, wall_ns)
        elif wall_ns > span.last_ns:
            span.last_ns = wall_ns
        elif wall_ns < span.first_ns:
            span.first_ns = wall_ns

    @property
    def whole(self) -> bool:
        """Whether every part of what was read has come to its proper end."""
        return all(one.whole and ENDING in one.metadata for one in self.readers.values())

    @property
    def unreadable(self) -> int:
        """Messages or stretches that could not be read."""
        readers = self.readers.values()
        return len(self.problems) + sum(r.orphans + max(r.lost, len(r.damage)) for r in readers)

    @property
    def dropped(self) -> int:
        """Messages that the recorders say they have left out."""
        endings = [one.metadata.get(ENDING, {}) for one in self.readers.values()]
        return sum(int(ending.get("dropped", "0")) for ending in endings)

    def metadata(self, name: str) -> dict[str, str]:
        """As the first part that has it says; empty where none has."""
        return next((m[name] for r in self.readers.values() if name in (m := r.metadata)), {})

    @property
    def gaps(self) -> list[tuple[Span, Span]]:
        """The parts before and behind each time that was not recorded."""
        spans = list(self.spans.values())
        return list(pairwise(spans))


def control_hash(path: Path, topics: Iterable[str] = CONTROL_TOPICS) -> str:
    """A fingerprint of what happened: topic, time and content of the control channels' messages.

    path: as for `run_files`. How messages were cut into chunks and files, and how channels are
    mixed, does not matter. Raises UnreadableRunError, OSError.
    """
    fingerprint = Fingerprint(topics)
    for message in RunParts(path).messages(fingerprint.topics):
        fingerprint.take(message)
    return fingerprint.hexdigest()
