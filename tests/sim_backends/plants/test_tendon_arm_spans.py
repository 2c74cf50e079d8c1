"""A rod whose routes are the spans of its tendons is the rod whose routes are the tendons."""

import numpy as np
import pytest

from sim_backends.plants.rod import Rod, helix
from tests.sim_backends.plants.rods import (
    LENGTH_MM,
    TENDON_ANGLES,
    TENDON_RADIUS_MM,
    TENDON_SECTION,
    TENDON_TURNS,
    equilibrium,
    tendon_rod,
)

SPANS, TENDONS = 9, 4
PULL_N = np.array([2.0, 0.5, 1.0, 3.0])
TIP_N, WEIGHT_N = [0.1, -0.2, 0.1], [0.0, -0.2, 0.0]


def span_rod(order: list[int]) -> Rod:
    """All tendons' spans, span after span as `order` says."""
    plates = np.linspace(0.0, LENGTH_MM, SPANS + 1)
    routes = [
        helix(TENDON_RADIUS_MM, angle, plates[span], plates[span + 1], turn_rad_per_mm=turn)
        for span in order
        for angle, turn in zip(TENDON_ANGLES, TENDON_TURNS, strict=True)
    ]
    return Rod(LENGTH_MM, TENDON_SECTION, routes, 36)


@pytest.mark.parametrize(
    "order",
    [list(range(SPANS)), list(reversed(range(SPANS))), [4, 8, 0, 2, 6, 1, 3, 7, 5]],
    ids=["from the base", "from the tip", "any"],
)
def test_spans_add_up_to_their_tendons(order: list[int]) -> None:
    """In shape, in length, and in what the lengths answer to moment and pull."""
    whole = equilibrium(tendon_rod(36), PULL_N, TIP_N, WEIGHT_N)
    spans = equilibrium(span_rod(order), np.tile(PULL_N, SPANS), TIP_N, WEIGHT_N)
    np.testing.assert_allclose(spans.march.position_mm, whole.march.position_mm, atol=1e-7)
    lengths = spans.march.length_mm.reshape(SPANS, TENDONS).sum(axis=0)
    np.testing.assert_allclose(lengths, whole.march.length_mm, atol=1e-7)
    gather = np.zeros((3 + TENDONS, 3 + SPANS * TENDONS))
    gather[:3, :3] = np.eye(3)
    gather[3:, 3:] = np.tile(np.eye(TENDONS), SPANS)
    np.testing.assert_allclose(gather @ spans.response @ gather.T, whole.response, atol=1e-6)
