"""`tentacled`: finds the command and runs it. A command is imported only when it is used."""

import argparse
import atexit
import gc
import os
import re
import sys
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from importlib import import_module
from typing import Any, Final, NoReturn, Protocol, cast

from config.documents.problems import did_you_mean
from daemon.commands.outcome.exit_codes import (
    EXIT_INTERNAL,
    EXIT_OK,
    EXIT_USAGE,
    exit_code_lines,
)
from daemon.commands.outcome.failures import Failure, Kind, UsageError, failure_of
from daemon.commands.outcome.result import (
    Result,
    only_json_on_stdout,
    program_version,
    tell_failure,
    tell_result,
    telling_json,
    versions,
)
from daemon.host.real_time import imported_for_good
from daemon.host.writable_places import ensure_writable_places

# The folder that each is in and what it is for, in the order in which a newcomer needs them.
COMMANDS: Final = {
    "demo": (
        "host",
        "show it all, with nothing plugged in: lab, daemon and a client round a rectangle",
    ),
    "check": (
        "host",
        "say what is wrong with a robot, experiment, scenario or study file, and where",
    ),
    "emulate": ("host", "start the emulated lab of a robot"),
    "probe": ("host", "connect to tracker and drives and show what they say"),
    "inject": ("client", "make an emulated device misbehave"),
    "run": ("host", "start the daemon of a robot"),
    "status": ("client", "show the robot at a glance"),
    "dashboard": ("host", "serve the operator's page: robots live, in a browser"),
    "bridge": ("bridge", "tell other programs what the robot tells: 3D Slicer, ROS 2, Foxglove"),
    "lease": ("client", "take control, and keep it until Ctrl-C"),
    "arm": ("client", "energise the drives where they stand"),
    "home": ("client", "let axes look for their zeros"),
    "surroundings": ("client", "say what is round the body, or replace it while it stands still"),
    "replan": ("client", "look for a path from where the robot stands, among what is round it"),
    "load": ("client", "make a trajectory and a controller ready"),
    "start": ("client", "follow what was loaded"),
    "teleoperate": ("client", "follow set-points"),
    "hold": ("client", "stand still, energised"),
    "resume": ("client", "go on after a hold"),
    "stop": ("client", "quick stop, then power off; no emergency stop circuit"),
    "disarm": ("client", "stop, and take the drives' power off"),
    "clear": ("client", "acknowledge faults"),
    "explore": ("workbench", "move a robot at random, for a model to be learnt from it"),
    "pretrain": ("workbench", "learn a forward model of a robot from an exploration"),
    "kinematics": (
        "workbench",
        "learn where the tip of concentric tubes is and points, from their statics",
    ),
    "experiment": ("workbench", "carry out an experiment file with emulated devices"),
    "reproduce": ("workbench", "carry out a paper's experiments, and put its tables beside ours"),
    "compare": (
        "workbench",
        "carry out experiments with all controllers, and put them side by side",
    ),
    "tune": ("workbench", "seek a study's options, with the same effort for every controller"),
    "report": ("recordings", "make a page of figures of a recorded run"),
    "export": ("recordings", "write a recorded run as tables: CSV, Parquet; or for Foxglove"),
    "recover": ("recordings", "make recordings whole that a crash has left unfinished"),
    "environment": ("workbench", "make surroundings to try the risk of touching them in"),
    "mdn": (
        "workbench",
        "collect data of a body, and learn where it is: the mixture density network",
    ),
    "plan": (
        "workbench",
        "look for a path to a place that keeps the whole body away from everything",
    ),
    "risk": ("workbench", "say how likely a random point of a mixture is in something solid"),
    "init": (
        "host",
        "begin a controller of your own, or a robot: something whole, in a new folder",
    ),
    "service": ("host", "write what makes the daemon a service: systemd, udev, CAN interfaces"),
    "plugins": ("host", "list the controllers, plants and trajectories that files may name"),
    "certificates": ("host", "make keys and certificates for clients on other machines"),
    "schema": ("host", "write the JSON Schema of robot files, for editors"),
    "completion": ("shell", "write what makes bash, zsh or fish complete commands and options"),
    "man": ("shell", "write the manual pages"),
    "doctor": ("host", "look for what would stop tentacled from working on this machine"),
}

