"""GET and SET: the device's user parameters, `name=value`, one per line."""

from collections.abc import Mapping

from drivers.aurora.codec.errors import CodecError

NEW_ALERTS = "Info.Status.New Alerts"
"""Reading it clears it, and the alert bit of the system status."""
ALERTS = "Info.Status.Alerts"
TRACK_FREQUENCY = "Param.Tracking.Track Frequency"
"""Frames per second; valid only while tracking."""
FRAME_FREQUENCY = "Param.Tracking.Frame Frequency"
"""Steps of the frame counter per second; valid only while tracking."""
TIMEOUT_PREFIX = "Info.Timeout."
DEVICE_TYPE_PREFIX = "Device.Type."
DEVICE_INSTANCE_PREFIX = "Device.Instance."


def decode_parameters(text: str) -> dict[str, str]:
    """Parameters by name, from a reply to GET. Raises CodecError."""
    parameters = {}
    for line in text.split("\n"):
        name, separator, value = line.partition("=")
        if not separator or not name:
            raise CodecError(f"GET: '{line}' is not NAME=VALUE")
        if name in parameters:
            raise CodecError(f"GET: '{name}' is there twice")
        parameters[name] = value
    return parameters


def encode_parameters(parameters: Mapping[str, str]) -> str:
    """The reply to GET. No LF after the last line."""
    return "\n".join(f"{name}={value}" for name, value in parameters.items())


def device_names(parameters: Mapping[str, str]) -> tuple[str, ...]:
    """Components like `SCU-0`, from the reply to GET:Device.*; indices may have gaps."""
    names = []
    for name, kind in parameters.items():
        index = name.removeprefix(DEVICE_TYPE_PREFIX)
        instance = parameters.get(DEVICE_INSTANCE_PREFIX + index)
        if index != name and instance is not None:
            names.append(f"{kind}-{instance}")
    return tuple(names)


def timeouts_s(parameters: Mapping[str, str]) -> dict[str, float]:
    """Seconds that each command may take, by its word, from the reply to GET:Info.Timeout.*"""
    found = {}
    for name, value in parameters.items():
        word = name.rpartition(TIMEOUT_PREFIX)[2]
        if word != name and value.isdecimal():
            found[word] = float(value)
    return found
