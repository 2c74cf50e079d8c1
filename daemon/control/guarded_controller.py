"""A controller of an installed package: whatever it does, the loop goes on and its name is told.

It is asked in a thread of its own and waited for no longer than a control step can wait. An answer
that is late, none, or not a step raises ControllerError with its name, which holds the robot. Until
a late one comes back it is asked nothing more; what it then says is thrown away. A call that keeps
the interpreter to itself, as compiled code may, cannot be left behind: the drives then stop by
themselves, as they do for everything that stops the loop.
"""

import queue
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, Protocol, TypeVar

import numpy as np

from config.documents.kinds import described
from daemon.control.controller import Controller, ControllerError, Observation, Proposal

T = TypeVar("T")

ANSWER_WITHIN_S: Final = 0.006
"""A frame comes every 15 or 25 ms, a bus cycle every 2 to 10. A bus cycle may begin late by so much
without being missed at 10 ms, and is skipped at 2 ms, of which the gate's targets bear ten."""
_LONGEST_NOTE: Final = 80
_METHODS: Final = ("reset", "observe", "propose", "learn", "save", "load")


class Answering(Protocol):
    """How a controller is asked."""

    def __call__(self, name: str) -> "Answers":
        """name: for people."""
        ...


class Answers(Protocol):
    """Asks one controller, one question after the other."""

    def ask(self, what: str, work: Callable[[], T], within_s: float | None) -> T:
        """What `work` returns or raises. within_s: None: however long it takes.

        Raises ControllerError where it does not come back in time, or has not yet.
        """
        ...

    def begin(self, what: str, work: Callable[[], object]) -> None:
        """Have `work` done before the next question; left out while it is busy."""
        ...


class AtOnce:
    """Where time is virtual, nothing takes long."""

    def __init__(self, name: str) -> None:
        del name

    def ask(self, what: str, work: Callable[[], T], within_s: float | None) -> T:
        """As `Answers` says."""
        del what, within_s
        return work()

    def begin(self, what: str, work: Callable[[], object]) -> None:
        """As `Answers` says."""
        del what
        work()


