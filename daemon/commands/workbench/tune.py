"""`tentacled tune STUDY --out DIR`: seek the options that its variants declare, all alike."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from daemon.commands.outcome.exit_codes import EXIT_FAILED, EXIT_OK
from daemon.commands.outcome.result import Result
from daemon.commands.terminal.argument_types import seed_number
from daemon.commands.terminal.event_log import add_log_argument
from daemon.commands.terminal.study_command import shipped_study
from daemon.commands.terminal.work_sharing import add_scheduler_argument

if TYPE_CHECKING:
    from daemon.workbench.bench.tuning import Candidate, Stage
    from daemon.workbench.studies.study_file import StudyFile

TUNED_FILE = "tuned.yaml"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("study", metavar="STUDY", help="bench_tuning, or a study file")
    parser.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="DIR",
        help="for runs and what was found; runs that are there and finished are not done again",
    )
    parser.add_argument(
        "--points", type=int, default=8, metavar="N", help="for each variant (default %(default)s)"
    )
    parser.add_argument(
        "--seed", type=seed_number, default=1, metavar="N", help="of the points: default 1"
    )
    parser.add_argument(
        "--jobs", type=int, default=2, metavar="N", help="processes at the same time (default 2)"
    )
    parser.add_argument(
        "--controllers", nargs="+", default=[], metavar="NAME", help="default: all of the study's"
    )
    add_scheduler_argument(parser)
    add_log_argument(parser)
    parser.set_defaults(keep_recordings=False)


def run(arguments: argparse.Namespace) -> Result:
    # What searches is slow to come: `--help` does without.
    from daemon.files import write_whole
    from daemon.workbench.bench import tuning
    from daemon.workbench.experiments.trial import TrialError
    from daemon.workbench.studies.run import PlanError
    from daemon.workbench.studies.study_file import load_study

    if arguments.points < 1 or arguments.jobs < 1:
        raise PlanError("--points and --jobs are 1 or more")
    file = load_study(shipped_study(arguments.study))
    study = file.study
    left = tuning.candidates(study, arguments.points, arguments.seed, arguments.controllers)
    scored: dict[str, float] = {}
    errors = 0
    for stage in tuning.stages(arguments.points, len(file.experiments)):
        left = tuning.survivors(left, scored, stage.points)
        scored, failed = _stage(file, left, stage, arguments)
        errors += failed
    best = tuning.survivors(left, scored, 1)
    winners = [one for one in best if one.variant.variant in scored]
    if not winners:
        raise TrialError(f"nothing was found: no run was carried out; {arguments.out} has why")
    bodies = range(study.first_plant, study.first_plant + study.plants) if study.plants else (0,)
    search = tuning.search_text(file, arguments.points, arguments.seed, bodies)
    text = tuning.tuned_text(study, winners, scored, search)
    path = arguments.out / TUNED_FILE
    write_whole(path, text.encode())
    found = {one.of: dict(one.options) for one in winners}
    untuned = [one.of for one in best if one not in winners]
    told = {
        "study": study.study,
        "tuned": found,
        "untuned": untuned,
        "errors": errors,
        "written": path,
    }
    if untuned:
        text += f"nothing was found for {', '.join(untuned)}: no run was carried out\n"
    return Result(told, f"{text}{path}", EXIT_FAILED if errors or untuned else EXIT_OK)


def _stage(
    file: "StudyFile", left: list["Candidate"], stage: "Stage", arguments: argparse.Namespace
) -> tuple[dict[str, float], int]:
    """What each candidate is worth on the stage's cells, and how many runs could not be done."""
    from daemon.commands.terminal.study_command import carry_out_runs
    from daemon.workbench.bench import tuning
    from daemon.workbench.studies.grid import Grid
    from daemon.workbench.studies.run import plan

    cells = list(file.experiments)[: stage.cells]
    with_them = tuning.with_candidates(file, left)
    runs = plan(with_them, file.study.seeds, file.study.plants, cells)
    errors = carry_out_runs(runs, arguments)
    return tuning.scores(Grid(runs, arguments.out).outcomes(), file.study), errors
