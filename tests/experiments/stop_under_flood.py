"""STOP while the remote interface is flooded: `python -m tests.experiments.stop_under_flood`.

A lab and a daemon as processes of their own, the arm moving. For each flood and each way of
stopping: how many of the STOPs came through, and how long it took from `stop` in the client to the
quick stop on the bus, as the recording dates it.
"""

import argparse
import asyncio
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import yaml

from daemon.recording.run_folder import RUN_FILE
from daemon.remote.client.client import RobotClient
from daemon.remote.client.client_errors import ClientError
from tests import SOFT_ARM
from tests.benchmarks.daemon import _first_quick_stop_ns, _process, until_running
from tests.benchmarks.timing import percentiles
from tests.daemon.remote.over_tls import free_port, make_certificates
from tests.experiments.floods import FLOODS, local, remote
from tests.hil.processes import command

NO_FLOOD: Final = "none"
WAYS: Final = ("local", "tls, kept", "tls, new")
OPERATOR: Final = "alice"
_USERS: Final = {OPERATOR: "operator", "bob": "viewer"}
_MOVES_FOR_S: Final = 0.3
_SETTLES_S: Final = 0.5
_RECORDED_WITHIN_S: Final = 30.0


class Outcome:
    """Of one flood and one way."""

    def __init__(self) -> None:
        self.to_bus_ms: list[float] = []
        self.lost: list[str] = []

    def __str__(self) -> str:
        count = len(self.to_bus_ms)
        if not count:
            return f"{0:>4} of {len(self.lost):<4}"
        figures = percentiles(self.to_bus_ms)
        return (
            f"{count:>4} of {count + len(self.lost):<4} median {figures['median']:6.2f}  "
            f"p99 {figures['p99']:6.2f}  worst {figures['max']:6.2f} ms"
        )


def flooded(flood: str, stops: int, real_time: bool = True) -> dict[str, Outcome]:
    """By way: so many STOPs each, one way after the other, under this flood."""
    with lab_and_daemon(real_time) as (folder, port, stop_port), ExitStack() as stack:
        return asyncio.run(_stopped(folder, port, stop_port, flood, stops, stack))


async def _stopped(
    folder: Path, port: int, stop_port: int, flood: str, stops: int, stack: ExitStack
) -> dict[str, Outcome]:
    outcomes = {way: Outcome() for way in WAYS}
    far = remote(folder, port, stop_port, OPERATOR)
    async with (
        await RobotClient.connect(local(folder), wait_s=30.0) as robot,
        await RobotClient.connect(far, wait_s=30.0) as kept,
    ):
        await until_running(robot)  # everything has been started and compiled
        await robot.stop()
        if flood != NO_FLOOD:
            where = [str(folder), str(port), str(stop_port)]
            words = [sys.executable, "-m", "tests.experiments.floods", flood, *where]
            stack.enter_context(_process(words))
        for _ in range(stops):
            for way, stop in (
                ("local", local(folder).stop),
                ("tls, kept", lambda request, within_s: kept.stop(within_s)),
                ("tls, new", far.stop),
            ):
                await _stop_once(robot, stop, outcomes[way])
    return outcomes


async def _stop_once(robot: RobotClient, stop: Any, outcome: Outcome) -> None:
    recording = await until_running(robot)
    await asyncio.sleep(_MOVES_FOR_S)
    asked_ns = time.monotonic_ns()
    try:
        answer = await stop("experiment", 5.0)
    except ClientError as error:
        outcome.lost.append(str(error))
        await robot.stop()
        return
    if not answer.confirmed:
        outcome.lost.append("not confirmed")
    await asyncio.sleep(_SETTLES_S)
    async with asyncio.timeout(_RECORDED_WITHIN_S):
        while not (Path(recording) / RUN_FILE).exists():  # the recorder finishes it
            await asyncio.sleep(_SETTLES_S)
    told_ns = _first_quick_stop_ns(Path(recording), asked_ns)
    if told_ns is None:
        outcome.lost.append("no quick stop in the recording")
        return
    outcome.to_bus_ms.append((told_ns - asked_ns) * 1e-6)


@contextmanager
def lab_and_daemon(real_time: bool = True) -> Iterator[tuple[Path, int, int]]:
    """The shipped arm, reachable on this machine and over tls: folder, port and STOP's port."""
    with TemporaryDirectory(prefix="t-", ignore_cleanup_errors=True) as name:
        folder = Path(name)
        make_certificates(folder / "certificates")
        port, stop_port = free_port(), free_port()
        robot = yaml.safe_load(SOFT_ARM.read_text())
        robot["remote"] = {
            "tls": {
                "endpoint": f"127.0.0.1:{port}",
                "stop_endpoint": f"127.0.0.1:{stop_port}",
                "certificates": "certificates",
            },
            "users": _USERS,
        }
        path = folder / "robot.yaml"
        path.write_text(yaml.safe_dump(robot))
        where = [str(path), "--runtime-dir", name]
        more = [] if real_time else ["--no-real-time"]
        with (
            _process(command("emulate", *where)),
            _process(command("run", *where, "--runs", f"{name}/runs", *more)),
        ):
            yield folder, port, stop_port


def main() -> None:
    """A table of all floods and ways."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--stops", type=int, default=50, help="of each way, under each flood")
    parser.add_argument("--flood", choices=[NO_FLOOD, *FLOODS], action="append")
    arguments = parser.parse_args()
    for flood in arguments.flood or [NO_FLOOD, *FLOODS]:
        try:
            outcomes = flooded(flood, arguments.stops)
        except (ClientError, AssertionError, subprocess.SubprocessError) as error:
            print(f"{flood:<20} {error}", flush=True)
            continue
        for way, outcome in outcomes.items():
            print(f"{flood:<20} {way:<10} {outcome}", flush=True)
            for why in sorted(set(outcome.lost)):
                print(f"{'':<31} lost: {why}", flush=True)


if __name__ == "__main__":
    main()
