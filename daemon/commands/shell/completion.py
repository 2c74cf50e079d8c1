"""`tentacled completion bash|zsh|fish`: what makes the shell complete commands, options and files.

The script is static: no program is run at a Tab. It completes the commands of the version that has
written it.
"""

import argparse
from collections.abc import Iterator, Mapping
from typing import Any, Final

from daemon.commands.outcome.failures import CommandError
from daemon.commands.outcome.result import Result
from daemon.commands.terminal.command_line import command_parser

_SHELLS: Final = {
    "bash": "~/.local/share/bash-completion/completions/tentacled",
    "zsh": "~/.zfunc/_tentacled, in a folder of $fpath",
    "fish": "~/.config/fish/completions/tentacled.fish",
}
"""Where each looks for it."""

_ROBOTS: Final = "_tentacled_robots"
_PREAMBLE: Final = {
    "bash": f"""
{_ROBOTS}() {{
  local folder="${{XDG_RUNTIME_DIR:-/run/user/$UID}}/tentacled" names=() one
  for one in "$folder"/*/; do [ -d "$one" ] && names+=("$(basename "$one")"); done
  compgen -W "${{names[*]}}" -- "$1"
}}
""",
    "zsh": f"""
{_ROBOTS}() {{
  local -a names
  names=(${{XDG_RUNTIME_DIR:-/run/user/$UID}}/tentacled/*(N/:t))
  compadd -a names
}}
""",
}
"""Names of the robots that run here, by the folders of their daemons."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("shell", choices=tuple(_SHELLS), metavar="SHELL", help=", ".join(_SHELLS))
    lines = [f"{shell:<6}{place}" for shell, place in _SHELLS.items()]
    parser.epilog = "where the shells look for it:\n  " + "\n  ".join(lines)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter


def run(arguments: argparse.Namespace) -> Result:
    script = completion_script(arguments.shell)
    return Result({"shell": arguments.shell, "script": script}, script.rstrip("\n"))


def completion_script(shell: str) -> str:
    """Of the whole command line. Raises CommandError where shtab is not installed."""
    try:
        import shtab
    except ModuleNotFoundError:
        text = "this needs shtab, which is not installed: pip install shtab"
        raise CommandError("unavailable", text, place="shtab") from None
    parser = command_parser()
    for action in _actions(parser):
        _say_what_it_is(action, shtab.FILE, shtab.DIRECTORY)
    script: str = shtab.complete(parser, shell, preamble=_PREAMBLE.get(shell, ""))
    return script


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    for action in parser._actions:  # noqa: SLF001
        if isinstance(action, argparse._SubParsersAction):  # noqa: SLF001
            for inner in action.choices.values():
                yield from _actions(inner)
        else:
            yield action


def _say_what_it_is(action: Any, file: object, directory: object) -> None:
    """For shtab, which takes a mapping of choices for commands."""
    if isinstance(action.choices, Mapping):
        action.choices = tuple(action.choices)
    named = f"{action.metavar or action.dest}".upper()
    if action.dest in ("robot", "robots") and getattr(action.type, "__name__", "") != "path":
        action.complete = dict.fromkeys(_PREAMBLE, _ROBOTS)
    elif getattr(action.type, "__name__", "") in ("Path", "path"):
        action.complete = directory if named in ("DIR", "FOLDER") else file
