"""A drive on a bus, and a master that speaks plain frames to it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from config.emulation.lab import EmulatedDrives
from sim_backends.devices.can.bus import CanBus
from sim_backends.devices.drive.axis.axis import Axis
from sim_backends.devices.drive.axis.mechanics import AxisMechanics
from sim_backends.devices.drive.drive import EmulatedDrive
from sim_backends.faults import understand

MS = 1_000_000
NODE = 5
EDS_FOLDER = Path(__file__).parents[3] / "config" / "eds"
STEPPER = EDS_FOLDER / "stepper.eds"
STEPPER3 = EDS_FOLDER / "stepper3.eds"

# Statusword: mask and value of each state, as the standard has them.
STATES = {
    "not ready": (0x4F, 0x00),
    "switch on disabled": (0x4F, 0x40),
    "ready": (0x6F, 0x21),
    "switched on": (0x6F, 0x23),
    "enabled": (0x6F, 0x27),
    "quick stop": (0x6F, 0x07),
    "fault reaction": (0x4F, 0x0F),
    "fault": (0x4F, 0x08),
}


class Refused(Exception):  # noqa: N818
    """The drive has aborted an SDO transfer."""

    def __init__(self, code: int) -> None:
        super().__init__(f"0x{code:08X}")
        self.code = code


class Rig:
    """One drive, one master. Times in ms."""

    def __init__(
        self,
        *quirks: Any,
        eds: Path = STEPPER,
        mechanics: Sequence[AxisMechanics] = (AxisMechanics(),),
        boots: bool = True,
        seed: int = 0,
        **options: Any,
    ) -> None:
        self.bus = CanBus(1_000_000)
        self.master = self.bus.attach("master", 128)
        self.heard: list[tuple[int, bytes, int]] = []
        self.master.listen({}, lambda can_id, data, t_ns: self.heard.append((can_id, data, t_ns)))
        self.drive = EmulatedDrive(
            self.bus,
            NODE,
            eds,
            EmulatedDrives(quirks=quirks, **options),
            seed=seed,
            mechanics=mechanics,
        )
        if boots:
            self.drive.power_on(0)
            self.run(310)
            self.heard.clear()

    @property
    def axis(self) -> Axis:
        return self.drive.axes[0]

    # Frames

    def run(self, ms: float) -> None:
        self.bus.advance(self.bus.now_ns + round(ms * MS))

    def send(self, can_id: int, data: bytes = b"") -> None:
        assert self.master.send(can_id, data, self.bus.now_ns)
        self.run(0.2)

    def frames(self, can_id: int) -> list[bytes]:
        """What was heard under an identifier; forgotten afterwards."""
        found = [data for heard_id, data, _ in self.heard if heard_id == can_id]
        self.heard = [entry for entry in self.heard if entry[0] != can_id]
        return found

    def nmt(self, command: int, node: int = NODE) -> None:
        self.send(0x000, bytes((command, node)))

    def operational(self) -> None:
        self.nmt(0x01)

    def sync(self, counter: int | None = None) -> None:
        self.send(0x080, b"" if counter is None else bytes((counter,)))

    def emergencies(self) -> list[int]:
        """Codes of the EMCY messages heard."""
        return [int.from_bytes(data[:2], "little") for data in self.frames(0x080 + NODE)]

    def states(self) -> list[int]:
        """Heartbeat bytes heard."""
        return [data[0] for data in self.frames(0x700 + NODE)]

    # SDO

    def ask(self, request: bytes, wait_ms: float = 10) -> bytes | None:
        """The answer to an SDO frame; None: there is none."""
        self.send(0x600 + NODE, request)
        self.run(wait_ms)
        answers = self.frames(0x580 + NODE)
        assert len(answers) <= 1
        return answers[0] if answers else None

    def read(self, index: int, subindex: int = 0, *, signed: bool = False) -> int:
        answer = self.ask(bytes((0x40, *index.to_bytes(2, "little"), subindex, 0, 0, 0, 0)))
        self._check(answer)
        assert answer is not None
        assert answer[1:4] == bytes((*index.to_bytes(2, "little"), subindex))
        length = 4 - (answer[0] >> 2 & 3)
        return int.from_bytes(answer[4 : 4 + length], "little", signed=signed)

    def write(self, index: int, subindex: int, value: int, size: int | None = None) -> None:
        if size is None:
            size = self.size(index, subindex)
        data = (value & (1 << 8 * size) - 1).to_bytes(4, "little")
        first = 0x23 | 4 - size << 2
        request = bytes((first, *index.to_bytes(2, "little"), subindex)) + data
        self._check(self.ask(request))

    def refused(self, index: int, subindex: int, value: int, size: int | None = None) -> int:
        """The abort code that a write is answered with; 0: it was accepted."""
        try:
            self.write(index, subindex, value, size)
        except Refused as refusal:
            return refusal.code
        return 0

    def size(self, index: int, subindex: int) -> int:
        entry = self.drive.objects.look_up(index, subindex)
        return entry.description.data_type.size or 0

    def _check(self, answer: bytes | None) -> None:
        assert answer is not None, "no answer"
        if answer[0] == 0x80:
            raise Refused(int.from_bytes(answer[4:], "little"))

    def set(self, index: int, value: int, subindex: int = 0) -> None:
        """Change an object at once, without the detour of an SDO."""
        self.drive.objects.look_up(index, subindex).write(value, self.bus.now_ns)

    def get(self, index: int, subindex: int = 0) -> int:
        value = self.drive.objects.look_up(index, subindex).read(self.bus.now_ns)
        assert isinstance(value, int)
        return value

    # Drive

    @property
    def statusword(self) -> int:
        return self.get(0x6041)

    @property
    def state(self) -> str:
        """The power state that the statusword shows."""
        word = self.statusword
        (found,) = [name for name, (mask, value) in STATES.items() if word & mask == value]
        return found

    @property
    def position(self) -> int:
        return self.get(0x6064)

    def control(self, *words: int) -> None:
        for word in words:
            self.set(0x6040, word)

    def enable(self, mode: int) -> None:
        """Operational and enabled in a mode, brake open."""
        self.operational()
        self.set(0x6060, mode)
        self.control(0x06, 0x07, 0x0F)
        self.run(60)
        assert self.state == "enabled"

    def map(self, receive: bool, number: int, entries: Sequence[int], kind: int) -> int:
        """Map a PDO (1 to 4) to the predefined identifier, which is returned."""
        communication = (0x1400 if receive else 0x1800) + number - 1
        mapping = communication + 0x200
        can_id = (0x100 if receive else 0x080) + 0x100 * number + NODE
        flags = 0 if receive else 1 << 30
        self.set(communication, can_id | flags | 1 << 31, 1)
        self.set(communication, kind, 2)
        self.set(mapping, 0, 0)
        for place, entry in enumerate(entries, 1):
            self.set(mapping, entry, place)
        self.set(mapping, len(entries), 0)
        self.set(communication, can_id | flags, 1)
        return can_id

    def fault(self, order: str) -> None:
        understand({"drive": self.drive}, f"drive.{order}").carry_out(self.bus.now_ns)
