"""What happens to the robot during an experiment: loads and faults, each at its time."""

from collections.abc import Callable, Sequence
from typing import Protocol

from config.tasks.experiment import Happening


class LabControl(Protocol):
    """The emulated world, from outside the robot."""

    def set_tip_load(self, mass_g: float) -> None:
        """Hang another weight on the tip."""
        ...

    def inject(self, fault: str) -> None:
        """Make a device misbehave."""
        ...


class Happenings:
    """Lets everything happen that is due. Called with every control step."""

    def __init__(
        self,
        planned: Sequence[Happening],
        tip_load_g: float,
        lab: LabControl,
        tell: Callable[[str], None],
    ) -> None:
        """tell: hears in words of what happens."""
        self._waiting = list(planned)
        self._load_g = tip_load_g
        self._filling: tuple[float, float] | None = None
        """Load to be reached in g, and how fast in g/s."""
        self._lab = lab
        self._tell = tell

    def step(self, elapsed_s: float, cycle: int, dt_s: float) -> None:
        """The trajectory has lasted for `elapsed_s` and is in `cycle`."""
        if self._waiting:
            for happening in [one for one in self._waiting if _due(one, elapsed_s, cycle)]:
                self._waiting.remove(happening)
                self._happen(happening)
        if self._filling is not None:
            goal_g, rate_g_s = self._filling
            self._load_g = min(goal_g, self._load_g + rate_g_s * dt_s)
            self._lab.set_tip_load(self._load_g)
            if self._load_g >= goal_g:
                self._filling = None

    def _happen(self, happening: Happening) -> None:
        if happening.inject is not None:
            self._lab.inject(happening.inject)
            self._tell(happening.inject)
            return
        goal_g = happening.tip_load_g
        assert goal_g is not None
        if happening.fill_g_s is not None:
            self._filling = (goal_g, happening.fill_g_s)
            self._tell(f"tip load filled up to {goal_g:g} g at {happening.fill_g_s:g} g/s")
            return
        self._load_g, self._filling = goal_g, None
        self._lab.set_tip_load(goal_g)
        self._tell(f"{goal_g:g} g at the tip")


def _due(happening: Happening, elapsed_s: float, cycle: int) -> bool:
    if happening.at_s is not None:
        return elapsed_s >= happening.at_s and cycle >= 0
    return happening.at_cycle is not None and cycle >= happening.at_cycle
