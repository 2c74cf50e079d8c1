"""The device's rhythm: how often it measures, and how fast its frame counter runs."""

from dataclasses import dataclass

from drivers.aurora.codec.errors import CodecError
from drivers.aurora.codec.parameters import FRAME_FREQUENCY, TRACK_FREQUENCY, decode_parameters
from drivers.aurora.link import DamagedReplyError, DeviceRefusedError, Link

_NORMAL_FRAMES_PER_S = 40.0
_FAST_FRAMES_PER_S = 1000.0 / 15.0
_TICKS_PER_S = 320.0


@dataclass(frozen=True)
class Rates:
    """Frames per second, and steps of the frame counter per second."""

    frames_per_s: float
    ticks_per_s: float


async def tracking_rates(link: Link, fast: bool) -> Rates:
    """What the device says while it tracks; older ones do not say it, but keep to the book."""
    usual = Rates(_FAST_FRAMES_PER_S if fast else _NORMAL_FRAMES_PER_S, _TICKS_PER_S)
    try:
        return await link.query("GET", "Param.Tracking.*", _rates)
    except (DeviceRefusedError, DamagedReplyError):
        return usual


def _rates(text: str) -> Rates:
    parameters = decode_parameters(text)
    try:
        rates = Rates(float(parameters[TRACK_FREQUENCY]), float(parameters[FRAME_FREQUENCY]))
    except (KeyError, ValueError):
        raise CodecError("GET: no track and frame frequency") from None
    if not (1.0 <= rates.frames_per_s <= 1000.0 and rates.ticks_per_s >= rates.frames_per_s):
        raise CodecError(f"GET: implausible {rates}")
    return rates
