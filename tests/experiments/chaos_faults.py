"""What can go wrong while the robot moves: everything that devices can be told, and people too.

A fault is drawn from the devices' own tables, so that a new one takes part by itself. Durations are
between a blink and a few seconds. Left out are two that nobody can mend from a desk.
"""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from daemon.control.controller import ControllerError
from daemon.messages import Disarm, Hold, Stop
from safety.risk_source import NoModel, RiskReading
from sim_backends.faults import FaultError, FaultKind, FaultyDevice, Parameter
from tests.daemon.service.rig import Rig
from tests.experiments.chaos_limits import TargetWitness

LONGEST_S: Final = 4.0
_SHORTEST_S: Final = 0.02
_NOT_FROM_A_DESK: Final = {
    "encoder": "its zero is lost: somebody has to refer the axis anew",
    "wrong_identity": "another product stands there: somebody has to change it",
}
_EMERGENCIES: Final = (0x1000, 0x2310, 0x3210, 0x4310, 0x7121, 0x8110, 0x8611, 0xFF01)
"""Without 0x7305, an encoder's, for the same reason."""
_SETTINGS: Final = (0x1017, 0x6007, 0x605A, 0x605E, 0x6065, 0x6085, 0x60C2)
"""Objects of a drive that decide how it stops, and how it follows."""
_CODES: Final = {"bits": (1,), "code": _EMERGENCIES, "index": _SETTINGS, "subindex": (0,)}
_WORDS: Final = {
    "who": ("tip", "base"),
    "frames": ("sync", "heartbeat", "nmt", "sdo", "setpoint"),
}
_COUNTS: Final = {"ticks": (1, 200_000), "count": (1, 40), "node": (1, 6)}
_NUMBERS: Final = {
    "probability": (0.02, 1.0),
    "rate_per_s": (100.0, 12_000.0),
    "distance_mm": (1.0, 200.0),
    "value": (0.0, 8.0),
}
_RIDDEN_OUT: Final = frozenset(
    {
        # Drivers ask again, or the filter does not believe it: nothing has to be said of a little.
        *("bad_crc", "truncated", "fragmented", "garbage", "late", "no_reply", "zero_serial"),
        *("missing", "out_of_volume", "partially_out_of_volume", "broken_sensor", "frozen"),
        *("implausible_pose", "outlier", "frame_jump", "plug_tool", "blank_tool", "alert"),
        *("change_configuration", "unplug_field_generator", "hang_up"),
        # Nothing is asked of an SDO server while the robot moves.
        *("sdo_silent", "sdo_late", "sdo_abort", "sdo_toggle"),
        # What nobody looks at before the robot is armed again.
        *("setting", "foreign_write"),
        # Of what is shorter than what a bus or a drive tolerates.
        *("drop", "corrupt", "delay", "passive", "full", "babble", "warning", "sync_loss"),
        *("heartbeat_stop", "tpdo_stop", "dead", "stuck_statusword", "refuses_enable", "blocked"),
        *("load_step", "lease_lost", "risk_missing", "risk_late", "risk_broken", "recorder_fails"),
        *("controller_gives_up", "down", "sto", "under_voltage", "over_temperature"),
    }
)
"""What may pass without a word: only where the robot goes on as if nothing had been."""


class FlakyRisk(NoModel):
    """No model, which fails when it is told to."""

    def __init__(self) -> None:
        super().__init__()
        self.trouble = ""

    def assess(self, u_from: Any, u_to: Any, t_ns: int) -> RiskReading | None:
        if self.trouble == "missing":
            return None
        if self.trouble == "broken":
            raise ZeroDivisionError("a defect of the model")
        took_s = 1.0 if self.trouble == "late" else 0.0
        return RiskReading(0.0, None, took_s, self.name)


@dataclass
class World:
    """All that a fault may touch."""

    rig: Rig
    recorder: TargetWitness
    risk: FlakyRisk


@dataclass(frozen=True)
class Fault:
    """One of a pair."""

    order: str
    """In the grammar of devices, or as people say it."""
    kind: str
    lasts_s: float
    carry_out: Callable[[World], Awaitable[None]]

    @property
    def may_pass(self) -> bool:
        """Whether the robot may go on as if nothing had been."""
        return self.kind in _RIDDEN_OUT


class _Beside(NamedTuple):
    """What goes wrong beside the devices: it begins, it lasts, it ends."""

    name: str
    begin: Callable[[World, float], Awaitable[None]]
    end: Callable[[World], None] = lambda world: None


async def _lose_lease(world: World, _: float) -> None:
    world.rig.renewing = False


def _keep_lease(world: World) -> None:
    world.rig.renewing = True


async def _hang(world: World, share: float) -> None:
    world.rig.lab.set_tip_load(40.0 * share)


async def _ask(world: World, kind: type[Any]) -> None:
    await world.rig.ask(kind(token=world.rig.token))


async def _fail_controller(world: World, _: float) -> None:
    controller = world.rig.service.loop.controller
    if controller is None:
        return

    def failing(observation: object) -> None:
        raise ControllerError("it has lost its way")

    controller.propose = failing  # type: ignore[method-assign, assignment]


