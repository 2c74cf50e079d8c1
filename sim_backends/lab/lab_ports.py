"""The lab's ports: a folder with everything that other processes need to reach it.

At its control socket one JSON object per line asks, and one per line answers.
"""

import asyncio
import json
import os
import socket
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from drivers.clock import WallClock
from drivers.exclusive_name import ExclusiveName, NameTakenError
from sim_backends.devices.aurora.wires import PtyAurora
from sim_backends.devices.can.bus import CanBus
from sim_backends.devices.can.slcan_adapter import SlcanAdapter
from sim_backends.devices.can.socket_server import SocketServer
from sim_backends.lab.bodies import LabError
from sim_backends.lab.lab import Lab

LONGEST_LINE_BYTES: Final = 65_536

Request = Mapping[str, Any]
Handler = Callable[[Request], Mapping[str, Any]]


class ControlServer:
    """Answers requests `{"do": VERB, ...}` with `{"ok": true, ...}` or `{"ok": false, "error": …}`.

    Handlers are quick and run in the event loop. Whatever a client sends, it gets an answer or is
    hung up on, and the others do not notice.
    """

    def __init__(self, handlers: Mapping[str, Handler]) -> None:
        self._handlers = handlers
        self._server: asyncio.Server | None = None

    async def listen(self, path: Path) -> None:
        """Start answering on the unix socket `path`."""
        self._server = await asyncio.start_unix_server(self._serve, path, limit=LONGEST_LINE_BYTES)

    async def close(self) -> None:
        """Answer no more."""
        if self._server is not None:
            self._server.close()
            self._server = None

    def answer(self, line: bytes) -> Mapping[str, Any]:
        """The answer to one line."""
        try:
            request = json.loads(line)
        except ValueError as error:
            return _refusal(f"not JSON: {error}")
        if not isinstance(request, dict):
            return _refusal('a request is an object like {"do": "state"}')
        handler = self._handlers.get(str(request.get("do")))
        if handler is None:
            return _refusal(f"there is no {request.get('do')!r}: do {', '.join(self._handlers)}")
        try:
            return {"ok": True, **handler(request)}
        except ValueError as error:
            return _refusal(str(error))

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            while line := await reader.readline():
                writer.write(json.dumps(self.answer(line)).encode() + b"\n")
                await writer.drain()
        except (ConnectionError, ValueError):  # ValueError: a line without an end
            pass
        finally:
            writer.close()


def _refusal(error: str) -> Mapping[str, Any]:
    return {"ok": False, "error": error}


AURORA: Final = "aurora"
CONTROL_SOCKET: Final = "control.sock"
LAB_FILE: Final = "lab.json"

_LONGEST_SOCKET_PATH: Final = 107
_STANDSTILL_NS: Final = 60_000_000
"""The body is looked at more often than this, and with it every bus."""


class LabTakenError(LabError):
    """Another lab lives in the folder."""


