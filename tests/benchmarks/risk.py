"""What the risk of one step costs: `python -m tests.benchmarks.risk` prints one JSON.

The mixture network forward, the bounds of body_point_risk over mesh size, contact_risk of a
thousand shapes, and how long surroundings take to be made ready, once.
"""

import json
import time
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import TypeVar

import numpy as np

from safety.risk.body_point import BodyPointRisk
from safety.risk.contact import ContactModel
from safety.risk.distance_grid import distance_grid
from safety.risk.environment import environment
from safety.risk.mixture import Mixture
from safety.risk.mixture_network import MixtureNetwork
from safety.risk.shapes import CHEST_PORT, chest
from tests.benchmarks.timing import Figures, percentiles
from tests.safety.risk.arms import Pose, points_mixture, shape_mixture
from tests.safety.risk.networks import random_arrays

T = TypeVar("T")

TRIANGLES = (5_000, 50_000, 200_000)
"""Those of the targets."""
_SPACING_MM = 1.5
_POSES = [
    Pose(curvature, turn, spread=4e-4)
    for curvature in (0.002, 0.004, 0.006)
    for turn in np.radians((0.0, 72.0, 144.0, 216.0, 288.0))
]


def measure(repeats: int = 400) -> Figures:
    """Microseconds for the network, milliseconds for the rest, by what is asked. Code is warm."""
    return {
        "network_us": _network(10 * repeats),
        "body_point_ms": {str(count): _body_point(count, repeats) for count in TRIANGLES},
        "contact_ms": _contact(repeats),
    }


def _network(repeats: int) -> Figures:
    """Four inputs, three layers of 128, five components over three dimensions; and over eight."""
    figures: Figures = {}
    inputs = list(np.random.default_rng(0).uniform(-8.0, 8.0, (64, 4)))
    for activation in ("relu", "tanh", "silu"):
        network = MixtureNetwork(random_arrays(), activation)
        figures[f"forward_{activation}"] = _timed(network.mixture, inputs, repeats, 1e6)
    wide = MixtureNetwork(random_arrays(dimensions=8), "relu")
    figures["forward_relu_8_dimensions"] = _timed(wide.mixture, inputs, repeats, 1e6)
    slopes = np.ones(5), np.ones((5, 3)), np.ones((5, 3, 3))
    network = MixtureNetwork(random_arrays(), "relu")
    figures["gradient_relu"] = _timed(lambda u: network.gradient(u, *slopes), inputs, repeats, 1e6)
    return figures


def _body_point(triangles: int, repeats: int) -> Figures:
    """Five components each, in a chest of so many triangles."""
    mesh = chest(triangles, seed=0)
    environment(*mesh)
    started = time.perf_counter()
    risk = BodyPointRisk(environment(*mesh))
    ready_s = time.perf_counter() - started
    mixtures = [points_mixture(pose) for pose in _POSES]
    values = [risk.near_exact(mixture).value for mixture in mixtures]
    bounds = [risk.bounds(mixture) for mixture in mixtures]
    ratio = [one.printed / value for one, value in zip(bounds, values, strict=True)]
    tighter = [(one.certified or 1.0) / value for one, value in zip(bounds, values, strict=True)]
    return {
        "printed_bound": _timed(risk.printed, mixtures, repeats, 1e3),
        "both_bounds": _timed(risk.bounds, mixtures, repeats, 1e3),
        "near_exact_with_derivatives": _timed(risk.near_exact, mixtures, repeats, 1e3),
        "made_ready_s": round(ready_s, 3),
        "median_value": round(float(np.median(values)), 5),
        "printed_over_value": round(float(np.median(ratio)), 2),
        "certified_over_value": round(float(np.median(tighter)), 2),
    }


def _contact(repeats: int) -> Figures:
    """A thousand shapes of 41 nodes and 8 coefficients, in the chest of the middle size."""
    mesh = environment(*chest(TRIANGLES[1], seed=0), port=CHEST_PORT)
    started = time.perf_counter()
    grid = distance_grid(mesh, _SPACING_MM)
    ready_s = time.perf_counter() - started
    poses = [shape_mixture(pose) for pose in _POSES]
    model = ContactModel(poses[0][0], grid, CHEST_PORT)
    mixtures = [mixture for _, mixture in poses]
    steps = [step for mixture in mixtures for step in _walk(mixture)]
    risks = [model.risk(mixture).probability for mixture in mixtures]
    return {
        "at_rest": _timed(model.risk, mixtures, repeats, 1e3),
        "along_one_step": _timed(model.along, steps, repeats, 1e3),
        "grid_made_s": round(ready_s, 3),
        "grid_places": int(grid.values_mm.size),
        "lowest_and_highest_risk": [min(risks), max(risks)],
    }


def _walk(mixture: Mixture) -> list[tuple[Mixture, Mixture]]:
    """Ten steps that move the tip by a millimetre each; each begins where the last one ended."""
    means, factors = mixture.means_mm, mixture.factors_per_mm
    ways = [Mixture(mixture.weights, means + 0.2 * step, factors) for step in range(11)]
    return list(pairwise(ways))


def _timed(
    function: Callable[[T], object], arguments: Sequence[T], repeats: int, scale: float
) -> Figures:
    """Over all arguments in turn."""
    for argument in arguments:
        function(argument)
    durations = []
    for number in range(repeats):
        argument = arguments[number % len(arguments)]
        started = time.perf_counter()
        function(argument)
        durations.append(time.perf_counter() - started)
    return percentiles(durations, scale)


if __name__ == "__main__":
    print(json.dumps(measure(), indent=2))
