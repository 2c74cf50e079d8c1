"""`tentacled`: finds the command and runs it. A command is imported only when it is used."""

import argparse
import atexit
import gc
import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.metadata import version
from typing import Final, Protocol, cast

from daemon.host.real_time import imported_for_good

EXIT_OK: Final = 0
EXIT_FAILED: Final = 1
EXIT_USAGE: Final = 2
EXIT_INTERRUPTED: Final = 130

# In the order in which a newcomer needs them.
_COMMANDS: Final = {
    "demo": "show it all, with nothing plugged in: lab, daemon and a client round a rectangle",
    "check": "say what is wrong with a robot, experiment, scenario or study file, and where",
    "emulate": "start the emulated lab of a robot",
    "probe": "connect to tracker and drives and show what they say",
    "inject": "make an emulated device misbehave",
    "run": "start the daemon of a robot",
    "status": "show the robot at a glance",
    "lease": "take control, and keep it until Ctrl-C",
    "arm": "energise the drives where they stand",
    "home": "let axes look for their zeros",
    "load": "make a trajectory and a controller ready",
    "start": "follow what was loaded",
    "teleoperate": "follow set-points",
    "hold": "stand still, energised",
    "resume": "go on after a hold",
    "stop": "quick stop, then power off; no emergency stop circuit",
    "disarm": "stop, and take the drives' power off",
    "clear": "acknowledge faults",
    "explore": "move a robot at random, for a model to be learnt from it",
    "pretrain": "learn a forward model of a robot from an exploration",
    "experiment": "carry out an experiment file with emulated devices",
    "reproduce": "carry out a paper's experiments, and put its tables beside ours",
    "compare": "carry out experiments with all controllers, and put them side by side",
    "report": "make a page of figures of a recorded run",
    "recover": "make recordings whole that a crash has left unfinished",
    "environment": "make surroundings to try the risk of touching them in",
    "mdn": "collect data of a body, and learn where it is: the mixture density network",
    "risk": "say how likely a random point of a mixture is in something solid",
    "certificates": "make keys and certificates for clients on other machines",
    "schema": "write the JSON Schema of robot files, for editors",
    "doctor": "look for what would stop tentacled from working on this machine",
}

_ONE_WORD: Final = ("start", "hold", "resume", "disarm", "clear")
"""Nothing but themselves is to be said: one module has them all."""


class CommandModule(Protocol):
    """What each module in `daemon.commands` has."""

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the command's arguments."""
        ...

    def run(self, arguments: argparse.Namespace) -> int:
        """Do it. Returns the exit code."""
        ...


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point of the console command. Returns the exit code."""
    # To look through all there is for garbage as the process ends would take tenths of a second.
    atexit.register(gc.freeze)
    words = list(sys.argv[1:] if argv is None else argv)
    wanted = next((word for word in words if not word.startswith("-")), None)
    parser = argparse.ArgumentParser(
        prog="tentacled", description="The control daemon for continuum robots."
    )
    parser.add_argument("--version", action="version", version=version("tentacled"))
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name, purpose in _COMMANDS.items():
        subparser = subparsers.add_parser(name, help=purpose, description=purpose)
        if name == wanted:
            _command(name).add_arguments(subparser)
    arguments = parser.parse_args(words)
    try:
        return _command(arguments.command).run(arguments)
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except BrokenPipeError:  # the reader of our output has left, as `head` does
        sys.stderr.close()
        return EXIT_OK


def _command(name: str) -> CommandModule:
    module = "order" if name in _ONE_WORD else name
    with imported_for_good():
        return cast(CommandModule, import_module(f"daemon.commands.{module}"))


if __name__ == "__main__":
    sys.exit(main())
