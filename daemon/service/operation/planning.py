"""Planning while the robot stands: what is asked of the planner, and what becomes of its answer.

The planner itself is no part of the running daemon. It is asked in a process of its own, with what
is in force: the robot file, the surroundings, what moves among them, and where the axes are. What
comes back is a path file, for `load` as any; nothing moves by it.
"""

from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, Final

import msgspec

from config.tasks.planned_path import PlannedPath
from daemon.host.processes import ApartError, answer_apart
from daemon.messages import PathPlanned, Plan
from daemon.reference.planned_path import misfit, write_path
from daemon.risk.body_risk_source import BodyRiskSource
from daemon.service.motion_loader import CommandRefusedError, OffTheLoop, in_a_thread
from daemon.service.operation.run_recording import RunRecording
from daemon.service.robot_service import RobotService
from safety.causes import Cause
from safety.risk.seen_tip import SeenTip
from safety.states import OperatingState

PlanPath = Callable[[bytes], Awaitable[bytes]]
"""Answers a `PlanRequest` with a `PlanOutcome`, both as JSON. Raises ApartError, TimeoutError."""

_MODULE: Final = "daemon.workbench.planning.plan_process"
_WITHIN_S: Final = 90.0
_STANDS: Final = (OperatingState.READY, OperatingState.ARMED, OperatingState.HOLD)
_FASTEST_TIP_MM_S: Final = 25.0
"""What a controller may be asked to lead a tip by."""
_MOST_VIA: Final = 16


class SeenBody(msgspec.Struct, frozen=True):
    """A `SeenTip`."""

    mean: list[float]
    beside: float
    value: list[float]


class PlanRequest(msgspec.Struct, frozen=True):
    """What is to be planned, where, and from where."""

    robot_path: str
    surface: dict[str, Any]
    moving: list[list[float]]
    """Where obstacles that move may be while they are believed: capsules, each with three numbers
    of where it begins, three of the way to its end, and its radius, mm."""
    u: list[float]
    to_mm: list[float]
    via_mm: list[list[float]]
    pointing: list[float] | None
    tip_speed_mm_s: float
    most_risk: float
    seed: int
    seen: SeenBody | None = None
    """What the tip tells of the body that stands there; None: there is none that the model agrees
    with."""


class PlanOutcome(msgspec.Struct, frozen=True):
    """A path, as its file has it; or why there is none."""

    path: dict[str, Any] | None = None
    none: str = ""
    """Name of the reason."""
    text: str = ""


