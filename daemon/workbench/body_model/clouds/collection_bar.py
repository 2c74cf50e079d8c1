"""How far a collection is, on a terminal; silent elsewhere."""

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)


class CollectionBar:
    """A bar for each thing that begins. On stderr: what is printed goes elsewhere."""

    def __init__(self, console: Console | None = None) -> None:
        out = console or Console(stderr=True)
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
            console=out,
            disable=not out.is_terminal,
        )
        self._task = self._progress.add_task("", visible=False)

    def __enter__(self) -> "CollectionBar":
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def begin(self, what: str, total: int, done: int) -> None:
        """A new bar."""
        self._task = self._progress.add_task(what, total=total, completed=done)

    def advance(self, by: int) -> None:
        """So many more."""
        self._progress.advance(self._task, by)
