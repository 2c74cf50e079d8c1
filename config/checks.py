"""What the parts of a robot must be to each other. Each check works on the parts that are sound."""

from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from itertools import combinations
from typing import Any, TypeVar

from pydantic import TypeAdapter, ValidationError

from config.axis import Axis, Drive, Quantity
from config.bus import Bus
from config.control import PoseFilterSettings, Supervision
from config.coupling.coordinates import Coordinate, coordinate_findings
from config.coupling.limits import CoupledLimit
from config.documents.problems import did_you_mean
from config.documents.schema_errors import location_in_file
from config.documents.yaml_document import Location
from config.emulation.lab import Emulation
from config.emulation.plants import ConcentricTubesPlant, SoftArmPlant, TendonArmPlant
from config.patience import frames_impatience, impatience
from config.tracker import Tracker

T = TypeVar("T")
Finding = tuple[Location, str]

_AXIS: TypeAdapter[Axis] = TypeAdapter(Axis)
_COORDINATE: TypeAdapter[Coordinate] = TypeAdapter(Coordinate)
_COUPLED_LIMIT: TypeAdapter[CoupledLimit] = TypeAdapter(CoupledLimit)
_POSITION_COUNTS = 2**31 - 1
_UNSIGNED_COUNTS = 2**32 - 1
_CYCLES_PER_TIMEOUT = 3
_FRAME_S = 0.025
"""A step leads as far ahead as to the tracker's next frame, ..."""
_CYCLES_AHEAD = 3
"""... its targets count from the next SYNC, and where the axis is was measured at the last one."""
_NODE_WIDE = (
    "eds",
    "vendor_id",
    "product_code",
    "heartbeat_period_s",
    "heartbeat_timeout_s",
    "state_timeout_s",
)


@dataclass(frozen=True)
class Parts:
    """The parts of a robot file that are sound by themselves; None where one is not."""

    buses: Mapping[str, Bus | None]
    named_buses: list[object]
    """The bus that each axis names, sound or not."""
    drives: list[Drive | None]
    axes: list[Axis | None]
    tool_roles: list[str] | None
    """The roles that the tracker's tools have, sound or not; None where there are no tools."""
    tracker: Tracker | None
    supervision: Supervision | None
    pose_filter: PoseFilterSettings | None
    emulation: Emulation | None
    homing_order: object = None
    """As the file has it."""
    coordinates: Sequence[Coordinate | None] = ()
    coupled_limits: Sequence[CoupledLimit | None] = ()

    @classmethod
    def of(cls, value: object) -> "Parts":
        data = _mapping(value)
        axes = [_mapping(axis) for axis in _items(data.get("axes"))]
        return cls(
            {name: _sound(Bus, bus) for name, bus in _mapping(data.get("buses")).items()},
            [_mapping(axis.get("drive")).get("bus") for axis in axes],
            [_sound(Drive, axis.get("drive")) for axis in axes],
            [_sound(_AXIS, axis) for axis in axes],
            _roles(_mapping(data.get("tracker")).get("tools")),
            _sound(Tracker, data.get("tracker")),
            _sound(Supervision, data.get("supervision", {})),
            _sound(PoseFilterSettings, data.get("pose_filter", {})),
            _sound(Emulation, data.get("emulation")),
            data.get("homing_order"),
            [_sound(_COORDINATE, one) for one in _items(data.get("coordinates"))],
            [_sound(_COUPLED_LIMIT, one) for one in _items(data.get("coupled_limits"))],
        )


def _roles(tools: object) -> list[str] | None:
    return [str(role) for role in tools] if isinstance(tools, Mapping) else None


def _mapping(value: object) -> Mapping[Any, Any]:
    return value if isinstance(value, Mapping) else {}


def _items(value: object) -> list[object]:
    return value if isinstance(value, list) else []


def _sound(kind: type[T] | TypeAdapter[T], value: object) -> T | None:
    """The part, without what is wrong in it where it can do without; None where it cannot."""
    adapter: TypeAdapter[T] = kind if isinstance(kind, TypeAdapter) else TypeAdapter(kind)
    try:
        return adapter.validate_python(value)
    except ValidationError as error:
        value = deepcopy(value)
        for details in error.errors():
            _remove(value, location_in_file(value, details["loc"])[0])
    try:
        return adapter.validate_python(value)
    except ValidationError:
        return None


def _remove(value: Any, location: Location) -> None:
    for part in location[:-1]:
        value = value.get(part) if isinstance(value, dict) else None
    if isinstance(value, dict) and location:
        value.pop(location[-1], None)