class Planning:
    """Of one robot; one path after the other."""

    def __init__(
        self,
        service: RobotService,
        recording: RunRecording,
        robot_path: Path,
        files: Path | None,
        off_the_loop: OffTheLoop,
        plan_path: PlanPath,
    ) -> None:
        """files: the folder whose files `load` may name; None: paths are only answered."""
        self._service = service
        self._recording = recording
        self._robot_path = robot_path
        self._files = files
        self._off_the_loop = off_the_loop
        self._plan_path = plan_path
        self._busy = False

    async def plan(self, command: Plan) -> tuple[str, PlannedPath]:
        """Name of the path's file, empty where none is kept, and the path.

        Raises CommandRefusedError, with the planner's own reason where there is no path.
        """
        source = self._service.dependencies.risk
        if not isinstance(source, BodyRiskSource):
            text = "this robot has no model of its body, and so nothing can be planned"
            raise CommandRefusedError("no_model", text)
        wrong = _wrong(command)
        if wrong:
            raise CommandRefusedError("bad_goal", wrong)
        if self._busy:
            raise CommandRefusedError("busy", "a path is being planned already: wait for it")
        request = self._request(source, command)
        self._busy = True
        try:
            outcome = await self._asked(request)
            if outcome.path is None:
                raise CommandRefusedError(outcome.none or "no_path", outcome.text)
            path = PlannedPath.model_validate_json(msgspec.json.encode(outcome.path))
            # It took a while, in which the surroundings may have been replaced.
            identity = source.files.identity
            found = misfit(path, self._service.robot, *identity)
            if found is not None:
                raise CommandRefusedError(*found)
            return await self._kept(path), path
        finally:
            self._busy = False

    def _request(self, source: BodyRiskSource, command: Plan) -> bytes:
        """Raises CommandRefusedError where the robot does not stand, or does not know where, or
        nobody knows where obstacles are that move."""
        service = self._service
        if service.supervisor.state not in _STANDS:
            text = f"the robot is {service.supervisor.state.value}: plan while it is armed or held"
            raise CommandRefusedError("wrong_state", text)
        if gone := service.obstacles.late(service.clock.now_ns()):
            text = (
                f"where the moving obstacles of {gone} are is no longer known: plan when their "
                "stream is back, or has ended"
            )
            raise CommandRefusedError(Cause.OBSTACLES_LATE.value, text)
        u = [
            min(max(c.scale.position(c.position_counts), c.axis.travel[0]), c.axis.travel[1])
            for c in service.loop.channels
        ]
        request = PlanRequest(
            robot_path=str(self._robot_path.absolute()),
            surface=source.files.surroundings.surface.model_dump(mode="json"),
            moving=service.obstacles.swept.capsules.tolist(),
            u=u,
            to_mm=command.to_mm,
            via_mm=command.via_mm,
            pointing=command.pointing,
            tip_speed_mm_s=command.tip_speed_mm_s,
            most_risk=command.most_risk,
            seed=command.seed,
            seen=_seen(source.seen_tip(service.clock.now_ns())),
        )
        return msgspec.json.encode(request)

    async def _asked(self, request: bytes) -> PlanOutcome:
        try:
            return msgspec.json.decode(await self._plan_path(request), type=PlanOutcome)
        except (ApartError, TimeoutError, msgspec.MsgspecError) as error:
            text = f"the planner gives no answer: {str(error) or 'it takes too long'}"
            raise CommandRefusedError("not_planned", text) from None

    async def _kept(self, path: PlannedPath) -> str:
        """In the folder of files, and beside the recording. Raises CommandRefusedError."""
        now_ns, folder = self._service.clock.now_ns(), self._files
        name = f"plan-{now_ns // 1_000_000}.json"
        if folder is not None:
            try:
                await self._off_the_loop(lambda: _write(folder / name, path))
            except (OSError, TimeoutError) as error:
                raise CommandRefusedError("not_kept", f"{folder}: {error}") from None
        text = path.model_dump_json()
        await self._recording.keep(name, text.encode())
        self._service.publish(
            PathPlanned(
                t_ns=now_ns,
                file=name,
                surroundings_sha256=path.surroundings_sha256,
                model_sha256=path.model_sha256,
                duration_s=path.t_s[-1],
                to_mm=list(path.tip_mm[-1]),
                contact_risk=_figure(path, "contact_risk_upper_limit"),
                clearance_mm=_figure(path, "clearance_5_percent_mm"),
            )
        )
        return name if folder is not None else ""


def _wrong(command: Plan) -> str:
    """Why nobody can plan this; empty: somebody may."""
    places = [command.to_mm, *command.via_mm, *([command.pointing] if command.pointing else [])]
    if any(len(place) != 3 for place in places):
        return "to_mm, each of via_mm, and pointing have three numbers"
    if len(command.via_mm) > _MOST_VIA:
        return f"{len(command.via_mm)} places on the way are more than {_MOST_VIA}"
    if command.pointing is not None and not any(command.pointing):
        return "pointing: 0, 0, 0 is no direction"
    if not 0.0 < command.tip_speed_mm_s <= _FASTEST_TIP_MM_S:
        return f"tip_speed_mm_s: above 0, and at most {_FASTEST_TIP_MM_S:g}"
    if not 0.0 < command.most_risk <= 1.0:
        return "most_risk: a probability above 0"
    return "" if command.seed >= 0 else "seed: 0 or more"


def _seen(tip: SeenTip | None) -> SeenBody | None:
    return None if tip is None else SeenBody(tip.mean.tolist(), tip.beside, tip.value.tolist())


def _figure(path: PlannedPath, name: str) -> float | None:
    value = path.figures.get(name)
    return float(value) if isinstance(value, int | float) else None


def _write(path: Path, planned: PlannedPath) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_path(path, planned)


async def plan_in_a_process(request: bytes) -> bytes:
    """Beside the loop. As `PlanPath`."""
    return await in_a_thread(lambda: answer_apart(_MODULE, request, _WITHIN_S), _WITHIN_S + 5.0)
