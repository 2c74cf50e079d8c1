"""STOP while the remote interface is flooded: `python -m tests.experiments.stop_under_flood`.

A lab and a daemon as processes of their own, the arm moving. For each flood and each way of
stopping: how many of the STOPs came through, and how long it took from `stop` in the client to the
quick stop on the bus, as the recording dates it. With root's rights also from its bytes on the
wire: what the daemon's side takes, whatever the client has to do before.
"""

import argparse
import asyncio
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, NamedTuple

import msgspec
import yaml

from daemon.messages import Event
from daemon.recording.format.channels import TOPICS
from daemon.recording.run_folder import RUN_FILE
from daemon.recording.run_parts import RunParts
from daemon.remote.client.client import RobotClient
from daemon.remote.client.client_errors import ClientError
from safety.states import OperatingState
from tests import SOFT_ARM
from tests.benchmarks.daemon import _process, first_quick_stop_ns, until_running
from tests.benchmarks.timing import percentiles
from tests.daemon.remote.over_tls import free_port, make_certificates
from tests.experiments.floods import FLOODS, local, remote
from tests.experiments.wire_tap import WireTap
from tests.hil.processes import command

NO_FLOOD: Final = "none"
LOCAL: Final = "local"
KEPT: Final = "tls, kept"
NEW: Final = "tls, new"
WAYS: Final = (LOCAL, KEPT, NEW)
OPERATOR: Final = "alice"
_USERS: Final = {OPERATOR: "operator", "bob": "viewer"}
_MOVES_FOR_S: Final = 0.3
_SETTLES_S: Final = 0.2
_LOOK_EVERY_S: Final = 0.1
_RECORDED_WITHIN_S: Final = 30.0
_STOPPING: Final = frozenset({"hold", "disarm", "fault", "estop"})


class Outcome:
    """Of one flood and one way."""

    def __init__(self) -> None:
        self.to_bus_ms: list[float] = []
        """From `stop` in the client to the quick stop on the bus."""
        self.from_wire_ms: list[float] = []
        """The same from the last byte of the STOP on the wire."""
        self.from_hello_ms: list[float] = []
        """The same from the connection's first byte, where it was a new one."""
        self.of_service_ms: list[float] = []
        """Of that, what did not pass while the client had the next word."""
        self.at_rest: list[str] = []
        """A stall of this machine had stopped the drives before anybody asked: why, as it is told.
        Every one of these STOPs was answered."""
        self.lost: list[str] = []

    def __str__(self) -> str:
        answered = len(self.to_bus_ms) + len(self.at_rest)
        rows = [f"{answered:>4} of {answered + len(self.lost):<4}"]
        for name, values in (
            ("", self.to_bus_ms),
            ("from its last byte", self.from_wire_ms),
            ("from its first byte", self.from_hello_ms),
            ("of that the service", self.of_service_ms),
        ):
            if values:
                figures = percentiles(values)
                rows.append(
                    f"{name:>20} median {figures['median']:6.2f}  p99 {figures['p99']:6.2f}  "
                    f"worst {figures['max']:6.2f} ms"
                )
        return f"\n{'':<41}".join([" ".join(rows[:2]), *rows[2:]])


class Asked(NamedTuple):
    """A STOP that was answered, to be looked up in the recording."""

    outcome: Outcome
    recording: Path
    asked_ns: int
    answered_ns: int
    confirmed: bool


def flooded(flood: str, stops: int, real_time: bool = True) -> dict[str, Outcome]:
    """By way: so many STOPs each, one way after the other, under this flood."""
    with lab_and_daemon(real_time) as (folder, port, stop_port), ExitStack() as stack:
        try:
            taps = [
                stack.enter_context(WireTap(stop_port, answers=answers))
                for answers in (False, True)
            ]
        except PermissionError:  # without them there are the client's own figures
            taps = []
        outcomes, asked = asyncio.run(_stopped(folder, port, stop_port, flood, stops, stack))
        for one in asked:
            told_ns = _look_up(one)
            if told_ns is not None and taps:
                sent_ns, answered_ns = (tap.between(one.asked_ns, told_ns) for tap in taps)
                _on_the_wire(one.outcome, sent_ns, answered_ns, told_ns)
        return outcomes


