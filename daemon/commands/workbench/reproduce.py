"""`tentacled reproduce STUDY --out DIR`: a paper's experiments, its tables with ours in them."""

import argparse

from daemon.commands.outcome.result import Result
from daemon.commands.terminal.study_command import add_grid_arguments, shipped_study


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("study", metavar="STUDY", help="ho2018, or a study file")
    add_grid_arguments(parser)
    parser.add_argument(
        "--only",
        nargs="+",
        default=[],
        metavar="NAME",
        help="run these experiments or controllers alone; the tables show all that is there",
    )


def run(arguments: argparse.Namespace) -> Result:
    # matplotlib is slow to come: `--help` does without.
    from daemon.commands.terminal.study_command import Only, WriteUp, carry_out_study
    from daemon.workbench.studies.write_up import reproduction_figures, reproduction_tables

    path = shipped_study(arguments.study)
    how = WriteUp(reproduction_tables, reproduction_figures)
    only: Only = {"experiments and controllers": arguments.only}
    return carry_out_study(path, arguments, only, lambda _: how)
