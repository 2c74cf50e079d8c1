"""The bounds and the value of body_point_risk against sampling.

`python -m tests.experiments.body_point` takes some minutes. Random mixtures among random convex
bodies, a million samples of each. Ends with exit code 1 where a bound is below what was sampled by
more than chance allows, or the values are off more often than chance has it. Prints one JSON.
"""

import argparse
import json
import sys
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import binom, norm

from safety.risk.body_point import BodyPointRisk
from tests.safety.risk.scenes import random_mixture, random_scene, solid_share

_UNLIKELY = 1e-7
"""What chance may do once in ten thousand such experiments of a thousand scenes."""


@dataclass(frozen=True)
class Outcome:
    """One scene."""

    seed: int
    sampled: float
    value: float
    certified: float
    printed: float
    below: bool
    """A bound is below what was sampled."""
    off: float
    """How far the value is off what was sampled, in standard deviations that are as unlikely."""


def outcome(seed: int, samples: int) -> Outcome:
    """Of the scene and the mixture that this seed makes."""
    random = np.random.default_rng(seed)
    scene, mixture = random_scene(random), random_mixture(random)
    hits = round(solid_share(scene, mixture.sample(samples, random)) * samples)
    risk = BodyPointRisk(scene.environment)
    bounds, value = risk.bounds(mixture), risk.near_exact(mixture).value
    assert bounds.certified is not None
    lowest = min(bounds.certified, bounds.printed)
    return Outcome(
        seed,
        hits / samples,
        value,
        bounds.certified,
        bounds.printed,
        bool(binom.sf(hits - 1, samples, lowest) < _UNLIKELY),
        _off(hits, samples, value),
    )


def _off(hits: int, samples: int, value: float) -> float:
    """From the exact tails of the binomial distribution, halfway through the count itself."""
    here = binom.pmf(hits, samples, value)
    above = binom.sf(hits, samples, value) + 0.5 * here
    below = binom.cdf(hits - 1, samples, value) + 0.5 * here
    return float(norm.isf(max(min(above, below), 1e-300)))


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.experiments.body_point")
    parser.add_argument("--scenes", type=int, default=1000)
    parser.add_argument("--samples", type=int, default=1_000_000)
    arguments = parser.parse_args()
    outcomes = []
    for seed in range(arguments.scenes):
        outcomes.append(outcome(1_000_000 + seed, arguments.samples))
        if sys.stderr.isatty():
            print(f"\r{seed + 1} of {arguments.scenes} ", end="", file=sys.stderr)
    told = summary(outcomes, arguments.samples)
    print(json.dumps(told, indent=2))
    off_too_often = told["beyond_3_sigma"] > 3 + 0.01 * len(outcomes)
    return 1 if told["bounds_below"] or off_too_often else 0


def summary(outcomes: list[Outcome], samples: int) -> dict[str, Any]:
    """Figures of all scenes."""
    off = np.array([one.off for one in outcomes])
    touched = [one for one in outcomes if one.value > 1e-4]
    ratio = np.array([[one.printed / one.value, one.certified / one.value] for one in touched])
    return {
        "scenes": len(outcomes),
        "samples": samples,
        "bounds_below": [one.seed for one in outcomes if one.below],
        "beyond_3_sigma": int((off > 3.0).sum()),
        "expected_beyond_3_sigma": round(2.0 * float(norm.sf(3.0)) * len(outcomes), 1),
        "farthest_off_sigma": round(float(off.max()), 2),
        "printed_over_value": np.round(np.quantile(ratio[:, 0], (0.1, 0.5, 0.9)), 3).tolist(),
        "certified_over_value": np.round(np.quantile(ratio[:, 1], (0.1, 0.5, 0.9)), 3).tolist(),
    }


if __name__ == "__main__":
    sys.exit(main())
