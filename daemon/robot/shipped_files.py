"""Files that are shipped with us, wherever a command asks for one: `builtin:` and its name."""

import argparse
from collections.abc import Callable, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Final, Literal

from config.documents.problems import did_you_mean

Folder = Literal["robots", "experiments", "scenarios", "studies"]
FOLDERS: Final[tuple[Folder, ...]] = ("robots", "experiments", "scenarios", "studies")
_BUILTIN: Final = "builtin:"


def shipped_files(folder: Folder) -> dict[str, Path]:
    """By the names under which a command line has them, in their order."""
    place = Path(str(files("config") / folder))
    return {f"{_BUILTIN}{path.stem}": path for path in sorted(place.glob("*.yaml"))}


def file_argument(*folders: Folder) -> Callable[[str], Path]:
    """The `type` of an argument that names a file, which may be a shipped one of these folders."""

    def path(text: str) -> Path:
        if not text.startswith(_BUILTIN):
            return Path(text)
        known = {name: file for folder in folders for name, file in shipped_files(folder).items()}
        if text not in known:
            raise argparse.ArgumentTypeError(
                f"there is no {text}{did_you_mean(text, known)}; --list shows all"
            )
        return known[text]

    return path


class ListShipped(argparse.Action):
    """`--list`: shows the shipped files that the command's argument may name, and ends."""

    def __init__(
        self, option_strings: Sequence[str], dest: str, const: Sequence[Folder], **more: str
    ) -> None:
        """const: the folders."""
        super().__init__(option_strings, dest, nargs=0, help=more.get("help"))
        self._folders = const

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        """Print their names, one to a line."""
        for folder in self._folders:
            for name in shipped_files(folder):
                print(name)
        parser.exit()


def add_list_option(parser: argparse.ArgumentParser, *folders: Folder) -> None:
    """Declare `--list`."""
    text = "the shipped files that may be named, and nothing else"
    parser.add_argument("--list", action=ListShipped, const=folders, help=text)
