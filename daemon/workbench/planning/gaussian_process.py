"""The paper's own way to make a path safer, to compare with: equation 10, by Bayesian steps.

Thompson et al., section V: in each of 50 iterations one waypoint between the ends is taken, places
near it are drawn, and the one with the highest probability of improvement (Jones 2001) under a
Gaussian process is tried; it stays where the path's risk by equation 10 became less. Which
waypoint, how many draws, how near and which kernel the paper does not say; here: the waypoints by
chance, 64 draws, a neighbourhood as wide as the waypoints are apart, and a squared exponential over
the axes.

What it lowers is `body_point_risk`, the chance that random points of the body are in something
solid, one for each waypoint: not the chance that the body touches.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import ndtr

from daemon.host.progress import Progress
from daemon.workbench.planning.body_in_place import BodyInPlace
from safety.risk.model.mixture import FloatArray

ITERATIONS: Final = 50
"""As the paper has it."""
_DRAWS: Final = 64
_NOISE: Final = 1e-3
"""Of the risk's logarithm, where its variance is one."""
_SMALLEST: Final = 1e-9


@dataclass(frozen=True, eq=False)
class PaperPath:
    """What came of it."""

    waypoints: FloatArray
    """(n, m)."""
    course: tuple[float, ...]
    """Equation 10 before, and after each iteration."""


def lowered(
    body: BodyInPlace, waypoints: FloatArray, iterations: int, seed: int, progress: Progress
) -> PaperPath:
    """The (n, m) path with equation 10 lowered. The means of the mixture stay free."""
    random = np.random.default_rng(seed)
    path = waypoints.copy()
    risks = body.printed_risks(path)
    known, values = [*path], [_logarithm(risk) for risk in risks]
    course = [_product(risks)]
    apart = np.abs(np.diff(path * body.model.scale, axis=0)).mean() if len(path) > 1 else 0.0
    width = max(float(apart), 1e-3)
    progress.begin("Bayesian steps", iterations, 0)
    for _ in range(iterations if len(path) > 2 else 0):
        row = int(random.integers(1, len(path) - 1))
        offsets = random.uniform(-1.0, 1.0, (_DRAWS, path.shape[1])) * width
        drawn = path[row] + offsets / body.model.scale
        drawn = drawn[[body.allowed(u) and body.means_free(u) for u in drawn]]
        progress.advance()
        if not len(drawn):
            course.append(course[-1])
            continue
        scaled = np.array(known) * body.model.scale
        means, spreads = _process(scaled, np.array(values), drawn * body.model.scale, width)
        hopeful = ndtr((_logarithm(risks[row]) - means) / spreads)
        tried = drawn[int(np.argmax(hopeful))]
        risk = float(body.printed_risks(tried[None])[0])
        known.append(tried)
        values.append(_logarithm(risk))
        others = risks.copy()
        others[row] = risk
        if _product(others) < course[-1]:
            path[row], risks = tried, others
        course.append(_product(risks))
    return PaperPath(path, tuple(course))


def _process(
    known: FloatArray, values: FloatArray, asked: FloatArray, width: float
) -> tuple[FloatArray, FloatArray]:
    """Mean and standard deviation at (a, m) places, of the process through (k,) at (k, m)."""
    middle, spread = float(values.mean()), max(float(values.std()), 1e-6)
    reach = 2.0 * width
    kernel = _kernel(known, known, reach) + _NOISE * np.eye(len(known))
    factor = cho_factor(kernel, lower=True)
    across = _kernel(asked, known, reach)
    means = across @ cho_solve(factor, (values - middle) / spread)
    left = 1.0 - np.einsum("ak,ka->a", across, cho_solve(factor, across.T))
    return middle + spread * means, spread * np.sqrt(np.maximum(left, 1e-9))


def _kernel(a: FloatArray, b: FloatArray, reach: float) -> FloatArray:
    square = np.square(a[:, None] - b).sum(axis=2)
    return np.asarray(np.exp(-0.5 * square / reach**2))


def _logarithm(risk: float) -> float:
    return float(np.log(max(risk, _SMALLEST)))


def _product(risks: FloatArray) -> float:
    return float(1.0 - np.prod(1.0 - risks))
