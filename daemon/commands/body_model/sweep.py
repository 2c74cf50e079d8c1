"""`tentacled mdn sweep ROBOT.yaml CLOUDS.npz --out NLL.png`: how many components a body needs.

Figure 4 of Thompson et al.: the likelihood of what was kept back, over the number of components.
They chose the most that do not collapse; how many that are depends on where components begin.
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from daemon.commands.body_model.train import (
    add_data_arguments,
    add_training_arguments,
    prepare_torch,
)
from daemon.commands.outcome.failures import UsageError, as_failed
from daemon.commands.outcome.result import Result
from daemon.robot.checked_robot import add_robot_argument, robot_with_warnings_told

if TYPE_CHECKING:
    from collections.abc import Callable

    from daemon.commands.terminal.progress_line import ProgressLine
    from daemon.workbench.body_model.evaluation.component_sweep import Counted

_MOST = 16


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_robot_argument(parser)
    add_data_arguments(parser)
    parser.add_argument(
        "--components", default="1..16", metavar="FIRST..LAST", help="default: %(default)s"
    )
    parser.add_argument(
        "--start",
        choices=("arc", "plain", "both"),
        default="both",
        help="components begin along the body, as in `mdn train`; or as chance has it, as in the "
        "paper (default: %(default)s)",
    )
    parser.add_argument("--out", type=Path, required=True, metavar="NLL.png")
    add_training_arguments(parser, 2000, "at most: enough to tell numbers of components apart")


def run(arguments: argparse.Namespace) -> Result:
    checked = robot_with_warnings_told(arguments.robot)
    components = _range(arguments.components)
    if components is None:
        raise UsageError(f"--components: FIRST..LAST, from 1 to {_MOST}")
    prepare_torch(arguments.threads)
    # Torch and matplotlib take seconds to come: `--help` does without.
    from daemon.commands.terminal.compiled import telling_progress
    from daemon.files import check_can_be_made
    from daemon.workbench.body_model.clouds.cloud_dataset import CloudDataset
    from daemon.workbench.body_model.evaluation.component_sweep import summary, sweep
    from daemon.workbench.body_model.evaluation.mdn_figures import write_sweep
    from daemon.workbench.body_model.training.body_training import STARTS, BodySettings

    try:
        check_can_be_made(arguments.out)
        settings = replace(BodySettings().training, steps=arguments.steps, seed=arguments.seed)
        dataset = CloudDataset.load(arguments.data, checked.file.robot)
        starts = [start for start in STARTS if arguments.start in (start, "both")]
        with telling_progress() as progress:
            say = (lambda _: None) if arguments.json else _said_past(progress)
            progress.begin("learning", float(settings.steps * len(starts) * len(components)))
            found = [
                one
                for start in starts
                for one in sweep(dataset, components, settings, start, say, progress)
            ]
        write_sweep(found, arguments.out)
    except ValueError as error:
        raise as_failed(error) from None
    found_out, lines = summary(found), []
    for start, one in found_out["starts"].items():
        collapsed = one["first_collapsed"]
        said = "none collapsed" if collapsed is None else f"first collapsed at {collapsed}"
        best = one["recommended"]
        advice = "try fewer components" if best is None else f"recommended: {best} components"
        lines.append(f"{start}: {said}; {advice}")
    return Result({**found_out, "written": arguments.out}, "\n".join([*lines, str(arguments.out)]))


def _said_past(progress: "ProgressLine") -> "Callable[[Counted], None]":
    return lambda counted: progress.tell(counted.line)


def _range(words: str) -> range | None:
    first, _, last = words.partition("..")
    try:
        found = range(int(first), int(last or first) + 1)
    except ValueError:
        return None
    return found if found and found[0] >= 1 and found[-1] <= _MOST else None