_ONE_WORD: Final = ("start", "hold", "resume", "disarm", "clear")
"""Nothing but themselves is to be said: one module has them all."""


class CommandModule(Protocol):
    """What each module in `daemon.commands` has."""

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the command's arguments."""
        ...

    def run(self, arguments: argparse.Namespace) -> Result:
        """Do it. Errors of `daemon.commands.outcome.failures` are told by who calls it."""
        ...


class CommandGroup:
    """A command with words below it, each a module of one folder, imported when it is used."""

    def __init__(self, folder: str, metavar: str, purposes: Mapping[str, str]) -> None:
        """purposes: by the word."""
        self._folder, self._metavar, self._purposes = folder, metavar, purposes

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Those of all its words."""
        words = parser.add_subparsers(dest="word", metavar=self._metavar, required=True)
        for word, purpose in self._purposes.items():
            below = words.add_parser(word, help=purpose, description=purpose)
            self._module(word).add_arguments(below)

    def run(self, arguments: argparse.Namespace) -> Result:
        """The word's."""
        return self._module(arguments.word).run(arguments)

    def _module(self, word: str) -> CommandModule:
        return cast(CommandModule, import_module(f"daemon.commands.{self._folder}.{word}"))


class CommandParser(argparse.ArgumentParser):
    """Says what may have been meant by a word that it does not know."""

    def parse_known_args(self, *words: Any, **more: Any) -> Any:
        """As the overridden one; but what this parser does not know is refused by itself, not by
        the one above it, which has other options."""
        self._words = [str(word) for word in words[0] or ()] if words else []
        known, unknown = super().parse_known_args(*words, **more)
        if unknown:
            self.error(f"unknown: {self._with_options_meant(unknown)}")
        return known, unknown

    def error(self, message: str) -> NoReturn:
        """Tell it, with the usage, and end with the exit code of wrong usage."""
        if _REQUIRED in message:  # perhaps it is there, but misspelt
            options = self._options()
            given = [word for word in self._words if word.startswith("--") and word != "--"]
            names = ((word, word.partition("=")[0]) for word in given)
            misspelt = [
                word for word, name in names if not any(one.startswith(name) for one in options)
            ]
            message += f"; unknown: {self._with_options_meant(misspelt)}" if misspelt else ""
        self.print_usage(sys.stderr)
        told = _with_what_was_meant(message)
        if telling_json():
            failure = failure_of(UsageError(told))
            assert failure is not None
            tell_failure(self.prog.removeprefix("tentacled").strip(), failure)
        self.exit(EXIT_USAGE, f"{self.prog}: error: {told}\n")

    def _options(self) -> list[str]:
        return re.findall(r"--[a-z][a-z-]*", self.format_help())

    def _with_options_meant(self, words: Sequence[str]) -> str:
        has = self._options()
        return ", ".join(f"{word}{did_you_mean(word.partition('=')[0], has)}" for word in words)


_REQUIRED: Final = "arguments are required"

_CHOICE: Final = re.compile(
    r"(argument (\S+): )invalid choice: (?:'|\")(.*)(?:'|\") \(choose from (.*)\)", re.S
)
_FEW_CHOICES: Final = 100
"""Characters: what is longer is not read, and stands in the help."""


def _with_what_was_meant(message: str) -> str:
    found = _CHOICE.fullmatch(message)
    if found is None:
        return message
    argument, name, word, known = found.groups()
    choices = [choice.strip("' ") for choice in known.split(",")]
    meant = did_you_mean(word, choices)
    if name == "COMMAND":
        return f"there is no command '{word}'{meant}; `tentacled --help` lists them"
    more = "" if meant or len(known) > _FEW_CHOICES else f": there are {', '.join(choices)}"
    return f"{argument}there is no '{word}'{meant}{more}"


