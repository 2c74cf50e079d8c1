"""The emulated Aurora: its tools, its place and its errors."""

from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from config.model import ConfigModel, NotNegative, Positive, Vector3

Quaternion = Annotated[tuple[float, float, float, float], Field(strict=False)]


class EmulatedTool(ConfigModel):
    """A sensor plugged into the emulated tracker."""

    attached_to: Literal["tip", "base", "nothing"]
    """Where on the robot it sits. `nothing`: it lies beside the field generator, out of volume."""
    port: Annotated[int, Field(ge=1, le=16)]
    channel: Literal[0, 1] = 0
    serial: Annotated[str, StringConstraints(pattern=r"^[0-9A-F]{8}$")]
    degrees_of_freedom: Literal[5, 6] = 6
    part_number: Annotated[str, StringConstraints(max_length=20)] = "610061"
    blank_memory: bool = False
    """Its memory chip is not programmed: initialising it fails with error 13."""


class EmulatedTracker(ConfigModel):
    """The emulated Aurora: its tools, its place and its errors."""

    tools: list[EmulatedTool]
    base_position_mm: Vector3 = (0.0, 0.0, -300.0)
    """The robot's base in the field generator's frame."""
    base_quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """Scalar first."""
    freeze_tag: str = "AURORA Rev 013"
    """`AURORA Rev 008` makes some third-party clients ask for text replies."""
    strict_baud_rate: bool = True
    """Bytes at another rate than the device's are noise, as on a wire."""
    initialise_clears_handles: bool = True
    """Whether INIT forgets all tools, or keeps them initialised. Both exist."""
    hold_until_new_frame: bool = False
    """Answer a second request for the same frame only when the next frame is there."""
    reset_time_s: Positive = 1.0
    """2 to 12 s on real hardware."""
    initialise_tool_s: NotNegative = 0.2
    """About 2 s per tool on real hardware."""
    reply_delay_s: NotNegative = 0.002
    clock_error_ppm: float = 25.0
    distortion_rms_mm: NotNegative = 0.8
    """Smooth and fixed: the accuracy that the maker quotes."""
    distortion_rms_rad: NotNegative = 0.012
    jitter_mm: NotNegative = 0.1
    """White, per coordinate, 300 mm from the generator; half of it near by, more far away."""
    jitter_rad: NotNegative = 0.0013
    outliers_per_s: NotNegative = 0.005
    """Single frames that are wildly wrong and carry no flag."""
    outlier_mm: Annotated[tuple[Positive, Positive], Field(strict=False)] = (5.0, 50.0)
