"""`tentacled mdn collect ROBOT.yaml --out CLOUDS.npz`: what cameras see of an emulated body."""

import argparse
import sys
from pathlib import Path

from daemon.cli import EXIT_FAILED, EXIT_OK, EXIT_USAGE
from daemon.robot_argument import add_robot_argument, robot_or_explain

_OF_TEN_TO_TEST = 0.1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_robot_argument(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="CLOUDS.npz")
    parser.add_argument(
        "--configurations",
        type=int,
        default=2530,
        metavar="N",
        help="a tenth of them is for tests (default: %(default)s, as in the paper)",
    )
    parser.add_argument(
        "--starts",
        type=int,
        default=12,
        metavar="N",
        help="from which each is come to (default: %(default)s)",
    )
    parser.add_argument(
        "--points", type=int, default=256, metavar="N", help="kept of each cloud (default: 256)"
    )
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="default: %(default)s")
    parser.add_argument(
        "--processes", type=int, default=2, metavar="N", help="default: %(default)s"
    )


def run(arguments: argparse.Namespace) -> int:
    # The plant's compiled code is slow to come: `--help` does without.
    from daemon.risk.cloud_dataset import CloudDatasetError
    from daemon.risk.collection import CollectionError, CollectionSettings
    from daemon.risk.collection_bar import CollectionBar
    from daemon.risk.emulated_body import UnreachableError
    from daemon.risk.parallel_collection import collect
    from daemon.worker_processes import worker_processes
    from sim_backends.lab import LabError

    checked = robot_or_explain(arguments.robot)
    if checked is None:
        return EXIT_FAILED
    try:
        test = round(_OF_TEN_TO_TEST * arguments.configurations)
        settings = CollectionSettings(
            arguments.configurations - test,
            test,
            arguments.starts,
            arguments.points,
            arguments.seed,
        )
        if arguments.processes < 1:
            raise ValueError("there must be a process")
    except ValueError as error:
        print(error, file=sys.stderr)
        return EXIT_USAGE
    try:
        with CollectionBar() as bar, worker_processes(arguments.processes) as workers:
            made = collect(checked.file, settings, arguments.out, workers, bar)
    except (CollectionError, UnreachableError, CloudDatasetError, LabError, OSError) as error:
        print(error, file=sys.stderr)
        return EXIT_FAILED
    clouds = len(made) * settings.starts
    print(
        f"{arguments.out}: {len(made)} configurations ({int(made.test.sum())} to test with, "
        f"{int(made.block.sum())} in the block), {clouds} clouds of {settings.points} points"
    )
    return EXIT_OK
