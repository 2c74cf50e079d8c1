"""`tentacled man --write DIR`: the manual pages, made from the command line itself."""

import argparse
from pathlib import Path

from daemon.commands.outcome.failures import UsageError
from daemon.commands.outcome.result import Result
from daemon.commands.shell.roff import manual_pages
from daemon.files import make_folder


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "page", nargs="?", metavar="PAGE", help="print this one, such as tentacled-run"
    )
    parser.add_argument(
        "--write", type=Path, metavar="DIR", help="all of them into a folder of this one: man1"
    )
    parser.epilog = (
        "They are read by `man -l FILE`, and found by `man tentacled` where DIR is one of "
        "$MANPATH, such as ~/.local/share/man."
    )


def run(arguments: argparse.Namespace) -> Result:
    pages = manual_pages()
    if arguments.write is None:
        name = arguments.page or "tentacled"
        if f"{name}.1" not in pages:
            raise UsageError(f"there is no page {name}: there are {', '.join(sorted(pages))}")
        return Result({"page": name, "roff": pages[f"{name}.1"]}, pages[f"{name}.1"].rstrip())
    folder = arguments.write / "man1"
    make_folder(folder)
    for name, text in pages.items():
        (folder / name).write_text(text, encoding="utf-8")
    written = [folder / name for name in pages]
    return Result({"written": written}, "\n".join(map(str, written)))