_INTERNAL: Final = Kind("internal", EXIT_INTERNAL, "report it, with the traceback on stderr")


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point of the console command. Returns the exit code."""
    # To look through all there is for garbage as the process ends would take tenths of a second.
    atexit.register(gc.freeze)
    words = list(sys.argv[1:] if argv is None else argv)
    _open_what_is_closed()
    ensure_writable_places()
    with only_json_on_stdout() if _wants_json(words) else nullcontext():
        name = _first_word(words)
        try:
            arguments = parsed(words)  # imports the command: Ctrl-C may come by then
            name = name_of(arguments)
            result = _command(arguments.command).run(arguments)
            tell_result(name, result)
        except BrokenPipeError:  # the reader of our output has left, as `head` does
            sys.stderr.close()
            return EXIT_OK
        except SystemExit as ending:
            if isinstance(ending.__context__, BrokenPipeError):  # rich ends the process for it
                return EXIT_OK
            raise
        except (Exception, KeyboardInterrupt) as error:
            return _failed(name, error)
    return result.code


def _open_what_is_closed() -> None:
    """Standard streams that whoever has started us did not give: nothing is read, and none hears.

    A file takes the lowest number that is free, so the next one opened would stand in its place.
    """
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: PTH123, SIM115


def _failed(name: str, error: BaseException) -> int:
    failure = failure_of(error)
    if failure is None:
        traceback.print_exception(error)
        failure = Failure(_INTERNAL, f"{type(error).__name__}: {error}")
    tell_failure(name, failure)
    return failure.kind.code


def _first_word(words: Sequence[str]) -> str:
    """The command that is meant, before anything has been imported for it."""
    return next((word for word in words if not word.startswith("-")), "")


def parsed(words: Sequence[str]) -> argparse.Namespace:
    """What the words after `tentacled` ask for. Explains wrong usage, and ends the process."""
    parser = command_parser(only=_first_word(words))
    if not words:
        parser.print_help(sys.stderr)
        sys.exit(EXIT_USAGE)
    return parser.parse_args(words)


def command_parser(only: str | None = None) -> CommandParser:
    """The whole command line. only: no other command gets its arguments, nor is it imported."""
    parser = CommandParser(
        prog="tentacled",
        description="The control daemon for continuum robots.",
        epilog="exit codes:\n" + "\n".join(f"  {line}" for line in exit_code_lines()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=_Version, help="of tentacled; with --json of its parts")
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, (_, purpose) in COMMANDS.items():
        subparser = subparsers.add_parser(name, help=purpose, description=purpose)
        if only is None or name == only:
            _command(name).add_arguments(subparser)
            for _, leaf in leaves(subparser):
                _add_json_argument(leaf)
    return parser


def leaves(parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Each command below this parser that has no further words, with its name."""
    below = [one for one in parser._actions if isinstance(one, argparse._SubParsersAction)]  # noqa: SLF001
    if not below:
        yield parser.prog.removeprefix("tentacled").strip(), parser
    for action in below:
        for one in dict.fromkeys(action.choices.values()):
            yield from leaves(one)


def name_of(arguments: argparse.Namespace) -> str:
    """Of the command that was asked for, with all its words: `mdn collect`."""
    return " ".join(
        word
        for word in (arguments.command, *(getattr(arguments, key, "") for key in _FURTHER_WORDS))
        if word
    )


_FURTHER_WORDS: Final = ("word",)
"""Where commands with words below them leave those."""


def _add_json_argument(parser: argparse.ArgumentParser) -> None:
    if "--json" not in parser._option_string_actions:  # noqa: SLF001
        text = "one JSON object on standard output, and nothing else; of a failure, too"
        parser.add_argument("--json", action="store_true", help=text)


def _wants_json(words: Sequence[str]) -> bool:
    """Also while the words have not been understood, or cannot be."""
    own = words[: words.index("--")] if "--" in words else words
    return any(len(word) >= len("--js") and "--json".startswith(word) for word in own)


class _Version(argparse.Action):
    """Of tentacled; for programs, and for who reports a defect, of what it stands on, too."""

    def __init__(self, option_strings: Sequence[str], dest: str, **more: Any) -> None:
        super().__init__(option_strings, dest, nargs=0, help=more.get("help"))

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        tell_result("version", Result(versions(), program_version()))
        parser.exit()


def _command(name: str) -> CommandModule:
    folder, _ = COMMANDS[name]
    module = "order" if name in _ONE_WORD else name
    with imported_for_good():
        return cast(CommandModule, import_module(f"daemon.commands.{folder}.{module}"))


if __name__ == "__main__":
    sys.exit(main())
