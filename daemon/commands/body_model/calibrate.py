"""`tentacled mdn calibrate ROBOT.yaml --model MODEL.npz --out DIR`: predicted and real contacts."""

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from config.paths import named_model
from daemon.commands.outcome.failures import as_failed
from daemon.commands.outcome.result import Result
from daemon.robot.checked_robot import add_robot_argument, robot_with_warnings_told

if TYPE_CHECKING:
    from daemon.workbench.body_model.evaluation.contact_calibration import ContactCalibration


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_robot_argument(parser)
    parser.add_argument(
        "--model", type=named_model, required=True, metavar="MODEL.npz",
        help="`builtin:` and its name for a shipped one",
    )  # fmt: skip
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="for the figure and contact.json"
    )
    for name, default, purpose in (
        ("configurations", 250, "of the body"),
        ("rollouts", 200, "of each: come to from so many others, so fewer than the configurations"),
        ("obstacles", 4, "put near the body at each configuration, one after the other"),
        ("samples", 1000, "shapes that contact_risk tries"),
        ("seed", 1, "of all of it"),
        (
            "bodies",
            0,
            "of the same design, one by chance for each rollout; 0: the robot file's own",
        ),
        ("processes", 2, "that roll out"),
    ):
        help_text = f"{purpose} (default: %(default)s)"
        parser.add_argument(f"--{name}", type=int, default=default, metavar="N", help=help_text)
    parser.add_argument(
        "--grid-mm",
        type=float,
        metavar="MM",
        help="as in robot files (default: half of the body's radius, 1.5 at most)",
    )


def run(arguments: argparse.Namespace) -> Result:
    checked = robot_with_warnings_told(arguments.robot)
    # Matplotlib and the plant's compiled code are slow to come: `--help` does without.
    from daemon.array_files import misfit_of
    from daemon.commands.terminal.compiled import telling_progress
    from daemon.files import make_folder, write_whole
    from daemon.host.processes import worker_processes
    from daemon.risk.model_file import read_model
    from daemon.workbench.body_model.evaluation.contact_calibration import (
        contact_calibration,
        write_reliability,
    )
    from daemon.workbench.body_model.evaluation.rollouts import roll_out
    from safety.risk.model.risk_model import RiskModelError

    try:
        file = read_model(arguments.model)
        if misfit := misfit_of(file.about, checked.file.robot):
            raise RiskModelError(f"{arguments.model} does not fit this robot: {misfit}")
        make_folder(arguments.out)
        with telling_progress() as bar, worker_processes(arguments.processes) as workers:
            rollouts = roll_out(
                checked.file.robot,
                arguments.configurations,
                arguments.rollouts,
                arguments.seed,
                workers,
                bar,
                arguments.bodies,
            )
            bar.begin("contacts", len(rollouts.u), 0)
            found = contact_calibration(
                file,
                rollouts,
                arguments.obstacles,
                arguments.samples,
                arguments.grid_mm,
                arguments.seed,
                bar.advance,
            )
        path, figure = arguments.out / "contact.json", arguments.out / "reliability.png"
        write_whole(path, (json.dumps(found.summary(), indent=2) + "\n").encode())
        write_reliability(found, figure)
    except ValueError as error:
        raise as_failed(error) from None
    told = "\n".join((*_said(found), str(path), str(figure)))
    return Result({"calibration": found.summary(), "written": [path, figure]}, told)


def _said(found: "ContactCalibration") -> tuple[str, str]:
    return (
        f"{len(found.predicted)} situations of {found.rollouts} rollouts "
        f"(left out: {found.unknown} configurations that the model does not know, {found.learnt} "
        "that it was trained at); "
        f"in {found.undecided:.0%} it was open whether it touches",
        f"expected calibration error {found.expected_error:.3f}, largest of a tenth "
        f"{found.largest_error:.3f}; a single situation is off by {found.single_error:.3f} on the "
        f"average; more contacts than the upper limit in {found.exceeded:.1%}",
    )
