"""Every fault of drives and bus ends in a named condition, and in recovery where there is one.

Each row is injected into a bus of two enabled drives. Recovery means: all nodes operational again
by themselves, the condition gone, and the drives ready to be enabled once more.
"""

import asyncio
from dataclasses import dataclass

import pytest

from config.emulation.lab import EmulatedDrives
from drivers.cia402.power_state import PowerGoal, PowerState
from sim_backends.devices.can.faults import BUS_FAULTS
from sim_backends.devices.drive.faults import DRIVE_FAULTS
from tests.drivers.cia402.rig import BUS, Rig, axes, on_a_rig


@dataclass(frozen=True)
class Row:
    """One fault and what must come of it."""

    order: str
    condition: str
    subject: str = "can0/1"
    says: str = ""
    moving: bool = False
    """Whether the axes move when it comes."""
    setting_up: bool = False
    """Whether it comes while the node is being set up, not afterwards."""
    stops: bool = True
    """Whether the axis is not enabled any more afterwards."""

    @property
    def fault(self) -> str:
        """Its name in the devices' tables."""
        return self.order.split("=")[0].rpartition(".")[2]


DRIVE = "drive.can0/1."
BUS_ = "bus.can0."

ROWS = [
    Row(DRIVE + "power_cycle=2s", "node_pdo_silent"),
    Row(DRIVE + "power_cycle=0.1s", "node_reset"),
    Row(DRIVE + "reset", "node_reset"),
    Row(DRIVE + "boots_twice", "node_reset"),
    Row(DRIVE + "wrong_identity", "node_wrong_device", says="product code is 0x57E2, not 0x57E1"),
    Row(DRIVE + "dead=1s", "node_pdo_silent"),
    Row(DRIVE + "heartbeat_stop=0.6s", "node_lost"),
    Row(DRIVE + "tpdo_stop=0.5s", "node_pdo_silent"),
    Row(DRIVE + "sync_loss=0.5s", "node_pdo_silent"),
    Row(DRIVE + "emergency=0x7305", "drive_fault", "axis_0", says="0x7305"),
    Row(DRIVE + "short_emergency=0x1000", "drive_emergency", says="0x1000", stops=False),
    Row(DRIVE + "setting=0x605A,0,5", "node_settings_changed", says="0x605A:00"),
    Row(DRIVE + "warning=0.5s", "drive_warning", "axis_0", stops=False),
    Row(DRIVE + "blocked=1s", "drive_following_error", says="0x8611", moving=True),
    Row(DRIVE + "over_temperature=0.5s", "drive_fault", "axis_0", says="0x4310"),
    Row(DRIVE + "under_voltage=0.5s", "drive_fault", "axis_0", says="0x3220"),
    Row(DRIVE + "sto=0.5s", "drive_no_voltage", "axis_0"),
    Row(DRIVE + "encoder=0.5s", "drive_fault", "axis_0", says="0x7305"),
    Row(DRIVE + "sdo_silent=2s", "node_sdo_silent", says="no answer", setting_up=True),
    Row(DRIVE + "sdo_late=0.7s,2s", "node_sdo_silent", says="no answer", setting_up=True),
    Row(
        DRIVE + "sdo_abort=0x06090030,3",
        "node_setting_refused",
        says="value out of range",
        setting_up=True,
    ),
    Row(DRIVE + "sdo_toggle=9", "node_setting_refused", says="toggle", setting_up=True),
    Row(DRIVE + "stuck_statusword=4s", "drive_unwilling", "axis_0", stops=False),
    Row(DRIVE + "refuses_enable=4s", "drive_unwilling", "axis_0", stops=False),
    Row(BUS_ + "off", "bus_off", "can0"),
    Row(BUS_ + "passive=0.5s", "bus_error_passive", "can0", stops=False),
    Row(BUS_ + "down=0.6s", "bus_down", "can0"),
    Row(BUS_ + "unplug=0.6s", "bus_gone", "can0"),
    Row(BUS_ + "full=2s", "bus_queue_full", "can0"),
    Row(BUS_ + "drop=0.9,0.5s", "node_pdo_silent"),
    Row(BUS_ + "corrupt=0.5,0.5s", "bus_error_passive", "can0", stops=False),
    Row(BUS_ + "babble=12000,0.5s", "bus_foreign_frames", "can0", stops=False),
    Row(BUS_ + "foreign_master=0.5s", "bus_foreign_master", "can0", "SYNC", stops=False),
    Row(BUS_ + "foreign_master=0.5s,nmt", "bus_foreign_master", "can0", "enter pre operational"),
    Row(BUS_ + "foreign_write=1,0x605A,0,5", "node_settings_changed", says="0x605A:00"),
    Row(BUS_ + "delay=0.1s,0.6s", "node_pdo_silent"),
]


