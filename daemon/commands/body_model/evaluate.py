"""`tentacled mdn evaluate ROBOT.yaml CLOUDS.npz --model MODEL.npz --out DIR`: what it is worth."""

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from config.paths import named_model
from daemon.commands.body_model.train import add_data_arguments, prepare_torch
from daemon.commands.outcome.failures import as_failed
from daemon.commands.outcome.result import Result
from daemon.commands.terminal.argument_types import seed_number
from daemon.robot.checked_robot import add_robot_argument, robot_with_warnings_told

if TYPE_CHECKING:
    from daemon.workbench.body_model.evaluation.evaluation import Evaluation


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_robot_argument(parser)
    add_data_arguments(parser)
    parser.add_argument(
        "--model", type=named_model, required=True, metavar="MODEL.npz",
        help="`builtin:` and its name for a shipped one",
    )  # fmt: skip
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="for figures and evaluation.json"
    )
    parser.add_argument(
        "--references",
        type=int,
        default=253,
        metavar="N",
        help="test configurations that get a mixture of their own (default: %(default)s)",
    )
    parser.add_argument(
        "--no-block",
        action="store_true",
        help="train no network that has never been in the block of the configurations",
    )
    parser.add_argument(
        "--seed", type=seed_number, default=1, metavar="N", help="default: %(default)s"
    )
    parser.add_argument("--threads", type=int, default=1, metavar="N", help="default: %(default)s")


def run(arguments: argparse.Namespace) -> Result:
    checked = robot_with_warnings_told(arguments.robot)
    prepare_torch(arguments.threads)
    # Torch and matplotlib take seconds to come: `--help` does without.
    from daemon.array_files import misfit_of
    from daemon.commands.terminal.compiled import telling_progress
    from daemon.files import make_folder, write_whole
    from daemon.risk.model_file import read_model
    from daemon.workbench.body_model.clouds.cloud_dataset import CloudDataset
    from daemon.workbench.body_model.evaluation.evaluation import evaluate
    from daemon.workbench.body_model.evaluation.mdn_figures import write_evaluation
    from daemon.workbench.body_model.training.body_training import BodySettings
    from daemon.workbench.body_model.training.network import NetworkShape
    from safety.risk.model.risk_model import RiskModelError

    try:
        dataset = CloudDataset.load(arguments.data, checked.file.robot)
        make_folder(arguments.out)
        file = read_model(arguments.model)
        if misfit := misfit_of(file.about, checked.file.robot):
            raise RiskModelError(f"{arguments.model} does not fit this robot: {misfit}")
        shape = NetworkShape(file.model.points.components)
        block = None if arguments.no_block else (shape, BodySettings().training)
        with telling_progress() as progress:
            made = evaluate(file, dataset, arguments.seed, arguments.references, block, progress)
        path = arguments.out / "evaluation.json"
        write_whole(path, (json.dumps(made.summary(), indent=2) + "\n").encode())
        figures = write_evaluation(made, file.model, dataset, arguments.out)
    except ValueError as error:
        raise as_failed(error) from None
    written = [path, *figures]
    return Result(
        {"evaluation": made.summary(), "written": written},
        "\n".join([*_lines(made), *map(str, written)]),
    )


def _lines(made: "Evaluation") -> list[str]:
    from daemon.workbench.body_model.training.body_training import nats_in_metres
    from daemon.workbench.body_model.training.calibration import LEVELS

    own, block = made.reference, made.block
    lines = [
        f"tested at {int(made.unseen.test.sum())} configurations that the model was not trained at"
        + (", of the clouds that it was trained with" if made.unseen.same_clouds else ""),
        f"NLL {nats_in_metres(made.points.mean_nll_mm):.3f} nats per point (places in m) there"
        + (
            ""
            if made.training_nll_mm is None
            else f", {nats_in_metres(made.training_nll_mm):.3f} where it was trained"
        ),
        f"beside a mixture of each of {own.configurations} configurations by itself: network "
        f"{own.network:.3f}, reference {own.reference:.3f} ({own.in_sample:.3f} in sample); "
        f"difference {own.difference:+.3f}, 95 %: {own.interval[0]:+.3f} to {own.interval[1]:+.3f}",
        f"coverage of points: {_shares(LEVELS, made.points.coverage().tolist())}",
        f"coverage of shapes: {_shares(LEVELS, made.shapes.coverage().tolist())}; "
        f"tip {made.tip_error_mm:.2f} mm off its mean, {made.tip_spread_mm:.2f} mm of it by starts",
        f"smallest mean weight {made.least_weight:.3f}; the model knows {made.known:.1%} of the "
        "test configurations",
    ]
    if made.unseen.left_out:
        lines.insert(
            1,
            f"left out: {made.unseen.left_out} configurations that these data keep back, and the "
            "model was trained at",
        )
    if (truth := made.truth) is not None:
        lines.append(
            f"of true shapes: coverage {_shares(LEVELS, truth.shapes.coverage().tolist())}; "
            f"tip {truth.tip_error_mm:.2f} mm off its mean. Centrelines fitted to the clouds "
            f"are off by {truth.fit_off_mm[0]:.2f} mm, 1 % of their nodes by "
            f"{truth.fit_off_mm[1]:.2f}, root mean square {truth.fit_error_mm[0]:.2f}, stated "
            f"{truth.fit_error_mm[1]:.2f}"
        )
    if block is not None:
        knowing = "" if block.knowing is None else f"; {block.knowing:.3f} if seen"
        lines.append(
            f"block of {block.configurations} configurations never seen: NLL {block.inside:.3f} "
            f"({block.outside:.3f} outside{knowing}); "
            f"coverage {_shares(LEVELS, block.coverage)}"
        )
    return lines


def _shares(levels: tuple[float, ...], found: "list[float] | tuple[float, ...]") -> str:
    pairs = zip(levels, found, strict=True)
    return ", ".join(f"{level:.0%} → {share:.1%}" for level, share in pairs)
