"""`tentacled experiment EXPERIMENT.yaml --out DIR`: carry it out, in virtual time or in real."""

import argparse
import sys
from pathlib import Path

from daemon.commands.outcome.failures import CommandError
from daemon.commands.outcome.result import Result
from daemon.commands.terminal.argument_types import seed_number
from daemon.commands.terminal.compiled import compile_all, telling_progress
from daemon.commands.terminal.progress_line import Aside, ProgressLine
from daemon.files import make_folder
from daemon.host.logs import logging_to_stderr
from daemon.host.real_time import imported_for_good
from daemon.host.stop_signals import all_like_ctrl_c
from daemon.recording.result import Result as RunResult
from daemon.recording.result import pose_text, table_text
from daemon.robot.checked_robot import tracker_warnings
from daemon.robot.shipped_files import add_list_option, file_argument
from daemon.workbench.experiments.construction import check_happenings
from daemon.workbench.experiments.experiment_file import ExperimentFile, load_experiment
from daemon.workbench.experiments.measures import measures_of, recovery_lines
from daemon.workbench.pretraining.model_cache import with_model
from daemon.workbench.report.report_process import ReportBeside


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "experiment",
        type=file_argument("experiments"),
        metavar="EXPERIMENT.yaml",
        help="builtin:rectangle is one that is shipped",
    )
    add_list_option(parser, "experiments")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="the run's folder, made new"
    )
    parser.add_argument("--seed", type=seed_number, metavar="N", help="instead of the file's")
    parser.add_argument(
        "--real-time", action="store_true", help="with the devices in a process of their own"
    )
    parser.add_argument("--no-report", action="store_true", help="figures and recording only")


def run(arguments: argparse.Namespace) -> Result:
    file = load_experiment(arguments.experiment)
    check_happenings(file)
    for warning in tracker_warnings(file.file):
        print(f"{warning} (warning)", file=sys.stderr)
    seed = file.experiment.seed if arguments.seed is None else arguments.seed
    try:
        make_folder(arguments.out.parent)
        arguments.out.mkdir()
        with (
            all_like_ctrl_c(),
            logging_to_stderr("experiment"),
            telling_progress() as progress,
        ):
            return _experiment(file, seed, arguments, progress)
    except FileExistsError:
        place = str(arguments.out)
        text = f"{place} is there already: name a new folder"
        raise CommandError("cannot_create", text, place=place) from None
    except KeyboardInterrupt:
        text = f"ended early: what was recorded is in {arguments.out}"
        raise CommandError("interrupted", text, place=str(arguments.out)) from None


def _experiment(
    file: ExperimentFile, seed: int, arguments: argparse.Namespace, progress: ProgressLine
) -> Result:
    """Raises TrialError, UnreadableRunError, OSError."""
    report = ReportBeside(arguments.out)
    try:
        if not (arguments.no_report or arguments.real_time):  # which has a use for every core
            report.begin()
        file = with_model(file, seed, progress.tell, progress)
        if arguments.real_time:
            result = _in_real_time(file, seed, arguments.out, progress)
        else:
            result = _in_virtual_time(file, seed, arguments.out, report, progress)
        progress.end()
        print(table_text(result.cycles))
        if result.true_cycles:
            print(f"the same of the true tip:\n{table_text(result.true_cycles)}")
        if any(row.angle_rad is not None for row in result.tip_pose):
            print(f"root mean squares by coordinate:\n{pose_text(result.tip_pose)}")
        measures = measures_of(file, arguments.out)
        if measures is not None:
            print("".join(f"{line}\n" for line in recovery_lines(measures.recoveries)), end="")
        written = None
        if not arguments.no_report:
            progress.begin("drawing the report", 0.0)
            written = report.write()
            progress.tell(str(written))
        return Result(
            {"run": arguments.out, "report": written, "result": result, "measures": measures}
        )
    finally:
        report.end()


# Neither kind of time waits for what only the other needs.


def _in_real_time(
    file: ExperimentFile, seed: int, folder: Path, progress: ProgressLine
) -> RunResult:
    from daemon.workbench.experiments.in_real_time import carry_out_in_real_time

    compile_all(file.file)  # here, where it is told: the lab's process is waited for
    with Aside(progress) as aside:
        return carry_out_in_real_time(file, seed, folder, aside.tell, aside)


def _in_virtual_time(
    file: ExperimentFile, seed: int, folder: Path, report: ReportBeside, progress: ProgressLine
) -> RunResult:
    with imported_for_good():
        from daemon.workbench.experiments.in_virtual_time import carry_out_in_virtual_time

    return carry_out_in_virtual_time(
        file, seed, folder, progress.tell, report.control_hash, progress
    )
