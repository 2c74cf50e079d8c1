"""The workers of a dask cluster as an executor, with no worker that would compute something else.

A worker that is lost in the middle of a task costs that task's time: the scheduler gives it to
another one. What a task raises is its result, and not tried again. Tasks take and give plain data:
nothing is read or written on a disk that all machines would have to share.
"""

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any, Final, TypeVar

from daemon.workbench.cluster.sameness import Facts, differences, facts

T = TypeVar("T")

_ANSWERS_WITHIN_S: Final = 10.0
_WORKERS_WITHIN_S: Final = 30.0
_FACTS_WITHIN_S: Final = 120.0
"""A worker imports nothing of ours before it is asked."""


class ClusterError(RuntimeError):
    """No cluster, or none with workers; the text says what to do."""


class ClusterMismatchError(RuntimeError):
    """A worker would compute something else; the text names what differs."""


@contextmanager
def cluster_workers(scheduler: str) -> Iterator[Executor]:
    """The workers of the scheduler at `tcp://host:port`. Raises ClusterError, ClusterMismatchError.

    Whoever joins later is looked at with the first task that it gets.
    """
    if find_spec("distributed") is None:
        raise ClusterError(
            "this needs the library 'distributed', which is not installed: "
            "pip install 'tentacled[cluster]'"
        )
    from distributed import Client

    try:
        client = Client(scheduler, timeout=_ANSWERS_WITHIN_S, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:
        raise ClusterError(f"no scheduler answers at {scheduler}: {error}") from None
    try:
        _check(client, scheduler)
        yield _CheckedExecutor(client.get_executor(pure=False, retries=0))
    finally:
        client.close(timeout=_ANSWERS_WITHIN_S)


def _check(client: Any, scheduler: str) -> None:
    """Raises ClusterError, ClusterMismatchError."""
    try:
        client.wait_for_workers(1, timeout=_WORKERS_WITHIN_S)
    except TimeoutError:
        raise ClusterError(
            f"the scheduler at {scheduler} has no workers: "
            f"dask worker {scheduler} --nthreads 1 --nworkers auto"
        ) from None
    for address, about in client.scheduler_info(n_workers=-1)["workers"].items():
        if about["nthreads"] != 1:
            raise ClusterMismatchError(
                f"{address}: it has {about['nthreads']} threads, and one thread's work would be in "
                "the other's way: start it with --nthreads 1"
            )
    told = client.run(_told_facts, on_error="return")
    for address, there in sorted(told.items()):
        check_sameness(address, facts(), there)


def check_sameness(address: str, here: Facts, there: Facts | BaseException) -> None:
    """Raises ClusterMismatchError, which names the worker and all that differs."""
    if not isinstance(there, Mapping):
        raise ClusterMismatchError(f"{address}: tentacled does not work there: {there}")
    if different := differences(here, there):
        raise ClusterMismatchError(f"{address}: {'; '.join(different)}")


def _told_facts() -> Facts:
    """On a worker."""
    return facts()


def checked(here: Facts, task: Callable[..., T], *more: Any) -> T:
    """On a worker: do a task of who has these facts. Raises ClusterMismatchError."""
    check_sameness("a worker that came later", here, facts())
    return task(*more)


class _CheckedExecutor(Executor):
    """Sends with each task what the worker has to be like."""

    def __init__(self, executor: Any) -> None:
        self._executor = executor

    def submit(self, task: Callable[..., T], /, *more: Any, **named: Any) -> "Future[T]":
        assert not named, "tasks have no named arguments"
        future: Future[T] = self._executor.submit(checked, facts(), task, *more)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        self._executor.shutdown(wait=wait, cancel_futures=cancel_futures)
