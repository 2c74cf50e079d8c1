"""`tentacled mdn train ROBOT.yaml CLOUDS.npz --out MODEL.npz`: learn where a body is."""

import argparse
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from daemon.commands.outcome.failures import CommandError, UsageError, as_failed
from daemon.commands.outcome.result import Result
from daemon.commands.terminal.argument_types import seed_number
from daemon.robot.checked_robot import add_robot_argument, robot_with_warnings_told

if TYPE_CHECKING:
    from daemon.commands.terminal.progress_line import ProgressLine
    from daemon.workbench.body_model.training.body_training import BodySettings
    from daemon.workbench.body_model.training.training import Check

NEEDS_TORCH: Final = "training needs PyTorch, and it is not installed"
INSTALL_TORCH: Final = "in the source folder, pip install '.[training]'"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_robot_argument(parser)
    add_data_arguments(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="MODEL.npz")
    parser.add_argument(
        "--components", type=int, default=5, metavar="K", help="default: %(default)s"
    )
    parser.add_argument(
        "--shape-components",
        type=int,
        default=8,
        metavar="K",
        help="of the network over the shape's coefficients; each becomes a narrow and a wide one "
        "(default: %(default)s, which is the most)",
    )
    parser.add_argument(
        "--coefficients",
        type=int,
        default=8,
        metavar="N",
        help="that say what shape the body has (default: %(default)s)",
    )
    add_training_arguments(parser, 6000, "at most; for the shapes a third more")


def add_data_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "data", type=Path, metavar="CLOUDS.npz", help="as `tentacled mdn collect` makes them"
    )


def add_training_arguments(parser: argparse.ArgumentParser, steps: int, what: str) -> None:
    """steps: usually; what: more about them."""
    parser.add_argument(
        "--steps", type=int, default=steps, metavar="N", help=f"{what} (default: %(default)s)"
    )
    parser.add_argument(
        "--seed", type=seed_number, default=1, metavar="N", help="default: %(default)s"
    )
    parser.add_argument(
        "--threads",
        type=int,
        default=1,
        metavar="N",
        help="other threads, other roundings (default: %(default)s; more are hardly faster)",
    )


def prepare_torch(threads: int) -> None:
    """Make torch ready. Raises CommandError where it is not installed."""
    try:
        import torch
    except ModuleNotFoundError:
        raise CommandError(
            "unavailable", f"{NEEDS_TORCH}: {INSTALL_TORCH}", place="torch"
        ) from None
    torch.set_num_threads(threads)


def run(arguments: argparse.Namespace) -> Result:
    checked = robot_with_warnings_told(arguments.robot)
    prepare_torch(arguments.threads)
    # Torch takes seconds to come: `--help` does without.
    from daemon.commands.terminal.compiled import telling_progress
    from daemon.files import check_can_be_made
    from daemon.risk.model_file import write_model
    from daemon.workbench.body_model.clouds.cloud_dataset import CloudDataset
    from daemon.workbench.body_model.training.body_training import nats_in_metres, train_body
    from daemon.workbench.body_model.training.recalibration import Widths

    try:
        settings = _settings(arguments)
    except ValueError as error:
        raise UsageError(str(error)) from None
    try:
        check_can_be_made(arguments.out)
        dataset = CloudDataset.load(arguments.data, checked.file.robot)
        with telling_progress() as progress:
            made = train_body(dataset, settings, _Checks(settings, progress).hear)
        about = {**made.about, "commands": _commands(arguments, dataset.provenance)}
        write_model(arguments.out, made.arrays, about)
    except ValueError as error:
        raise as_failed(error) from None
    kept_back = nats_in_metres(made.points.best.kept_back)
    widths = made.about["shapes_widths"]
    text = (
        f"{arguments.out}: NLL {kept_back:.3f} nats per point (places in m) at configurations that "
        f"were kept back, best after step {made.points.best.step}; for what the modes leave out "
        f"and the fit is off, up to {made.about['basis_left_out_mm']:.2f} mm are added; of shapes, "
        f"{widths['wide_share']:.0%} are {widths['wide']:.2f} times as wide as learnt, the others "
        f"{widths['narrow']:.2f} times, as the same say"
    )
    if not Widths(**widths).enough:
        text += (
            ". That is the most that is allowed: bodies miss this model by more than it says, so "
            "its risks are not to be trusted. See the body at more configurations, or more starts"
        )
    return Result(
        {
            "written": arguments.out,
            "nll_nats_in_metres": kept_back,
            "step": made.points.best.step,
            "about": about,
        },
        text,
    )


def _settings(arguments: argparse.Namespace) -> "BodySettings":
    from daemon.workbench.body_model.training.body_training import BodySettings
    from daemon.workbench.body_model.training.network import NetworkShape

    usual = BodySettings()
    return replace(
        usual,
        points=NetworkShape(arguments.components),
        shapes=replace(usual.shapes, components=arguments.shape_components),
        coefficients=arguments.coefficients,
        training=replace(usual.training, steps=arguments.steps, seed=arguments.seed),
        shapes_training=replace(
            usual.shapes_training, steps=4 * arguments.steps // 3, seed=arguments.seed
        ),
    )


class _Checks:
    """What is told of a training: each check, and how far each network is."""

    def __init__(self, settings: "BodySettings", progress: "ProgressLine") -> None:
        self._settings = settings
        self._progress = progress
        self._network = ""

    def hear(self, network: str, check: "Check") -> None:
        """As `train_body` tells it."""
        if network != self._network:
            self._network = network
            of_points = self._settings.training
            training = of_points if network == "points" else self._settings.shapes_training
            self._progress.begin(f"learning, {network}, at the most", float(training.steps))
        self._progress.tell(
            f"{network} step {check.step}: NLL {check.learnt_from:.3f}, kept back "
            f"{check.kept_back:.3f} nats (mm)"
        )
        self._progress.reach(float(check.step))


def _commands(arguments: argparse.Namespace, collected: Mapping[str, Any]) -> list[str]:
    """What makes the same again. Names of files, not where they are."""
    lines = []
    if (how := collected.get("settings")) is not None:
        lines.append(
            f"tentacled mdn collect {arguments.robot.name} --out {arguments.data.name} "
            f"--configurations {how['training'] + how['test']} --starts {how['starts']} "
            f"--points {how['points']} --seed {how['seed']}"
            + (f" --bodies {how['bodies']}" if how.get("bodies") else "")
        )
    if (how := collected.get("imported")) is not None:
        body = how["surface"]
        lines.append(
            f"tentacled mdn collect {arguments.robot.name} --out {arguments.data.name} "
            f"--from FOLDER --unit {how['unit']} --length-mm {body['length_mm']:g} "
            f"--radius-mm {how['radius_mm']:g} --tube-radius-mm {body['tube_radius_mm']:g} "
            f"--disks {body['disks']} --disk-radius-mm {body['disk_radius_mm']:g} "
            f"--points {how['points']} --seed {how['seed']} "
            f"--tip-load-g {collected['tip_load_g']:g}"
            + (f" --seen-on {collected['seen_on']}" if "seen_on" in collected else "")
        )
    lines.append(
        f"tentacled mdn train {arguments.robot.name} {arguments.data.name} "
        f"--out {arguments.out.name} --components {arguments.components} "
        f"--shape-components {arguments.shape_components} "
        f"--coefficients {arguments.coefficients} --steps {arguments.steps} "
        f"--seed {arguments.seed} --threads {arguments.threads}"
    )
    return lines
