"""Other surroundings for a robot that stands still: checked and prepared aside, then exchanged.

Until all of it has succeeded nothing changes; the exchange itself is between two control steps.
"""

import re
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Final

import msgspec

from config.control import (
    PlacedMesh,
    Surface,
    load_more_surroundings,
    load_surface,
)
from config.documents.model import OptionsError
from config.paths import BUILTIN, is_file, shipped_or_beside
from daemon.host.processes import ApartError
from daemon.messages import Surround, SurroundingsChanged, Upload
from daemon.risk.body_risk_source import BodyRiskSource
from daemon.risk.mesh_file import binary_stl
from daemon.risk.preparation import prepare_apart
from daemon.risk.surroundings import BodySize, RiskSurroundings
from daemon.service.motion_loader import CommandRefusedError, OffTheLoop, in_a_thread
from daemon.service.operation.run_recording import RunRecording
from daemon.service.operation.uploads import Uploads
from daemon.service.robot_service import RobotService
from safety.risk.surroundings.environment import EnvironmentFaultError
from safety.states import OperatingState

UPLOADED: Final = "upload:"
_PREPARED_WITHIN_S: Final = 130.0
"""A little more than its process has."""
_BUILTIN: Final = re.compile(re.escape(BUILTIN) + r"[A-Za-z0-9_][A-Za-z0-9_.-]*")

Listener = Callable[[RiskSurroundings, bytes], None]
"""Hears of surroundings that are in force, and of their meshes as a binary STL file."""


