"""One experiment, carried out: the same service and operator as under a remote client."""

import asyncio
import re
from collections.abc import Callable
from typing import Final

from config.tasks.experiment import Experiment
from daemon.host.progress import Progress, Unheard
from daemon.messages import Acquire, Answer, Arm, Disarm, Refusal, Tip
from daemon.reference.trajectories import Trajectory
from daemon.service.motion_loader import CommandRefusedError
from daemon.service.operation.session import Session
from daemon.workbench.experiments.scripted_events import Happenings, LabControl
from daemon.workbench.experiments.stopwatch import Stopwatch, TimedController
from safety.states import OperatingState

Tell = Callable[[str], None]
"""Hears in words of what happens."""

_USER: Final = "experiment"
_READY_WITHIN_S: Final = 120.0
_RENEWALS_PER_LEASE: Final = 4
_LOOK_EVERY_S: Final = 0.05
_LOOKS_UNTIL_IT_RUNS: Final = 20
_COUNTED: Final = re.compile(r"(\D*)(\d+) of (\d+)")
"""In a controller's note: what it does, and how much of that."""
_NOT_TO_BE_FOLLOWED: Final = {"unreachable", "axis_too_slow"}
_MOST_IN_A_ROW: Final = 50
"""So often may it be held at once when it was resumed."""
_LONGEST_HELD_S: Final = 180.0
"""What goes by itself is over by then, the risk of the last minute too."""
_LONGEST_UNREADY_S: Final = 300.0
"""So long may a controller not be ready and its note stay the same: no shipped one comes near."""


class TrialError(RuntimeError):
    """The experiment could not be carried out; the text says why."""


class RefusedTrialError(TrialError):
    """The trajectory cannot be followed, and nothing has moved; the text says why."""


