"""An emulated Aurora without I/O: bytes go in at a baud rate, and come out when they are due."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from config.emulation.lab import EmulatedTracker
from drivers.aurora.codec.commands import (
    MAX_COMMAND_BYTES,
    AuroraCommand,
    LineSettings,
    decode_command,
)
from drivers.aurora.codec.errors import CodecError
from drivers.aurora.codec.parameters import FRAME_FREQUENCY, TRACK_FREQUENCY
from drivers.aurora.codec.replies import (
    OKAY,
    RESET,
    encode_binary_reply,
    encode_error,
    encode_text_reply,
)
from drivers.aurora.codec.status_bits import SystemStatus
from drivers.aurora.codec.tool_information import NO_SERIAL
from drivers.aurora.codec.tracking_data import TrackingData
from sim_backends.devices.aurora import identity
from sim_backends.devices.aurora import system_commands as system
from sim_backends.devices.aurora import tool_commands as tools
from sim_backends.devices.aurora.command_interface import (
    BAD_CRC,
    INVALID_COMMAND,
    OUT_OF_RANGE,
    SYSTEM_NOT_INITIALISED,
    TOO_LONG,
    WRONG_MODE,
    CommandedTracker,
    CommandError,
    Reply,
    TrackerMode,
)
from sim_backends.devices.aurora.faults import FAULTS, Pending
from sim_backends.devices.aurora.parameters import COMPONENTS, ParameterError, Parameters
from sim_backends.devices.aurora.port import Agenda, Port
from sim_backends.devices.aurora.rack import Handle, Rack, Socket
from sim_backends.devices.aurora.tracking import TICKS_PER_S, BodyPoses, FrameGrid, Tracking
from sim_backends.devices.device import DeviceClock
from sim_backends.faults import FaultError, FaultKind, Value

_RESET_DELAY_NS = 100_000_000
"""Leaves the client time to change its rate."""

Handler = Callable[[CommandedTracker, str], Reply]

_ALWAYS = (TrackerMode.POWERED, TrackerMode.SETUP, TrackerMode.TRACKING)
_SETUP = (TrackerMode.POWERED, TrackerMode.SETUP)
_INITIALISED = (TrackerMode.SETUP,)
_TRACKING = (TrackerMode.TRACKING,)


class Rule(NamedTuple):
    """When a command is allowed, and what it does."""

    modes: tuple[TrackerMode, ...]
    handler: Handler


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


class EmulatedAurora:
    """The device. A shell connects it: `port.output` takes its bytes, `on_hang_up` unplugs it, and
    `on_injected` looks anew when it is due."""

    def __init__(
        self,
        config: EmulatedTracker,
        body_poses: BodyPoses,
        seed: int = 0,
        powered_up_ns: int = 0,
    ) -> None:
        """body_poses: called once per frame, with the host time at which it is measured."""
        self.config = config
        noise, sensing = np.random.SeedSequence(seed).spawn(2)
        self._random = np.random.default_rng(noise)
        self._agenda = Agenda(powered_up_ns)
        self._pending = Pending()
        self._reply_delay_ns = round(config.reply_delay_s * 1e9)
        self._grid = FrameGrid(DeviceClock(config.clock_error_ppm, powered_up_ns))
        self._system_status = SystemStatus(0)
        self.mode = TrackerMode.POWERED
        self.rack = Rack(config.tools)
        self.on_hang_up: Callable[[float], None] = _nobody_to_unplug
        self.on_injected: Callable[[], None] = _nobody_to_tell
        self.port = Port(
            self._agenda,
            self._pending,
            config.strict_baud_rate,
            self._random,
            self._reply_delay_ns,
            self._execution_ns,
            self._answer,
        )
        self.tracking = Tracking(
            config,
            body_poses,
            self._agenda,
            self._grid,
            self.rack,
            self._pending,
            sensing,
        )
        self.forget_parameters()

    # What comes from outside.

    def receive(self, data: bytes, baud_rate: int, t_ns: int) -> None:
        """The host begins to send bytes, at its own rate."""
        self.advance(t_ns)
        self.port.receive(data, baud_rate, t_ns)

    def line_break(self, t_ns: int) -> None:
        """The host holds the line low."""
        self.advance(t_ns)
        if self.mode is not TrackerMode.RESETTING:
            self._restart(self.config.reset_time_s, RESET)

    def advance(self, t_ns: int) -> int | None:
        """Device."""
        return self._agenda.run(t_ns)

    @property
    def faults(self) -> Sequence[FaultKind]:
        """FaultyDevice."""
        return FAULTS

    def inject(self, fault: str, arguments: Mapping[str, Value], t_ns: int) -> None:
        """FaultyDevice."""
        self.advance(t_ns)
        kind = next(kind for kind in FAULTS if kind.name == fault)
        if "who" in arguments:
            self._socket(str(arguments["who"]))
        act = self._sudden_faults().get(fault)
        if act is not None:
            act(arguments)
        else:
            self._pending.add(kind, arguments, t_ns)
        self.on_injected()

    # What the commands need.

    @property
    def line(self) -> LineSettings:
        """The serial line's settings."""
        return self.port.settings

    @property
    def field_generator_is_unplugged(self) -> bool:
        """Whether nothing can be measured for want of a field."""
        return self._pending.holds("unplug_field_generator", self._agenda.now_ns)

    def change_line(self, settings: LineSettings) -> None:
        """COMM, from the end of its reply on."""
        self.port.change_settings(settings)

    def forget_parameters(self) -> None:
        """All user parameters as at power-up."""
        self.parameters = Parameters(
            identity.CONTROL_UNIT_SERIAL, identity.combined_firmware(self.config.freeze_tag)
        )

    def initialise(self) -> None:
        """INIT, in whatever mode."""
        self.stop_tracking()
        self._system_status = SystemStatus(0)
        if self.config.initialise_clears_handles:
            self.rack.clear()

    def reset_soon(self, soft: bool) -> None:
        """RESET."""
        self._silence()
        duration_s, word = (0.0, OKAY) if soft else (self.config.reset_time_s, RESET)
        self._agenda.after(_RESET_DELAY_NS, lambda: self._restart(duration_s, word))

    def look_for_tools(self) -> None:
        """PHSR: what was plugged in or out is known from now on."""
        self.rack.assign_handles()
        self._system_status = SystemStatus(0)

    def serial_of(self, handle: Handle) -> str:
        """The serial number that PHINF reports."""
        return NO_SERIAL if self._pending.take("zero_serial") else handle.socket.tool.serial

    def start_tracking(self, fast: bool, from_zero: bool) -> None:
        """TSTART."""
        self.mode = TrackerMode.TRACKING
        self._grid.start(self._agenda.now_ns, fast, from_zero)
        frames_per_s = 1e9 / self._grid.period_ns
        self.parameters.set_rates({TRACK_FREQUENCY: frames_per_s, FRAME_FREQUENCY: TICKS_PER_S})
        self.tracking.start()

    def stop_tracking(self) -> None:
        """TSTOP."""
        self.mode = TrackerMode.SETUP
        self.parameters.set_rates({TRACK_FREQUENCY: 0.0, FRAME_FREQUENCY: 0.0})
        self.tracking.stop()

    def tracking_data(self, out_of_volume_too: bool) -> TrackingData:
        """The content of BX and TX."""
        status = self._system_status
        if self.field_generator_is_unplugged:
            status |= SystemStatus.FIELD_GENERATOR_UNPLUGGED
        if self.parameters.has_new_alerts:
            status |= SystemStatus.ALERT_PENDING
        return TrackingData(self.tracking.readings(out_of_volume_too), int(status))

    # One command.

    def _execution_ns(self, line: bytes) -> int:
        if line[:5].upper() == b"PINIT":
            return round((self.config.reply_delay_s + self.config.initialise_tool_s) * 1e9)
        return self._reply_delay_ns

    def _answer(self, line: bytes) -> bytes | int:
        try:
            command = decode_command(line)
            if command.word in ("BX", "TX") and self.mode is TrackerMode.TRACKING:
                later_ns = self.tracking.next_news_ns(self.config.hold_until_new_frame)
                if later_ns is not None:
                    return later_ns
            reply = carry_out(self, command)
        except CodecError as error:
            if len(line) > MAX_COMMAND_BYTES:
                return encode_error(TOO_LONG)
            return encode_error(BAD_CRC if error.bad_crc else INVALID_COMMAND)
        except CommandError as refusal:
            return encode_error(refusal.code)
        if isinstance(reply, bytes):
            return encode_binary_reply(reply)
        return encode_text_reply(reply) if reply else b""

    # Restarting.

    def _silence(self) -> None:
        """Whatever was going on is over."""
        self._agenda.clear()
        self.tracking.stop()
        self.port.restart()
        self.port.is_deaf = True
        self.mode = TrackerMode.RESETTING

    def _restart(self, duration_s: float, word: str) -> None:
        self._silence()
        self._agenda.after(round(duration_s * 1e9), lambda: self._up_again(word))

    def _up_again(self, word: str) -> None:
        self.mode = TrackerMode.POWERED
        self.port.is_deaf = False
        self.rack.clear()
        self.forget_parameters()
        self._pending.forget_replies()
        self._system_status = SystemStatus(0)
        self._grid.power_up(self._agenda.now_ns)
        self.port.send(encode_text_reply(word))

    # Faults that happen at once.

    def _sudden_faults(self) -> Mapping[str, Callable[[Mapping[str, Value]], None]]:
        return {
            "late": self._be_late,
            "hang": lambda _: setattr(self.port, "hangs", True),
            "outlier": self._outlier,
            "frame_jump": lambda a: self._grid.jump(int(a["ticks"])),
            "unplug_tool": self._unplug,
            "plug_tool": self._plug,
            "blank_tool": lambda a: setattr(self._socket(str(a["who"])), "blank", True),
            "change_configuration": lambda _: self._flag(SystemStatus.CONFIGURATION_CHANGED),
            "alert": self._alert,
            "reset": lambda _: self._restart(self.config.reset_time_s, RESET),
            "long_reset": lambda a: self._restart(float(a["duration"]), RESET),
            "break": lambda _: self.line_break(self._agenda.now_ns),
            "baud_loss": lambda _: self.port.change_settings(LineSettings(9600)),
            "hang_up": lambda a: self.on_hang_up(float(a["duration"])),
        }

    def _be_late(self, arguments: Mapping[str, Value]) -> None:
        self.port.late_ns = round(float(arguments["delay"]) * 1e9)
        kind = next(kind for kind in FAULTS if kind.name == "late")
        self._pending.add(kind, arguments, self._agenda.now_ns)

    def _outlier(self, arguments: Mapping[str, Value]) -> None:
        direction = self._random.normal(size=3)
        direction *= float(arguments["distance_mm"]) / np.linalg.norm(direction)
        self.tracking.displace_once(str(arguments["who"]), direction)

    def _unplug(self, arguments: Mapping[str, Value]) -> None:
        socket = self._socket(str(arguments["who"]))
        if not socket.plugged:
            raise FaultError(f"{socket.name} is not plugged in")
        self.rack.unplug(socket)
        self._flag(SystemStatus.TOOL_UNPLUGGED)

    def _plug(self, arguments: Mapping[str, Value]) -> None:
        socket = self._socket(str(arguments["who"]))
        if socket.plugged:
            raise FaultError(f"{socket.name} is plugged in already")
        self.rack.plug(socket)
        self._flag(SystemStatus.TOOL_PLUGGED)

    def _flag(self, bit: SystemStatus) -> None:
        self._system_status |= bit

    def _alert(self, arguments: Mapping[str, Value]) -> None:
        component = str(arguments["component"])
        if component not in COMPONENTS:
            raise FaultError(f"there is no '{component}' (there are: {', '.join(COMPONENTS)})")
        self.parameters.raise_alerts(component, int(arguments["bits"]))

    def _socket(self, name: str) -> Socket:
        socket = self.rack.socket(name)
        if socket is None:
            there = ", ".join(socket.name for socket in self.rack.sockets)
            raise FaultError(f"there is no tool '{name}' (there are: {there})")
        return socket


def carry_out(device: CommandedTracker, command: AuroraCommand) -> Reply:
    """Do what the command says. Raises CommandError."""
    rule = RULES.get(command.word)
    if rule is None:
        raise CommandError(INVALID_COMMAND)
    if device.mode not in rule.modes:
        needs_init = device.mode is TrackerMode.POWERED and rule.modes is _INITIALISED
        raise CommandError(SYSTEM_NOT_INITIALISED if needs_init else WRONG_MODE)
    try:
        return rule.handler(device, command.arguments)
    except CodecError:
        raise CommandError(OUT_OF_RANGE) from None
    except ParameterError as error:
        raise CommandError(error.code) from None


def _nobody_to_unplug(duration_s: float) -> None:
    raise FaultError(f"nothing is connected that could be unplugged for {duration_s:g} s")


def _nobody_to_tell() -> None:
    """Nothing is connected."""
