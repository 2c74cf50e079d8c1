"""The emulated lab around one robot: body, tracker, buses and drives, wired to each other.

Nothing here is connected to the outside; `lab_ports` does that for other processes, and the
in-process links of the devices do it for virtual time.
"""

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from config.axis import Axis
from config.paths import eds_path
from config.robot import Robot
from drivers.clock import Clock
from drivers.pose import Pose
from sim_backends.devices.aurora.device import EmulatedAurora
from sim_backends.devices.can.bus import CanBus
from sim_backends.devices.can.faults import BusFaults
from sim_backends.devices.device import DeviceClock, Pump
from sim_backends.devices.drive.axis.axis import Axis as DriveAxis
from sim_backends.devices.drive.axis.mechanics import AxisMechanics
from sim_backends.devices.drive.drive import EmulatedDrive
from sim_backends.faults import FaultyDevice, understand
from sim_backends.lab.bodies import LabError, plant_of
from sim_backends.lab.body import Body
from sim_backends.lab.play import PLAYS
from sim_backends.plants.plant import PlantError, TipLoad
from sim_backends.plants.shooting import warm_up

_BEYOND_TRAVEL = 0.02
"""End stops and their switches lie this share of the travel beyond its ends."""

_REMEMBERED: Final = 1000
"""Entries of a diary."""


@dataclass(frozen=True)
class _Seeds:
    tracker: int
    drives: int
    buses: int

    @classmethod
    def of(cls, seed: int) -> "_Seeds":
        return cls(*(int(word) for word in np.random.SeedSequence(seed).generate_state(3)))


class Lab:
    """A robot without hardware. Lives in the running event loop once `start` was called."""

    def __init__(
        self, robot: Robot, robot_path: Path, clock: Clock, seed: int | None = None
    ) -> None:
        """seed: instead of the robot file's. Raises LabError."""
        if robot.emulation is None:
            raise LabError(f"{robot_path}: there is no 'emulation' in this robot file")
        emulation = robot.emulation
        seeds = _Seeds.of(emulation.seed if seed is None else seed)
        self.robot = robot
        self._clock = clock
        self._period_ns = round(emulation.plant_period_s * 1e9)
        self.buses = {
            name: CanBus(bus.bitrate_bit_s, seeds.buses + place)
            for place, (name, bus) in enumerate(robot.buses.items())
        }
        self.drives = _drives(robot, robot_path, self.buses, seeds.drives)
        shafts = [self._shaft(axis) for axis in robot.axes]
        load = TipLoad(emulation.tip_load_g)
        warm_up()
        self.diary = Diary()
        try:
            self.body = Body(plant_of(emulation, robot), robot.axes, shafts, load, self.diary.note)
        except PlantError as error:
            raise LabError(str(error)) from None
        self.tracker = EmulatedAurora(
            emulation.tracker, self._poses, seeds.tracker, powered_up_ns=clock.now_ns()
        )
        self.devices: Mapping[str, FaultyDevice] = {
            "tracker": self.tracker,
            **{f"bus.{name}": BusFaults(bus) for name, bus in self.buses.items()},
            **{f"drive.{name}": drive for name, drive in self.drives.items()},
        }
        self.pumps: dict[str, Pump] = {}
        self._stop_heart: Callable[[], None] = lambda: None

    def start(self) -> None:
        """Switch everything on."""
        now_ns = self._clock.now_ns()
        for name, bus in self.buses.items():
            bus.advance(now_ns)
            self.pumps[name] = Pump(bus, self._clock)
        for drive in self.drives.values():
            drive.power_on(now_ns)
        self._touch()
        heart = Pump(_Heart(self._period_ns, self._poses, self.body), self._clock)
        heart.touch()
        self._stop_heart = heart.stop

    def stop(self) -> None:
        """Leave the event loop."""
        self._stop_heart()
        for pump in self.pumps.values():
            pump.stop()

    def inject(self, *orders: str) -> None:
        """Carry out fault orders now, and none where one is not understood. Raises FaultError."""
        injections = [understand(self.devices, order) for order in orders]
        for order, injection in zip(orders, injections, strict=True):
            injection.carry_out(self._clock.now_ns())
            self.diary.note(order)
        self._touch()

    def set_tip_load(self, mass_g: float) -> None:
        """Hang another weight on the tip."""
        self.body.advance(self._clock.now_ns())
        self.body.load = TipLoad(mass_g)
        self.diary.note(f"{mass_g:g} g at the tip")

    def play(self, name: str | None) -> None:
        """Begin a scripted actuation of the axes that no motor holds; None ends it.

        Raises LabError.
        """
        if name is not None and name not in PLAYS:
            raise LabError(f"there is no play '{name}': there are {', '.join(PLAYS)}")
        play = None if name is None else PLAYS[name](self.robot.axes)
        self.body.begin_play(play, self._clock.now_ns())

    def _poses(self, t_ns: int) -> Mapping[str, Pose]:
        for bus in self.buses.values():
            bus.advance(t_ns)
        return self.body.poses(t_ns)

    def _touch(self) -> None:
        for pump in self.pumps.values():
            pump.touch()

    def _shaft(self, axis: Axis) -> DriveAxis:
        return self.drives[f"{axis.drive.bus}/{axis.drive.node}"].axes[axis.drive.axis]


