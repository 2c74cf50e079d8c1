"""What clients ask of the robot: who may, whether it is possible now, and what then happens."""

import asyncio
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import Any, Final

from daemon.control.guarded_controller import at_once as answers_at_once
from daemon.control.guarded_controller import in_a_thread
from daemon.messages import (
    Acquire,
    Answer,
    Arm,
    Clear,
    Command,
    Disarm,
    Hold,
    Home,
    Inject,
    Load,
    Obstacles,
    Plan,
    Reason,
    Refusal,
    Release,
    Resume,
    Setpoint,
    SetpointRefused,
    Start,
    Status,
    Stop,
    Surround,
    Teleoperate,
    Upload,
    Verb,
    verb,
)
from daemon.recording.flight_recorder import RecordingError
from daemon.service.motion_loader import CommandRefusedError, MotionLoader, OffTheLoop, at_once
from daemon.service.operation.clearing import Clearing
from daemon.service.operation.homing import RobotHoming
from daemon.service.operation.loading import Loading
from daemon.service.operation.planning import Planning, PlanPath
from daemon.service.operation.run_recording import RunRecording
from daemon.service.operation.surrounding import Surrounding
from daemon.service.operation.verbs import Prepared, verb_states
from daemon.service.robot_service import RobotService
from daemon.supervision.explained import explained
from safety.states import OperatingState, Request

BLEND_SPEED_MM_S: Final = 5.0
_MOST_ANSWERED: Final = 1000
"""Places of a path: each is some hundred bytes, of the quarter of a million of an answer."""
_LOOK_EVERY_S: Final = 0.002
_CONTACT_REMEDY: Final = (
    "Move the body or what it touches by hand, or correct risk.surface in the robot file; or arm "
    "with --despite-contact and lead it out"
)


