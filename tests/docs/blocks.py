"""Code blocks of README and of the pages in `docs/`, and what a test may do with each.

The first line of a `sh` block says so where it is a comment of one of these beginnings, so that a
reader sees it too:

- `# on a rig`, `# as root`, `# from a checkout`: not run, only understood;
- `# in terminals of their own`: each line is started, and runs until the page has ended;
- `# takes minutes`: run by `make experiments` alone (`python -m tests.docs PAGE`);
- `# takes hours`: not run. What is typed to try it, on the same page, is smaller and is run.

Every other block is run to its end by `make hil`, in its order, in one folder for each page.
"""

import re
import shlex
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).parents[2]
MARKS: Final = {
    "# on a rig": "not run",
    "# as root": "not run",
    "# from a checkout": "not run",
    "# in terminals of their own": "background",
    "# takes minutes": "long",
    "# takes hours": "not run",
}
_OURS: Final = ("tentacled ", "make ")


class Block(NamedTuple):
    page: str
    """Its file, relative to the checkout."""
    line: int
    """Of its first line, from 1."""
    language: str
    text: str
    """Without the indentation of what it stands in."""

    @property
    def mark(self) -> str:
        """What its first line says of it: `run` where it says nothing."""
        first = self.text.partition("\n")[0]
        found = [mark for begin, mark in MARKS.items() if first.startswith(begin)]
        return found[0] if found else "run"

    @property
    def commands(self) -> list[str]:
        """Each of our commands in it, whole and without its comment."""
        lines = [
            re.sub(r" +#.*$", "", line.removeprefix("$ ").strip())
            for line in self.text.replace("\\\n", " ").splitlines()
        ]
        parts = [part.strip() for line in lines for part in line.split(";")]
        return [part for part in parts if part.startswith(_OURS)]


def pages() -> list[str]:
    """README and every page of `docs/`, relative to the checkout."""
    found = (path.relative_to(ROOT).as_posix() for path in (ROOT / "docs").rglob("*.md"))
    return ["README.md", *sorted(found)]


def text_of(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


def blocks_of(page: str, *languages: str) -> list[Block]:
    """The blocks of a page, in their order: all of them, or those in some languages."""
    found = _blocks(page, text_of(page))
    return [block for block in found if not languages or block.language in languages]


def _blocks(page: str, text: str) -> Iterator[Block]:
    opened: tuple[int, str] | None = None
    lines: list[str] = []
    for number, line in enumerate(text.splitlines(), start=1):
        bare = line.strip()
        if not bare.startswith("```"):
            lines.append(line)
        elif opened is None:
            opened, lines = (number + 1, bare.removeprefix("```").partition(" ")[0]), []
        else:
            yield Block(page, *opened, textwrap.dedent("\n".join([*lines, ""])))
            opened = None


def prose_of(page: str) -> str:
    """A page without its blocks, on one line."""
    return " ".join(re.sub(r"(?ms)^ *```.*?^ *```$", "", text_of(page)).split())


def commands_of(page: str) -> list[str]:
    """What it tells people to type: from its blocks, and from its text where it has words."""
    found = [line for block in blocks_of(page, "sh", "") for line in block.commands]
    found += re.findall(r"`(tentacled [a-z]+ [^`]+)`", prose_of(page))
    return list(dict.fromkeys(found))


def words_of(command: str) -> list[str]:
    """A command's arguments, without the program."""
    return shlex.split(command)[1:]
