"""An emulated lab: its drives, its Aurora, and how they are set up round a body."""

from typing import Annotated, Literal

from pydantic import Field, StringConstraints

from config.documents.model import ConfigModel, NotNegative, Positive, Quaternion, Vector3
from config.emulation.plants import Plant

Quirk = Literal[
    "boots_twice",
    "csp_not_listed",
    "emcy_short",
    "fixed_mapping_count",
    "even_mapping_only",
    "no_dummy_mapping",
    "factory_pdos_flood",
    "guarding_excludes_heartbeat",
    "interpolation_index_fixed",
    "interpolation_while_inactive",
    "late_sync_holds",
    "no_encoder",
    "communication_error_stops",
    "tells_reference",
    "counts_modulo_turn",
]


class EmulatedDrives(ConfigModel):
    """The emulated CiA 402 drives."""

    quirks: Annotated[tuple[Quirk, ...], Field(strict=False)] = ()
    """Ways of real products; each is described in sim_backends/devices/drive/quirks.py."""
    clock_error_ppm: NotNegative = 50.0
    """Spread of the drives' own clocks."""
    boot_time_s: Positive = 0.3
    sync_lost_after_periods: Positive = 10.0
    """How many SYNC periods (0x1006) may pass without one. Products have from 2 to none at all."""
    sdo_delay_s: NotNegative = 0.002
    response_time_s: Positive = 0.004
    """Lag of the position loop."""
    motor_torque_nmm: Positive = 400.0
    """Torque at which the motor stalls."""
    brake_release_s: NotNegative = 0.05


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
    position_mm: Vector3 = (0.0, 0.0, 0.0)
    """Where it sits in the frame of what it is attached to."""
    quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """How it is turned there, scalar first."""


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


class Emulation(ConfigModel):
    """The emulated lab around this robot."""

    plant: Plant
    tracker: EmulatedTracker
    drives: EmulatedDrives = EmulatedDrives()
    seed: Annotated[int, Field(ge=0)] = 0
    patience_s: NotNegative = 0.4
    """In real time the daemon and the emulated drives wait at least this long for each other before
    one takes the other for lost: on a busy computer a program may stand still for tenths of a
    second. It holds for buses whose channel is one of the lab; 0: the times of a rig hold there
    too."""
    plant_period_s: Positive = 0.025
    """Time between two solutions of the body's statics."""
    tip_load_g: NotNegative = 0.0
