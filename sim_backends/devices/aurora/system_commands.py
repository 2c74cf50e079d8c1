"""Commands of the emulated tracker about the system: settings, modes, tracking."""
# ruff: noqa: ARG001 - all commands have one shape

from functools import lru_cache

from drivers.aurora.codec.commands import decode_line_settings
from drivers.aurora.codec.errors import CodecError
from drivers.aurora.codec.fields import hex_number
from drivers.aurora.codec.parameters import encode_parameters
from drivers.aurora.codec.replies import OKAY
from drivers.aurora.codec.tracking_data import OUT_OF_VOLUME_TOO, TRANSFORMS, encode_bx, encode_tx
from drivers.aurora.codec.versions import encode_version_text
from drivers.aurora.codec.volumes import encode_volumes
from sim_backends.devices.aurora import identity
from sim_backends.devices.aurora.command_interface import (
    BAD_LINE_SETTINGS,
    CANNOT_START_TRACKING,
    NEEDS_8_BITS,
    NOT_PRESENT,
    OUT_OF_RANGE,
    PARAMETER_COUNT,
    TOO_SHORT,
    CommandedTracker,
    CommandError,
    Reply,
)


def api_revision(device: CommandedTracker, arguments: str) -> Reply:
    """APIREV."""
    return str(identity.API_REVISION)


def beep(device: CommandedTracker, arguments: str) -> Reply:
    """BEEP."""
    if not 1 <= hex_number(arguments, "BEEP") <= 9:
        raise CommandError(OUT_OF_RANGE)
    return "1"


def comm(device: CommandedTracker, arguments: str) -> Reply:
    """COMM."""
    try:
        settings = decode_line_settings(arguments)
    except CodecError:
        raise CommandError(BAD_LINE_SETTINGS) from None
    device.change_line(settings)
    return OKAY


def forget_parameters(device: CommandedTracker, arguments: str) -> Reply:
    """DFLT."""
    device.forget_parameters()
    return OKAY


def echo(device: CommandedTracker, arguments: str) -> Reply:
    """ECHO."""
    if len(arguments) < 4:
        raise CommandError(TOO_SHORT)
    return arguments


def get_parameters(device: CommandedTracker, arguments: str) -> Reply:
    """GET."""
    return encode_parameters(device.parameters.get(arguments))


def describe_parameters(device: CommandedTracker, arguments: str) -> Reply:
    """GETINFO."""
    return "\n".join(device.parameters.describe(arguments))


def set_parameter(device: CommandedTracker, arguments: str) -> Reply:
    """SET."""
    name, separator, value = arguments.partition("=")
    if not separator:
        raise CommandError(PARAMETER_COUNT)
    device.parameters.set(name, value)
    return OKAY


def save_parameters(device: CommandedTracker, arguments: str) -> Reply:
    """SAVE."""
    device.parameters.found(arguments or "*")
    return OKAY


def initialise(device: CommandedTracker, arguments: str) -> Reply:
    """INIT."""
    device.initialise()
    return OKAY


def reset(device: CommandedTracker, arguments: str) -> Reply:
    """RESET."""
    if arguments not in ("", "0", "1"):
        raise CommandError(OUT_OF_RANGE)
    device.reset_soon(soft=arguments == "0")
    return ""


def system_status(device: CommandedTracker, arguments: str) -> Reply:
    """SSTAT."""
    return "00"


def version(device: CommandedTracker, arguments: str) -> Reply:
    """VER."""
    tag = device.config.freeze_tag
    if arguments == "5":
        return identity.combined_firmware(tag)
    if arguments == "7" and device.field_generator_is_unplugged:
        raise CommandError(NOT_PRESENT)
    if arguments not in ("0", "4", "7"):
        raise CommandError(OUT_OF_RANGE)
    return encode_version_text(identity.version_lines(arguments, tag))


def features(device: CommandedTracker, arguments: str) -> Reply:
    """SFLIST."""
    if arguments == "00":
        return f"{identity.FEATURES:08X}"
    if arguments != "03":
        raise CommandError(OUT_OF_RANGE)
    return encode_volumes([identity.CUBE])


def select_volume(device: CommandedTracker, arguments: str) -> Reply:
    """VSEL."""
    if arguments != "1":
        raise CommandError(OUT_OF_RANGE)
    return OKAY


def start_tracking(device: CommandedTracker, arguments: str) -> Reply:
    """TSTART."""
    options = hex_number(arguments or "00", "TSTART")
    if options & ~0xC0:
        raise CommandError(OUT_OF_RANGE)
    if device.field_generator_is_unplugged:
        raise CommandError(CANNOT_START_TRACKING)
    device.start_tracking(fast=bool(options & 0x40), from_zero=bool(options & 0x80))
    return OKAY


def stop_tracking(device: CommandedTracker, arguments: str) -> Reply:
    """TSTOP."""
    device.stop_tracking()
    return OKAY


def track_binary(device: CommandedTracker, arguments: str) -> Reply:
    """BX."""
    options = _tracking_options(arguments)
    if device.line.data_bits != 8:
        raise CommandError(NEEDS_8_BITS)
    return encode_bx(device.tracking_data(bool(options & OUT_OF_VOLUME_TOO)))


def track_text(device: CommandedTracker, arguments: str) -> Reply:
    """TX."""
    options = _tracking_options(arguments)
    return encode_tx(device.tracking_data(bool(options & OUT_OF_VOLUME_TOO)))


@lru_cache(maxsize=16)
def _tracking_options(arguments: str) -> int:
    options = hex_number(arguments or "0001", "BX") | TRANSFORMS
    if options & ~(TRANSFORMS | OUT_OF_VOLUME_TOO):
        raise CommandError(OUT_OF_RANGE)
    return options
