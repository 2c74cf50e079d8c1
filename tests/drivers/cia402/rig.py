"""A bus master and emulated drives on a modelled bus, in virtual time."""

import asyncio
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import dataclass
from typing import Any

from pydantic import TypeAdapter

from config.axis import Axis
from config.bus import Bus
from config.emulation.lab import EmulatedDrives
from config.paths import eds_path
from daemon.host.periodic_timer import LoopTimer
from drivers.axis_scale import count_limits
from drivers.can.link import CanLink, FrameReceiver
from drivers.canopen.object_dictionary import ObjectDictionary
from drivers.cia402.drive_bus import DriveBus
from drivers.cia402.power_state import PowerGoal
from drivers.conditions import ConditionChange
from safety.permit import PermittedHoming, PermittedStep, permit, permit_homing
from sim_backends.devices.can.bus import CanBus
from sim_backends.devices.can.faults import BusFaults
from sim_backends.devices.can.in_process import InProcessLink
from sim_backends.devices.device import Pump
from sim_backends.devices.drive.drive import EmulatedDrive
from sim_backends.faults import understand
from sim_backends.virtual_time import run_in_virtual_time, virtual_clock
from tests import SHIPPED_ROBOTS

BUS = Bus(interface="tentacled", channel="can0.sock", cycle_period_s=0.01)

AXIS = {
    "kind": "linear_stepper",
    "lead_mm": 2.0,
    "travel_mm": [0.0, 50.0],
    "max_velocity_mm_s": 10.0,
    "max_acceleration_mm_s2": 100.0,
    "quick_stop_deceleration_mm_s2": 200.0,
    "following_error_mm": 1.0,
}


@dataclass(frozen=True)
class Told:
    """One change of a condition."""

    t_s: float
    name: str
    subject: str
    present: bool
    detail: str


def axes(count: int, *, per_node: int = 1, **drive: Any) -> list[Axis]:
    """`count` axes on nodes 1, 2, …, `per_node` on each."""
    return [
        TypeAdapter[Axis](Axis).validate_python(
            {
                **AXIS,
                "name": f"axis_{number}",
                "drive": {
                    "bus": "can0",
                    "node": 1 + number // per_node,
                    "axis": number % per_node,
                    "eds": "builtin:stepper.eds" if per_node == 1 else "builtin:stepper3.eds",
                    "counts_per_turn": 4000,
                    "rated_torque_nmm": 400.0,
                    **drive,
                },
            }
        )
        for number in range(count)
    ]


