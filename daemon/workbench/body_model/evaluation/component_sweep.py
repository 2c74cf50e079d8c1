"""How many components a body needs: figure 4 of Thompson et al., and where mixtures collapse.

A mixture collapses where some of its components get next to no weight: it has more than it can use.
How soon it does so depends on where its components begin: see `Start`.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from daemon.host.progress import Progress
from daemon.workbench.body_model.clouds.cloud_dataset import CloudDataset
from daemon.workbench.body_model.evaluation.evaluation import some_points, weights_at
from daemon.workbench.body_model.training.body_training import (
    STARTS,
    Start,
    nats_in_metres,
    train_points,
)
from daemon.workbench.body_model.training.calibration import scores
from daemon.workbench.body_model.training.network import NetworkShape
from daemon.workbench.body_model.training.training import Check, TrainingSettings
from safety.risk.model.mixture_network import MixtureNetwork

_NOTHING: Final = 0.01
"""A component with less weight is of no use."""
_COLLAPSED: Final = 0.05
"""More than so many test configurations with such a component."""
_MOSTLY: Final = 0.5
_WORTH: Final = 0.05
"""Nats per point that another component must bring."""


@dataclass(frozen=True)
class Counted:
    """A network with so many components. NLL in nats per point, places in m."""

    start: Start
    components: int
    learnt_from: float
    test: float
    least_weight: float
    """The smallest mean weight of a component, over the test configurations."""
    useless: float
    """Share of the test configurations where some component has a weight below 0.01."""
    idle: int
    """Components with a weight below 0.01 at most of the test configurations."""

    @property
    def collapsed(self) -> bool:
        """Whether it has more components than it can use."""
        return self.useless > _COLLAPSED

    @property
    def line(self) -> str:
        """For the terminal."""
        return (
            f"{self.start}, K = {self.components}: NLL {self.test:.3f} nats (m), on its training "
            f"{self.learnt_from:.3f}; smallest mean weight {self.least_weight:.3f}, below 0.01 at "
            f"{self.useless:.1%}{f'  COLLAPSED ({self.idle} idle)' if self.collapsed else ''}"
        )


def sweep(
    dataset: CloudDataset,
    components: Iterable[int],
    settings: TrainingSettings,
    start: Start,
    heard: Callable[[Counted], None],
    progress: Progress,
) -> list[Counted]:
    """Train each number of components, and try it on the test configurations.

    Raises TrainingError. heard: is told of each. progress: of steps, as many as the settings have
    for each.
    """
    u = dataset.configurations[dataset.test]
    samples = some_points(dataset, dataset.test, settings.seed)
    found = []
    for count in components:
        steps = _Steps(progress)
        shape = NetworkShape(count)
        trained = train_points(dataset, ~dataset.test, shape, settings, start, steps.heard)
        steps.reach(settings.steps)
        network = MixtureNetwork(trained.arrays, trained.activation)
        weights = weights_at(network, u)
        found.append(
            Counted(
                start,
                count,
                nats_in_metres(trained.best.learnt_from),
                nats_in_metres(scores(network, u, samples, settings.seed).mean_nll_mm),
                float(weights.mean(axis=0).min()),
                float((weights < _NOTHING).any(axis=1).mean()),
                int(((weights < _NOTHING).mean(axis=0) > _MOSTLY).sum()),
            )
        )
        heard(found[-1])
    return found


class _Steps:
    """Of one training, told as progress."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._told = 0

    def heard(self, _: str, check: Check) -> None:
        self.reach(check.step)

    def reach(self, step: int) -> None:
        self._progress.advance(float(step - self._told))
        self._told = step


def by_start(found: Iterable[Counted]) -> dict[Start, list[Counted]]:
    """Those of each start that was tried."""
    every = list(found)
    parts = {start: [one for one in every if one.start == start] for start in STARTS}
    return {start: part for start, part in parts.items() if part}


def first_collapsed(found: Iterable[Counted]) -> int | None:
    """The fewest components of those that have collapsed."""
    return min((one.components for one in found if one.collapsed), default=None)


def recommended(found: Sequence[Counted]) -> int | None:
    """The fewest components of which more bring next to nothing, among those not collapsed.

    All of one start. Next to nothing: 0.05 nats for each one more. None: all have collapsed.
    """
    sound = [one for one in found if not one.collapsed]
    for number, one in enumerate(sound):
        if all(
            one.test - more.test < _WORTH * (more.components - one.components)
            for more in sound[number + 1 :]
        ):
            return one.components
    return None


def summary(found: Sequence[Counted]) -> dict[str, Any]:
    """For JSON. Recommended is what is best for the start that `train` takes, if it was tried."""
    parts = by_start(found)
    return {
        "recommended": recommended(next(iter(parts.values()))),
        "starts": {
            start: {"recommended": recommended(part), "first_collapsed": first_collapsed(part)}
            for start, part in parts.items()
        },
        "sweep": [{**vars(one), "collapsed": one.collapsed} for one in found],
    }