class Diary:
    """What was done to a lab from outside: the last of it, numbered from 1."""

    def __init__(self) -> None:
        self.count = 0
        self._entries: deque[str] = deque(maxlen=_REMEMBERED)

    def note(self, text: str) -> None:
        """It was done now."""
        self.count += 1
        self._entries.append(text)

    def after(self, number: int) -> list[tuple[int, str]]:
        """What came after the entry of this number, as far as it is remembered."""
        first = self.count - len(self._entries) + 1
        return [(at, text) for at, text in enumerate(self._entries, first) if at > number]


class _Heart:
    """Keeps the body moving while no tracker looks at it. A `Device`."""

    def __init__(self, period_ns: int, beat: Callable[[int], object], body: Body) -> None:
        self._period_ns = period_ns
        self._beat = beat
        self._body = body

    def advance(self, t_ns: int) -> int:
        # Half a period of grace: a tracker's own rhythm is never quite ours.
        if 2 * (t_ns - self._body.advanced_ns) >= 3 * self._period_ns:
            self._beat(t_ns)
        return max(self._body.advanced_ns + 3 * self._period_ns // 2, t_ns + 1)


def _drives(
    robot: Robot, robot_path: Path, buses: Mapping[str, CanBus], seed: int
) -> dict[str, EmulatedDrive]:
    """The drives by `bus/node`, each with the axes that the robot file puts on it."""
    assert robot.emulation is not None
    options = robot.emulation.drives
    nodes: dict[tuple[str, int], list[Axis]] = {}
    for axis in robot.axes:
        nodes.setdefault((axis.drive.bus, axis.drive.node), []).append(axis)
    random = np.random.default_rng(seed)
    return {
        f"{bus}/{node}": EmulatedDrive(
            buses[bus],
            node,
            eds_path(axes[0].drive.eds, robot_path),
            options,
            seed=seed,
            clock=DeviceClock(float(random.uniform(-1, 1) * options.clock_error_ppm)),
            mechanics=_mechanics(axes),
        )
        for (bus, node), axes in nodes.items()
    }


def _mechanics(axes: list[Axis]) -> list[AxisMechanics]:
    """How the axes of one drive are built, in the order of their numbers."""
    by_number = {axis.drive.axis: _axis_mechanics(axis) for axis in axes}
    spare = next(iter(by_number.values()))
    return [by_number.get(number, spare) for number in range(max(by_number) + 1)]


def _axis_mechanics(axis: Axis) -> AxisMechanics:
    """Stops and switches a little beyond the travel; the lab's zero is the axis' own."""
    travel, per_unit = axis.travel, axis.counts_per_unit
    margin = _BEYOND_TRAVEL * (travel[1] - travel[0])
    low, high = sorted(((travel[0] - margin) * per_unit, (travel[1] + margin) * per_unit))
    return AxisMechanics(
        counts_per_turn=axis.drive.counts_per_turn,
        rated_torque_nmm=axis.drive.rated_torque_nmm,
        absolute_encoder=axis.homing.referenced == "absolute_encoder",
        low_stop_counts=low,
        high_stop_counts=high,
        low_switch_counts=low,
        high_switch_counts=high,
    )
