"""From whatever state an earlier client left the device in, the driver gets to tracking."""

import asyncio
import dataclasses
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from config.tracker import ToolSelector
from drivers.aurora.bring_up import CONTROL_UNIT
from drivers.aurora.codec.versions import ApiRevision
from drivers.aurora.tracker import TrackerState
from drivers.byte_stream import ByteReceiver, ByteStream, StreamError
from sim_backends.devices.aurora import device as emulated_device
from sim_backends.devices.aurora import identity
from sim_backends.devices.aurora.command_interface import CommandError, TrackerMode
from sim_backends.virtual_time import run_in_virtual_time
from tests.drivers.aurora.golden import COMMANDS
from tests.drivers.aurora.rig import (
    BASE,
    EXACT,
    TIP,
    Ears,
    Rig,
    configured,
    emulated,
    leave_behind,
    running,
    until_tracking,
)

INIT = ("INIT:", 9600)
TO_115200 = ("COMM:50000", 9600)


def at(baud_rate: int, *words: str) -> list[tuple[str, int]]:
    return [(word, baud_rate) for word in words]


TRACKING = ["PHSR:02", "PINIT:0A", "PINIT:0B", "PENA:0AD", "PENA:0BD", "TSTART:"]

LEFT_BEHIND: dict[str, list[tuple[str, int]]] = {
    "initialised": [INIT],
    "at 38400": [INIT, ("COMM:30000", 9600)],
    "at 57600": [INIT, ("COMM:40000", 9600)],
    "at 115200": [INIT, TO_115200],
    "at 230400": [INIT, ("COMM:A0000", 9600)],
    "at 921600": [INIT, ("COMM:60000", 9600)],
    "tracking at 9600": [INIT, *at(9600, *TRACKING)],
    "tracking at 115200": [INIT, TO_115200, *at(115200, *TRACKING)],
    "tracking at 230400": [INIT, ("COMM:A0000", 9600), *at(230400, *TRACKING)],
}


def bring_up(prepare: Callable[[Rig], Awaitable[object]], **settings: Any) -> Rig:
    async def main() -> Rig:
        rig = Rig(**settings)
        await prepare(rig)
        async with running(rig):
            await until_tracking(rig)
            await asyncio.sleep(1.0)
            assert rig.tracker.status.baud_rate == rig.device.line.baud_rate
            assert set(rig.tracker.status.tools.roles.values()) == {"tip", "base"}
            assert rig.holding() == set()
            assert all(frame.tip is not None for frame in rig.frames)
            assert len(rig.frames) >= 40
        return rig

    return run_in_virtual_time(main())


async def nothing(rig: Rig) -> None:
    """As the device is at power-up."""


def test_a_fresh_device_is_brought_up_in_the_maker_s_order() -> None:
    rig = bring_up(nothing)
    expected = """
        INIT: COMM:50000 APIREV: APIREV: GET:Info.Timeout.* VER:5 VER:0 VER:7 SFLIST:03 GET:Device.*
        GET:Info.Status.New+Alerts GET:Info.Status.Alerts
        GET:FG-0.Info.Status.New+Alerts GET:FG-0.Info.Status.Alerts
        GET:SIU-0.Info.Status.New+Alerts GET:SIU-0.Info.Status.Alerts
        PHSR:01 PHSR:02 PINIT:0A PINIT:0B PHSR:02 PHSR:00 PHINF:0A0085 PHINF:0B0085
        PENA:0AD PENA:0BD TSTART:80 GET:Param.Tracking.* BX:0801
    """
    sent = [command[:-5].decode().replace(" ", "+") for command in rig.sent()]
    assert sent[: len(expected.split())] == expected.split()
    known = {f"{text}{digits}\r".encode() for text, digits in COMMANDS.items()}
    assert known & set(rig.sent())
    assert rig.tracker.status.counters.timeouts == 0


@pytest.mark.parametrize("state", LEFT_BEHIND)
def test_a_device_left_behind_is_found_without_a_reset(state: str) -> None:
    async def prepare(rig: Rig) -> None:
        await leave_behind(rig, *LEFT_BEHIND[state])
        assert rig.device.mode is (
            TrackerMode.TRACKING if "tracking" in state else TrackerMode.SETUP
        )
        assert rig.device.line.baud_rate == LEFT_BEHIND[state][-1][1] or "tracking" not in state

    rig = bring_up(prepare)
    assert rig.tracker.status.counters.resets == 0