def test_the_table_has_every_fault_there_is() -> None:
    there_are = {kind.name for kind in (*DRIVE_FAULTS, *BUS_FAULTS)}
    assert {row.fault for row in ROWS} == there_are


@pytest.mark.parametrize("row", ROWS, ids=lambda row: str(row.order))
def test_a_fault_is_named_and_recovered_from(row: Row) -> None:
    async def test(rig: Rig) -> None:
        await rig.enabled()
        if row.moving:
            rig.master.write(rig.step(20_000, 2.0))
            await asyncio.sleep(0.3)
        if row.setting_up:
            rig.inject(DRIVE + "reset")
        rig.inject(row.order)
        if row.condition == "drive_unwilling":
            rig.master.set_goal(PowerGoal.OFF if row.fault.startswith("stuck") else None)
            await asyncio.sleep(0.2)
            if row.fault == "refuses_enable":
                rig.master.channels[0].set_goal(PowerGoal.OFF, rig.clock.now_ns())
                await asyncio.sleep(0.2)
                rig.master.channels[0].set_goal(PowerGoal.ENABLED, rig.clock.now_ns())
        if row.fault == "setting":  # nobody could notice before the drives are asked
            (wrong,) = await rig.master.check_settings(1.0)
            assert wrong == "can0/1 0x605A:00 (end of a quick stop) reads 5, not 6"
        await rig.until(lambda: row.condition in rig.names(), within_s=5.0)
        if row.condition == "node_settings_changed":
            await asyncio.sleep(3.0)
            assert rig.master.operational, "a node is not set up anew while its drive has torque"
            rig.master.set_goal(PowerGoal.OFF)
        told = next(t for t in rig.told if t.name == row.condition)
        assert told.subject == row.subject
        assert row.says in told.detail
        await recovered(rig, row)

    on_a_rig(
        test,
        robot_axes=axes(2, product_code=0x57E1, vendor_id=0x7E57),
        options=EmulatedDrives(),
        bus=BUS,
    )


async def recovered(rig: Rig, row: Row) -> None:
    """Wait for recovery; where an operator has to act, act."""
    if row.fault == "wrong_identity":
        await asyncio.sleep(5.0)
        assert (row.condition, row.subject) in rig.holding()
        return
    await asyncio.sleep(6.0)
    await rig.operational()
    if row.stops:
        assert rig.master.channels[0].state is not PowerState.OPERATION_ENABLED
    rig.master.reset_faults()
    await asyncio.sleep(0.5)
    await rig.enabled()
    await asyncio.sleep(0.1)
    left = {name for name, _ in rig.holding()} - {"drive_emergency"}
    assert left == set()


def power_state(rig: Rig) -> PowerState:
    return rig.master.channels[0].state


def test_a_fault_whose_cause_remains_cannot_be_reset() -> None:
    async def test(rig: Rig) -> None:
        await rig.enabled()
        rig.inject(DRIVE + "over_temperature=3s")
        await asyncio.sleep(0.5)
        rig.master.reset_faults()
        await asyncio.sleep(1.0)
        assert power_state(rig) is PowerState.FAULT
        await asyncio.sleep(2.0)
        rig.master.reset_faults()
        await asyncio.sleep(0.5)
        assert power_state(rig) is PowerState.SWITCH_ON_DISABLED

    on_a_rig(test)


def test_a_fault_is_never_reset_by_itself() -> None:
    async def test(rig: Rig) -> None:
        await rig.enabled()
        rig.inject(DRIVE + "emergency=0x7305")
        await asyncio.sleep(5.0)
        assert rig.master.channels[0].state is PowerState.FAULT
        rig.master.set_goal(PowerGoal.ENABLED)
        await asyncio.sleep(1.0)
        assert rig.master.channels[0].state is PowerState.FAULT

    on_a_rig(test)
