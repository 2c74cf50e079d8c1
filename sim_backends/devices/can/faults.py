"""The faults that the emulated bus can be told to have."""

import struct
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Final

from drivers.canopen.codec import cob_ids
from drivers.canopen.codec.error import CodecError
from drivers.canopen.codec.nmt import NmtCommand, encode_nmt_command
from drivers.canopen.codec.sdo import EXPEDITED_BYTES, ExpeditedDownload, UploadRequest
from sim_backends.devices.can.bus import CanBus
from sim_backends.devices.can.port import OFF_ERRORS, PASSIVE_ERRORS
from sim_backends.faults import FOREVER_S, FaultError, FaultKind, Parameter, Value

_DURATION: Final = Parameter("duration", "duration_s", FOREVER_S)
_PROBABILITY: Final = Parameter("probability", "number", 0.1)

BUS_FAULTS: Final = (
    FaultKind("off", "the adapters' controllers go bus-off; they restart as they are set to"),
    FaultKind("passive", "the adapters' controllers are error-passive", (_DURATION,)),
    FaultKind("down", "the interface is set down", (_DURATION,)),
    FaultKind("unplug", "the adapter is pulled out", (_DURATION,)),
    FaultKind("full", "nobody acknowledges: transmit queues fill up", (_DURATION,)),
    FaultKind("drop", "nodes miss frames", (_PROBABILITY, _DURATION)),
    FaultKind("corrupt", "frames are destroyed, and sent again", (_PROBABILITY, _DURATION)),
    FaultKind(
        "babble",
        "a foreign node sends frames of high priority",
        (Parameter("rate_per_s", "number", 1000.0), _DURATION),
    ),
    FaultKind(
        "foreign_master",
        "another master sends on the bus: sync, heartbeat, nmt, sdo or setpoint",
        (_DURATION, Parameter("frames", "word", "sync")),
    ),
    FaultKind(
        "foreign_write",
        "another master writes an object of a node over SDO",
        (
            Parameter("node", "count"),
            Parameter("index", "code"),
            Parameter("subindex", "code", 0),
            Parameter("value", "number", 0.0),
        ),
    ),
    FaultKind(
        "delay",
        "frames come out of the adapters late",
        (Parameter("delay", "duration_s", 0.02), _DURATION),
    ),
)

_BABBLE_ID: Final = 0x010
_BABBLE_QUEUE: Final = 4
_MAX_RATE_PER_S: Final = 50_000
_FOREIGN_QUEUE: Final = 4
_FOREIGN_PERIOD_NS: Final = 50_000_000
_FOREIGN_FRAMES: Final[Mapping[str, tuple[int, bytes]]] = {
    "sync": (cob_ids.SYNC, b""),
    "heartbeat": (cob_ids.heartbeat(127), b"\x05"),
    "nmt": (cob_ids.NMT, encode_nmt_command(NmtCommand.ENTER_PRE_OPERATIONAL, cob_ids.ALL_NODES)),
    "sdo": (cob_ids.sdo_request(1), UploadRequest(0x1018, 1).encode()),
    "setpoint": (cob_ids.rpdo(1, 1), bytes(6)),
}
"""What the other master says, each time."""


