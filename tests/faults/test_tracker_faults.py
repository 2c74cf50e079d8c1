"""One row per fault of the tracker: what it is called, and how it ends."""

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass, field

import pytest

from config.tracker import ToolSelector
from drivers.aurora.conditions import CONDITIONS
from drivers.aurora.tracker import TrackerState
from sim_backends.devices.aurora.faults import FAULTS
from sim_backends.virtual_time import run_in_virtual_time
from tests.drivers.aurora.rig import (
    BASE,
    EXACT,
    TIP,
    Rig,
    configured,
    emulated,
    running,
    until_tracking,
)


@dataclass(frozen=True)
class Row:
    """Inject `orders`, one every second. Then `raised` has been raised. When all is over, within
    `well_in_s`, exactly `holding` still hold and frames with `roles` come again."""

    orders: tuple[str, ...]
    raised: set[str]
    well_in_s: float
    holding: set[str] = field(default_factory=set)
    roles: set[str] = field(default_factory=lambda: {"tip", "base"})
    counted: Mapping[str, int] = field(default_factory=dict)
    """Lowest values of counters at the end."""
    settings: Mapping[str, object] = field(default_factory=dict)


UNPLUGGED = {"tool_disabled", "tool_absent"}
"""First the tracker says that it lost the tool, then the driver has looked for it in vain."""

