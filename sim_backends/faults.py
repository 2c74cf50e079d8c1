"""Scripted faults: their grammar, `TARGET.FAULT=VALUE,VALUE`, and the tables devices declare.

tracker.missing=0.5s            the tip is missing for half a second
tracker.bad_crc=3               the next three replies carry a wrong CRC
drive.can0/3.emergency=0x8611   node 3 on can0 reports a following error
bus.can0.off                    bus-off until it restarts
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

from config.documents.problems import did_you_mean

Value = float | int | str
ParameterKind = Literal["duration_s", "count", "code", "number", "word"]

FOREVER_S = 1e9


class FaultError(ValueError):
    """A fault that cannot be injected as asked; the text says what can be."""


@dataclass(frozen=True)
class Parameter:
    """One value a fault takes. `default` None: it must be given."""

    name: str
    kind: ParameterKind
    default: Value | None = None


@dataclass(frozen=True)
class FaultKind:
    """One fault a device can be told to have."""

    name: str
    text: str
    parameters: tuple[Parameter, ...] = ()

    def usage(self) -> str:
        """`missing=DURATION_S` with its defaults, for lists and error texts."""
        shown = [
            p.name.upper() if p.default is None else f"[{p.name}={_show(p.default)}]"
            for p in self.parameters
        ]
        return self.name + ("=" + ",".join(shown) if shown else "")

    def bind(self, values: Sequence[str]) -> dict[str, Value]:
        """Values as text to arguments by name. Raises FaultError."""
        if len(values) > len(self.parameters):
            raise FaultError(f"{self.name} takes {len(self.parameters)} values: {self.usage()}")
        arguments: dict[str, Value] = {}
        for index, parameter in enumerate(self.parameters):
            if index < len(values):
                arguments[parameter.name] = _read(parameter, values[index])
            elif parameter.default is None:
                raise FaultError(f"{self.name} needs {parameter.name}: {self.usage()}")
            else:
                arguments[parameter.name] = parameter.default
        return arguments


class FaultyDevice(Protocol):
    """A device that can be told to misbehave."""

    @property
    def faults(self) -> Sequence[FaultKind]:
        """What it can be told."""
        ...

    def inject(self, fault: str, arguments: Mapping[str, Value], t_ns: int) -> None:
        """Misbehave from host time `t_ns` on. Raises FaultError where that makes no sense now."""
        ...


@dataclass(frozen=True)
class Injection:
    """An order in the grammar above, understood."""

    device: FaultyDevice
    fault: str
    arguments: Mapping[str, Value]

    def carry_out(self, t_ns: int) -> None:
        """Raises FaultError where it makes no sense at `t_ns`."""
        self.device.inject(self.fault, self.arguments, t_ns)


def understand(devices: Mapping[str, FaultyDevice], order: str) -> Injection:
    """What an order asks of which device. Raises FaultError."""
    head, _, tail = order.strip().partition("=")
    target, _, fault = head.rpartition(".")
    if not target:
        raise FaultError(f"'{order}' is not of the form DEVICE.FAULT, such as tracker.missing=3s")
    if target not in devices:
        hint = did_you_mean(target, devices) or f" (there are: {', '.join(sorted(devices))})"
        raise FaultError(f"'{order}': there is no device '{target}'{hint}")
    device = devices[target]
    kinds = {kind.name: kind for kind in device.faults}
    if fault not in kinds:
        hint = did_you_mean(fault, kinds) or f" (it has: {', '.join(sorted(kinds))})"
        raise FaultError(f"'{order}': {target} has no fault '{fault}'{hint}")
    values = [value.strip() for value in tail.split(",")] if tail else []
    return Injection(device, fault, kinds[fault].bind(values))


_DURATION = re.compile(r"(\d+(?:\.\d*)?|\.\d+)(s|ms|min)?")
_PER_UNIT = {"s": 1.0, "ms": 1e-3, "min": 60.0, None: 1.0}


def _read(parameter: Parameter, text: str) -> Value:
    try:
        if parameter.kind == "duration_s":
            if text == "forever":
                return FOREVER_S
            match = _DURATION.fullmatch(text)
            if match is None:
                raise ValueError
            return float(match[1]) * _PER_UNIT[match[2]]
        if parameter.kind in ("count", "code"):
            number = int(text, 0)
            if number < 0:
                raise ValueError
            return number
        return float(text) if parameter.kind == "number" else text
    except ValueError:
        example = {"duration_s": "0.5s, 200ms or forever", "count": "3", "code": "0x8611"}
        wanted = example.get(parameter.kind, "a number")
        raise FaultError(f"{parameter.name}: '{text}' is not like {wanted}") from None


def _show(value: Value) -> str:
    return "forever" if value == FOREVER_S else str(value)