def findings(parts: Parts) -> Iterator[Finding]:
    """Everything wrong between the parts, in the order of the file."""
    yield from _tracker_findings(parts)
    if parts.tracker is not None:
        yield from frames_impatience(parts.tracker, parts.supervision, parts.pose_filter)
    for name, bus in parts.buses.items():
        if bus is not None:
            yield from _bus_findings(("buses", name), bus, parts)
    for index, named in enumerate(parts.named_buses):
        if isinstance(named, str) and named not in parts.buses:
            hint = did_you_mean(named, parts.buses)
            yield ("axes", index, "drive", "bus"), f"there is no bus '{named}'{hint}"
    for index, drive in enumerate(parts.drives):
        if drive is not None:
            yield from _drive_findings(("axes", index, "drive"), drive, parts)
    for index, axis in enumerate(parts.axes):
        if axis is not None:
            yield from _axis_findings(("axes", index), axis, parts)
    yield from _cylinder_findings(parts)
    yield from _tendon_findings(parts)
    yield from _tube_findings(parts)
    yield from _name_findings(parts)
    yield from _coupling_findings(parts)
    yield from _homing_findings(parts)
    yield from _node_findings(parts)


def _tracker_findings(parts: Parts) -> Iterator[Finding]:
    if parts.tool_roles is not None and "tip" not in parts.tool_roles:
        meant = next((r for r in parts.tool_roles if did_you_mean(r, ["tip"])), None)
        hint = f" (did you mean 'tip' by '{meant}'?)" if meant else ""
        yield ("tracker", "tools"), f"there must be a 'tip', the sensor at the robot's tip{hint}"
    if parts.tracker is None:
        return
    tools = parts.tracker.tools
    for (first, one), (second, other) in combinations(tools.items(), 2):
        if one == other:
            yield ("tracker", "tools", second), f"is the same sensor as '{first}'"
    if parts.emulation is None:
        return
    plugged = parts.emulation.tracker.tools
    for role, tool in tools.items():
        if not any(
            tool.serial == there.serial or (tool.port, tool.channel) == (there.port, there.channel)
            for there in plugged
        ):
            yield ("tracker", "tools", role), "no such tool in emulation.tracker.tools"
    for index, tool_there in enumerate(plugged):
        place = (tool_there.port, tool_there.channel)
        if place in [(tool.port, tool.channel) for tool in plugged[:index]]:
            yield ("emulation", "tracker", "tools", index, "port"), "this port is already taken"


def _bus_findings(at: Location, bus: Bus, parts: Parts) -> Iterator[Finding]:
    period_ms = bus.cycle_period_s * 1e3
    if abs(period_ms - round(period_ms)) > 1e-6:
        yield (*at, "cycle_period_s"), f"must be whole milliseconds, not {period_ms:g} ms"
    least = 2 * bus.master_heartbeat_period_s
    if bus.master_heartbeat_timeout_s < least:
        yield (
            (*at, "master_heartbeat_timeout_s"),
            f"must be at least twice master_heartbeat_period_s: {least:g} s or more",
        )
    if parts.supervision is not None:
        for text in impatience(parts.supervision, bus, parts.emulation):
            yield (*at, "master_heartbeat_timeout_s"), text


def _drive_findings(at: Location, drive: Drive, parts: Parts) -> Iterator[Finding]:
    bus = parts.buses.get(drive.bus)
    if bus is not None and drive.node == bus.master_node:
        yield (*at, "node"), f"{drive.node} is the master's own node ID on {drive.bus}"
    least = 2 * drive.heartbeat_period_s
    if drive.heartbeat_timeout_s < least:
        yield (
            (*at, "heartbeat_timeout_s"),
            f"must be at least twice heartbeat_period_s: {least:g} s or more",
        )
    if bus is not None and drive.goes_on_s:
        yield from _setpoint_findings((*at, "setpoint_timeout_s"), drive, bus, parts)


def _setpoint_findings(at: Location, drive: Drive, bus: Bus, parts: Parts) -> Iterator[Finding]:
    """A frame or two may be late; and the daemon itself says first that it stood still."""
    least = _CYCLES_PER_TIMEOUT * bus.cycle_period_s
    if drive.setpoint_timeout_s < least:
        yield at, f"must be at least {_CYCLES_PER_TIMEOUT} bus cycles: {least:g} s or more"
    supervision = parts.supervision
    if supervision is None or (bus.emulated and parts.emulation and parts.emulation.patience_s):
        return
    if not supervision.loop_fault_after_s < drive.setpoint_timeout_s:
        yield (
            at,
            "must be longer than supervision.loop_fault_after_s "
            f"({supervision.loop_fault_after_s:g} s), so that the daemon can say why",
        )


