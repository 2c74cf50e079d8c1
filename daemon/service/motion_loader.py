"""What a message asks to follow, and with which controller: checked, or refused with all faults.

A message names data, or files of one folder that is declared for it. Whatever is read from a file
or takes long is done off the loop, and within a bounded time.
"""

import asyncio
import os
import threading
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import Any, Final, Protocol, TypeVar

from config.documents.kinds import described
from config.documents.model import OptionsError
from config.paths import is_shipped_model
from config.robot import Robot
from config.tasks.controllers import (
    Broyden,
    ControllerOptions,
    load_controller_options,
    position_only,
)
from config.tasks.trajectory import Planned, Waypoints, load_trajectory_options
from daemon.control import guarded_controller
from daemon.control.axis_speeds import HasForesight
from daemon.control.controller import Controller, ControllerError
from daemon.control.guarded_controller import Answering
from daemon.control.reachability import Bounds, HasKinematics
from daemon.controllers.make_controller import make_controller
from daemon.messages import Load
from daemon.reference.trajectories import Trajectory, make_trajectory
from daemon.reference.waypoints import WaypointError
from daemon.robot.axes import AxisRanges
from safety.failsafe import ActiveReason

# A command that is not carried out, and why.


class CommandRefusedError(Exception):
    """A command that is not carried out."""

    def __init__(self, name: str, text: str, reasons: Sequence[ActiveReason] = ()) -> None:
        super().__init__(text)
        self.name = name
        self.text = text
        self.reasons = reasons


T = TypeVar("T")

_READ_WITHIN_S: Final = 15.0


class OffTheLoop(Protocol):
    """Calls what may take long, where it does not hold the loop."""

    def __call__(self, work: Callable[[], T]) -> Awaitable[T]:
        """What `work` returns or raises; TimeoutError where it takes too long."""
        ...


async def at_once(work: Callable[[], T]) -> T:
    """In virtual time nothing takes long, and a thread's time is nobody's."""
    return work()


async def in_a_thread(work: Callable[[], T], within_s: float = _READ_WITHIN_S) -> T:
    """In a thread that is left behind where it does not come back."""
    loop = asyncio.get_running_loop()
    future: asyncio.Future[T] = loop.create_future()

    def settle(outcome: Callable[[Any], None], value: Any) -> None:
        if not future.done():
            outcome(value)

    def run() -> None:
        outcome: tuple[Callable[[Any], None], Any]
        try:
            outcome = future.set_result, work()
        except Exception as error:
            outcome = future.set_exception, error
        except BaseException as error:  # a package that means to end the process ends its own load
            outcome = future.set_exception, RuntimeError(described(error))
        if not loop.is_closed():
            loop.call_soon_threadsafe(settle, *outcome)

    # Not one of asyncio's own threads, for which the way down would wait.
    threading.Thread(target=run, name="load", daemon=True).start()
    async with asyncio.timeout(within_s):
        return await future


class MotionLoader:
    """Makes trajectories and controllers from messages. One after the other."""

    def __init__(
        self,
        robot: Robot,
        seed: int,
        folder: Path | None = None,
        off_the_loop: OffTheLoop = at_once,
        answering: Answering = guarded_controller.at_once,
    ) -> None:
        """seed: of controllers. folder: whose files may be named; None: none. answering: how
        controllers of packages are asked."""
        self._robot = robot
        self._seed = seed
        self._folder = folder
        self._off_the_loop = off_the_loop
        self._answering = answering
        self._busy = False

    async def to_follow(self, command: Load) -> tuple[Trajectory, Controller, Bounds]:
        """What a `load` asks for, and what it has to keep to. Raises CommandRefusedError."""
        if command.robot and command.robot != self._robot.robot:
            text = f"it is meant for {command.robot}, and this is {self._robot.robot}"
            raise CommandRefusedError("wrong_robot", text)
        return await self._made(lambda: self._to_follow(command))

    async def controller(self, mapping: dict[str, Any] | None) -> Controller:
        """The controller that a message asks for. Raises CommandRefusedError."""
        return await self._made(lambda: self.make_controller(self._options(mapping)))

    def make_controller(self, options: ControllerOptions) -> Controller:
        """A controller for this robot. Raises CommandRefusedError."""
        try:
            return make_controller(options, self._robot, self._seed, self._answering)
        except ControllerError as error:
            raise CommandRefusedError("bad_controller", str(error)) from None

    def bounds(self, options: ControllerOptions, controller: Controller) -> Bounds:
        """What a trajectory has to keep to."""
        return Bounds(
            self._robot.workspace,
            controller.kinematics if isinstance(controller, HasKinematics) else None,
            getattr(options, "max_tip_speed_mm_s", None),
            AxisRanges.of(self._robot),
            controller.foresight if isinstance(controller, HasForesight) else None,
            position_only(options),
        )

    async def _made(self, work: Callable[[], T]) -> T:
        if self._busy:
            raise CommandRefusedError(
                "busy", "something is being loaded already: wait for its answer"
            )
        self._busy = True
        try:
            return await self._off_the_loop(work)
        except TimeoutError:
            raise CommandRefusedError("too_slow", f"not read within {_READ_WITHIN_S:g} s") from None
        finally:
            self._busy = False

    def _to_follow(self, command: Load) -> tuple[Trajectory, Controller, Bounds]:
        trajectory = self._trajectory(command)
        options = self._options(command.controller)
        controller = self.make_controller(options)
        return trajectory, controller, self.bounds(options, controller)

    def _trajectory(self, command: Load) -> Trajectory:
        try:
            options = load_trajectory_options(command.trajectory)
            if isinstance(options, Waypoints | Planned) and options.file is not None:
                named = str(self._named(options.file, "bad_trajectory"))
                options = options.model_copy(update={"file": named})
            return make_trajectory(options, Path("/"), command.cycles)
        except (OptionsError, WaypointError, ValueError) as error:
            raise CommandRefusedError("bad_trajectory", str(error)) from None

    def _options(self, mapping: dict[str, Any] | None) -> ControllerOptions:
        """Without any, those of the controller that needs to know nothing."""
        if mapping is None:
            return Broyden(kind="broyden")
        try:
            options = load_controller_options(mapping)
        except OptionsError as error:
            raise CommandRefusedError("bad_controller", str(error)) from None
        model = getattr(options, "model", None)
        if model is None or is_shipped_model(model):
            return options
        return options.model_copy(update={"model": str(self._named(model, "bad_controller"))})

    def _named(self, name: str, refusal: str) -> Path:
        """A file of the folder. What is elsewhere is refused alike, whether it is there or not."""
        if self._folder is None:
            raise CommandRefusedError(
                refusal, "no folder is declared whose files commands may name"
            )
        folder = os.path.realpath(self._folder)
        try:
            path = os.path.realpath(Path(folder) / name)
        except ValueError:  # a zero byte
            path = ""
        if os.path.commonpath([folder, path or "/"]) != folder or path == folder:
            text = (
                f"only files in {folder} can be named: put it there, or send its data "
                "(`tentacled load` sends waypoints)"
            )
            raise CommandRefusedError(refusal, text)
        return Path(path)
