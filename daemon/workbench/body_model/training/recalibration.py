"""Makes a network's mixtures as wide as what was kept back says: three numbers, after the training.

Where friction holds a body it stays close to where it was, and now and then it slips: its misses
are peaked and have long tails, at every actuation vector much alike. A component of a mixture has
neither. So each becomes two, in the same place and turned alike: a narrow and a wide one. How
narrow, how wide, and which share is of the wide ones is the same for all of them, and the most
likely of configurations that the weights were not fitted to: too little to be fitted to those.
"""

from dataclasses import dataclass
from math import log
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.special import expit, logsumexp

from daemon.workbench.body_model.training.training import TrainingError
from safety.risk.model.mixture import MOST_COMPONENTS, FloatArray
from safety.risk.model.mixture_network import MixtureNetwork

Arrays = dict[str, NDArray[Any]]

MOST_DOUBLED: Final = MOST_COMPONENTS // 2
"""Components that can become two."""
_FIRST: Final = (log(0.8), log(1.3), 0.0)
MOST_WIDER: Final = 3.0
"""Times narrower or wider, no further: then it is the network that is wrong."""


@dataclass(frozen=True)
class Widths:
    """Of the two that each component becomes, in its own standard deviations."""

    narrow: float
    wide: float
    wide_share: float

    @property
    def enough(self) -> bool:
        """Whether no more was asked for than may be."""
        return self.wide < MOST_WIDER * (1.0 - 1e-6)


def recalibrated(
    arrays: Arrays, activation: str, u: FloatArray, samples_mm: NDArray[Any]
) -> tuple[Arrays, Widths]:
    """A network of twice the components, most likely for (k, s, d) samples at (k, m) u.

    It may have MOST_DOUBLED components. Raises TrainingError where it gives no mixtures.
    """
    squares, logarithms = _seen(MixtureNetwork(arrays, activation), u, samples_mm)
    d = samples_mm.shape[2]

    def unlikely(parameters: FloatArray) -> float:
        narrow, wide = np.clip(parameters[:2], -log(MOST_WIDER), log(MOST_WIDER)).tolist()
        share = float(expit(parameters[2]))
        parts = np.logaddexp(
            np.log1p(-share) - d * narrow - 0.5 * squares * np.exp(-2.0 * narrow),
            np.log(share) - d * wide - 0.5 * squares * np.exp(-2.0 * wide),
        )
        return -float(logsumexp(logarithms[:, :, None] + parts, axis=1).mean())

    found = minimize(unlikely, np.array(_FIRST), method="Nelder-Mead")
    first, second = np.exp(np.clip(found.x[:2], -log(MOST_WIDER), log(MOST_WIDER))).tolist()
    share = float(expit(found.x[2]))
    widths = Widths(first, second, share) if first <= second else Widths(second, first, 1 - share)
    return doubled(arrays, widths), widths


def doubled(arrays: Arrays, widths: Widths) -> Arrays:
    """The network with its components twice over: first all narrow, then all wide ones."""
    narrow, wide = _widened(arrays, widths.narrow), _widened(arrays, widths.wide)
    made = dict(arrays)
    for head in ("means", "factors", "weights"):
        for part in ("weight", "bias"):
            name = _last(arrays, head, part)
            made[name] = np.concatenate([narrow[name], wide[name]])
    logits = _last(arrays, "weights", "bias")
    shares = np.log([1.0 - widths.wide_share, widths.wide_share])
    made[logits] += np.repeat(shares, arrays[logits].size).astype(made[logits].dtype)
    lowest, highest = arrays["log_diagonal_limits"]
    made["log_diagonal_limits"] = np.array(
        [lowest - max(0.0, log(widths.wide)), highest - min(0.0, log(widths.narrow))]
    )
    return made


def _seen(
    network: MixtureNetwork, u: FloatArray, samples_mm: NDArray[Any]
) -> tuple[FloatArray, FloatArray]:
    """(k, K, s) squares of the whitened samples, and (k, K) ln w + ln|Ū|."""
    squares = np.empty((len(u), network.components, samples_mm.shape[1]))
    logarithms = np.empty(squares.shape[:2])
    for i, (place, samples) in enumerate(zip(u, samples_mm, strict=True)):
        mixture = network.mixture(place)
        if mixture is None:
            raise TrainingError(f"the network gives no mixture at {place}")
        for k, factor in enumerate(mixture.factors_per_mm):
            squares[i, k] = np.square(mixture.whitened(k, samples)).sum(axis=1)
            logarithms[i, k] = np.log(np.diag(factor)).sum()
        logarithms[i] += np.log(np.maximum(mixture.weights, np.finfo(float).tiny))
    return squares, logarithms


def _widened(arrays: Arrays, wider: float) -> Arrays:
    """The same network, with every component so many times as wide in all directions."""
    rows, columns = np.triu_indices(arrays["output_offset_mm"].size)
    weight, bias = _last(arrays, "factors", "weight"), _last(arrays, "factors", "bias")
    on_diagonal = np.tile(rows == columns, arrays[bias].size // rows.size)
    # Of the diagonal it is the logarithm that comes out of the layer.
    scaled = np.where(on_diagonal, 1.0, 1.0 / wider)
    moved = np.where(on_diagonal, -log(wider), 0.0)
    made = dict(arrays)
    made[weight] = (arrays[weight] * scaled[:, None]).astype(arrays[weight].dtype)
    made[bias] = (arrays[bias] * scaled + moved).astype(arrays[bias].dtype)
    return made


def _last(arrays: Arrays, head: str, part: str) -> str:
    """The name of the last layer's weight or bias."""
    layers = [int(name.split(".")[1]) for name in arrays if name.startswith(f"{head}.")]
    return f"{head}.{max(layers)}.{part}"