def _axis_findings(at: Location, axis: Axis, parts: Parts) -> Iterator[Finding]:
    for key, text in axis.problems():
        yield (*at, key), text
    yield from _count_findings(at, axis)
    bus = parts.buses.get(axis.drive.bus)
    if bus is not None:
        least = axis.max_velocity * (_FRAME_S + _CYCLES_AHEAD * bus.cycle_period_s)
        if not axis.following_error >= least * (1.0 - 1e-9):
            yield (
                (*at, axis.key("following_error")),
                f"a target is up to {least:.3g} {axis.unit} ahead of where the axis was measured, "
                "at its highest velocity: so much or more, or go slower",
            )


def _count_findings(at: Location, axis: Axis) -> Iterator[Finding]:
    """Drives are told positions in 32 bits with a sign, and all else in 32 bits without."""
    counts_per_unit = abs(axis.counts_per_unit)
    furthest = max((*axis.travel, axis.homing_position), key=abs)
    if not abs(furthest) * counts_per_unit < _POSITION_COUNTS:
        yield (
            (*at, axis.key("travel")),
            f"{furthest:g} is {furthest * counts_per_unit:.3g} counts of the drive, "
            "which has 32 bits for them: check counts_per_turn, gear_ratio and the unit",
        )
    in_drive_units = counts_per_unit / axis.drive.velocity_unit_counts_s
    velocity = axis.max_velocity * in_drive_units
    sent: dict[Quantity, float] = {
        "max_velocity": 2.0 * velocity if axis.drive.goes_on_s else velocity,  # with a sign
        "max_acceleration": axis.max_acceleration * in_drive_units,
        "quick_stop_deceleration": axis.quick_stop_deceleration * in_drive_units,
        "following_error": axis.following_error * counts_per_unit,
    }
    for quantity, counts in sent.items():
        if not counts < _UNSIGNED_COUNTS:
            text = f"is {counts:.3g} units of the drive, which has 32 bits for them"
            yield (*at, axis.key(quantity)), text


def _cylinder_findings(parts: Parts) -> Iterator[Finding]:
    """A cylinder per chamber, whose piston cannot push out more gas than there is before it."""
    if parts.emulation is None or not isinstance(parts.emulation.plant, SoftArmPlant):
        return
    chambers = len(parts.emulation.plant.chamber_area_ratios)
    if len(parts.axes) != chambers:
        text = f"{len(parts.axes)} axes cannot fill the {chambers} chambers of emulation.plant"
        yield ("axes",), text
    for index, axis in enumerate(parts.axes):
        if axis is not None and axis.kind != "linear_stepper":
            yield ("axes", index, "kind"), "a soft_arm is moved by linear_stepper axes"
        elif axis is not None and axis.piston_area_mm2 is None:
            yield ("axes", index, "bore_mm"), "is missing: the axis pushes a soft_arm's gas"
    volume_ml = parts.emulation.plant.cylinder_volume_ml
    for index, axis in enumerate(parts.axes):
        if axis is None or axis.piston_area_mm2 is None:
            continue
        pushed_ml = axis.piston_area_mm2 * axis.travel[1] / 1000
        if pushed_ml >= volume_ml:
            yield (
                ("axes", index, "bore_mm"),
                f"pushes {pushed_ml:.1f} mL out of emulation.plant.cylinder_volume_ml, "
                f"{volume_ml:g} mL",
            )


def _tendon_findings(parts: Parts) -> Iterator[Finding]:
    """One motor per tendon, and a pretension that is neither slack nor too much."""
    if parts.emulation is None or not isinstance(parts.emulation.plant, TendonArmPlant):
        return
    plant = parts.emulation.plant
    if len(parts.axes) != len(plant.tendons):
        tendons = len(plant.tendons)
        text = f"{len(parts.axes)} axes cannot pull the {tendons} tendons of emulation.plant"
        yield ("axes",), text
    for index, axis in enumerate(parts.axes):
        if axis is None:
            continue
        if axis.tension_range_n is None:
            yield ("axes", index, "kind"), "a tendon_arm is moved by tendon_motor axes"
        elif not axis.tension_range_n[0] < plant.pretension_n < axis.tension_range_n[1]:
            yield (
                ("axes", index, "min_tension_n"),
                f"emulation.plant.pretension_n, {plant.pretension_n:g} N, must lie between "
                f"min_tension_n and max_tension_n ({axis.tension_range_n[1]:g} N)",
            )