@pytest.mark.parametrize("baud_rate", [9600, 115200])
@pytest.mark.parametrize("wait_s", [0.0, 0.0015, 0.004, 0.006, 0.05])
def test_a_device_in_the_middle_of_a_reply_is_found(baud_rate: int, wait_s: float) -> None:
    change = [] if baud_rate == 9600 else [TO_115200]
    exchanges = [INIT, *change, *at(baud_rate, *TRACKING, "BX:0801")]
    bring_up(lambda rig: leave_behind(rig, *exchanges, wait_s=wait_s))


@pytest.mark.parametrize("wait_s", [0.0, 0.05, 0.3, 0.9, 1.2])
def test_a_device_that_is_resetting_is_found(wait_s: float) -> None:
    bring_up(lambda rig: leave_behind(rig, INIT, ("RESET:", 9600), wait_s=wait_s))


@pytest.mark.parametrize("baud_rate", [9600, 115200])
def test_half_a_command_in_the_device_s_buffer_does_no_harm(baud_rate: int) -> None:
    async def half_a_command(rig: Rig) -> None:
        if baud_rate != 9600:
            await leave_behind(rig, INIT, TO_115200)

        stream = await rig.open_stream(Ears())
        stream.set_baud_rate(baud_rate)
        stream.write(b"PHSR:0")
        await asyncio.sleep(0.1)
        stream.close()

    rig = bring_up(half_a_command)
    assert rig.tracker.status.counters.resets == 0


def test_a_device_that_hangs_is_reset_by_a_break() -> None:
    async def hang(rig: Rig) -> None:
        rig.inject("hang")

    rig = bring_up(hang)
    assert rig.tracker.status.counters.resets == 1
    assert "device_reset" in rig.raised()


@pytest.mark.parametrize("baud_rate", [9600, 38400, 57600, 115200, 230400, 921600])
def test_every_baud_rate_can_be_configured(baud_rate: int) -> None:
    async def main() -> None:
        rig = Rig(config=configured(baud_rate=baud_rate))
        async with running(rig):
            await until_tracking(rig)
            assert rig.device.line.baud_rate == baud_rate

    run_in_virtual_time(main())


def test_text_replies_and_the_handshake_can_be_configured() -> None:
    rig = bring_up(nothing, config=configured(reply_format="text", hardware_handshake=True))
    assert b"COMM:50001" in b"".join(rig.sent())
    assert b"TX:0801" in b"".join(rig.sent())


def test_a_device_whose_init_keeps_the_tools_is_used_as_it_is() -> None:
    """Handles that are initialised and enabled already, and a stale one of an unplugged tool."""

    async def prepare(rig: Rig) -> None:
        await leave_behind(rig, INIT, TO_115200, *at(115200, *TRACKING, "TSTOP:"))
        rig.inject("unplug_tool=port7")

    spare = TIP.model_copy(update={"attached_to": "nothing", "port": 7, "serial": "0000BEEF"})
    rig = bring_up(
        prepare,
        device_config=emulated(TIP, BASE, spare, initialise_clears_handles=False, **EXACT),
    )
    assert b"PHF:0C" in b"".join(rig.sent())
    assert b"PINIT:0A" not in b"".join(rig.sent())


def test_leaving_politely_spares_the_next_client_the_search() -> None:
    async def main() -> None:
        rig = Rig()
        async with running(rig):
            await until_tracking(rig)
        assert rig.device.mode is TrackerMode.SETUP
        assert rig.device.line.baud_rate == 9600
        assert rig.sent()[-2:] == [b"TSTOP:2C14\r", b"COMM:000000084\r"]
        assert rig.tracker.status.state is TrackerState.CLOSED
        rig.traffic.clear()
        async with running(rig):
            await until_tracking(rig)
        assert rig.sent()[:2] == [b"INIT:E3A5\r", b"COMM:500000048\r"]

    run_in_virtual_time(main())


@pytest.mark.parametrize("moment_s", [0.0, 0.01, 0.1, 0.2, 0.5, 0.8, 1.2, 2.0])
def test_cancelling_at_any_moment_ends_within_a_second(moment_s: float) -> None:
    async def main() -> float:
        rig = Rig()
        task = asyncio.create_task(rig.tracker.run())
        await asyncio.sleep(moment_s)
        start = asyncio.get_running_loop().time()
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        await rig.open_stream(Ears())  # the line is free again
        return asyncio.get_running_loop().time() - start

    assert run_in_virtual_time(main()) <= 1.0


async def until(rig: Rig, condition: str, within_s: float = 60.0) -> None:
    async with asyncio.timeout(within_s):
        while condition not in rig.holding():
            await asyncio.sleep(0.05)


def test_a_device_of_another_family_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> None:
        rig = Rig()
        async with running(rig):
            await until(rig, "wrong_family")
            assert rig.frames == []
            monkeypatch.undo()
            await until_tracking(rig)
            assert rig.holding() == set()

    monkeypatch.setattr(identity, "API_REVISION", ApiRevision("G", 1, 4))
    run_in_virtual_time(main())


