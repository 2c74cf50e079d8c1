"""A CAN bus and the rhythm that the master keeps on it."""

from typing import Annotated, Final, Literal

from pydantic import Field

from config.documents.model import ConfigModel, DriveTime, NodeId, Positive

LAB: Final = "lab:"
"""What the name of a port begins with where it is one of an emulated lab."""

BitRate = Literal[1_000_000, 800_000, 500_000, 250_000, 125_000]


class Bus(ConfigModel):
    """One CAN bus, opened through python-can."""

    interface: str
    """The python-can interface: `socketcan` for real hardware, `slcan` for a serial adapter,
    `tentacled` for the emulated bus; any other that python-can has works too."""

    channel: str
    """`can0` for socketcan, a serial port for slcan, `lab:can0.sock` for the emulated bus."""

    options: dict[str, bool | int | float | str] = Field(default_factory=dict)
    """What else python-can's interface wants: `{host: 192.168.0.5, port: 29536}` for socketcand."""

    bitrate_bit_s: BitRate = 1_000_000

    cycle_period_s: Annotated[float, Field(ge=0.002, le=0.02)]
    """SYNC period. Whole milliseconds: 0x60C2 of most drives cannot say anything else."""

    master_node: NodeId = 127
    """The node ID under which the master sends its heartbeat."""

    master_heartbeat_period_s: Positive = 0.05

    master_heartbeat_timeout_s: DriveTime = 0.2
    """Drives stop by themselves when they have not heard the master for this long (0x1016)."""

    tx_queue_frames: Annotated[int, Field(ge=1)] = 128
    """Frames the interface must be able to queue (`ip link set can0 txqueuelen 128`)."""

    @property
    def emulated(self) -> bool:
        """Whether it is one of an emulated lab."""
        return self.channel.startswith(LAB)