class InAThread:
    """Where time is real. The thread ends with the process, or when it is not asked any more."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._work: queue.SimpleQueue[_Job] = queue.SimpleQueue()
        self._late: _Job | None = None
        self._begun: _Job | None = None
        self._thread = threading.Thread(target=self._serve, name=name[:15], daemon=True)
        self._thread.start()

    def ask(self, what: str, work: Callable[[], T], within_s: float | None) -> T:
        """As `Answers` says."""
        if self._late is not None and not self._late.done.is_set():
            raise ControllerError(f"{self._name} is still busy: {self._busy_with(self._late)}")
        self._late = None
        job = _Job(what, work)
        self._work.put(job)
        if not job.done.wait(within_s):
            self._late = job
            within_ms, busy_with = 1e3 * (within_s or 0.0), self._busy_with(job)
            raise ControllerError(
                f"{self._name} gave no answer within {within_ms:g} ms: {busy_with}"
            )
        if job.error is not None:
            raise job.error
        answer: T = job.answer
        return answer

    def begin(self, what: str, work: Callable[[], object]) -> None:
        """As `Answers` says."""
        if all(job is None or job.done.is_set() for job in (self._late, self._begun)):
            self._begun = _Job(what, work)
            self._work.put(self._begun)

    def _busy_with(self, job: "_Job") -> str:
        """What it does while a question waits, which may be what it was to do before."""
        begun = self._begun
        return job.what if begun is None or begun.done.is_set() else begun.what

    def _serve(self) -> None:
        while True:
            job = self._work.get()
            try:
                job.answer = job.work()
            except Exception as error:
                job.error = error
            except BaseException as error:  # Ctrl-C comes to the main thread: this is its own
                job.error = RuntimeError(described(error))
            job.done.set()


class _Job:
    def __init__(self, what: str, work: Callable[[], Any]) -> None:
        self.what, self.work = what, work
        self.done = threading.Event()
        self.answer: Any = None
        self.error: Exception | None = None


def at_once(name: str) -> Answers:
    """In virtual time."""
    return AtOnce(name)


def in_a_thread(name: str) -> Answers:
    """In real time."""
    return InAThread(name)


class GuardedController:
    """A `Controller` round one that is not ours."""

    def __init__(
        self, whose: str, name: str, controller: Controller, axes: int, answers: Answers
    ) -> None:
        """whose: as errors call it. axes: m."""
        self.name = name
        self.steers_direction = getattr(controller, "steers_direction", False) is True
        self._whose, self._controller = whose, controller
        self._axes, self._answers = axes, answers
        self._ready = False
        self._unlearnt: ControllerError | None = None
        """What went wrong in spare time, for the next step to tell."""

    @classmethod
    def made(
        cls,
        whose: str,
        name: str,
        make: Callable[[], Controller],
        axes: int,
        answering: Answering,
    ) -> "GuardedController":
        """Make it, and look whether it has what a controller has. Raises ControllerError."""
        try:
            controller = make()
        except ControllerError as error:
            raise ControllerError(f"{whose}: {error}") from None
        except (Exception, SystemExit) as error:  # whatever a package does
            raise ControllerError(f"{whose} cannot be made: {described(error)}") from error
        missing = [one for one in _METHODS if not callable(getattr(controller, one, None))]
        if missing:
            raise ControllerError(f"{whose} is no Controller: it has no {', '.join(missing)}")
        return cls(whose, name, controller, axes, answering(whose))

    @property
    def ready(self) -> bool:
        """As it said with its last answer."""
        return self._ready

    def reset(self, observation: Observation) -> None:
        """As `Controller` says."""
        self._ask("reset", lambda: self._controller.reset(_copy(observation)))

    def observe(self, observation: Observation) -> None:
        """As `Controller` says."""
        self._ask("observe", lambda: self._controller.observe(_copy(observation)))

    def propose(self, observation: Observation) -> Proposal:
        """As `Controller` says. Only a step for every axis, of numbers, comes back."""
        return self._ask(
            "propose", lambda: self._checked(self._controller.propose(_copy(observation)))
        )

    def learn(self) -> None:
        """As `Controller` says. Not waited for; what it raises is raised by the next step."""
        self._answers.begin("learn", self._learn)

    def _learn(self) -> None:
        try:
            self._controller.learn()
        except (Exception, SystemExit) as error:  # whatever a package does
            text = f"{self._whose} failed in learn: {described(error)}"
            self._unlearnt = ControllerError(text)

    def save(self, path: Path) -> None:
        """As `Controller` says. However long it takes: this is not asked for by the loop."""
        self._answers.ask("save", lambda: self._controller.save(path), None)

    def load(self, path: Path) -> None:
        """As `Controller` says, and as `save`."""
        self._answers.ask("load", lambda: self._controller.load(path), None)

    def _ask(self, what: str, work: Callable[[], T]) -> T:
        def answered() -> tuple[T, bool]:
            return work(), bool(self._controller.ready)

        unlearnt, self._unlearnt = self._unlearnt, None
        if unlearnt is not None:
            raise unlearnt
        try:
            answer, self._ready = self._answers.ask(what, answered, ANSWER_WITHIN_S)
        except ControllerError as error:
            text = str(error)
            own = text if self._whose in text else f"{self._whose}: {text}"
            raise ControllerError(own) from None
        except (Exception, SystemExit) as error:  # whatever a package does
            raise ControllerError(f"{self._whose} failed in {what}: {described(error)}") from error
        return answer

    def _checked(self, proposal: object) -> Proposal:
        if not isinstance(proposal, Proposal):
            raise ControllerError(f"{self._whose} proposed no Proposal, but {proposal!r:.60}")
        try:
            step = np.array(proposal.delta_u, np.float64)
        except (TypeError, ValueError) as error:
            raise ControllerError(f"{self._whose} proposed no step: {described(error)}") from None
        if step.shape != (self._axes,):
            raise ControllerError(
                f"{self._whose} proposed a step of shape {step.shape}, and there are {self._axes} "
                "axes"
            )
        if not np.isfinite(step).all():
            raise ControllerError(f"{self._whose} proposed what is not a number")
        part = proposal.part if isinstance(proposal.part, int) else None
        expected_mm, pace = proposal.expected_mm, proposal.pace
        if not (isinstance(pace, float | int) and 0.0 < pace <= 1.0):
            raise ControllerError(
                f"{self._whose} asked for a pace of {pace!r:.60}: it is above 0, and 1 at the most"
            )
        if not (expected_mm is None or (isinstance(expected_mm, float) and expected_mm >= 0.0)):
            raise ControllerError(
                f"{self._whose} expects an error of {expected_mm!r:.60}: it is None, or mm"
            )
        return Proposal(step, str(proposal.note)[:_LONGEST_NOTE], part, expected_mm, pace)


def _copy(observation: Observation) -> Observation:
    """What it does to its observation, or keeps of it, is its own."""
    arrays: dict[str, Any] = {
        name: value.copy()
        for name, value in observation._asdict().items()
        if isinstance(value, np.ndarray)
    }
    return observation._replace(**arrays)