ROWS = {
    "bad_crc": Row(("bad_crc=3",), {"crc_errors"}, 1.5, counted={"crc_errors": 3, "retries": 3}),
    "bad_crc, for long": Row(
        ("bad_crc=30",), {"crc_errors", "silent", "bad_replies", "device_reset"}, 15.0
    ),
    "bad_crc in text": Row(("bad_crc=3",), {"crc_errors"}, 1.5, settings={"reply_format": "text"}),
    "truncated": Row(("truncated=1",), {"silent"}, 1.0, counted={"timeouts": 1}),
    "fragmented": Row(("fragmented=100",), set(), 1.0),
    "garbage": Row(("garbage=5",), set(), 1.0, counted={"noise_bytes": 35}),
    "late": Row(("late=0.4s,1",), {"silent"}, 1.0, counted={"timeouts": 1, "strays": 1}),
    "late in text": Row(("late=0.4s,1",), {"silent"}, 1.0, settings={"reply_format": "text"}),
    "a little late": Row(("late=0.15s,1",), {"silent"}, 1.0),
    "no_reply": Row(("no_reply=1",), {"silent"}, 1.0, counted={"timeouts": 1}),
    "no_reply, for long": Row(
        ("no_reply=100",), {"silent", "device_reset"}, 8.0, counted={"resets": 1}
    ),
    "hang": Row(("hang",), {"silent", "device_reset"}, 8.0, counted={"resets": 1}),
    "missing": Row(("missing=0.5s",), {"tool_missing"}, 1.0),
    "missing base": Row(("missing=0.5s,base",), {"tool_missing"}, 1.0),
    "missing, for long": Row(("missing=forever",), {"tool_missing"}, 1.0, {"tool_missing"}),
    "out_of_volume": Row(("out_of_volume=0.5s",), {"out_of_volume"}, 1.0),
    "partially_out_of_volume": Row(
        ("partially_out_of_volume=0.5s",), {"partially_out_of_volume"}, 1.0
    ),
    "broken_sensor": Row(("broken_sensor=0.5s",), {"sensor_fault", "tool_missing"}, 1.0),
    "implausible_pose": Row(("implausible_pose=0.2s",), {"implausible_pose"}, 1.0),
    "outlier": Row(("outlier=30",), set(), 1.0),
    "frozen": Row(("frozen=0.5s",), {"frozen"}, 1.0, counted={"duplicates": 5}),
    "frame_jump": Row(("frame_jump=100000",), set(), 1.0, counted={"counter_jumps": 1}),
    "unplug_tool": Row(("unplug_tool=tip",), UNPLUGGED, 2.0, {"tool_absent"}, {"base"}),
    "plug_tool": Row(
        ("unplug_tool=tip", "plug_tool=tip"), UNPLUGGED, 3.0, counted={"tool_setups": 3}
    ),
    "a loose plug": Row(
        ("unplug_tool=base", "plug_tool=base", "unplug_tool=base", "plug_tool=base"),
        UNPLUGGED,
        4.0,
    ),
    "blank_tool": Row(
        ("unplug_tool=tip", "blank_tool=tip", "plug_tool=tip"),
        UNPLUGGED | {"tool_not_programmed"},
        3.0,
        {"tool_not_programmed"},
        {"base"},
    ),
    "zero_serial": Row(("zero_serial=3", "unplug_tool=tip", "plug_tool=tip"), UNPLUGGED, 5.0),
    "zero_serial, for long": Row(
        ("zero_serial=1000", "unplug_tool=tip", "plug_tool=tip"),
        UNPLUGGED | {"tool_unidentified"},
        12.0,
        {"tool_absent", "tool_unidentified"},
        set(),
        settings={
            "tools": {
                "tip": ToolSelector(serial=TIP.serial),
                "base": ToolSelector(serial=BASE.serial),
            }
        },
    ),
    "unplug_field_generator": Row(
        ("unplug_field_generator=1s",), {"field_generator_unplugged", "tool_missing"}, 2.0
    ),
    "change_configuration": Row(
        ("change_configuration",), {"configuration_changed"}, 2.0, counted={"tool_setups": 2}
    ),
    "alert": Row(("alert=2,FG-0",), {"alert"}, 1.0, {"alert"}),
    "an alert that ends": Row(("alert=0x8", "alert=0"), {"alert"}, 2.0),
    "reset": Row(("reset",), {"silent", "device_reset"}, 5.0, counted={"resets": 1}),
    "reset at 9600 baud": Row(
        ("reset",),
        {"silent", "device_reset", "frames_missed"},
        8.0,
        {"frames_missed"},
        counted={"resets": 1},
        settings={"baud_rate": 9600},
    ),
    "long_reset": Row(("long_reset=12s",), {"silent", "device_reset"}, 20.0),
    "break": Row(("break",), {"silent", "device_reset"}, 5.0, counted={"resets": 1}),
    "baud_loss": Row(("baud_loss",), {"silent", "device_reset"}, 5.0),
    "hang_up": Row(("hang_up=1s",), {"link_lost", "port_missing"}, 4.0, counted={"reconnects": 1}),
    "unplugged while it hangs": Row(
        ("hang", "hang_up=1s"), {"silent", "link_lost", "port_missing", "device_reset"}, 10.0
    ),
    "unplugged while a break is waited for": Row(
        ("long_reset=12s", *["frozen=0s"] * 4, "hang_up=1s"),
        {"silent", "link_lost", "port_missing", "device_reset"},
        25.0,
    ),
    "a loose cable": Row(
        ("hang_up=0.3s", "hang_up=0.3s", "hang_up=0.3s"),
        {"link_lost", "port_missing"},
        4.0,
        counted={"reconnects": 3},
    ),
}


def test_every_fault_that_the_tracker_knows_has_a_row() -> None:
    tested = {order.partition("=")[0] for row in ROWS.values() for order in row.orders}
    assert tested == {fault.name for fault in FAULTS}


def test_every_condition_has_a_text_and_a_remedy() -> None:
    assert len(CONDITIONS) >= 25
    assert len({condition.name for condition in CONDITIONS}) == len(CONDITIONS)
    assert all(condition.text and condition.remedy for condition in CONDITIONS)


@pytest.mark.parametrize("name", ROWS)
def test_a_fault_is_named_and_survived(name: str) -> None:
    row = ROWS[name]

    async def main() -> None:
        rig = Rig(emulated(**EXACT), configured(**row.settings))
        async with running(rig):
            await until_tracking(rig)
            await asyncio.sleep(3.0)
            assert rig.holding() <= row.holding
            rig.changes.clear()
            for order in row.orders:
                rig.inject(order)
                await asyncio.sleep(1.0)
            await asyncio.sleep(max(row.well_in_s - len(row.orders), 0.0))
            rig.frames.clear()
            await asyncio.sleep(5.5)  # the frame statistics look back over five seconds
            check(rig, row)

    run_in_virtual_time(main())