class Surrounding:
    """Of one robot."""

    def __init__(
        self,
        service: RobotService,
        recording: RunRecording,
        robot_path: Path,
        off_the_loop: OffTheLoop,
    ) -> None:
        """robot_path: of the robot file, from where its own meshes are seen."""
        self.listeners: list[Listener] = []
        self._service = service
        self._recording = recording
        self._robot_path = robot_path
        self._off_the_loop = off_the_loop
        self._prepare = service.dependencies.prepare_surroundings
        self._folder: Path | None = None
        self._uploads = Uploads(self._temporary, off_the_loop)
        self._busy = False
        recording.begun.append(self._tell_recording)

    async def upload(self, user: str, part: Upload) -> str:
        """Take a part of a file. Raises CommandRefusedError."""
        return await self._uploads.take(user, part)

    async def surround(self, command: Surround, still_allowed: Callable[[], None]) -> str:
        """Exchange the surroundings, and tell them. still_allowed: raises CommandRefusedError once
        the command would be refused. Raises CommandRefusedError."""
        source = self._source()
        self._check_stands_still()
        if self._busy:
            raise CommandRefusedError("busy", "others are being prepared already: wait for them")
        self._busy = True
        try:
            wanted = await self._wanted(source, command)
            return await self._exchange(source, wanted, still_allowed)
        finally:
            self._busy = False

    def close(self) -> None:
        """Give up what clients have sent."""
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)

    async def _exchange(
        self, source: BodyRiskSource, wanted: Surface, still_allowed: Callable[[], None]
    ) -> str:
        size = BodySize.of(source.files.model.model)
        try:
            around = await self._prepare(wanted, size, self._robot_path)
            risk, stl = await self._off_the_loop(
                lambda: (source.among(around), binary_stl(around.mesh))
            )
        except EnvironmentFaultError as error:
            raise CommandRefusedError(error.name, self._without_folder(str(error))) from None
        except (ApartError, ValueError, OSError, TimeoutError) as error:
            text = str(error) or "it took too long"
            raise CommandRefusedError("not_prepared", self._without_folder(text)) from None
        # Preparing takes a while, in which anything may have happened.
        still_allowed()
        self._check_stands_still()
        source.surround(around, risk)
        self._service.loop.forget_clearance()
        text = f"{around.name}, {len(around.environment.triangles)} triangles: {around.sha256}"
        loop, state = self._service.loop, self._service.supervisor.state
        if state.follows and (why := loop.refuses_rest()):
            text += f"; {why}"
        self._service.events.tell("note", "surroundings", text, subject="risk")
        for listener in self.listeners:
            listener(around, stl)
        name = f"surroundings-{around.sha256[:12]}.stl"
        self._tell_recording(name)
        await self._recording.keep(name, stl)
        return text

    # What a message asks for.

    def _source(self) -> BodyRiskSource:
        source = self._service.dependencies.risk
        if not isinstance(source, BodyRiskSource):
            text = "this robot has no model of its body, and nothing asks what is round it"
            raise CommandRefusedError("no_model", text)
        return source

    def _check_stands_still(self) -> None:
        supervisor = self._service.supervisor
        if supervisor.running or supervisor.state is OperatingState.HOMING:
            raise CommandRefusedError("wrong_state", "the robot is moving: hold or stop it first")
        if supervisor.arming:
            raise CommandRefusedError("wrong_state", "the robot is being armed: wait for it")

    async def _wanted(self, source: BodyRiskSource, command: Surround) -> Surface:
        own, asked = self._service.robot.risk.surface, command.surface
        if asked is None:
            if command.add or own is None:
                raise CommandRefusedError("bad_surroundings", "there is nothing to add")
            return own
        try:
            if not command.add:
                surface = await self._off_the_loop(lambda: load_surface(asked))
                main = self._found(surface)
                bodies = [self._found(one) for one in surface.bodies]
                return surface.model_copy(update={"mesh": main.mesh, "bodies": bodies})
            more = await self._off_the_loop(lambda: load_more_surroundings(asked))
            there = source.files.surroundings.surface
            bodies = [*there.bodies, *(self._found(one) for one in more.bodies)]
            together = {"bodies": bodies, "regions": [*there.regions, *more.regions]}
            kept = there.model_copy(update=together)
            return load_surface(kept.model_dump(mode="python"))
        except OptionsError as error:
            raise CommandRefusedError("bad_surroundings", str(error)) from None
        except TimeoutError:
            raise CommandRefusedError("not_prepared", "it took too long") from None

    def _found(self, one: PlacedMesh) -> PlacedMesh:
        """With the place of its file. Raises CommandRefusedError."""
        if one.mesh.startswith(UPLOADED):
            path = self._uploads.path(one.mesh.removeprefix(UPLOADED))
            return one.model_copy(update={"mesh": str(path)})
        if _BUILTIN.fullmatch(one.mesh):
            if is_file(shipped_or_beside(one.mesh, "surfaces", self._robot_path)):
                return one
            raise CommandRefusedError("bad_surroundings", f"there is no {one.mesh[:80]}")
        text = "a mesh is `upload:` and the SHA-256 of what was uploaded, or `builtin:` and a name"
        raise CommandRefusedError("bad_surroundings", text)

    # What is told of it.

    def _tell_recording(self, file: str = "") -> None:
        source = self._service.dependencies.risk
        if not isinstance(source, BodyRiskSource):
            return
        around = source.files.surroundings
        self._service.publish(
            SurroundingsChanged(
                t_ns=self._service.clock.now_ns(),
                sha256=around.sha256,
                mesh=around.name,
                triangles=len(around.environment.triangles),
                surface=msgspec.json.encode(around.surface.model_dump(mode="json")).decode(),
                file=file or "surroundings.stl",
            )
        )

    def _without_folder(self, text: str) -> str:
        """What is wrong with a file is the client's to know, where we keep it is not."""
        if self._folder is None:
            return text
        return re.sub(re.escape(str(self._folder)) + r"/[0-9a-f]{64}/", "", text)

    def _temporary(self) -> Path:
        if self._folder is None:
            self._folder = Path(tempfile.mkdtemp(prefix="tentacled-uploads-"))
        return self._folder


async def prepare_in_a_process(
    surface: Surface, size: BodySize, robot_path: Path
) -> RiskSurroundings:
    """Beside the loop. As `PrepareSurroundings`."""

    def prepared() -> RiskSurroundings:
        with tempfile.TemporaryDirectory(prefix="tentacled-") as name:
            # What is mapped into memory stays when its name goes.
            return prepare_apart(surface, size, robot_path, Path(name))

    return await in_a_thread(prepared, _PREPARED_WITHIN_S)
