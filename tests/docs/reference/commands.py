"""The page of the command line: every command with its arguments."""

import argparse
from collections.abc import Iterator

from daemon.commands.outcome.exit_codes import MEANINGS
from daemon.commands.terminal.command_line import COMMANDS, command_parser
from tests.docs.reference.markdown import plain, table

_HEAD = """\
# Commands

Every command of `tentacled`, with what it takes. `tentacled COMMAND --help` says the same.
Each of them takes `--json`: standard output then carries one JSON object and nothing else, with
`schema`, `version`, `exit_code` and `result`; or `error`: `kind`, `message`, `place`, `remedy`.

## Exit codes

"""


def commands_page() -> str:
    """The page."""
    overview = table(
        ("command", "what it does"),
        ((f"[`{name}`](#tentacled-{name})", purpose) for name, (_, purpose) in COMMANDS.items()),
    )
    codes = table(("code", "meaning"), ((str(code), text) for code, text in MEANINGS.items()))
    (commands,) = command_parser()._subparsers._group_actions  # type: ignore[union-attr]
    sections = ["".join(_section(parser, "##")) for parser in dict(commands.choices or {}).values()]
    return f"{_HEAD}{codes}\n## All of them\n\n{overview}{''.join(sections)}"


def _section(parser: argparse.ArgumentParser, level: str) -> Iterator[str]:
    yield f"\n{level} {parser.prog}\n\n"
    if parser.description:
        yield f"{_sentence(plain(parser.description))}\n"
    rows = [row for action in parser._actions if (row := _row(action)) is not None]
    if rows:
        yield "\n" + table(("argument", "meaning"), rows)
    for group in parser._action_groups:
        if group.description and group.title:
            yield f"\n{group.title.capitalize()}: {plain(group.description)}\n"
    if parser.epilog:
        yield f"\n```\n{parser.epilog.strip()}\n```\n"
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            told = {choice.dest: choice.help or "" for choice in action._choices_actions}
            for name, inner in action.choices.items():
                inner.prog = f"{parser.prog.partition(' [')[0]} {name}"
                inner.description = inner.description or told.get(name, "")
                yield from _section(inner, f"{level}#")


def _row(action: argparse.Action) -> tuple[str, str] | None:
    if isinstance(action, argparse._HelpAction | argparse._SubParsersAction):
        return None
    if action.help == argparse.SUPPRESS:
        return None
    meaning = (action.help or "") % {
        "default": action.default,
        "prog": "",
        "choices": ", ".join(map(str, action.choices or ())),
    }
    return f"`{_shown(action)}`", plain(meaning)


def _shown(action: argparse.Action) -> str:
    value = _value(action)
    if not action.option_strings:
        return f"[{value}]" if action.nargs in ("?", "*") else value
    return f"{', '.join(action.option_strings)} {value}".strip()


def _value(action: argparse.Action) -> str:
    if action.nargs == 0:
        return ""
    if action.metavar is not None:
        names = action.metavar
        return " ".join(names) if isinstance(names, tuple) else names
    if action.choices is not None:
        return "{" + ",".join(map(str, action.choices)) + "}"
    return action.dest.upper()


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + ("" if text.endswith(".") else ".")