async def _stopped(
    folder: Path, port: int, stop_port: int, flood: str, stops: int, stack: ExitStack
) -> tuple[dict[str, Outcome], list[Asked]]:
    outcomes = {way: Outcome() for way in WAYS}
    asked: list[Asked] = []
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
                (LOCAL, local(folder).stop),
                (KEPT, lambda request, within_s: kept.stop(within_s)),
                (NEW, far.stop),
            ):
                one = await _stop_once(robot, stop, outcomes[way])
                asked += [] if one is None else [one]
        for one in asked:
            async with asyncio.timeout(_RECORDED_WITHIN_S):
                while not (one.recording / RUN_FILE).exists():  # the recorder finishes it
                    await asyncio.sleep(_LOOK_EVERY_S)
    return outcomes, asked


async def _stop_once(robot: RobotClient, stop: Any, outcome: Outcome) -> Asked | None:
    """None: it did not come through."""
    recording = Path(await until_running(robot))
    await asyncio.sleep(_MOVES_FOR_S)
    asked_ns = time.monotonic_ns()
    try:
        answer = await stop("experiment", 5.0)
    except ClientError as error:
        outcome.lost.append(str(error))
        await robot.stop()
        return None
    answered_ns = time.monotonic_ns()
    await asyncio.sleep(_SETTLES_S)
    return Asked(outcome, recording, asked_ns, answered_ns, answer.confirmed)


def _look_up(one: Asked) -> int | None:
    """When the quick stop was on the bus; None: it was not, or the drives did not confirm it."""
    outcome, asked_ns = one.outcome, one.asked_ns
    told_ns = first_quick_stop_ns(one.recording, asked_ns)
    if told_ns is None:
        why = _stopped_before(one.recording, asked_ns)
        if why:
            outcome.at_rest.append(why)
        else:
            outcome.lost.append("no quick stop in the recording, and nothing had stopped it before")
    elif not one.confirmed:
        outcome.lost.append("not confirmed by the drives")
        return None
    else:
        outcome.to_bus_ms.append((told_ns - asked_ns) * 1e-6)
    return told_ns


def _on_the_wire(
    outcome: Outcome, sent_ns: Sequence[int], answered_ns: Sequence[int], told_ns: int
) -> None:
    """sent_ns, answered_ns: when bytes went to the service and from it, before the quick stop."""
    if not sent_ns:
        return
    outcome.from_wire_ms.append((told_ns - sent_ns[-1]) * 1e-6)
    if len(sent_ns) > 1 and answered_ns:
        outcome.from_hello_ms.append((told_ns - sent_ns[0]) * 1e-6)
        of_client_ns = sent_ns[-1] - answered_ns[-1]
        outcome.of_service_ms.append((told_ns - sent_ns[0] - of_client_ns) * 1e-6)


def _stopped_before(recording: Path, asked_ns: int) -> str:
    """The state that the robot had left RUNNING for before it was asked, and why; empty: none."""
    topic, decoder = TOPICS[Event], msgspec.json.Decoder(Event)
    events = [decoder.decode(message.data) for message in RunParts(recording).messages([topic])]
    before = [event for event in events if event.t_ns <= asked_ns]
    states = [event.name for event in before if event.kind == "state"]
    if not states or states[-1] == OperatingState.RUNNING.value:
        return ""
    causes = dict.fromkeys(e.name for e in before if e.kind == "cause" and e.severity in _STOPPING)
    return f"{states[-1]}: {', '.join(causes) or 'unknown'}"


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
            for why in sorted(set(outcome.at_rest)):
                print(f"{'':<31} at rest before it was asked: {why}", flush=True)
            for why in sorted(set(outcome.lost)):
                print(f"{'':<31} lost: {why}", flush=True)


if __name__ == "__main__":
    main()
