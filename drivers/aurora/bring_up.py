"""From a device in an unknown state to one that is initialised, at the wanted rate and known."""

import asyncio
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

from config.tracker import Tracker
from drivers.aurora.codec.commands import LineSettings, encode_line_settings
from drivers.aurora.codec.parameters import decode_parameters, device_names, timeouts_s
from drivers.aurora.codec.versions import AURORA_FAMILY, ApiRevision, VersionText
from drivers.aurora.codec.volumes import Volume, decode_volumes
from drivers.aurora.link import (
    POWER_UP_BAUD_RATE,
    AuroraError,
    DamagedReplyError,
    DeviceRefusedError,
    DeviceRestartedError,
    Link,
    NoReplyError,
)

T = TypeVar("T")

CONTROL_UNIT = "SCU-0"
"""The component whose name may be left out before a parameter; old firmware knows no other way."""

_OTHER_BAUD_RATES = (115200, 230400, 921600, 57600, 38400)
_PROBE_TIMEOUT_S = 0.3
_PROBES_PER_RATE = 3
_RATE_CHANGE_S = 0.1
_RATE_ATTEMPTS = 3
_BAD_LINE_SETTINGS = 0x06
_SPOILT_COMMAND = (0x01, 0x02, 0x03)


class NobodyThereError(AuroraError):
    """Nothing answers, whatever is tried."""


class WrongFamilyError(AuroraError):
    """The device is not an Aurora."""


class RateRefusedError(AuroraError):
    """The device cannot be used at the configured baud rate."""


@dataclass(frozen=True)
class DeviceInformation:
    """What the device says about itself. Empty where it cannot say it."""

    api_revision: ApiRevision
    firmware: str
    """Combined firmware revision, three digits: the one to compare."""
    control_unit: VersionText
    field_generator: VersionText
    volumes: tuple[Volume, ...]
    components: tuple[str, ...]
    """`SCU-0`, `FG-0`, `SIU-1`: prefixes of their parameters."""


class Awake(NamedTuple):
    """How the device was found."""

    baud_rate: int
    by_break: bool


async def wake(link: Link, configured_baud_rate: int) -> Awake:
    """Get the device to answer INIT, whatever rate it is at and whatever it is doing.

    Raises NobodyThereError, DeviceRefusedError.
    """
    link.forget_restart()
    for baud_rate in _probe_order(configured_baud_rate):
        link.set_baud_rate(baud_rate)
        if await _answers_init(link):
            return Awake(baud_rate, by_break=False)
    if not await link.restart_by_break():
        raise NobodyThereError("no reply at any baud rate, nor after a break")
    await link.command("INIT")
    return Awake(POWER_UP_BAUD_RATE, by_break=True)


def _probe_order(configured_baud_rate: int) -> Iterator[int]:
    seen = set()
    for baud_rate in (POWER_UP_BAUD_RATE, configured_baud_rate, *_OTHER_BAUD_RATES):
        if baud_rate not in seen:
            seen.add(baud_rate)
            yield baud_rate


async def _answers_init(link: Link) -> bool:
    """Whether INIT works at the present rate. Any readable reply proves the rate right, even an
    error: bytes sent at a wrong rate may have been taken for the beginning of this command."""
    for _ in range(_PROBES_PER_RATE):
        try:
            await link.command("INIT", attempts=1, timeout_s=_PROBE_TIMEOUT_S)
        except NoReplyError:
            return False
        except DeviceRestartedError:
            link.forget_restart()
        except DamagedReplyError:
            continue
        except DeviceRefusedError as error:
            if error.code not in _SPOILT_COMMAND:
                raise
        else:
            return True
    return False


async def set_rate(link: Link, config: Tracker) -> None:
    """Bring device and host to the configured rate. Raises RateRefusedError."""
    wanted = LineSettings(config.baud_rate, hardware_handshake=config.hardware_handshake)
    for _ in range(_RATE_ATTEMPTS):
        if link.baud_rate == wanted.baud_rate and not wanted.hardware_handshake:
            return
        try:
            # Never twice: a device whose OKAY got lost listens at the new rate already.
            await link.command("COMM", encode_line_settings(wanted), attempts=1)
            await asyncio.sleep(_RATE_CHANGE_S)
            link.set_baud_rate(wanted.baud_rate)
            await link.resynchronise()
        except DeviceRefusedError as error:
            if error.code == _BAD_LINE_SETTINGS:
                raise RateRefusedError(f"{wanted.baud_rate} baud: {error}") from None
            raise
        except (NoReplyError, DamagedReplyError):
            if not await link.restart_by_break():
                raise NobodyThereError("no reply after a break") from None
            await link.command("INIT")
        else:
            return
    raise RateRefusedError(f"nothing readable comes at {wanted.baud_rate} baud")


async def identify(link: Link) -> DeviceInformation:
    """Ask the device what it is. Raises WrongFamilyError."""
    revision = await link.query("APIREV", "", ApiRevision.decode)
    if revision.family != AURORA_FAMILY:
        raise WrongFamilyError(f"its interface revision is {revision}, an Aurora's begins with D")
    link.timeouts_s = await _if_it_can(link, "GET", "Info.Timeout.*", _timeouts_s, {})
    return DeviceInformation(
        revision,
        await _if_it_can(link, "VER", "5", str.strip, ""),
        await _if_it_can(link, "VER", "0", VersionText.decode, VersionText(())),
        await _if_it_can(link, "VER", "7", VersionText.decode, VersionText(())),
        await _if_it_can(link, "SFLIST", "03", decode_volumes, ()),
        await components(link),
    )


async def components(link: Link) -> tuple[str, ...]:
    """The parts of the system. An older device names none: only its control unit is known then."""
    return await _if_it_can(link, "GET", "Device.*", _device_names, (CONTROL_UNIT,))


def _timeouts_s(text: str) -> dict[str, float]:
    return timeouts_s(decode_parameters(text))


def _device_names(text: str) -> tuple[str, ...]:
    return device_names(decode_parameters(text)) or (CONTROL_UNIT,)


async def _if_it_can(
    link: Link, word: str, arguments: str, decode: Callable[[str], T], otherwise: T
) -> T:
    """The reply; `otherwise` from a device that is too old, lacks the part, or words it its own
    way: tracking does not depend on it."""
    try:
        return await link.query(word, arguments, decode)
    except (DeviceRefusedError, DamagedReplyError):
        return otherwise
