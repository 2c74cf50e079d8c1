"""`tentacled teleoperate --device`: in a process of its own, with a scripted hand at a pipe."""

import asyncio
import os
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from daemon.commands.outcome.exit_codes import (
    EXIT_DATA,
    EXIT_NO_INPUT,
    EXIT_UNAVAILABLE,
    EXIT_USAGE,
)
from daemon.commands.terminal.command_line import main
from daemon.messages import Setpoint, SetpointRefused
from daemon.steering.devices import DeviceState
from daemon.steering.hid_device import HidDevice, HidDeviceError, looks_like
from daemon.steering.input_events import EV_ABS, EV_KEY, EV_REL, EventStream
from daemon.steering.station import replayed
from tests.daemon.remote.commands.typed import Daemon, started
from tests.daemon.remote.rig import ROBOT, WITHIN_S, FakeRobot, tip
from tests.daemon.steering.scripted import DEAD_MAN, LET_GO, Puck

OK = 0
TIP = (1.1, 2.1, 103.4)
"""Where the fake robot's stands."""


@pytest.fixture(autouse=True)
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where daemons of this test run if nobody says otherwise."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    return tmp_path / "tentacled"


@pytest.fixture
def pipe(tmp_path: Path) -> Path:
    path = tmp_path / "puck"
    os.mkfifo(path)
    return path


class WithTips(Daemon):
    """... that tells where the tip is, 50 times a second."""

    def __enter__(self) -> FakeRobot:
        robot = super().__enter__()
        self._ended = threading.Event()
        self._teller = threading.Thread(target=self._tell, daemon=True)
        self._teller.start()
        return robot

    def __exit__(self, *why: object) -> None:
        self._ended.set()
        self._teller.join()
        super().__exit__(*why)

    def _tell(self) -> None:
        number = 0
        while not self._ended.wait(0.02):
            number += 1
            self._loop.call_soon_threadsafe(self.server.publish, tip(number))
            if number % 5 == 0:
                self._loop.call_soon_threadsafe(self.server.publish, self.robot.status())


def until(wanted: Callable[[], object]) -> None:
    deadline_s = time.monotonic() + WITHIN_S
    while not wanted():
        assert time.monotonic() < deadline_s, "not in time"
        time.sleep(0.01)


def places(robot: FakeRobot) -> list[list[float]]:
    return [setpoint.position_mm for _, setpoint in robot.setpoints]


def ended(process: "subprocess.Popen[str]") -> str:
    """What it has said, when it has ended well."""
    assert process.wait(WITHIN_S) == OK
    assert process.stderr is not None
    return process.stderr.read()


def test_a_hand_leads_the_tip_and_a_journal_of_it_leads_it_the_same_way(
    root: Path, pipe: Path, tmp_path: Path
) -> None:
    journal = tmp_path / "journal"
    with WithTips(root / ROBOT) as robot:
        words = ("--device", pipe, "--record", journal, "--controller", "broyden")
        with started("teleoperate", *words, "--leash", "50") as hand:
            puck = Puck(pipe)
            until(lambda: "teleoperate" in robot.verbs())
            puck.push(350)
            time.sleep(0.3)
            assert robot.setpoints == []
            puck.key(DEAD_MAN)
            until(lambda: len(robot.setpoints) > 20)
            puck.key(LET_GO)
            time.sleep(0.3)
            there = len(robot.setpoints)
            time.sleep(0.3)
            assert len(robot.setpoints) == there
            robot.state = "hold"
            time.sleep(0.3)
            puck.key(DEAD_MAN)
            until(lambda: "resume" in robot.verbs())
            puck.push(0, 0, -350)
            until(lambda: len(robot.setpoints) > there + 20)
            puck.pull_out()
            assert "the device has gone" in ended(hand)
        led = places(robot)
        assert tuple(led[0]) == TIP
        assert led[19][0] > TIP[0] + 3.0
        assert tuple(led[there]) == TIP
        assert led[-1][2] > TIP[2] + 2.0
        assert robot.verbs()[-1] == "hold"
        command = robot.carried_out[0][1]
        assert getattr(command, "controller", None) == {"kind": "broyden"}
        robot.setpoints.clear()
        robot.state = "running"
        robot.lease = type(robot.lease)(60.0)
        robot._sequence = -1
        with started("teleoperate", "--replay", journal) as again:
            ended(again)
        with journal.open("rb") as lines:
            asked = [one.target for one in replayed(lines) if one.target is not None]
        assert_among(led, [list(one.position_mm) for one in asked])
        assert_among(places(robot), [list(one.position_mm) for one in asked])


def assert_among(came: list[list[float]], asked: list[list[float]]) -> None:
    """In their order and to the last bit; of what a busy machine sends at once, some is dropped."""
    rest = iter(asked)
    assert all(one in rest for one in came)
    assert len(came) > 0.5 * len(asked)


class Walled(FakeRobot):
    """Its workspace ends 1 mm to the right of its tip."""

    def setpoint(self, user: str, setpoint: Setpoint) -> SetpointRefused | None:
        if setpoint.position_mm[0] > TIP[0] + 1.0:
            return SetpointRefused(sequence=setpoint.sequence, reason="outside", user=user)
        return super().setpoint(user, setpoint)


