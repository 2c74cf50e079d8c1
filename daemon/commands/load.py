"""`tentacled load FILE.yaml`: make a trajectory ready, and a controller if the file names one."""

import argparse
import sys
from pathlib import Path

from config.problems import ConfigError
from config.yaml_document import read_yaml
from daemon.cli import EXIT_FAILED
from daemon.remote.command_line import (
    add_json_argument,
    add_target_arguments,
    add_timeout_argument,
    run_command,
)
from daemon.remote.messages import Load


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "file",
        type=Path,
        metavar="FILE.yaml",
        help="an experiment file, or one with `trajectory` and `controller` alone",
    )
    add_target_arguments(parser)
    add_json_argument(parser)
    add_timeout_argument(parser)
    parser.add_argument("--cycles", type=int, metavar="N", help="instead of the file's")


def run(arguments: argparse.Namespace) -> int:
    document = read_yaml(arguments.file)
    if document.problems:
        print("\n".join(str(problem) for problem in document.problems), file=sys.stderr)
        return EXIT_FAILED
    content = document.value if isinstance(document.value, dict) else {}
    trajectory, controller = content.get("trajectory"), content.get("controller")
    if not isinstance(trajectory, dict):
        print(f"{arguments.file}: there is no trajectory in it", file=sys.stderr)
        return EXIT_FAILED
    if controller is not None and not isinstance(controller, dict):
        print(f"{arguments.file}: a controller is written like a trajectory", file=sys.stderr)
        return EXIT_FAILED
    if controller is not None and content.get("pretraining") is not None:
        model = _pretrained(arguments.file)
        if isinstance(model, str):
            print(model, file=sys.stderr)
            return EXIT_FAILED
        controller = {**controller, **model}
    command = Load(trajectory=trajectory, controller=controller, cycles=arguments.cycles)
    return run_command(arguments, command)


def _pretrained(path: Path) -> dict[str, str] | str:
    """What an experiment's controller gets from its pre-training; a text where there is none.

    Found, or made in virtual time first.
    """
    # Nobody else who loads a trajectory has to wait for what learns.
    from daemon.experiment.experiment_file import load_experiment
    from daemon.experiment.pretrained import with_model
    from daemon.experiment.trial import TrialError

    try:
        file = load_experiment(path)
        file = with_model(file, file.experiment.seed, lambda text: print(text, file=sys.stderr))
    except (ConfigError, TrialError, OSError) as error:
        return str(error)
    model = getattr(file.experiment.controller, "model", None)
    return {} if model is None else {"model": str(model)}
