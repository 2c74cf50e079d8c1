"""`tentacled compare --out DIR`: all controllers on the same experiments, side by side."""

import argparse

from daemon.commands.outcome.result import Result
from daemon.commands.terminal.study_command import add_grid_arguments, shipped_study


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_grid_arguments(parser)
    parser.add_argument(
        "--study", default="controllers", metavar="STUDY", help="which; default: controllers"
    )
    parser.add_argument(
        "--experiments", nargs="+", default=[], metavar="NAME", help="default: all of the study's"
    )
    parser.add_argument(
        "--controllers", nargs="+", default=[], metavar="NAME", help="default: all of the study's"
    )


def run(arguments: argparse.Namespace) -> Result:
    # matplotlib is slow to come: `--help` does without.
    from daemon.commands.terminal.study_command import Only, WriteUp, carry_out_study
    from daemon.workbench.bench.figure import bench_figures
    from daemon.workbench.bench.tables import bench_files, bench_tables
    from daemon.workbench.studies.write_up import comparison_figures, comparison_tables

    bench = WriteUp(bench_tables, bench_figures, bench_files)
    comparison = WriteUp(comparison_tables, comparison_figures)
    path = shipped_study(arguments.study)
    only: Only = {"experiments": arguments.experiments, "controllers": arguments.controllers}
    return carry_out_study(path, arguments, only, lambda file: bench if file.cells else comparison)
