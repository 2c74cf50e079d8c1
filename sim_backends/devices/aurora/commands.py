"""The commands of the emulated tracker: when each is allowed, and what carries it out."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

from drivers.aurora.codec.commands import AuroraCommand
from drivers.aurora.codec.errors import CodecError
from sim_backends.devices.aurora import system_commands as system
from sim_backends.devices.aurora import tool_commands as tools
from sim_backends.devices.aurora.command_interface import (
    INVALID_COMMAND,
    OUT_OF_RANGE,
    SYSTEM_NOT_INITIALISED,
    WRONG_MODE,
    CommandedTracker,
    Mode,
    Refusal,
    Reply,
)
from sim_backends.devices.aurora.parameters import ParameterError

Handler = Callable[[CommandedTracker, str], Reply]

_ALWAYS = (Mode.POWERED, Mode.SETUP, Mode.TRACKING)
_SETUP = (Mode.POWERED, Mode.SETUP)
_INITIALISED = (Mode.SETUP,)
_TRACKING = (Mode.TRACKING,)


class Rule(NamedTuple):
    """When a command is allowed, and what it does."""

    modes: tuple[Mode, ...]
    handler: Handler


def carry_out(device: CommandedTracker, command: AuroraCommand) -> Reply:
    """Do what the command says. Raises Refusal."""
    rule = RULES.get(command.word)
    if rule is None:
        raise Refusal(INVALID_COMMAND)
    if device.mode not in rule.modes:
        needs_init = device.mode is Mode.POWERED and rule.modes is _INITIALISED
        raise Refusal(SYSTEM_NOT_INITIALISED if needs_init else WRONG_MODE)
    try:
        return rule.handler(device, command.arguments)
    except CodecError:
        raise Refusal(OUT_OF_RANGE) from None
    except ParameterError as error:
        raise Refusal(error.code) from None


RULES: Mapping[str, Rule] = {
    "APIREV": Rule(_ALWAYS, system.api_revision),
    "BEEP": Rule(_ALWAYS, system.beep),
    "BX": Rule(_TRACKING, system.track_binary),
    "COMM": Rule(_ALWAYS, system.comm),
    "DFLT": Rule(_ALWAYS, system.forget_parameters),
    "ECHO": Rule(_ALWAYS, system.echo),
    "GET": Rule(_ALWAYS, system.get_parameters),
    "GETINFO": Rule(_ALWAYS, system.describe_parameters),
    "INIT": Rule(_ALWAYS, system.initialise),
    "LED": Rule(_ALWAYS, tools.led),
    "PDIS": Rule(_SETUP, tools.disable_tool),
    "PENA": Rule(_SETUP, tools.enable_tool),
    "PHF": Rule(_SETUP, tools.free),
    "PHINF": Rule(_SETUP, tools.tell_tool),
    "PHSR": Rule(_INITIALISED, tools.list_handles),
    "PINIT": Rule(_SETUP, tools.initialise_tool),
    "PPRD": Rule(_SETUP, tools.read_memory),
    "PPWR": Rule(_SETUP, tools.write_memory),
    "PSEL": Rule(_SETUP, tools.select_memory),
    "PSOUT": Rule(_ALWAYS, tools.output_lines),
    "PSRCH": Rule(_SETUP, tools.search_memory),
    "PURD": Rule(_SETUP, tools.read_memory),
    "PUWR": Rule(_SETUP, tools.write_memory),
    "PVWR": Rule(_SETUP, tools.upload_definition),
    "RESET": Rule(_ALWAYS, system.reset),
    "SAVE": Rule(_ALWAYS, system.save_parameters),
    "SET": Rule(_ALWAYS, system.set_parameter),
    "SFLIST": Rule(_SETUP, system.features),
    "SSTAT": Rule(_ALWAYS, system.system_status),
    "TSTART": Rule(_INITIALISED, system.start_tracking),
    "TSTOP": Rule(_TRACKING, system.stop_tracking),
    "TTCFG": Rule(_SETUP, tools.wire_test_definition),
    "TX": Rule(_TRACKING, system.track_text),
    "VER": Rule(_SETUP, system.version),
    "VSEL": Rule(_INITIALISED, system.select_volume),
}