def refuse(code: int) -> Callable[..., str]:
    def handler(device: object, arguments: str) -> str:
        raise CommandError(code)

    return handler


def change_rules(
    monkeypatch: pytest.MonkeyPatch, changes: dict[str, Callable[..., str] | None]
) -> None:
    rules = dict(emulated_device.RULES)
    for word, handler in changes.items():
        if handler is None:
            del rules[word]
        else:
            rules[word] = rules[word]._replace(handler=handler)
    monkeypatch.setattr(emulated_device, "RULES", rules)


def test_an_older_device_that_lacks_commands_is_used_all_the_same(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    original = emulated_device.RULES["PHINF"].handler

    def only_older_options(device: Any, arguments: str) -> Any:
        if int(arguments[2:], 16) & 0x80:
            raise CommandError(0x23)
        return original(device, arguments)

    change_rules(
        monkeypatch,
        {"GET": None, "SFLIST": None, "VER": None, "PHINF": only_older_options},
    )
    rig = bring_up(nothing)
    device = rig.tracker.status.device
    assert device is not None
    assert (device.firmware, device.volumes, device.components) == ("", (), (CONTROL_UNIT,))


def test_alerts_that_are_told_in_another_way_are_done_without(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    original = emulated_device.RULES["GET"].handler

    def all_at_once(device: Any, arguments: str) -> Any:
        more = "\nInfo.Status.More=0" if "Alerts" in arguments else ""
        return str(original(device, arguments)) + more

    change_rules(monkeypatch, {"GET": all_at_once})
    assert bring_up(nothing).raised() == set()


@pytest.mark.parametrize("slow", ["GET", "PHINF"])
def test_a_reply_that_came_late_is_not_taken_for_that_of_the_next_command(
    slow: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Three plugs: handles that were told one too far would make the base sensor the tip."""
    original = emulated_device.RULES[slow].handler
    spare = BASE.model_copy(update={"port": 1, "serial": "3C112899"})
    tip, base = (tool.model_copy(update={"port": tool.port + 1}) for tool in (TIP, BASE))
    late: list[str] = []

    def late_once(device: Any, arguments: str) -> Any:
        if not late and (slow == "PHINF" or arguments == "Device.*"):
            late.append(arguments)
            device.inject("late", {"delay": 3.2, "count": 1}, 0)
        return original(device, arguments)

    change_rules(monkeypatch, {slow: late_once})
    rig = bring_up(
        nothing,
        device_config=emulated(spare, tip, base, **EXACT),
        config=configured(tools={"tip": ToolSelector(port=2), "base": ToolSelector(port=3)}),
    )
    assert late
    assert rig.tracker.status.tools.roles == {0x0B: "tip", 0x0C: "base"}
    device = rig.tracker.status.device
    assert device is not None
    assert device.components == ("SCU-0", "FG-0", "SIU-0")


def test_a_rate_that_the_device_refuses_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> None:
        rig = Rig(config=configured(baud_rate=921600))
        async with running(rig):
            await until(rig, "rate_refused")

    change_rules(monkeypatch, {"COMM": refuse(0x06)})
    run_in_virtual_time(main())


class SlowAdapter:
    """A stream whose adapter does not know 921600 baud, and stays at the rate before."""

    def __init__(self, stream: ByteStream) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def set_baud_rate(self, baud_rate: int) -> None:
        if baud_rate != 921600:
            self._stream.set_baud_rate(baud_rate)


def test_a_rate_that_the_adapter_does_not_know_is_named() -> None:
    async def main() -> None:
        rig = Rig(config=configured(baud_rate=921600))
        opener = rig.open_stream

        async def open_stream(receiver: ByteReceiver) -> Any:
            return SlowAdapter(await opener(receiver))

        rig.tracker._open_stream = open_stream
        async with running(rig):
            await until(rig, "rate_refused")
            assert rig.frames == []

    run_in_virtual_time(main())


@pytest.mark.parametrize(("word", "code"), [("INIT", 0x15), ("INIT", 0x2E), ("TSTART", 0x14)])
def test_a_command_that_must_work_but_is_refused_is_named(
    word: str, code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def main() -> None:
        rig = Rig()
        async with running(rig):
            await until(rig, "device_error")
            (active,) = rig.tracker.status.conditions
            assert f"{word}: error {code:02X}" in active.detail
            monkeypatch.undo()
            await until_tracking(rig)
            assert rig.holding() == set()

    change_rules(monkeypatch, {word: refuse(code)})
    run_in_virtual_time(main())


def test_a_remark_of_the_device_is_noted_and_does_no_harm(monkeypatch: pytest.MonkeyPatch) -> None:
    original = emulated_device.RULES["PENA"].handler

    def with_a_remark(device: Any, arguments: str) -> str:
        original(device, arguments)
        return "WARNING02"

    async def main() -> None:
        rig = Rig()
        async with running(rig):
            await until_tracking(rig)
            assert rig.raised() == {"device_warning"}
            assert rig.holding() == set()
            assert "PENA: warning 02" in rig.changes[0].active.detail

    change_rules(monkeypatch, {"PENA": with_a_remark})
    run_in_virtual_time(main())


@pytest.mark.parametrize(("word", "code"), [("PENA", 0x09), ("PINIT", 0x1E)])
def test_one_tool_that_is_refused_does_not_stop_the_other(
    word: str, code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    original = emulated_device.RULES[word].handler

    def refuse_the_first(device: Any, arguments: str) -> Any:
        if arguments.startswith("0A"):
            raise CommandError(code)
        return original(device, arguments)

    async def main() -> None:
        rig = Rig()
        async with running(rig):
            await until_tracking(rig)
            (active,) = rig.tracker.status.conditions
            assert (active.condition.name, active.subject) == ("tool_refused", "tracker/tip")
            assert f"{word}: error {code:02X}" in active.detail
            assert set(rig.tracker.status.tools.roles.values()) == {"base"}

    change_rules(monkeypatch, {word: refuse_the_first})
    run_in_virtual_time(main())


def test_a_port_with_nothing_behind_it_is_named_and_tried_again() -> None:
    async def main() -> None:
        rig = Rig()
        rig.device.port.is_deaf = True
        rig.device.line_break = lambda t_ns: None  # type: ignore[method-assign]
        async with running(rig):
            await until(rig, "no_answer")
            assert rig.frames == []
            rig.device.port.is_deaf = False
            await until_tracking(rig)
            assert rig.holding() == set()

    run_in_virtual_time(main())


@pytest.mark.parametrize(
    ("number", "condition"),
    [(2, "port_missing"), (13, "port_denied"), (16, "port_busy"), (5, "port_unusable")],
)
def test_a_port_that_cannot_be_opened_is_named_and_tried_again(number: int, condition: str) -> None:
    async def main() -> None:
        rig = Rig()
        opener = rig.open_stream

        async def refuse_to_open(receiver: ByteReceiver) -> ByteStream:
            raise StreamError(number, "it cannot be opened", "do something")

        rig.tracker._open_stream = refuse_to_open
        async with running(rig):
            await asyncio.sleep(0.01)
            assert rig.holding() == {condition}
            (active,) = rig.tracker.status.conditions
            assert active.detail == "it cannot be opened: do something"
            rig.tracker._open_stream = opener
            await until_tracking(rig)
            assert rig.holding() == set()

    run_in_virtual_time(main())


def test_tools_are_chosen_by_serial_number_or_port_and_channel() -> None:
    """A dual sensor: one plug, one serial number, two channels; plugged in in any order."""
    first = TIP.model_copy(update={"port": 3, "degrees_of_freedom": 5})
    second = first.model_copy(update={"channel": 1, "attached_to": "base"})
    by_serial = ToolSelector(serial=TIP.serial), ToolSelector(serial=TIP.serial, channel=1)
    by_port = ToolSelector(port=3), ToolSelector(port=3, channel=1)
    for tip, base in (by_serial, by_port):
        rig = bring_up(
            nothing,
            device_config=emulated(second, first, **EXACT),
            config=configured(tools={"tip": tip, "base": base}),
        )
        status = rig.tracker.status
        assert {str(tool) for tool in status.tools.plugged} == {
            f"port 3 channel 0 serial {TIP.serial}",
            f"port 3 channel 1 serial {TIP.serial}",
        }


def test_the_snapshot_of_the_status_does_not_change_any_more() -> None:
    async def main() -> None:
        rig = Rig()
        async with running(rig):
            await until_tracking(rig)
            status = rig.tracker.status
            before = dataclasses.asdict(status.counters)
            await asyncio.sleep(1.0)
            assert dataclasses.asdict(status.counters) == before
            assert rig.tracker.status.counters.frames > status.counters.frames
            with pytest.raises(dataclasses.FrozenInstanceError):
                status.baud_rate = 0  # type: ignore[misc]
            device = status.device
            assert device is not None
            assert device.firmware == "013"
            assert device.control_unit.value("Freeze Tag") == "AURORA Rev 013"
            assert device.components == ("SCU-0", "FG-0", "SIU-0")
            assert device.volumes[0].shape == "cube"

    run_in_virtual_time(main())
