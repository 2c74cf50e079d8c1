"""How the emulated tracker can be told to misbehave."""

from collections.abc import Mapping

from sim_backends.faults import FOREVER_S, FaultKind, Parameter, Value

_COUNT = Parameter("count", "count", 1)
_WHO = Parameter("who", "word", "tip")
_DURATION = Parameter("duration", "duration_s", 0.5)

FAULTS = (
    FaultKind("bad_crc", "replies carry a wrong checksum", (_COUNT,)),
    FaultKind("truncated", "replies end half way", (_COUNT,)),
    FaultKind("fragmented", "replies come in small pieces", (Parameter("count", "count", 100),)),
    FaultKind("garbage", "noise goes before replies", (_COUNT,)),
    FaultKind("late", "replies come late", (Parameter("delay", "duration_s", 0.4), _COUNT)),
    FaultKind("no_reply", "commands are carried out, but not answered", (_COUNT,)),
    FaultKind("hang", "nothing is answered until the device is reset"),
    FaultKind("missing", "a sensor cannot be measured", (_DURATION, _WHO)),
    FaultKind("out_of_volume", "a sensor is outside the volume", (_DURATION, _WHO)),
    FaultKind("partially_out_of_volume", "one of its two coils is outside", (_DURATION, _WHO)),
    FaultKind("broken_sensor", "a sensor's lead is broken", (_DURATION, _WHO)),
    FaultKind("implausible_pose", "a pose comes that is none", (_DURATION, _WHO)),
    FaultKind(
        "outlier",
        "one frame is wildly wrong and carries no flag",
        (Parameter("distance_mm", "number", 30.0), _WHO),
    ),
    FaultKind("frozen", "one frame is repeated", (_DURATION,)),
    FaultKind("frame_jump", "the frame counter jumps", (Parameter("ticks", "count", 100_000),)),
    FaultKind("unplug_tool", "a tool is unplugged", (_WHO,)),
    FaultKind("plug_tool", "a tool is plugged in", (_WHO,)),
    FaultKind("blank_tool", "a tool's memory is blank when it is next plugged in", (_WHO,)),
    FaultKind("zero_serial", "tools report no serial number", (_COUNT,)),
    FaultKind("unplug_field_generator", "the field generator is unplugged", (_DURATION,)),
    FaultKind("change_configuration", "a sensor interface is added"),
    FaultKind(
        "alert",
        "a component raises alerts; 0 ends them",
        (Parameter("bits", "code", 1), Parameter("component", "word", "SCU-0")),
    ),
    FaultKind("reset", "the device restarts by itself"),
    FaultKind("long_reset", "as reset, but slowly", (Parameter("duration", "duration_s", 12.0),)),
    FaultKind("break", "the line is held low, which resets the device"),
    FaultKind("baud_loss", "the device falls back to 9600 baud and says nothing"),
    FaultKind(
        "hang_up",
        "the serial adapter is unplugged for a while",
        (Parameter("duration", "duration_s", 1.0),),
    ),
)
"""Those with a count hit the next replies, those with a duration hold until it is over; the others
happen at once."""


class Pending:
    """Faults that wait for their reply, or for their end."""

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}
        self._ends_ns: dict[tuple[str, str], int] = {}

    def add(self, kind: FaultKind, arguments: Mapping[str, Value], t_ns: int) -> bool:
        """Remember a fault; False: it is not one that lasts."""
        names = [parameter.name for parameter in kind.parameters]
        if "count" in names:
            self._counts[kind.name] = int(arguments["count"])
        elif names[:1] == ["duration"]:
            who = str(arguments.get("who", ""))
            end_s = min(float(arguments["duration"]), FOREVER_S)
            self._ends_ns[kind.name, who] = t_ns + round(end_s * 1e9)
        else:
            return False
        return True

    def take(self, name: str) -> bool:
        """Whether the next of its kind is to be hit; it counts down."""
        left = self._counts.get(name, 0)
        if left:
            self._counts[name] = left - 1
        return left > 0

    @property
    def any_lasts(self) -> bool:
        """False: there is no fault with a duration, and `holds` need not be asked."""
        return bool(self._ends_ns)

    def holds(self, name: str, t_ns: int, who: str = "") -> bool:
        """Whether it lasts at this time."""
        return bool(self._ends_ns) and t_ns < self._ends_ns.get((name, who), 0)

    def forget_replies(self) -> None:
        """A reset is over: replies are answered again."""
        self._counts.clear()
