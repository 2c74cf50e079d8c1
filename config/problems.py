"""What is wrong with a configuration file, and where: one line per problem, all of them at once."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from difflib import get_close_matches

Key = str | int


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
        super().__init__("\n".join(map(str, self.problems)))


def key_path(location: Iterable[Key]) -> str:
    """`("axes", 0, "lead_mm")` as an operator would write it: `axes[0].lead_mm`."""
    path = ""
    for part in location:
        path += f"[{part}]" if isinstance(part, int) else f".{part}" if path else part
    return path


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """` (did you mean 'x'?)` for the nearest known word, or an empty string."""
    near = get_close_matches(word, list(known), n=1, cutoff=0.6)
    return f" (did you mean '{near[0]}'?)" if near else ""
