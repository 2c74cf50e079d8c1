"""Lines for a terminal, each short enough for it, and a page of them that is not higher than it."""

import shutil
import sys
import textwrap
from collections.abc import Sequence
from typing import Final, Self

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.text import Text

DIM: Final = "dim"
BAD: Final = "bold red"
GOOD: Final = "green"

_PAGE_WIDTH: Final = 80
"""Where there is no terminal that has one."""
_NARROWEST: Final = 40
_PROMPT: Final = 1
"""Lines that are wanted below a page: the cursor's."""
_GAP: Final = 2
"""Between the columns of a table."""


class Size:
    """Of the page: columns, and lines; None: as many as there are.

    endless_rows: nobody looks at it through a window: texts are broken at `width` all the same, and
    rows of a table are as long as what is in them.
    """

    def __init__(
        self, width: int, height: int | None = None, *, endless_rows: bool = False
    ) -> None:
        self.width = max(width, _NARROWEST)
        self.height = height
        self.row_width = sys.maxsize if endless_rows else self.width
        """Of what cannot be broken between words, and is cut."""

    @classmethod
    def of_terminal(cls) -> "Size":
        """Of the one that stdout is, or of a page without an end."""
        found = shutil.get_terminal_size((0, 0))  # which is what COLUMNS says, where it is set
        columns, known = found.columns or _PAGE_WIDTH, bool(found.columns)
        if not sys.stdout.isatty():
            return cls(columns, endless_rows=not known)
        return cls(columns, found.lines - _PROMPT if found.lines else None)


def print_page(shown: RenderableType, console: Console | None = None) -> None:
    """One page, whose lines are as long as they were made."""
    (console or Console()).print(shown, soft_wrap=True)


class LivePage:
    """A page that is shown again and again: in its place on a terminal, else one by one."""

    def __init__(self, *, last_alone: bool = False) -> None:
        """last_alone: where there is no terminal, only the last one is printed, in the end."""
        self._console = Console()
        self._live = Live(console=self._console, auto_refresh=False)
        self._last_alone = last_alone
        self._last: RenderableType | None = None

    @property
    def in_place(self) -> bool:
        """Whether there is a terminal."""
        return self._console.is_terminal

    def __enter__(self) -> Self:
        if self.in_place:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()
        if self._last is not None:
            print_page(self._last, self._console)

    def show(self, shown: RenderableType) -> None:
        if self.in_place:
            self._live.update(shown, refresh=True)
        elif self._last_alone:
            self._last = shown
        else:
            print_page(shown, self._console)


def page(size: Size, kinds: Sequence[list[Text]]) -> Group:
    """The first of these that is not too high; of the last one as much as there is room for.

    kinds: the same, told with less and less detail.
    """
    lines: list[Text] = []
    for lines in kinds:
        if size.height is None or len(lines) <= size.height:
            return Group(*lines)
    assert size.height is not None
    kept = max(size.height - 1, 1)
    more = Text(f"… {len(lines) - kept} lines more than this window has", style=DIM)
    return Group(*lines[:kept], more)


def paragraph(size: Size, *spans: tuple[str, str], indent: int = 4, first: int = 0) -> list[Text]:
    """Styled spans as one text, broken between words; all lines but the first are indented.

    spans: text and style. first: the first line's own indentation.
    """
    plain = "".join(text for text, _ in spans)
    styles = [style for text, style in spans for _ in text]
    lines: list[Text] = []
    at = 0
    broken = textwrap.wrap(
        plain,
        size.width,
        initial_indent=" " * first,
        subsequent_indent=" " * indent,
        break_on_hyphens=False,
    )
    for line in broken:
        lead = indent if lines else first
        made = Text(" " * lead)
        while lines and plain[at].isspace():  # which is left out at a break
            at += 1
        for letter in line[lead:]:
            made.append(letter, style=styles[at])
            at += 1
        lines.append(made)
    return lines


def cut(text: str, width: int, *, tail: bool = False) -> str:
    """No longer than `width`. tail: the end is what matters, as of a path."""
    if len(text) <= width:
        return text
    return f"…{text[len(text) - width + 1 :]}" if tail else f"{text[: width - 1]}…"


def table(
    head: Sequence[str],
    rows: Sequence[Sequence[tuple[str, str]]],
    right: Sequence[int] = (),
    *,
    width: int,
) -> list[Text]:
    """Rows of (text, style) in columns as wide as what is in them; the first gives way.

    right: which columns are aligned to the right.
    """
    widths = [
        max([len(name), *(len(row[column][0]) for row in rows)]) for column, name in enumerate(head)
    ]
    over = sum(widths) + _GAP * (len(widths) - 1) - width
    if over > 0:
        widths[0] = max(widths[0] - over, len(head[0]), 4)
    lines = []
    for row in ([(name, DIM) for name in head], *rows):
        line = Text()
        for column, (text, style) in enumerate(row):
            shown = cut(text, widths[column])
            filled = shown.rjust(widths[column]) if column in right else shown.ljust(widths[column])
            line.append(" " * _GAP if column else "")
            line.append(filled, style=style)
        line.rstrip()
        line.truncate(width, overflow="ellipsis")
        lines.append(line)
    return lines


def grid(cells: Sequence[str], width: int) -> list[Text]:
    """Short texts side by side, as many in a line as there is room for."""
    if not cells:
        return []
    widest = max(map(len, cells))
    in_line = max((width + _GAP) // (widest + _GAP), 1)
    rows = [cells[start : start + in_line] for start in range(0, len(cells), in_line)]
    gap = " " * _GAP
    return [Text(cut(gap.join(cell.ljust(widest) for cell in row).rstrip(), width)) for row in rows]
