"""Whether a network's mixtures are as wide as what was seen: how much of it lies where they say."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from daemon.workbench.body_model.training.training import TrainingError
from safety.risk.model.mixture import FloatArray
from safety.risk.model.mixture_network import MixtureNetwork

LEVELS: Final = (0.5, 0.8, 0.95)
CURVE: Final = tuple(round(0.05 * step, 2) for step in range(1, 20))
_DRAWS: Final = 4000
"""From each mixture, to find its regions."""


@dataclass(frozen=True, eq=False)
class Scores:
    """Of a network over k configurations."""

    nll_mm: FloatArray
    """(k,) mean negative log-likelihood in nats, of a density per mm^d."""
    depth: FloatArray
    """(k, s) for each sample the share of its mixture that is denser than the place of the sample.
    They are even between 0 and 1 where the mixtures are right."""

    @property
    def mean_nll_mm(self) -> float:
        """Over all configurations."""
        return float(self.nll_mm.mean())

    def coverage(self, levels: tuple[float, ...] = LEVELS) -> FloatArray:
        """(levels,) the share of all samples in the densest region that holds so much."""
        return np.array([float((self.depth <= level).mean()) for level in levels])


def scores(
    network: MixtureNetwork, u: FloatArray, samples_mm: NDArray[Any], seed: int = 0
) -> Scores:
    """How (k, s, d) samples at (k, m) u lie in the network's mixtures there.

    Raises TrainingError.
    """
    random = np.random.default_rng(seed)
    nll, depth = np.empty(len(u)), np.empty(samples_mm.shape[:2])
    for i, (place, samples) in enumerate(zip(u, samples_mm, strict=True)):
        mixture = network.mixture(place)
        if mixture is None:
            raise TrainingError(f"the network gives no mixture at {place}")
        density = mixture.log_density(samples.astype(np.float64))
        drawn = np.sort(mixture.log_density(mixture.sample(_DRAWS, random)))
        nll[i] = -density.mean()
        depth[i] = 1.0 - np.searchsorted(drawn, density) / _DRAWS
    return Scores(nll, depth)
