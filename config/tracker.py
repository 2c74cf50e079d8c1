"""The electromagnetic tracker and the sensors on it."""

from typing import Annotated, Final, Literal

from pydantic import Field, StringConstraints, model_validator

from config.documents.model import ConfigModel, Name, NotNegative, Positive, Quaternion, Vector3

BaudRate = Literal[9600, 38400, 57600, 115200, 230400, 921600]
_FRAME_S: Final = {"normal": 1.0 / 40.0, "fast": 1.0 / 66.0}
_BYTES: Final = {"binary": (24, 42), "text": (25, 70)}
"""Of a request with its reply, and for each tool in it: what BX and TX are made of."""
_BITS_PER_BYTE: Final = 10
"""With start and stop bit."""


class ToolSelector(ConfigModel):
    """Which sensor a name means: by its serial number, or by the port it is plugged into."""

    serial: Annotated[str, StringConstraints(pattern=r"^[0-9A-F]{8}$")] | None = None
    """Eight upper-case hex digits, as `tentacled probe` shows them."""

    port: Annotated[int, Field(ge=1, le=16)] | None = None
    """Port on the sensor interface, from 1."""

    channel: Literal[0, 1] = 0
    """Second sensor of a dual 5-DOF plug: 1."""

    position_mm: Vector3 = (0.0, 0.0, 0.0)
    """Of the tip's sensor: where it sits in the frame of the tip, whose z axis leads out of it."""

    quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """... and how it is turned there, scalar first. What is followed and told is then the tip, and
    not the sensor."""

    @model_validator(mode="after")
    def _exactly_one_way(self) -> "ToolSelector":
        if (self.serial is None) == (self.port is None):
            raise ValueError("say either serial or port")
        return self


class Tracker(ConfigModel):
    """An NDI Aurora on a serial port."""

    kind: Literal["ndi_aurora"] = "ndi_aurora"

    port: str
    """`/dev/serial/by-id/...` for real hardware, `lab:aurora` for the emulated tracker."""

    baud_rate: BaudRate = 115200
    """230400 and 921600 need combined firmware 009 or newer; 921600 needs USB."""

    hardware_handshake: bool = False
    """RTS/CTS. Recommended by NDI at 921600, harmful on some adapters: prove it on yours."""

    reply_format: Literal["binary", "text"] = "binary"
    """`text` doubles the bytes on the wire; for looking at it with a terminal."""

    frame_rate: Literal["normal", "fast"] = "normal"
    """40 Hz, or 66 Hz with twice the noise: say so to the filter, too
    (`pose_filter.position_noise_mm`), or it does not believe the frames."""

    acquisition_latency_s: NotNegative = 0.0
    """From a measurement to its earliest possible reply, where you have measured it on your rig.
    The device does not tell; samples are dated earlier by this much."""

    silent_after_s: Positive = 0.1
    """No new frame for this long is reported: a silent or a frozen tracker. On a slow line it takes
    the time of two replies at least."""

    base_averaged_s: Positive | None = None
    """Over how long the base sensor's pose is averaged, for a base that stands still: its jitter
    moves a tip that is far from it. A base that moves slowly is followed so much later, one that
    leaps at once. None: each frame has its own."""

    tools: dict[Name, ToolSelector]
    """Sensors by role. `tip` must be there; `base` is the frame of all poses, where present."""

    @property
    def frame_s(self) -> float:
        """What is between two frames of the device."""
        return _FRAME_S[self.frame_rate]

    @property
    def frames_apart_s(self) -> float:
        """What is between two frames that the line can bring, on the average: it may be too slow
        for all of them."""
        fixed, per_tool = _BYTES[self.reply_format]
        exchange_s = _BITS_PER_BYTE * (fixed + per_tool * len(self.tools)) / self.baud_rate
        return max(exchange_s, self.frame_s)