def check(rig: Rig, row: Row) -> None:
    assert rig.raised() | row.holding == row.raised | row.holding
    assert rig.holding() == row.holding
    assert rig.tracker.status.state is TrackerState.TRACKING
    counters = rig.tracker.status.counters
    for counter, lowest in row.counted.items():
        assert getattr(counters, counter) >= lowest, counter
    assert set(rig.tracker.status.tools.roles.values()) == row.roles
    if row.roles:
        expected = 5.5 * (40.0 if rig.tracker.status.baud_rate > 9600 else 8.0)
        assert len(rig.frames) >= expected - 3
        assert set(rig.frames[-1].tools) == row.roles


def test_a_lost_line_is_reported_at_once() -> None:
    async def main() -> None:
        rig = Rig()
        async with running(rig):
            await until_tracking(rig)
            await asyncio.sleep(1.0)
            rig.inject("hang_up=1s")
            assert "link_lost" in rig.holding()

    run_in_virtual_time(main())


def test_silence_is_reported_within_the_configured_time() -> None:
    async def main() -> None:
        rig = Rig(config=configured(silent_after_s=0.1))
        async with running(rig):
            await until_tracking(rig)
            await asyncio.sleep(1.0)
            rig.inject("hang")
            await asyncio.sleep(0.5)
            last_ns = rig.frames[-1].received_ns
            raised = next(c for c in rig.changes if c.active.condition.name == "silent")
            assert 100_000_000 <= raised.t_ns - last_ns <= 130_000_000

    run_in_virtual_time(main())


def test_an_alert_says_which_component_and_what() -> None:
    async def main() -> None:
        rig = Rig()
        async with running(rig):
            await until_tracking(rig)
            rig.inject("alert=0x12,SIU-0")
            await asyncio.sleep(1.0)
            (active,) = rig.tracker.status.conditions
            assert active.subject == "tracker/SIU-0"
            assert active.detail == "communication fault, alert 00000010"

    run_in_virtual_time(main())


def test_an_absent_tool_says_what_was_wanted_and_what_is_there() -> None:
    async def main() -> None:
        rig = Rig(config=configured(tools={"tip": ToolSelector(serial="DEADBEEF")}))
        async with running(rig):
            async with asyncio.timeout(10.0):
                while not rig.holding():
                    await asyncio.sleep(0.1)
            (active,) = rig.tracker.status.conditions
            assert (active.condition.name, active.subject) == ("tool_absent", "tracker/tip")
            assert "DEADBEEF" in active.detail
            assert "port 1 channel 0 serial 3C112801" in active.detail

    run_in_virtual_time(main())


@pytest.mark.parametrize("word", ["INIT", "COMM", "APIREV", "PHSR", "PINIT", "PHINF", "TSTART"])
@pytest.mark.parametrize("fault", ["bad_crc=1", "truncated=1", "no_reply=1", "garbage=1"])
def test_a_damaged_reply_to_any_command_of_the_bring_up_is_survived(word: str, fault: str) -> None:
    async def main() -> None:
        rig = Rig()
        before = rig.tracker._on_traffic
        assert before is not None
        injected = False

        def listen(direction, data, t_ns) -> None:  # type: ignore[no-untyped-def]
            nonlocal injected
            before(direction, data, t_ns)
            if data.startswith(word.encode()) and not injected:
                injected = True
                asyncio.get_running_loop().call_soon(rig.inject, fault)

        rig.tracker._on_traffic = listen
        async with running(rig):
            await until_tracking(rig, within_s=30.0)
            await asyncio.sleep(2.0)
            assert injected
            assert rig.holding() == set()

    run_in_virtual_time(main())