def _mend_controller(world: World) -> None:
    controller = world.rig.service.loop.controller
    if controller is not None:
        controller.__dict__.pop("propose", None)


def _risk(trouble: str) -> Callable[[World, float], Awaitable[None]]:
    async def begin(world: World, _: float) -> None:
        world.risk.trouble = trouble

    return begin


def _risk_well(world: World) -> None:
    world.risk.trouble = ""


async def _break_recorder(world: World, _: float) -> None:
    world.recorder.broken = "its process was killed"


def _mend_recorder(world: World) -> None:
    world.recorder.broken = ""


BESIDE: Final = (
    _Beside("lease_lost", _lose_lease, _keep_lease),
    _Beside("load_step", _hang, lambda world: world.rig.lab.set_tip_load(0.0)),
    _Beside("operator_hold", lambda world, _: _ask(world, Hold)),
    _Beside("operator_stop", lambda world, _: _ask(world, Stop)),
    _Beside("operator_disarm", lambda world, _: _ask(world, Disarm)),
    _Beside("controller_gives_up", _fail_controller, _mend_controller),
    _Beside("risk_missing", _risk("missing"), _risk_well),
    _Beside("risk_late", _risk("late"), _risk_well),
    _Beside("risk_broken", _risk("broken"), _risk_well),
    _Beside("recorder_fails", _break_recorder, _mend_recorder),
)


def kinds(devices: Mapping[str, FaultyDevice]) -> list[str]:
    """Every fault there is, each once: `tracker.hang`, `drive.blocked`, `load_step`."""
    found = {
        f"{name.split('.')[0]}.{kind.name}": None
        for name, device in devices.items()
        for kind in device.faults
        if kind.name not in _NOT_FROM_A_DESK
    }
    return [*found, *(one.name for one in BESIDE)]


def drawn(kind: str, devices: Mapping[str, FaultyDevice], random: np.random.Generator) -> Fault:
    """One fault of a kind, with a device and values by chance."""
    lasts_s = float(np.exp(random.uniform(np.log(_SHORTEST_S), np.log(LONGEST_S))))
    for one in BESIDE:
        if one.name == kind:
            return _beside(one, lasts_s, float(random.uniform()))
    where, _, name = kind.partition(".")
    device = str(random.choice([one for one in devices if one.split(".")[0] == where]))
    table = {fault.name: fault for fault in devices[device].faults}
    values = [_value(parameter, lasts_s, random) for parameter in table[name].parameters]
    order = f"{device}.{name}" + ("=" + ",".join(values) if values else "")
    return Fault(order, name, _length_s(table[name], values), _injected(order))


def _length_s(fault: FaultKind, values: list[str]) -> float:
    """Until it is over by itself, as its values say."""
    durations = [
        float(value.removesuffix("s"))
        for parameter, value in zip(fault.parameters, values, strict=True)
        if parameter.kind == "duration_s"
    ]
    return max(durations, default=0.0)


def _injected(order: str) -> Callable[[World], Awaitable[None]]:
    async def carry_out(world: World) -> None:
        with suppress(FaultError):  # a drive without supply can do nothing wrong any more
            world.rig.lab.inject(order)

    return carry_out


def _beside(one: _Beside, lasts_s: float, share: float) -> Fault:
    async def carry_out(world: World) -> None:
        await one.begin(world, share)
        asyncio.get_running_loop().call_later(lasts_s, one.end, world)

    return Fault(f"{one.name} {lasts_s:.2f}s", one.name, lasts_s, carry_out)


def _value(parameter: Parameter, lasts_s: float, random: np.random.Generator) -> str:
    if parameter.kind == "duration_s":
        longest = 0.3 if parameter.name == "delay" else LONGEST_S
        return f"{min(lasts_s, longest):.3f}s"
    if parameter.kind == "count":
        least, most = _COUNTS.get(parameter.name, (1, 10))
        return str(int(np.exp(random.uniform(np.log(least), np.log(most)))))
    if parameter.kind == "code":
        return f"0x{int(random.choice(_CODES.get(parameter.name, _EMERGENCIES))):04X}"
    if parameter.kind == "number":
        least_number, most_number = _NUMBERS.get(parameter.name, (0.0, 1.0))
        return f"{random.uniform(least_number, most_number):.3f}"
    if parameter.name in _WORDS:
        return str(random.choice(_WORDS[parameter.name]))
    assert parameter.default is not None
    return str(parameter.default)


async def mend(world: World) -> None:
    """What somebody does by hand afterwards: tools plugged in, alerts over."""
    rig = world.rig
    for one in BESIDE:
        one.end(world)
    for who in ("tip", "base"):
        socket = rig.lab.tracker.rack.socket(who)
        assert socket is not None
        if socket.plugged and socket.blank:
            rig.lab.inject(f"tracker.unplug_tool={who}")
        socket.blank = False
        if not socket.plugged:
            rig.lab.inject(f"tracker.plug_tool={who}")
    rig.lab.inject("tracker.alert=0")
