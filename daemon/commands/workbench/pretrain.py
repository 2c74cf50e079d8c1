"""`tentacled pretrain ROBOT.yaml DATA.npz --out MODEL.npz`: learn a forward model from data."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from daemon.commands.outcome.failures import UsageError
from daemon.commands.outcome.result import Result
from daemon.commands.terminal.argument_types import seed_number
from daemon.robot.checked_robot import add_robot_argument, robot_with_warnings_told

if TYPE_CHECKING:
    from daemon.learning.forward.pretraining import Pretraining


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_robot_argument(parser)
    parser.add_argument(
        "data", type=Path, nargs="+", metavar="DATA.npz", help="as `tentacled explore` makes them"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="MODEL.npz")
    parser.add_argument("--epochs", type=int, default=15, metavar="N", help="default: %(default)s")
    parser.add_argument(
        "--fields",
        type=int,
        metavar="N",
        help="receptive fields (default: one for every hundred motions)",
    )
    parser.add_argument(
        "--test-share",
        type=float,
        default=0.2,
        metavar="SHARE",
        help="of the lines that are kept back to test the model with (default: %(default)s)",
    )
    parser.add_argument(
        "--sample",
        type=float,
        metavar="MM",
        help="how far the tip goes in a motion (default: 1)",
    )
    parser.add_argument(
        "--lag",
        type=float,
        metavar="S",
        help="how much later than its axes the body moves (default: found in the data)",
    )
    parser.add_argument(
        "--seed", type=seed_number, default=1, metavar="N", help="default: %(default)s"
    )
    parser.add_argument("--no-figures", action="store_true", help="the model only")


def run(arguments: argparse.Namespace) -> Result:
    # What learns is compiled when it comes, and matplotlib is slow: `--help` does without.
    from daemon.commands.terminal.compiled import telling_progress
    from daemon.files import check_can_be_made
    from daemon.learning.forward.pretrained_model import PretrainedModel
    from daemon.learning.forward.pretraining import PretrainingSettings, pretrain
    from daemon.learning.samples.dataset import Dataset, joined
    from daemon.learning.samples.motion_samples import SamplingSettings
    from daemon.workbench.pretraining.model_cache import epochs_told
    from daemon.workbench.pretraining.pretraining_table import print_table

    checked = robot_with_warnings_told(arguments.robot)
    try:
        sampling = {} if arguments.sample is None else {"tip_mm": arguments.sample}
        settings = PretrainingSettings(
            arguments.epochs,
            arguments.fields,
            arguments.test_share,
            arguments.seed,
            SamplingSettings(**sampling),
            arguments.lag,
        )
    except ValueError as error:
        raise UsageError(str(error)) from None
    check_can_be_made(arguments.out)
    dataset = joined([Dataset.load(path, checked.file.robot) for path in arguments.data])
    with telling_progress() as progress:
        pretraining = pretrain(dataset, settings, epochs_told(settings, progress))
    model = PretrainedModel.of(pretraining, dataset)
    model.save(arguments.out)
    figures = [] if arguments.no_figures else _figures(pretraining, arguments.out)

    def show() -> None:
        print_table(pretraining)
        for path in (arguments.out, *figures):
            print(path)

    return Result({**model.metadata, "written": [arguments.out, *figures]}, show)


def _figures(pretraining: "Pretraining", model: Path) -> list[Path]:
    from daemon.workbench.pretraining.figures import write_figures

    return write_figures(pretraining, model.with_suffix(""))
