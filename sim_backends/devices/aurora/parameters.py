"""The emulated tracker's user parameters: GET, GETINFO, SET, DFLT."""

from collections.abc import Mapping
from dataclasses import dataclass

from drivers.aurora.codec.parameters import ALERTS, FRAME_FREQUENCY, NEW_ALERTS, TRACK_FREQUENCY

CONTROL_UNIT, FIELD_GENERATOR, SENSOR_INTERFACE = "SCU-0", "FG-0", "SIU-0"
COMPONENTS = (CONTROL_UNIT, FIELD_GENERATOR, SENSOR_INTERFACE)
SIMULATED_ALERTS = "Param.Simulated Alerts"

UNKNOWN_PARAMETER, WRONG_TYPE, OUT_OF_RANGE, READ_ONLY = 0x34, 0x35, 0x36, 0x39

_INTEGER, _FLOAT, _STRING = 1, 2, 3
_READ, _READ_WRITE, _VOLATILE = 1, 3, 9
_TIMEOUTS_S = {
    "APIREV": 1, "BEEP": 1, "BX": 1, "COMM": 1, "GET": 2, "INIT": 5, "PDIS": 1, "PENA": 1, "PHF": 1,
    "PHINF": 2, "PHSR": 2, "PINIT": 5, "RESET": 12, "SET": 2, "SFLIST": 1, "TSTART": 5, "TSTOP": 2,
    "TX": 1, "VER": 1,
}  # fmt: skip


class ParameterError(ValueError):
    """Refused; `code` is the device's error code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"error {code:02X}")
        self.code = code


@dataclass
class Parameter:
    """One user parameter."""

    value: str
    kind: int
    access: int
    largest: int = 0
    description: str = ""

    @property
    def is_writable(self) -> bool:
        """Whether SET may change it."""
        return bool(self.access & 2)


class Parameters:
    """All user parameters. Those of the control unit may be named with or without `SCU-0.`."""

    def __init__(self, serial: str, firmware: str) -> None:
        self._all: dict[str, Parameter] = {}
        self.has_new_alerts = False
        """Whether a client should ask."""
        for index, component in enumerate(COMPONENTS):
            kind, _, instance = component.partition("-")
            self._add(f"Device.Type.{index}", Parameter(kind, _STRING, _READ))
            self._add(f"Device.Instance.{index}", Parameter(instance, _INTEGER, _READ))
        self._add("Features.Firmware.Version", Parameter(firmware, _STRING, _READ))
        self._add("Features.Hardware.Model", Parameter("Emulated Aurora", _STRING, _READ))
        self._add("Features.Hardware.Serial Number", Parameter(serial, _STRING, _READ))
        self._add("Features.Hardware.Max Tool Ports", Parameter("16", _INTEGER, _READ))
        for word, limit_s in _TIMEOUTS_S.items():
            self._add(f"Info.Timeout.{word}", Parameter(str(limit_s), _INTEGER, _READ))
        for component in COMPONENTS:
            prefix = _prefix(component)
            for name in (ALERTS, NEW_ALERTS):
                self._add(prefix + name, Parameter("0", _INTEGER, _VOLATILE))
            self._add(prefix + SIMULATED_ALERTS, Parameter("0", _INTEGER, _READ_WRITE, 2**32 - 1))
        self._add("Param.System Beeper", Parameter("1", _INTEGER, _READ_WRITE, 1))
        self._add("Param.Tracking.Frame Sync Source", Parameter("0", _INTEGER, _READ_WRITE, 4))
        for name in (TRACK_FREQUENCY, FRAME_FREQUENCY):
            self._add(name, Parameter("0", _FLOAT, _VOLATILE))

    def found(self, pattern: str) -> dict[str, Parameter]:
        """Parameters by name; a trailing `*` stands for anything. Raises ParameterError."""
        name = pattern.removeprefix(f"{CONTROL_UNIT}.")
        if name.endswith("*"):
            matching = {n: p for n, p in self._all.items() if n.startswith(name[:-1])}
        else:
            matching = {name: self._all[name]} if name in self._all else {}
        if not matching:
            raise ParameterError(UNKNOWN_PARAMETER)
        return matching

    def get(self, pattern: str) -> dict[str, str]:
        """Values by name. Reading new alerts clears them. Raises ParameterError."""
        values = {name: parameter.value for name, parameter in self.found(pattern).items()}
        for name in values:
            if name.endswith(NEW_ALERTS):
                self._all[name].value = "0"
        self._look_for_new_alerts()
        return values

    def describe(self, pattern: str) -> list[str]:
        """The lines of GETINFO. Raises ParameterError."""
        return [
            f"{name}={p.value};{p.kind};{p.access};0;{p.largest};;{p.description}"
            for name, p in self.found(pattern).items()
        ]

    def set(self, name: str, value: str) -> None:
        """What SET does. Raises ParameterError."""
        name = name.removeprefix(f"{CONTROL_UNIT}.")
        parameter = self._all.get(name)
        if parameter is None:
            raise ParameterError(UNKNOWN_PARAMETER)
        if not parameter.is_writable:
            raise ParameterError(READ_ONLY)
        if not (value.isascii() and value.isdigit()):
            raise ParameterError(WRONG_TYPE)
        if int(value) > parameter.largest:
            raise ParameterError(OUT_OF_RANGE)
        parameter.value = value
        if name.endswith(SIMULATED_ALERTS):
            self.raise_alerts(name.removesuffix(SIMULATED_ALERTS).rstrip("."), int(value))

    def set_rates(self, rates: Mapping[str, float]) -> None:
        """Track and frame frequency, which hold only while tracking."""
        for name, value in rates.items():
            self._all[name].value = f"{value:g}"

    def raise_alerts(self, component: str, bits: int) -> None:
        """A component's alerts are `bits` now; those that changed are new."""
        prefix = _prefix(component or CONTROL_UNIT)
        alerts, new = self._all[prefix + ALERTS], self._all[prefix + NEW_ALERTS]
        new.value = str(int(new.value) | (int(alerts.value) ^ bits))
        alerts.value = str(bits)
        self._look_for_new_alerts()

    def _look_for_new_alerts(self) -> None:
        self.has_new_alerts = any(self._all[name].value != "0" for name in _NEW_ALERTS)

    def _add(self, name: str, parameter: Parameter) -> None:
        self._all[name] = parameter


def _prefix(component: str) -> str:
    return "" if component == CONTROL_UNIT else f"{component}."


_NEW_ALERTS = tuple(_prefix(component) + NEW_ALERTS for component in COMPONENTS)