def test_a_hand_that_pushes_against_the_workspace_s_end_stays_there(root: Path, pipe: Path) -> None:
    with (
        WithTips(root / ROBOT, Walled()) as robot,
        started("teleoperate", "--device", pipe, "--leash", "50") as hand,
    ):
        puck = Puck(pipe)
        until(lambda: "teleoperate" in robot.verbs())
        puck.key(DEAD_MAN)
        puck.push(350)
        until(lambda: len(robot.setpoints) > 30)
        puck.push(-350)
        until(lambda: places(robot)[-1][0] < TIP[0])
        puck.pull_out()
        said = ended(hand)
    assert said.count("refused: outside") == 1
    assert max(place[0] for place in places(robot)) > TIP[0] + 0.4


def test_where_the_tip_points_is_asked_for_where_it_is_steered(root: Path, pipe: Path) -> None:
    with (
        WithTips(root / ROBOT) as robot,
        started("teleoperate", "--device", pipe, "--pointing") as hand,
    ):
        puck = Puck(pipe)
        puck.key(DEAD_MAN)
        puck.push(0, 0, 0, 350)
        until(lambda: len(robot.setpoints) > 20)
        puck.pull_out()
        ended(hand)
    directions = [setpoint.direction for _, setpoint in robot.setpoints]
    assert directions[0] == [0.0, 0.0, 1.0]
    last = directions[-1]
    assert last is not None
    assert last[1] < -0.05
    assert last[2] > 0.9


def test_what_is_killed_sends_nothing_any_more(root: Path, pipe: Path) -> None:
    with (
        WithTips(root / ROBOT) as robot,
        started("teleoperate", "--device", pipe) as hand,
    ):
        puck = Puck(pipe)
        puck.key(DEAD_MAN)
        until(lambda: len(robot.setpoints) > 5)
        hand.kill()
        hand.wait()
        time.sleep(0.1)
        there = len(robot.setpoints)
        time.sleep(0.3)
        assert len(robot.setpoints) == there
        puck.pull_out()


@pytest.mark.parametrize(
    ("words", "what", "code"),
    [
        (("--device", "/nowhere"), "/nowhere: No such file", EXIT_UNAVAILABLE),
        (("--replay", "/nowhere"), "/nowhere: No such file", EXIT_NO_INPUT),
        (("--record", "x"), "--record goes with --device", EXIT_USAGE),
        (("--device", "x", "--axes", "up"), "axes are such as", EXIT_USAGE),
        (("--device", "x", "--speed", "0"), "more than 0", EXIT_USAGE),
        (("--controller", "{"), "--controller", EXIT_USAGE),
    ],
)
def test_what_cannot_be_is_said(
    words: tuple[str, ...], what: str, code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["teleoperate", *words]) == code
    assert what in capsys.readouterr().err


def test_a_file_that_is_no_journal_is_said_to_be_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "journal"
    path.write_bytes(msgspec.json.encode({"kind": "x"}) + b"\n")
    assert main(["teleoperate", "--replay", str(path)]) == EXIT_DATA
    assert f"{path}: line 1" in capsys.readouterr().err


def test_a_character_device_that_is_none_of_the_kernel_s_inputs_is_said_so() -> None:
    with pytest.raises(HidDeviceError, match=r"evdev|/dev/null"):
        HidDevice(Path("/dev/null"), None)


# A device of the kernel's: emulated, where the machine has /dev/uinput and evdev.

NO_UINPUT = "needs evdev and /dev/uinput, which may be written"


@pytest.mark.skipif(not os.access("/dev/uinput", os.W_OK), reason=NO_UINPUT)
def test_a_gamepad_of_the_kernel_s_is_known_by_its_axes_and_read() -> None:
    evdev = pytest.importorskip("evdev")
    stick = evdev.AbsInfo(value=0, min=-100, max=100, fuzz=0, flat=0, resolution=0)
    keys = {EV_KEY: [0x136, 0x137], EV_ABS: [(code, stick) for code in range(6)]}
    with evdev.UInput(keys, name="scripted gamepad") as pad:
        time.sleep(0.5)
        device = HidDevice(Path(pad.device.path), None)
        assert device.kind.profile == "gamepad"
        assert device.kind.ranges[0] == (-100.0, 100.0)
        came = bytearray()

        async def read() -> None:
            reading = asyncio.ensure_future(device.follow(came.extend))
            pad.write(EV_KEY, 0x137, 1)
            pad.write(EV_ABS, 0, 100)
            pad.syn()
            while not came:
                await asyncio.sleep(0.01)
            reading.cancel()

        asyncio.run(read())
        device.close()
    state = DeviceState(device.kind.made())
    for report in EventStream().feed(bytes(came)):
        state.take(report, 0)
    assert state.dead_man
    assert state.rates(0)[0] == 1.0


class FakeInput:
    """As much of `evdev.InputDevice` as is asked of it."""

    def __init__(self, codes: dict[int, list[int]]) -> None:
        self._codes = codes

    def capabilities(self, absinfo: bool = True) -> dict[int, list[int]]:
        assert not absinfo
        return self._codes


@pytest.mark.parametrize(
    ("codes", "profile"),
    [
        ({EV_KEY: [0x100, 0x101], EV_REL: list(range(6))}, "3d_mouse"),
        ({EV_KEY: [0x100], EV_ABS: list(range(6))}, "3d_mouse"),
        ({EV_KEY: [0x130, 0x136, 0x137], EV_ABS: [0, 1, 2, 3, 4, 5, 16, 17]}, "gamepad"),
        ({EV_KEY: [0x110, 0x111], EV_REL: [0, 1, 8]}, "mouse"),
        ({EV_KEY: list(range(1, 84))}, ""),
        ({EV_ABS: list(range(6))}, ""),
    ],
)
def test_a_device_is_known_by_its_keys_and_axes(codes: dict[int, list[int]], profile: str) -> None:
    assert looks_like(FakeInput(codes)) == profile