class LabPorts:
    """A started lab, reachable in `directory` until closed.

    There are `aurora` and, for each bus, `BUS` (a serial CAN adapter) and `BUS.sock` (a socket of
    struct can_frame), the control socket, and `lab.json`, which says what is there.
    """

    def __init__(self, lab: Lab, directory: Path, clock: WallClock) -> None:
        self._lab = lab
        self._directory = directory
        self._clock = clock
        self._aurora: PtyAurora | None = None
        self._sockets: dict[str, SocketServer] = {}
        self._adapters: dict[str, SlcanAdapter] = {}
        self._taken: ExclusiveName | None = None
        self._control = ControlServer(
            {
                "state": self._state,
                "faults": self._faults,
                "inject": self._inject,
                "load": self._load,
                "play": self._play,
                "diary": self._diary,
            }
        )

    async def open(self) -> None:
        """Make the folder and everything in it. Raises LabTakenError, LabError."""
        longest = max(map(len, (CONTROL_SOCKET, *(f"{name}.sock" for name in self._lab.buses))))
        if len(str(self._directory.absolute())) + 1 + longest > _LONGEST_SOCKET_PATH:
            raise LabError(
                f"{self._directory}: the names of sockets in it would be longer than "
                f"{_LONGEST_SOCKET_PATH} characters; choose a folder with a shorter name"
            )
        self._directory.mkdir(parents=True, exist_ok=True)
        self._take_directory()
        self._aurora = PtyAurora(self._lab.tracker, self._clock, self._directory / AURORA)
        for name, bus in self._lab.buses.items():
            self._open_bus(name, bus)
        (self._directory / CONTROL_SOCKET).unlink(missing_ok=True)
        await self._control.listen(self._directory / CONTROL_SOCKET)
        _write_whole(self._directory / LAB_FILE, json.dumps(self._description(), indent=2) + "\n")

    def _open_bus(self, name: str, bus: CanBus) -> None:
        """Two ways to one bus, which has one master all the same."""
        pump, path = self._lab.pumps[name], self._directory / name
        bus.standstill_ns = _STANDSTILL_NS
        door_of_bus = f"emulated {name} of process {os.getpid()} in {self._directory.absolute()}"
        self._sockets[name] = SocketServer(
            bus, pump, self._clock, path.with_name(f"{name}.sock"), door_of_bus=door_of_bus
        )
        self._adapters[name] = SlcanAdapter(bus, pump, self._clock, path, door_of_bus)

    async def close(self) -> None:
        """Take everything away again, unless the folder is another lab's."""
        if self._taken is None:
            return
        await self._control.close()
        for server in self._sockets.values():
            server.close()
        for adapter in self._adapters.values():
            adapter.close()
        if self._aurora is not None:
            self._aurora.close()
        for name in (CONTROL_SOCKET, LAB_FILE):
            (self._directory / name).unlink(missing_ok=True)
        self._taken.release()
        self._taken = None

    def _take_directory(self) -> None:
        """Raises LabTakenError where another lab lives in it."""
        status = self._directory.stat()
        try:
            taken = ExclusiveName(f"lab {status.st_dev} {status.st_ino}")
        except NameTakenError as error:
            raise LabTakenError(
                f"another lab is running in {self._directory} ({error.holder or 'unknown'}): "
                "choose another folder"
            ) from None
        if _somebody_answers(self._directory / CONTROL_SOCKET):  # from within a container
            taken.release()
            raise LabTakenError(
                f"another lab is running in {self._directory}: choose another folder"
            )
        self._taken = taken

    def _description(self) -> Mapping[str, Any]:
        robot, emulation = self._lab.robot, self._lab.robot.emulation
        assert emulation is not None
        return {
            "robot": robot.robot,
            "pid": os.getpid(),
            "started_ns": self._clock.wall_time_ns(),
            "tracker": {
                "port": AURORA,
                "tools": [tool.model_dump(mode="json") for tool in emulation.tracker.tools],
            },
            "buses": {
                name: {
                    "socket": f"{name}.sock",
                    "slcan": name,
                    "bitrate_bit_s": bus.bitrate_bit_s,
                    "nodes": sorted({a.drive.node for a in robot.axes if a.drive.bus == name}),
                }
                for name, bus in robot.buses.items()
            },
            "axes": [axis.name for axis in robot.axes],
            "plant": emulation.plant.model_dump(mode="json"),
            "control": CONTROL_SOCKET,
            "faults": self._fault_list(),
        }

    # What the control socket answers.

    def _state(self, request: Request) -> Mapping[str, Any]:
        del request
        body = self._lab.body.record
        return {
            "t_ns": body.t_ns,
            "tip_mm": body.state.tip.position_mm.tolist(),
            "actuators": body.actuators.tolist(),
            "actuator_forces": body.state.actuator_forces.tolist(),
            "centreline_mm": body.state.centreline_mm.tolist(),
            "body_radius_mm": body.state.radius_mm,
            "stability": body.state.stability,
            "snaps": body.state.snaps,
            "tip_load_g": self._lab.body.load.mass_g,
            "plant_failures": body.plant_failures,
            "last_plant_failure": body.last_failure,
            "failing": self._lab.body.failing,
        }

    def _faults(self, request: Request) -> Mapping[str, Any]:
        del request
        return {"faults": self._fault_list()}

    def _inject(self, request: Request) -> Mapping[str, Any]:
        faults = request.get("faults")
        if not isinstance(faults, list):
            raise ValueError("faults is a list of words")
        self._lab.inject(*map(str, faults))
        return {}

    def _load(self, request: Request) -> Mapping[str, Any]:
        mass_g = request.get("tip_load_g")
        if not isinstance(mass_g, int | float) or not 0.0 <= mass_g < float("inf"):
            raise LabError(f"tip_load_g is a weight in g, not {mass_g!r}")
        self._lab.set_tip_load(float(mass_g))
        return {}

    def _diary(self, request: Request) -> Mapping[str, Any]:
        after = request.get("after")
        if not isinstance(after, int):
            raise LabError(f"after is the number of an entry, not {after!r}")
        return {"count": self._lab.diary.count, "entries": self._lab.diary.after(after)}

    def _play(self, request: Request) -> Mapping[str, Any]:
        name = request.get("name")
        self._lab.play(None if name is None else str(name))
        return {}

    def _fault_list(self) -> dict[str, dict[str, str]]:
        return {
            target: {kind.usage(): kind.text for kind in device.faults}
            for target, device in self._lab.devices.items()
        }


def _somebody_answers(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX) as probe:
        try:
            probe.connect(str(path))
        except OSError:
            return False
    return True


def _write_whole(path: Path, text: str) -> None:
    """Nobody ever reads half of it."""
    fresh = path.with_name(f".{path.name}.{os.getpid()}")
    fresh.write_text(text)
    fresh.replace(path)
