"""The faults that the emulated bus can be told to have."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Final

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
        "delay",
        "frames come out of the adapters late",
        (Parameter("delay", "duration_s", 0.02), _DURATION),
    ),
)

_BABBLE_ID: Final = 0x010
_BABBLE_QUEUE: Final = 4
_MAX_RATE_PER_S: Final = 50_000


class BusFaults:
    """A bus as a device with faults. One that lasts is prolonged by injecting it again."""

    def __init__(self, bus: CanBus) -> None:
        self._bus = bus
        self._babbler = bus.attach("babbler", _BABBLE_QUEUE)
        self._babbler.connect(False)
        self._babble_period_ns = 0
        self._babble_timer = bus.queue.timer(self._babble)
        self._switches: dict[str, Callable[[Mapping[str, Value] | None], None]] = {
            "passive": self._passive,
            "down": self._down,
            "unplug": self._unplug,
            "full": self._full,
            "drop": self._drop,
            "corrupt": self._corrupt,
            "babble": self._set_babble,
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
