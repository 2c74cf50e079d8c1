"""Steering by hand, in processes: a scripted 3D mouse at a pipe, `tentacled teleoperate`, the
daemon and its lab. Whatever ends the hand, the daemon holds by itself."""

import os
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from math import dist
from pathlib import Path

import pytest

from daemon.remote.client.token_file import StoredLease, store_lease, token_file
from daemon.steering.station import Replayed, replayed
from safety.states import OperatingState as S
from tests.daemon.steering.scripted import CLUTCH, CLUTCH_OUT, DEAD_MAN, LET_GO, Puck
from tests.hil.daemon_rig import PATIENT, Rig, rig
from tests.hil.processes import PATIENCE_S, command

pytestmark = [pytest.mark.long, pytest.mark.hil, pytest.mark.xdist_group("steering")]

CONTROLLER = "constant_curvature"
"""It needs no exploration: motion begins at once."""
STANDS = (S.HOLD, S.ARMED)
"""Energised and at rest: held, and again when what held it is over."""
LED_MM = 4.0
NEAR_MM = 2.0
"""Between a reference and the tip that stands."""


@pytest.fixture
def one() -> Iterator[Rig]:
    with rig(PATIENT) as robot:
        yield robot


@contextmanager
def teleoperated(
    one: Rig, *words: str | Path, controller: str = CONTROLLER
) -> Iterator["subprocess.Popen[bytes]"]:
    """`tentacled teleoperate` with the lease of who has armed the robot."""
    one.armed()
    token, user = one.client._lease.token, "local"
    store_lease(token_file(one.folder, user), StoredLease(user, token))
    whole = ["teleoperate", "--runtime-dir", str(one.folder), "--controller", controller]
    process = subprocess.Popen(command(*whole, *map(str, words)))
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@contextmanager
def by_hand(
    one: Rig, *words: str | Path, controller: str = CONTROLLER
) -> Iterator[tuple["subprocess.Popen[bytes]", Puck]]:
    pipe = one.folder / "puck"
    if not pipe.exists():
        os.mkfifo(pipe)
    with teleoperated(one, "--device", pipe, *words, controller=controller) as process:
        puck = Puck(pipe)
        one.until_it_was(S.RUNNING)
        yield process, puck


def tip(one: Rig) -> Sequence[float]:
    while (found := one.status().tip_mm) is None:
        time.sleep(0.02)
    return found


def until_led(one: Rig, begin: Sequence[float], axis: int) -> None:
    one.until(lambda: tip(one)[axis] - begin[axis] > LED_MM)


def until_held(one: Rig) -> None:
    """By the daemon itself, because no set-point came."""
    one.until_told("setpoint_late")
    one.until_state(*STANDS)


def until_led_on(one: Rig) -> None:
    one.until(lambda: one.state is S.RUNNING and not one.causes())


def test_a_hand_leads_the_tip_lets_go_and_leads_on(one: Rig) -> None:
    with by_hand(one) as (_, puck):
        until_held(one)
        begin = tip(one)
        puck.push(350)
        time.sleep(1.0)
        assert one.state in STANDS, "nobody holds the dead-man's key"
        puck.key(DEAD_MAN)
        until_led(one, begin, 0)
        puck.key(CLUTCH)
        time.sleep(1.0)
        stood = tip(one)
        time.sleep(1.0)
        assert one.state is S.RUNNING
        assert dist(tip(one), stood) < NEAR_MM, "the hand comes back, the tip stays"
        puck.push(0, -350)
        time.sleep(0.5)
        puck.key(CLUTCH_OUT)
        until_led(one, stood, 1)
        one.from_now_on()
        puck.key(LET_GO)
        until_held(one)
        time.sleep(0.5)
        stood = tip(one)
        puck.push()
        puck.key(DEAD_MAN)
        until_led_on(one)
        one.until(lambda: one.status().reference_mm is not None)
        reference = one.status().reference_mm
        assert reference is not None
        assert dist(reference, tip(one)) < NEAR_MM, "it begins where the tip is"
        assert dist(stood, tip(one)) < NEAR_MM


def test_an_unplugged_device_and_a_killed_client_hold_the_robot(one: Rig) -> None:
    with by_hand(one) as (process, puck):
        puck.key(DEAD_MAN)
        until_led_on(one)
        one.from_now_on()
        puck.pull_out()
        assert process.wait(PATIENCE_S) == 0
        one.until_state(*STANDS)
    with by_hand(one) as (process, puck):
        puck.key(DEAD_MAN)
        until_led_on(one)
        one.from_now_on()
        process.kill()
        until_held(one)
        puck.pull_out()


def test_what_was_recorded_is_asked_for_again_to_the_last_bit(one: Rig, tmp_path: Path) -> None:
    journal = tmp_path / "journal"
    with by_hand(one, "--record", journal) as (process, puck):
        until_held(one)
        begin = tip(one)
        puck.push(200, -100, 50)
        puck.key(DEAD_MAN)
        until_led(one, begin, 0)
        puck.pull_out()
        assert process.wait(PATIENCE_S) == 0
    asked = whole(journal)
    assert asked == whole(journal)
    last = next(one.target for one in reversed(asked) if one.target is not None)
    with teleoperated(one, "--replay", journal) as process:
        one.until_it_was(S.RUNNING)
        one.until(lambda: dist(tip(one), last.position_mm) < LED_MM)
        assert process.wait(PATIENCE_S) == 0


def whole(journal: Path) -> list[Replayed]:
    with journal.open("rb") as lines:
        return list(replayed(lines))
