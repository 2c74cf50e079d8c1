"""Work that other machines may do: one share of it, or all of it by the workers of a cluster."""

import argparse
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from daemon.host.processes import Share, worker_processes


def share(text: str) -> Share:
    """Of `--share`: argparse tells what is wrong with it."""
    try:
        return Share.of(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def add_scheduler_argument(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--scheduler",
        metavar="tcp://HOST:PORT",
        help="of a dask cluster: its workers do it, not processes here (docs/cluster.md)",
    )


@contextmanager
def workers_of(scheduler: str | None, processes: int) -> Iterator[Executor]:
    """Of a cluster, or else processes here. Raises ClusterError, ClusterMismatchError."""
    if scheduler is None:
        with worker_processes(processes) as workers:
            yield workers
        return
    from daemon.workbench.cluster.cluster_workers import cluster_workers

    with cluster_workers(scheduler) as workers:
        yield workers
