"""`tentacled demo`: emulated lab, daemon and client, each in its own process, round a rectangle."""

import argparse
import asyncio
import select
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from importlib.resources import files
from pathlib import Path
from typing import Final

from config.documents.problems import in_words
from config.loader import load_robot
from daemon.commands.outcome.failures import CommandError
from daemon.commands.outcome.result import Result
from daemon.commands.terminal.argument_types import cycle_seconds
from daemon.commands.terminal.compiled import compile_all, telling_progress
from daemon.commands.terminal.tour import Tour, TourError
from daemon.files import check_folder_can_be_made
from daemon.host.clock import run_in_real_time
from daemon.host.processes import OwnProcesses, ProcessError, end_with_parent
from daemon.host.stop_signals import StopSignals
from daemon.learning.forward.pretraining import PretrainingError
from daemon.recording.result import read_result, table_text
from daemon.remote.client.client_errors import ClientError
from daemon.workbench.experiments.trial import TrialError
from daemon.workbench.pretraining.model_cache import pretrained
from daemon.workbench.report.report import write_report

_PAGE_WITHIN_S: Final = 30.0
_PAGE_ENDS_WITHIN_S: Final = 5.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--cycle",
        type=cycle_seconds,
        default=60.0,
        metavar="S",
        help="time for once round the rectangle",
    )
    parser.add_argument(
        "--runs", type=Path, default=Path("runs"), metavar="DIR", help="where the recording goes"
    )
    parser.add_argument(
        "--no-page", action="store_true", help="do not serve the operator's page beside it"
    )


def run(arguments: argparse.Namespace) -> Result:
    robot = Path(str(files("config") / "robots" / "soft_arm.yaml"))
    check_folder_can_be_made(arguments.runs)
    with tempfile.TemporaryDirectory(prefix="tentacled-") as name:
        directory = Path(name)
        with nullcontext() if arguments.no_page else _page(directory, arguments.runs):
            try:
                model = _prepared(robot)
            except (TrialError, PretrainingError, OSError) as error:
                text = f"the arm cannot be explored: {in_words(error)}"
                raise CommandError("failed", text) from None
            return run_in_real_time(_demonstrate(robot, directory, model, arguments))


@contextmanager
def _page(directory: Path, runs: Path) -> Iterator[None]:
    """The operator's page as long as the tour lasts, which goes on where it cannot be served."""
    words = ["dashboard", "soft_arm", "--runtime-dir", str(directory), "--runs", str(runs)]
    command = [sys.executable, "-m", "daemon.commands.terminal.command_line", *words]
    with subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=end_with_parent,
    ) as process:
        try:
            _tell_address(process)
            yield
        finally:
            process.terminate()
            try:
                process.wait(_PAGE_ENDS_WITHIN_S)
            except subprocess.TimeoutExpired:
                process.kill()


def _tell_address(process: "subprocess.Popen[str]") -> None:
    """It speaks when it is ready: the operator's address in its first line."""
    assert process.stdout is not None
    ready, _, _ = select.select([process.stdout], [], [], _PAGE_WITHIN_S)
    line = process.stdout.readline() if ready else ""
    address = line.strip().removeprefix("operator: ")
    if address:
        print(f"see it in a browser: {address}", flush=True)
    else:
        print("the operator's page is not there: the tour goes on without", file=sys.stderr)


def _prepared(robot: Path) -> Path:
    """What is known of the arm, learnt where it is not yet; and everything compiled, before
    processes start that are waited for. Raises TrialError, PretrainingError, OSError."""
    with telling_progress() as progress:
        file = load_robot(robot)
        model = pretrained(file, tell=progress.tell, progress=progress)
        compile_all(file)
    return model


async def _demonstrate(
    robot: Path, directory: Path, model: Path, arguments: argparse.Namespace
) -> Result:
    where = [str(robot), "--runtime-dir", str(directory)]
    daemon = ["run", *where, "--runs", str(arguments.runs)]
    stop, processes = StopSignals(), OwnProcesses(["emulate", *where], daemon)
    tour = asyncio.create_task(_guide(processes, directory, arguments.cycle, model))
    ending = asyncio.create_task(stop.wait(None))
    try:
        await asyncio.wait((tour, ending), return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in (tour, ending):
            task.cancel()
        outcome = (await asyncio.gather(tour, ending, return_exceptions=True))[0]
        await processes.end()
    if isinstance(outcome, asyncio.CancelledError):
        ended = "ended: the drives were stopped and switched off"
        return Result({"ended": ended}, f"\n{ended}")
    if isinstance(outcome, ProcessError | TourError | ClientError):
        raise CommandError("failed", f"\n{outcome}") from None
    if isinstance(outcome, BaseException):
        raise outcome
    return _result(Path(outcome))


async def _guide(processes: OwnProcesses, directory: Path, cycle_s: float, model: Path) -> str:
    """Returns the folder of the recording."""
    print("starting the emulated lab and the daemon", flush=True)
    await processes.start()
    controller = {"kind": "reward_weighted", "model": str(model)}
    return await Tour(directory, cycle_s, controller).run()


def _result(folder: Path) -> Result:
    result, report, lines = read_result(folder), write_report(folder), []
    if result is not None:
        lines = [
            f"\ndistance of the tip from its reference, {result.controller}:",
            table_text(result.cycles),
        ]
    told = {"recording": folder, "report": report, "result": result}
    return Result(told, "\n".join([*lines, f"\nreport: {report}"]))