class Operator:
    """Carries commands out. Implements the remote server's CommandHandler."""

    def __init__(
        self,
        service: RobotService,
        recording: RunRecording,
        seed: int,
        inject: Callable[[str], Awaitable[None]] | None,
        files: Path | None = None,
        off_the_loop: OffTheLoop = at_once,
        robot_path: Path = Path(),
        plan_path: PlanPath | None = None,
    ) -> None:
        """seed: of controllers. inject: makes an emulated device misbehave; raises ValueError.
        robot_path: of the robot file. plan_path: how paths are planned; None: they are not.

        files: the folder whose files commands may name. off_the_loop: how such files are read.
        """
        self._service = service
        self._recording = recording
        timed = off_the_loop is not at_once or service.dependencies.real_time is not None
        answering = in_a_thread if timed else answers_at_once
        loader = MotionLoader(service.robot, seed, files, off_the_loop, answering)
        self.loading = Loading(service, loader)
        self._inject_fault = inject
        self._homing = RobotHoming(service)
        self._clearing = Clearing(service)
        self.surrounding = Surrounding(service, recording, robot_path, off_the_loop)
        self._planning = (
            None
            if plan_path is None
            else Planning(service, recording, robot_path, files, off_the_loop, plan_path)
        )
        self._preparing = False
        """An `arm` or `home` is under way, and nothing is energised yet."""
        self._stops = 0
        self._waiting: set[str] = set()
        """Users of whom it was told that they want the lease, since somebody has it."""
        self._following = service.following
        service.verbs = self._verb_states
        self._verbs: dict[type[Command], Callable[[str, Any], Awaitable[Answer]]] = {
            Acquire: self._acquire,
            Release: self._release,
            Arm: self._arm,
            Home: self._home,
            Disarm: self._disarm,
            Load: self._load,
            Plan: self._plan,
            Start: self._start,
            Teleoperate: self._teleoperate,
            Hold: self._hold,
            Resume: self._resume,
            Stop: self._stop,
            Clear: self._clear,
            Upload: self._upload,
            Surround: self._surround,
            Inject: self._inject,
        }

    async def handle(self, user: str, command: Command) -> Answer | Refusal:
        """Carry `command` out, or say why not."""
        goes_on = isinstance(command, Upload) and command.offset > 0
        if not (goes_on or self._is_repeated(user, command)):
            self._service.events.tell("command", verb(command), f"{user} asks for it", subject=user)
        try:
            if not isinstance(command, Acquire | Stop):
                self._check_lease(user, command)
            return await self._verbs[type(command)](user, command)
        except CommandRefusedError as refused:
            now_ns = self._service.clock.now_ns()
            reasons = [explained(reason, now_ns) for reason in refused.reasons]
            return self._refusal(command, refused, reasons)

    def stop_now(self) -> None:
        """Quick stop on the bus at once. A `stop` that is handled then waits for the drives."""
        self._stops += 1
        self._service.supervisor.request(Request.STOP, self._service.clock.now_ns())

    def setpoint(self, user: str, setpoint: Setpoint) -> SetpointRefused | None:
        """Take a set-point, or say why it is dropped."""
        now_ns = self._service.clock.now_ns()
        if not self._service.lease.holds(setpoint.token, user, now_ns):
            why = "its token is not the lease's"
        else:
            why = self._following.take(setpoint, now_ns)
        return SetpointRefused(sequence=setpoint.sequence, reason=why) if why else None

    def obstacles(self, user: str, obstacles: Obstacles | str) -> None:
        """Take obstacles that move, or tell why they are dropped."""
        self._service.take_obstacles(user, obstacles)

    def status(self) -> Status:
        return self._service.status()

    # The verbs.

    async def _acquire(self, user: str, command: Acquire) -> Answer:
        service, now_ns = self._service, self._service.clock.now_ns()
        token = service.lease.acquire(user, command.token, now_ns)
        if token is None:
            holder = service.lease.holder(now_ns)
            raise CommandRefusedError(
                "lease_taken", f"{holder} has the lease; it ends when not renewed"
            )
        service.supervisor.checks.lease_held(now_ns)  # whatever is asked for next finds it so
        return self._answer(command, token=token, expires_in_s=service.lease.expires_in_s(now_ns))

    async def _release(self, user: str, command: Release) -> Answer:
        if self._service.supervisor.energised:
            raise CommandRefusedError("wrong_state", "the drives are energised: disarm first")
        self._service.lease.release(command.token, user, self._service.clock.now_ns())
        return self._answer(command)

    async def _arm(self, user: str, command: Arm) -> Answer:
        service, supervisor = self._service, self._service.supervisor
        await self._prepare(user, command, Request.ARM)
        if not command.despite_contact:
            self._check_contact()
        service.hurry()
        supervisor.arm(service.clock.now_ns())
        while supervisor.arming:
            await asyncio.sleep(_LOOK_EVERY_S)
        if not supervisor.state.energised:
            raise CommandRefusedError(
                "not_armed", "the drives were not enabled", supervisor.blocking
            )
        return self._answer(command)

    async def _home(self, user: str, command: Home) -> Answer:
        groups = self._homing.groups(command.axes)
        await self._prepare(user, command, Request.HOME)
        self._service.hurry()
        await self._homing.home(groups)
        names = ", ".join(channel.axis.name for group in groups for channel in group)
        return self._answer(command, text=f"homed: {names}")

    async def _prepare(self, user: str, command: Command, request: Request) -> None:
        """What comes before drives are energised, and takes a while. Raises CommandRefusedError."""
        self._check_can_begin(request)
        self._preparing, stops_before = True, self._stops
        try:
            await self._check_settings(request)
            await self._recording.begin()
        except RecordingError as error:
            raise CommandRefusedError("not_recording", str(error)) from None
        finally:
            self._preparing = False
        # Starting a recording takes a while, in which anything may have happened.
        if self._stops != stops_before:
            raise CommandRefusedError("stopped", "it was stopped meanwhile")
        self._check_lease(user, command)
        self._check_can_begin(request)

    async def _check_settings(self, request: Request) -> None:
        """What the drives would do by themselves must still be what they were told."""
        wrong = await self._service.check_settings()
        if wrong:
            reasons = self._service.supervisor.blocking
            raise CommandRefusedError("settings_differ", "; ".join(wrong), reasons)
        self._check_possible(request)

    def _check_contact(self) -> None:
        """A body that touches something is not energised unawares."""
        why = self._service.loop.refuses_rest()
        if why:
            raise CommandRefusedError("contact", f"{why}. {_CONTACT_REMEDY}")

    def _check_can_begin(self, request: Request) -> None:
        if self._preparing:
            raise CommandRefusedError("wrong_state", "the robot is being armed or homed already")
        self._check_possible(request)

    async def _disarm(self, user: str, command: Disarm) -> Answer:
        del user
        return await self._bring_to_rest(Request.DISARM, command)

    async def _stop(self, user: str, command: Stop) -> Answer:
        del user
        return await self._bring_to_rest(Request.STOP, command)

    async def _load(self, user: str, command: Load) -> Answer:
        still_allowed = partial(self._check_lease, user, command)
        trajectory = await self.loading.carry_out(command, still_allowed)
        return self._answer(command, text=f"{trajectory.kind}, {trajectory.duration_s:g} s")

    async def _plan(self, user: str, command: Plan) -> Answer:
        del user
        if self._planning is None:
            raise CommandRefusedError("not_planned", "nobody plans here")
        file, path = await self._planning.plan(command)
        content: dict[str, Any] | None = path.model_dump(mode="json")
        if len(path.t_s) > _MOST_ANSWERED:
            content = None
        text = f"{len(path.t_s)} places in {path.t_s[-1]:.1f} s"
        return self._answer(command, text=text, path=content, file=file)

    async def _start(self, user: str, command: Start) -> Answer:
        del user
        supervisor = self._service.supervisor
        self.loading.check_not_busy()
        if self._following.loaded is None:
            raise CommandRefusedError("nothing_loaded", "load a trajectory first")
        self.start()
        if supervisor.state is OperatingState.HOLD:
            raise CommandRefusedError(
                "held", "what stopped the motion still holds", supervisor.blocking
            )
        return self._answer(command)

    def start(self, blend_speed_mm_s: float = BLEND_SPEED_MM_S) -> None:
        """Follow what was loaded. Raises CommandRefusedError."""
        # In a hold, `resume` goes on with what was held; what was loaded since is begun.
        anew = self._service.supervisor.state is OperatingState.HOLD and self._following.loaded_anew
        request = Request.RESUME if anew else Request.START
        self._check_possible(request)
        assert self._following.loaded is not None
        self.loading.check_path(self._following.loaded.trajectory.path)
        self._following.follow_loaded(blend_speed_mm_s)
        self._service.supervisor.request(request, self._service.clock.now_ns())

    async def _teleoperate(self, user: str, command: Teleoperate) -> Answer:
        self._check_possible(Request.START)
        stops_before = self._stops
        controller = await self.loading.controller(command.controller)
        # Reading a model takes a while, in which anything may have happened.
        if self._stops != stops_before:
            raise CommandRefusedError("stopped", "it was stopped meanwhile")
        self._check_lease(user, command)
        self._check_possible(Request.START)
        now_ns = self._service.clock.now_ns()
        self._following.follow_setpoints(controller, now_ns)
        self._service.supervisor.request(Request.START, now_ns)
        return self._answer(command)

    async def _hold(self, user: str, command: Hold) -> Answer:
        del user
        self._check_possible(Request.HOLD)
        self._service.supervisor.request(Request.HOLD, self._service.clock.now_ns())
        return self._answer(command)

    async def _resume(self, user: str, command: Resume) -> Answer:
        del user
        supervisor = self._service.supervisor
        self._check_possible(Request.RESUME)
        if not self._following.can_go_on:
            raise CommandRefusedError("nothing_to_resume", "nothing was held: load and start")
        self.loading.check_path(self._following.followed_path)
        self.try_to_resume()
        if not supervisor.running:
            raise CommandRefusedError(
                "held", "what stopped the motion still holds", supervisor.blocking
            )
        return self._answer(command)

    def try_to_resume(self) -> None:
        """Go on, if what stopped the motion is over."""
        self._service.supervisor.request(Request.RESUME, self._service.clock.now_ns())

    async def _clear(self, user: str, command: Clear) -> Answer:
        """The answer waits for what passes by itself, so that `arm` may follow at once."""
        await self._clearing.at_rest()
        self._check_lease(user, command)
        self._check_possible(Request.CLEAR)
        self._service.obstacles.forget_late(self._service.clock.now_ns())
        if left := await self._clearing.clear():
            raise CommandRefusedError("still_wrong", "the cause has to go first", left)
        names = await self._clearing.not_yet_over()
        return self._answer(command, text=f"not ready yet: {', '.join(names)}" if names else "")

    async def _upload(self, user: str, command: Upload) -> Answer:
        return self._answer(command, text=await self.surrounding.upload(user, command))

    async def _surround(self, user: str, command: Surround) -> Answer:
        if self._preparing:
            raise CommandRefusedError("wrong_state", "the robot is being armed or homed")
        text = await self.surrounding.surround(command, lambda: self._check_lease(user, command))
        return self._answer(command, text=text)

    async def _inject(self, user: str, command: Inject) -> Answer:
        del user
        if self._inject_fault is None:
            raise CommandRefusedError("real_hardware", "faults are for emulated devices only")
        try:
            await self._inject_fault(command.fault)
        except ValueError as error:
            raise CommandRefusedError("bad_fault", str(error)) from None
        return self._answer(command)

    # What the verbs share.

    async def _bring_to_rest(self, request: Request, command: Command) -> Answer:
        """Quick stop at once; the answer waits for the drives to say that they did it."""
        self._stops += 1
        confirmed = await self._service.rest(request)
        text = "the drives have stopped" if confirmed else "NOT confirmed by the drives"
        return self._answer(command, text=text, confirmed=confirmed)

    def _is_repeated(self, user: str, command: Command) -> bool:
        """Whether it renews the lease, or asks once more for what somebody else has."""
        if not isinstance(command, Acquire):
            return False
        lease, now_ns = self._service.lease, self._service.clock.now_ns()
        if lease.holds(command.token, user, now_ns):
            return True
        waits = user in self._waiting
        if lease.holder(now_ns) is None:
            self._waiting.clear()
            return False
        self._waiting.add(user)
        return waits

    def _check_lease(self, user: str, command: Command) -> None:
        lease, now_ns = self._service.lease, self._service.clock.now_ns()
        if lease.holds(command.token, user, now_ns):
            return
        holder = lease.holder(now_ns)
        text = (
            "nobody has the lease: acquire it first"
            if holder is None
            else f"the lease is {holder}'s, and this is not its token"
        )
        raise CommandRefusedError("no_lease", text)

    def _check_possible(self, request: Request) -> None:
        """Whether the state permits it, as far as that can be told before."""
        supervisor = self._service.supervisor
        why = supervisor.refusal(request)
        if why:
            name = "not_ready" if supervisor.blocking else "wrong_state"
            raise CommandRefusedError(name, why, supervisor.blocking)

    def _verb_states(self) -> list[Verb]:
        return verb_states(
            self._service.supervisor,
            Prepared(
                loaded=self._following.loaded is not None,
                loaded_anew=self._following.loaded_anew,
                resumable=self._following.can_go_on,
                preparing=self._preparing,
                emulated=self._inject_fault is not None,
            ),
        )

    def _answer(self, command: Command, **more: Any) -> Answer:
        state = self._service.supervisor.state.value
        return Answer(request=command.request, state=state, **more)

    def _refusal(
        self, command: Command, refused: CommandRefusedError, reasons: list[Reason]
    ) -> Refusal:
        state = self._service.supervisor.state.value
        return Refusal(
            request=command.request,
            state=state,
            name=refused.name,
            text=refused.text,
            reasons=reasons,
        )