class BusFaults:
    """A bus as a device with faults. One that lasts is prolonged by injecting it again."""

    def __init__(self, bus: CanBus) -> None:
        self._bus = bus
        self._babbler = bus.attach("babbler", _BABBLE_QUEUE)
        self._babbler.connect(False)
        self._babble_period_ns = 0
        self._babble_timer = bus.queue.timer(self._babble)
        self._foreigner = bus.attach("foreign master", _FOREIGN_QUEUE)
        self._foreigner.connect(False)
        self._foreign_frame = _FOREIGN_FRAMES["sync"]
        self._foreign_timer = bus.queue.timer(self._say_as_master)
        self._gone_timer = bus.queue.timer(lambda _: self._foreign_master(None))
        self._switches: dict[str, Callable[[Mapping[str, Value] | None], None]] = {
            "passive": self._passive,
            "down": self._down,
            "unplug": self._unplug,
            "full": self._full,
            "drop": self._drop,
            "corrupt": self._corrupt,
            "babble": self._set_babble,
            "foreign_master": self._foreign_master,
            "delay": self._delay,
        }
        self._ends = {name: bus.queue.timer(partial(self._end, name)) for name in self._switches}

    @property
    def faults(self) -> Sequence[FaultKind]:
        """What it can be told to do wrong."""
        return BUS_FAULTS

    def inject(self, fault: str, arguments: Mapping[str, Value], t_ns: int) -> None:
        """Misbehave from `t_ns` on; the bus must be advanced afterwards. Raises FaultError."""
        self._bus.advance(t_ns)
        if fault == "off":
            for adapter in self._bus.adapters:
                for port in adapter.ports():
                    port.count_errors(transmit=OFF_ERRORS)
            return
        if fault == "foreign_write":
            self._foreign_write(arguments, t_ns)
            return
        self._switches[fault](arguments)
        self._ends[fault].set(t_ns + round(float(arguments["duration"]) * 1e9))

    def _end(self, fault: str, _t_ns: int) -> None:
        self._switches[fault](None)

    # Each is called with its arguments to begin, and with None to end.

    def _passive(self, arguments: Mapping[str, Value] | None) -> None:
        for adapter in self._bus.adapters:
            for port in adapter.ports():
                port.least_transmit_errors = PASSIVE_ERRORS if arguments else 0
                port.count_errors(transmit=0 if arguments else -PASSIVE_ERRORS)

    def _down(self, arguments: Mapping[str, Value] | None) -> None:
        self._bus.set_up(arguments is None)

    def _unplug(self, arguments: Mapping[str, Value] | None) -> None:
        self._bus.set_plugged(arguments is None)

    def _full(self, arguments: Mapping[str, Value] | None) -> None:
        self._bus.nobody_acknowledges = arguments is not None
        self._bus.rebuild()

    def _drop(self, arguments: Mapping[str, Value] | None) -> None:
        self._bus.drop_probability = _probability(arguments)

    def _corrupt(self, arguments: Mapping[str, Value] | None) -> None:
        self._bus.corrupt_probability = _probability(arguments)
        self._bus.rebuild()

    def _set_babble(self, arguments: Mapping[str, Value] | None) -> None:
        if arguments is None:
            self._babbler.connect(False)
            self._babble_timer.cancel()
            return
        rate = float(arguments["rate_per_s"])
        if not 0 < rate <= _MAX_RATE_PER_S:
            raise FaultError(f"a node babbles with up to {_MAX_RATE_PER_S} frames/s, not {rate:g}")
        self._babble_period_ns = round(1e9 / rate)
        self._babbler.connect(True)
        self._babble_timer.set(self._bus.now_ns + self._babble_period_ns)

    def _babble(self, t_ns: int) -> None:
        self._babbler.send(_BABBLE_ID, self._bus.random.bytes(8), t_ns)
        self._babble_timer.set(t_ns + self._babble_period_ns)

    def _foreign_master(self, arguments: Mapping[str, Value] | None) -> None:
        if arguments is None:
            self._foreigner.connect(False)
            self._foreign_timer.cancel()
            return
        frames = str(arguments["frames"])
        if frames not in _FOREIGN_FRAMES:
            raise FaultError(f"another master sends {', '.join(_FOREIGN_FRAMES)}, not '{frames}'")
        self._foreign_frame = _FOREIGN_FRAMES[frames]
        self._foreigner.connect(True)
        self._say_as_master(self._bus.now_ns)

    def _say_as_master(self, t_ns: int) -> None:
        self._foreigner.send(*self._foreign_frame, t_ns)
        self._foreign_timer.set(t_ns + _FOREIGN_PERIOD_NS)

    def _foreign_write(self, arguments: Mapping[str, Value], t_ns: int) -> None:
        node, index = int(arguments["node"]), int(arguments["index"])
        subindex, value = int(arguments["subindex"]), int(arguments["value"])
        try:
            data = value.to_bytes(EXPEDITED_BYTES, "little", signed=value < 0)
            request = ExpeditedDownload(index, subindex, data, sized=False).encode()
            can_id = cob_ids.sdo_request(node)
        except (CodecError, OverflowError, struct.error) as error:
            raise FaultError(f"no such object can be written: {error}") from None
        self._foreigner.connect(True)
        self._foreigner.send(can_id, request, t_ns)
        self._gone_timer.set(t_ns + _FOREIGN_PERIOD_NS)

    def _delay(self, arguments: Mapping[str, Value] | None) -> None:
        delay_ns = round(float(arguments["delay"]) * 1e9) if arguments else 0
        for adapter in self._bus.adapters:
            for port in adapter.ports():
                port.receive_delay_ns = delay_ns
        self._bus.rebuild()


def _probability(arguments: Mapping[str, Value] | None) -> float:
    if arguments is None:
        return 0.0
    probability = float(arguments["probability"])
    if not 0 <= probability <= 1:
        raise FaultError(f"a probability is 0 to 1, not {probability:g}")
    return probability