def _tube_findings(parts: Parts) -> Iterator[Finding]:
    """An axis that turns each tube, then one for each carriage, and collars in their order."""
    if parts.emulation is None or not isinstance(parts.emulation.plant, ConcentricTubesPlant):
        return
    plant = parts.emulation.plant
    kinds = ["tube_rotation"] * len(plant.tubes) + ["tube_translation"] * plant.carriages
    if len(parts.axes) != len(kinds):
        yield (
            ("axes",),
            f"{len(parts.axes)} axes cannot move the {len(plant.tubes)} tubes and "
            f"{plant.carriages} carriages of emulation.plant",
        )
    for index, (axis, kind) in enumerate(zip(parts.axes, kinds, strict=False)):
        if axis is not None and axis.kind != kind:
            text = f"must be a {kind}: the tubes' axes come first, then the carriages'"
            yield ("axes", index, "kind"), text
    at = ("emulation", "plant", "tubes")
    used = {tube.carriage for tube in plant.tubes}
    if used != set(range(plant.carriages)):
        yield at, f"carriages are numbered from 0 without a gap, not {sorted(used)}"
    for index, tube in enumerate(plant.tubes):
        before = plant.tubes[index - 1]
        if index and not tube.collar_mm < before.collar_mm:
            yield (*at, index, "collar_mm"), "must be behind the collar of the tube round it"
        if index and not tube.outer_radius_mm < before.outer_radius_mm:
            yield (*at, index, "outer_radius_mm"), "must be less than that of the tube round it"
    first = plant.tubes[0]
    if plant.mouth == "first_collar" and (first.collar_mm != 0.0 or first.carriage != 0):
        text = "the mouth is the first collar: its tube has collar_mm 0 and carriage 0"
        yield (*at, 0, "collar_mm"), text


def _name_findings(parts: Parts) -> Iterator[Finding]:
    sound = [(index, axis) for index, axis in enumerate(parts.axes) if axis is not None]
    for (_, one), (second, other) in combinations(sound, 2):
        if one.name == other.name:
            yield ("axes", second, "name"), f"there is already an axis '{one.name}'"


def _coupling_findings(parts: Parts) -> Iterator[Finding]:
    """Coordinates, and limits on sums of them."""
    sound = [axis for axis in parts.axes if axis is not None]
    whole = len(sound) == len(parts.axes)
    wrong = list(
        coordinate_findings(
            parts.coordinates, {axis.name: axis.unit for axis in sound} if whole else None
        )
    )
    yield from wrong
    if not parts.coupled_limits:
        return
    # Linear programs: of no use to most robots, and slow to load.
    from config.coupling.checks import AxisFacts, limit_findings

    facts = [
        AxisFacts(
            axis.name,
            axis.unit,
            axis.travel,
            axis.key("travel"),
            axis.counts_per_unit,
            axis.drive.mode,
            axis.drive.goes_on_s,
        )
        for axis in sound
    ]
    coordinates = [one for one in parts.coordinates if one is not None]
    known = whole and not wrong and len(coordinates) == len(parts.coordinates)
    groups = [[str(name) for name in _items(group)] for group in _items(parts.homing_order)]
    yield from limit_findings(parts.coupled_limits, facts if known else None, coordinates, groups)


def _homing_findings(parts: Parts) -> Iterator[Finding]:
    """Whoever must be homed has one place in the order, and nobody else is named."""
    if not isinstance(parts.homing_order, list):
        return
    names = {axis.name for axis in parts.axes if axis is not None}
    whole = all(axis is not None for axis in parts.axes)
    seen: set[str] = set()
    for group_index, group in enumerate(parts.homing_order):
        for index, name in enumerate(_items(group)):
            at = ("homing_order", group_index, index)
            if not isinstance(name, str):
                continue
            if whole and name not in names:
                yield at, f"there is no axis '{name}'{did_you_mean(name, names)}"
            if name in seen:
                yield at, f"'{name}' has a place in the order already"
            seen.add(name)
    for axis in parts.axes:
        if axis is None or axis.name in seen or axis.homing.referenced != "home_at_start":
            continue
        yield ("homing_order",), f"'{axis.name}' must be homed, and has no place in the order"


def _node_findings(parts: Parts) -> Iterator[Finding]:
    sound = [(index, drive) for index, drive in enumerate(parts.drives) if drive is not None]
    for (first, one), (second, other) in combinations(sound, 2):
        if (one.bus, one.node) != (other.bus, other.node):
            continue
        at, node = ("axes", second, "drive"), f"node {one.node} on {one.bus}"
        if one.axis == other.axis:
            yield (*at, "node"), f"axis {one.axis} of {node} is already that of axes[{first}]"
        for key in _NODE_WIDE:
            if getattr(one, key) != getattr(other, key):
                yield (*at, key), f"must be the same for all axes of {node}, as in axes[{first}]"
