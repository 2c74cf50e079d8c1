"""The command line as manual pages, in the language of man(7)."""

import argparse
import re
from collections.abc import Iterator
from typing import Final

from daemon.commands.outcome.exit_codes import MEANINGS
from daemon.commands.outcome.result import program_version
from daemon.commands.terminal.command_line import COMMANDS, command_parser, leaves

_WIDE: Final = 10_000
"""Columns: usage is broken by whoever shows the page."""


def manual_pages() -> dict[str, str]:
    """Each page by its file's name: `tentacled.1`, and one for each command with its words."""
    parser = command_parser()
    commands = dict(leaves(parser))
    pages = {"tentacled.1": _overview(commands)}
    for name, leaf in commands.items():
        title = f"tentacled {name}".replace(" ", "-")
        pages[f"{title}.1"] = _page(title, leaf)
    return pages


def _overview(commands: dict[str, argparse.ArgumentParser]) -> str:
    lines = [
        *_head("tentacled", "the control daemon for continuum robots"),
        ".SH SYNOPSIS",
        ".B tentacled",
        ".I COMMAND",
        "[\\fB\\-\\-json\\fR] ...",
        ".SH COMMANDS",
    ]
    for name, leaf in commands.items():
        purpose = leaf.description or COMMANDS[name.split()[0]][1]
        lines += [".TP", f".BR tentacled\\-{_escaped(name.replace(' ', '-'))} (1)"]
        lines += _paragraph(purpose)
    lines += [
        ".SH OPTIONS",
        ".TP",
        "\\fB\\-\\-json\\fR",
        *_paragraph(
            "Of every command: standard output carries one JSON object and nothing else, with "
            "schema, version, exit_code and result; or error, with kind, message, place and remedy."
        ),
        *_exit_codes(),
    ]
    return "\n".join(lines) + "\n"


def _page(title: str, parser: argparse.ArgumentParser) -> str:
    purpose = (parser.description or "").strip()
    words = _usage(parser)
    lines = [*_head(title, purpose.partition("\n")[0]), ".SH SYNOPSIS", *_paragraph(words)]
    actions = [
        action
        for action in parser._actions  # noqa: SLF001
        if action.help != argparse.SUPPRESS and action.dest != "help"
    ]
    for heading, wanted in (("ARGUMENTS", False), ("OPTIONS", True)):
        found = [action for action in actions if bool(action.option_strings) == wanted]
        if found:
            lines.append(f".SH {heading}")
        for action in found:
            lines += [".TP", _named(action), *_paragraph(_help(parser, action))]
    if parser.epilog:
        lines += [".SH NOTES", ".nf", *map(_line, parser.epilog.strip().splitlines()), ".fi"]
    return "\n".join([*lines, *_exit_codes(), ".SH SEE ALSO", ".BR tentacled (1)"]) + "\n"


def _head(title: str, purpose: str) -> list[str]:
    name = _escaped(title)
    return [
        f'.TH "{name.upper()}" "1" "" "tentacled {program_version()}" "tentacled"',
        ".SH NAME",
        f"{name} \\- {_escaped(purpose)}",
    ]


def _exit_codes() -> Iterator[str]:
    yield ".SH EXIT STATUS"
    for code, meaning in MEANINGS.items():
        yield from (".TP", f"\\fB{code}\\fR", *_paragraph(meaning))


def _usage(parser: argparse.ArgumentParser) -> str:
    formatter = argparse.HelpFormatter(parser.prog, width=_WIDE)
    formatter.add_usage(parser.usage, parser._actions, parser._mutually_exclusive_groups)  # noqa: SLF001
    return formatter.format_help().removeprefix("usage: ").strip()


def _help(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    return parser._get_formatter()._expand_help(action) if action.help else ""  # noqa: SLF001


def _named(action: argparse.Action) -> str:
    metavar = action.metavar
    value = " ".join(metavar) if isinstance(metavar, tuple) else metavar
    if value is None and action.choices is not None:
        value = "|".join(map(str, action.choices))
    if value is None and action.nargs != 0:
        value = action.dest.upper()
    shown = f"\\fI{_escaped(value)}\\fR" if value else ""
    if not action.option_strings:
        return shown
    options = ", ".join(f"\\fB{_escaped(one)}\\fR" for one in action.option_strings)
    return f"{options} {shown}".rstrip()


def _paragraph(text: str) -> list[str]:
    return [_line(line) for line in (text.strip() or "...").splitlines()]


def _line(text: str) -> str:
    """A line that begins with a dot or an apostrophe would be a request."""
    return re.sub(r"^([.'])", r"\\&\1", _escaped(text))


def _escaped(text: str) -> str:
    plain = text.replace("\\", "\\e").replace("-", "\\-")
    return re.sub(r"[^\x00-\x7f]", lambda found: f"\\[u{ord(found[0]):04X}]", plain)