class Trial:
    """Takes the lease, arms, follows the trajectory to its end, disarms."""

    def __init__(
        self,
        experiment: Experiment,
        trajectory: Trajectory,
        session: Session,
        lab: LabControl,
        stopwatch: Stopwatch,
        tell: Tell,
        progress: Progress | None = None,
    ) -> None:
        """progress: hears how far it is, each part of it for itself."""
        self._experiment = experiment
        self._trajectory = trajectory
        self._service = session.service
        self._operator = session.operator
        self._stopwatch = stopwatch
        self._tell = tell
        self._progress = Unheard() if progress is None else progress
        self._part: str | None = None
        """What is being done, as the progress has it."""
        self._token = ""
        self._happenings = Happenings(
            experiment.happenings, experiment.tip_load_g, lab, self._happened
        )
        self._last_ns: int | None = None
        self._cycle = -1
        self._unready_s, self._unready_note = 0.0, ""
        """How long the controller has not been ready, and told the same of what it does."""
        self._service.dependencies.subscribers.add_for(Tip, self._step)

    async def run(self) -> None:
        """Raises TrialError; the robot is then left to `RobotService.rest`."""
        self._progress.begin("getting ready", 0.0)
        await self._ready()
        await self._acquire()
        renewing = asyncio.create_task(self._keep_lease())
        try:
            await self._load()
            await self._ready()  # in real time reading a model may have kept the loop waiting
            self._carried_out(await self._operator.handle(_USER, Arm(token=self._token)))
            self._operator.start(self._experiment.blend_speed_mm_s)
            async with asyncio.timeout(self._experiment.longest_s):
                await self._follow()
            self._carried_out(await self._operator.handle(_USER, Disarm(token=self._token)))
        except CommandRefusedError as refused:
            kind = RefusedTrialError if refused.name in _NOT_TO_BE_FOLLOWED else TrialError
            raise kind(refused.text) from None
        except TimeoutError:
            late = f"the trajectory was not finished within {self._experiment.longest_s:g} s"
            held = "" if self._service.supervisor.running else f": {self._why()}"
            raise TrialError(late + held) from None
        finally:
            renewing.cancel()
            await asyncio.gather(renewing, return_exceptions=True)

    async def _ready(self) -> None:
        supervisor = self._service.supervisor
        try:
            async with asyncio.timeout(_READY_WITHIN_S):
                while supervisor.state is not OperatingState.READY:
                    await asyncio.sleep(_LOOK_EVERY_S)
        except TimeoutError:
            raise TrialError(f"the robot did not get ready: {self._why()}") from None

    async def _acquire(self) -> None:
        answer = self._carried_out(await self._operator.handle(_USER, Acquire(token=self._token)))
        self._token = answer.token

    async def _load(self) -> None:
        await self._operator.loading.load(self._trajectory, self._experiment.controller)
        following = self._service.following
        assert following.loaded is not None
        timed = TimedController(following.loaded.controller, self._stopwatch)
        following.loaded = following.loaded._replace(controller=timed)

    async def _keep_lease(self) -> None:
        while True:
            await asyncio.sleep(self._service.robot.supervision.lease_s / _RENEWALS_PER_LEASE)
            await self._acquire()

    async def _follow(self) -> None:
        """To the trajectory's end, going on whenever what held the motion is over."""
        supervisor, loop = self._service.supervisor, self._service.loop
        looks_running = in_a_row = 0
        held_s = 0.0
        while True:
            await asyncio.sleep(_LOOK_EVERY_S)
            if supervisor.running:
                self._tell_how_far()
                self._end_if_never_ready()
                looks_running += 1
                held_s = 0.0
                in_a_row = 0 if looks_running > _LOOKS_UNTIL_IT_RUNS else in_a_row
                continue
            looks_running = 0
            if loop.reference is not None and loop.reference.finished:
                return
            if not supervisor.state.energised:
                raise TrialError(f"the robot is {supervisor.state.value}: {self._why()}")
            held_s += _LOOK_EVERY_S
            where = f"{self._service.following.elapsed_s:.1f} s along the trajectory"
            if in_a_row >= _MOST_IN_A_ROW:
                raise TrialError(f"the motion is held again and again, {where}: {self._why()}")
            if held_s > _LONGEST_HELD_S:
                raise TrialError(f"the motion is held and cannot go on, {where}: {self._why()}")
            self._operator.try_to_resume()
            in_a_row += supervisor.running

    def _end_if_never_ready(self) -> None:
        """With a controller that is not ready, but not without end: nothing else would end it."""
        loaded, note = self._service.following.loaded, self._service.loop.note
        if loaded is None or loaded.controller.ready or note != self._unready_note:
            self._unready_s, self._unready_note = 0.0, note
        self._unready_s += _LOOK_EVERY_S
        if self._unready_s > _LONGEST_UNREADY_S:
            kind = self._experiment.controller.kind
            does = f"says '{note}'" if note else "has no note of what it does"
            raise TrialError(
                f"the controller {kind} has not been ready for {_LONGEST_UNREADY_S:g} s "
                f"and {does}: nothing is followed before its `ready` is true"
            )

    def _tell_how_far(self) -> None:
        """Of what the controller does first, where it counts that; then of the trajectory."""
        note, experiment = self._service.loop.note, self._experiment.experiment
        counted = _COUNTED.search(note)
        what, part = f"{experiment}: {note}", note
        now = total = 0.0
        if counted is not None:
            part, now, total = counted[1], float(counted[2]), float(counted[3])
        elif not note and self._cycle < 0:
            what = part = f"{experiment}: on the way to its start"
        elif not note:
            what, now = f"{experiment}: following", self._service.following.elapsed_s
            total = self._trajectory.duration_s
        if part != self._part:
            self._part = part
            self._progress.begin(what, total, now)
        else:
            self._progress.reach(now, total, what)

    def _step(self, tip: Tip) -> None:
        """Happenings go by the trajectory's own time."""
        dt_s = 0.0 if self._last_ns is None else (tip.t_ns - self._last_ns) * 1e-9
        self._last_ns, self._cycle = tip.t_ns, tip.cycle
        self._happenings.step(self._service.following.elapsed_s, tip.cycle, dt_s)

    def _happened(self, what: str) -> None:
        self._service.events.tell("note", "happening", what, subject="lab")
        self._tell(what)

    def _carried_out(self, outcome: Answer | Refusal) -> Answer:
        if isinstance(outcome, Answer):
            return outcome
        reasons = "; ".join(f"{r.name} ({r.subject}): {r.text}" for r in outcome.reasons)
        raise TrialError(": ".join(filter(None, (outcome.text, reasons))))

    def _why(self) -> str:
        reasons = self._service.supervisor.reasons
        told = [(r.cause, r.subject, r.detail or r.cause.text) for r in reasons]
        words = [f"{cause.value} ({subject}): {text}" for cause, subject, text in told]
        return "; ".join(words) or "?"
