"""What every controller is to the loop: it sees measurements and a reference, and proposes steps.

A controller knows no bus, no gate and no clock. What it proposes may be shortened or refused; what
became of it shows in the next observation.
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple, Protocol

from drivers.pose import Vector


class ControllerError(RuntimeError):
    """The controller cannot go on. Says why and what helps."""


Ahead = Callable[[float], tuple[Vector, Vector] | None]
"""(3,) mm and (3,) mm/s of the reference so many seconds from now; None: nobody knows."""


class Phase(NamedTuple):
    """Where a reference is along a path that it repeats."""

    seconds: float
    """Since the cycle began."""
    cycle_s: float
    """How long one lasts."""
    pace: float = 1.0
    """Seconds of these for each second that passes."""

    def after(self, lead_s: float) -> float:
        """Seconds since the cycle began, so much later."""
        return self.seconds + self.pace * lead_s


class Observation(NamedTuple):
    """What is known at one control step. Axes in mm or rad, tip in the base sensor's frame."""

    t_ns: int
    dt_s: float
    """Measured time since the last step."""
    u: Vector
    """(m,) where the axes are."""
    targets: Vector
    """(m,) where they were last told to be."""
    tip_mm: Vector
    tip_velocity_mm_s: Vector
    reference_mm: Vector
    reference_velocity_mm_s: Vector
    believed: bool = True
    """Whether the tip was measured at this step. Otherwise it is only extrapolated: nothing to
    learn from."""
    ahead: Ahead | None = None
    """Where the reference will be. None: nobody knows."""
    tip_direction: Vector | None = None
    """(3,) unit vector along the tip's axis. None: it is not seen."""
    reference_direction: Vector | None = None
    """(3,) where the tip should point. None: anywhere."""
    reference_turn: Vector | None = None
    """(3,) 1/s by which that changes."""
    phase: Phase | None = None
    """Where along its cycle the reference is. None: nothing is repeated."""
    tensions_n: Vector | None = None
    """(m,) how hard each axis pulls, as measured; NaN where it is no tendon. None: none is one."""
    own_speed_mm_s: float | None = None
    """Of the reference where it is not slowed, at the time from which on a pace that is asked for
    now will count. None: it cannot be slowed."""
    on_path: bool = False
    """Whether the reference is on its path, and not on the way to it. A hand has none."""


class Proposal(NamedTuple):
    """What the controller would do in this step."""

    delta_u: Vector
    """(m,) change to add to the targets."""
    note: str = ""
    """What it is doing, for people: empty while it simply follows."""
    part: int | None = None
    """Of an exploration: which motion of it this belongs to. None while it follows."""
    expected_mm: float | None = None
    """How far off the tip is expected to be, root mean square, as it is followed now. None: it does
    not know."""
    pace: float = 1.0
    """Share of its own speed at which the reference should go on, as soon as it can."""


def steers_direction(controller: object) -> bool:
    """Whether it leads the tip's direction, too, where the reference has one: then it has an
    attribute `steers_direction` that is true."""
    return bool(getattr(controller, "steers_direction", False))


class Controller(Protocol):
    """Turns a reference for the tip into steps of the axes."""

    @property
    def name(self) -> str: ...

    @property
    def ready(self) -> bool:
        """False while it explores: the reference waits, and it proposes motions of its own."""
        ...

    def reset(self, observation: Observation) -> None:
        """Motion begins from here; nothing may jump."""
        ...

    def observe(self, observation: Observation) -> None:
        """Learn from one frame. Called for every frame, moving or not; `believed` says whether
        there is anything to learn from it."""
        ...

    def propose(self, observation: Observation) -> Proposal:
        """The next step. Raises ControllerError where it cannot go on."""
        ...

    def learn(self) -> None:
        """Work that can wait, after each bus cycle: half a millisecond of it at the most, since a
        frame that comes meanwhile waits for so long.

        How much that is must not be found with a clock: runs in virtual time repeat themselves.
        """
        ...

    def save(self, path: Path) -> None:
        """Write what was learnt. Raises OSError."""
        ...

    def load(self, path: Path) -> None:
        """Go on from what was learnt before. Raises ModelError or OSError; nothing changes then."""
        ...
