"""The emulated CiA 402 drives and their quirks."""

from typing import Annotated, Literal

from pydantic import Field

from config.model import ConfigModel, NotNegative, Positive

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
