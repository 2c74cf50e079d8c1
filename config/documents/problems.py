"""What is wrong with a configuration file, and where: one line per problem, all of them at once."""

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import islice
from pathlib import Path
from typing import Final

Key = str | int

_LIKENESS: Final = 0.6
"""Of two words, as difflib measures it, from which one may have been meant by the other."""
_FILES_LOOKED_AT: Final = 10_000
_SHIPPED: Final = ("robots", "experiments", "scenarios", "studies")
"""Folders beside this file whose files may be meant wherever somebody stands."""


@dataclass(frozen=True, order=True)
class Problem:
    """One thing wrong with a file. `line` and `column` count from 1; 0: with the file itself."""

    file: str
    line: int
    column: int
    key_path: str
    message: str

    def __str__(self) -> str:
        where = f"{self.file}:{self.line}:{self.column}: " if self.line else f"{self.file}: "
        return where + (f"{self.key_path}: " if self.key_path else "") + self.message


class ConfigError(ValueError):
    """A configuration file that cannot be used, with every problem found in it."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems: Sequence[Problem] = tuple(sorted(set(problems)))
        super().__init__(self.problems)  # as it is made again on the other side of a process

    def __str__(self) -> str:
        return "\n".join(map(str, self.problems))


def key_path(location: Iterable[Key]) -> str:
    """`("axes", 0, "lead_mm")` as an operator would write it: `axes[0].lead_mm`."""
    path = ""
    for part in location:
        path += f"[{part}]" if isinstance(part, int) else f".{part}" if path else part
    return path


def in_words(error: Exception, file: Path | str = "") -> str:
    """What an error says; where the system says it, which file it is about and why.

    file: that is meant where the error names none.
    """
    if not isinstance(error, OSError) or error.strerror is None:
        return str(error)
    named = error.filename if isinstance(error.filename, str | Path) else file
    return f"{named}: {error.strerror}" if str(named) else error.strerror


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """` (did you mean 'x'?)` for the nearest known word, or an empty string."""
    return _meant(_nearest(word, known))


def did_you_mean_file(path: Path) -> str:
    """The same for a file that is not there: one of its folder, or else a shipped one."""
    beside = _nearest(path.name, _names(path.parent))
    if beside:
        return _meant(str(path.parent / beside))
    here = Path(__file__).parents[1]
    shipped = {file.stem: file for kind in _SHIPPED for file in (here / kind).glob("*.yaml")}
    stem = _nearest(path.stem, shipped)
    return _meant(_from_here(shipped[stem]) if stem else "")


def _meant(word: str) -> str:
    return f" (did you mean '{word}'?)" if word else ""


def _nearest(word: str, known: Iterable[str]) -> str:
    near = get_close_matches(word, list(known), n=1, cutoff=_LIKENESS)
    return near[0] if near else ""


def _names(folder: Path) -> list[str]:
    try:
        with os.scandir(folder) as entries:
            return [entry.name for entry in islice(entries, _FILES_LOOKED_AT) if entry.is_file()]
    except OSError:
        return []


def _from_here(path: Path) -> str:
    """Shorter where it is below the working directory."""
    try:
        return str(path.relative_to(Path.cwd()))
    except (ValueError, OSError):
        return str(path)