class Rig:
    """Master, bus and drives. Made inside the virtual-time loop. Taps the bus."""

    def __init__(
        self, robot_axes: list[Axis], options: EmulatedDrives, bus_config: Bus, powered: bool
    ) -> None:
        self.clock = virtual_clock()
        self.axes = robot_axes
        self.bus = CanBus(bus_config.bitrate_bit_s)
        self.pump = Pump(self.bus, self.clock)
        self.told: list[Told] = []
        self.frames: list[tuple[int, bytes]] = []
        self.drives = self._drives(options, powered)
        self.devices: dict[str, Any] = {
            "bus.can0": BusFaults(self.bus),
            **{f"drive.can0/{drive.node_id}": drive for drive in self.drives},
        }
        self.master = DriveBus(
            "can0",
            bus_config,
            list(enumerate(robot_axes)),
            {axis.drive.node: self._dictionary(axis) for axis in robot_axes},
            self._open,
            self.clock,
            on_change=self._changed,
            tap=self,
        )
        period_ns = round(bus_config.cycle_period_s * 1e9)
        self.timer = LoopTimer(period_ns, period_ns, self._tick)
        self.healthy = True
        self.pump.touch()

    def received(self, can_id: int, data: bytes, t_ns: int) -> None:
        del t_ns
        self.frames.append((can_id, data))

    def sent(self, frames: Sequence[tuple[int, bytes]], t_ns: int) -> None:
        del t_ns
        self.frames.extend(frames)

    def _drives(self, options: EmulatedDrives, powered: bool) -> list[EmulatedDrive]:
        by_node = {axis.drive.node: axis.drive.eds for axis in self.axes}
        drives = [
            EmulatedDrive(self.bus, node, eds_path(eds, SHIPPED_ROBOTS), options, seed=1)
            for node, eds in by_node.items()
        ]
        for drive in drives:
            if powered:
                drive.power_on(0)
        return drives

    def _dictionary(self, axis: Axis) -> ObjectDictionary:
        return ObjectDictionary(eds_path(axis.drive.eds, SHIPPED_ROBOTS))

    async def _open(self, receiver: FrameReceiver) -> CanLink:
        return InProcessLink(self.bus, self.pump, self.clock, receiver)

    def _tick(self, _tick: object) -> None:
        self.master.tick(self.clock.now_ns(), self.healthy)

    def _changed(self, change: ConditionChange) -> None:
        active = change.active
        self.told.append(
            Told(
                change.t_ns * 1e-9,
                active.condition.name,
                active.subject,
                change.present,
                active.detail,
            )
        )

    # What tests do.

    def names(self) -> set[str]:
        """Conditions that were told of, ever."""
        return {told.name for told in self.told if told.present}

    def holding(self) -> set[tuple[str, str]]:
        """Conditions that hold now, with their subjects."""
        return {(a.condition.name, a.subject) for a in self.master.conditions.active()}

    def detail_of(self, name: str) -> str:
        """What was said when a condition came last."""
        return next(t.detail for t in reversed(self.told) if t.name == name and t.present)

    async def until(self, true: Callable[[], bool], within_s: float = 10.0) -> None:
        """Let time pass until something is true."""
        async with asyncio.timeout(within_s):
            while not true():
                await asyncio.sleep(0.01)

    async def operational(self) -> None:
        await self.until(lambda: self.master.operational)

    async def enabled(self) -> None:
        await self.operational()
        self.master.set_goal(PowerGoal.ENABLED)
        await self.until(lambda: all(channel.following for channel in self.master.channels))

    def inject(self, order: str) -> None:
        understand(self.devices, order).carry_out(self.clock.now_ns())
        self.pump.touch()

    def positions(self) -> list[int]:
        """Where the drives say they are."""
        return [channel.position_counts for channel in self.master.channels]

    def step(self, change: int, duration_s: float, *, past_ends: bool = False) -> PermittedStep:
        """A permit to move all axes by `change` counts, `past_ends` of their travel or not."""
        start = self.positions()
        permitted = permit(
            from_counts=start,
            to_counts=[position + change for position in start],
            measured_counts=start,
            velocities_before=[change / duration_s] * len(start),
            begins_ns=self.clock.now_ns(),
            duration_ns=round(duration_s * 1e9),
            limits=[_loose(axis, past_ends) for axis in self.axes],
        )
        assert isinstance(permitted, PermittedStep), permitted
        return permitted

    def homing(self, axis: int) -> PermittedHoming:
        """Leave for an axis to look for its zero."""
        return permit_homing(axis, count_limits(self.axes[axis]))


def _loose(axis: Axis, past_ends: bool) -> Any:
    limits = count_limits(axis)
    lowest, highest = (-(10**9), 10**9) if past_ends else (limits.lowest, limits.highest)
    return type(limits)(lowest, highest, limits.max_velocity, 10**9, 10**9)


def on_a_rig(
    test: Callable[[Rig], Coroutine[Any, Any, None]],
    *,
    robot_axes: list[Axis] | None = None,
    options: EmulatedDrives | None = None,
    bus: Bus = BUS,
    powered: bool = True,
) -> Rig:
    """Run a test against master and drives."""
    rigs: list[Rig] = []

    async def run() -> None:
        rig = Rig(robot_axes or axes(2), options or EmulatedDrives(), bus, powered)
        rigs.append(rig)
        task = asyncio.create_task(rig.master.run())
        try:
            await test(rig)
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
            rig.timer.stop()

    run_in_virtual_time(run())
    return rigs[0]
