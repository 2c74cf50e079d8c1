"""Bodies that are described by their files alone: they follow their circles, and go round what is
in their way, in virtual time."""

from collections.abc import Callable
from typing import Final

import numpy as np
import pytest

from daemon.testing.labs import TestLab
from sim_backends.lab.body import Body
from sim_backends.plants.plant import FloatArray

ONCE: Final = {"cycle_s": 20.0, "cycles": 1}
BRISKLY: Final = {"cycle_s": 12.0, "cycles": 1}
POSTS: Final = {
    "one_segment": ((31.5, -7.0, 108.0), (41.5, 7.0, 128.0)),
    "three_tendon": ((28.0, -7.0, 136.0), (38.0, 7.0, 156.0)),
}
"""Corners of what stands beside each, mm."""

Nearest = Callable[[str], float]


@pytest.fixture
def nearest_mm(monkeypatch: pytest.MonkeyPatch) -> Nearest:
    """How near the true body has come to the post of an arm; negative: it was in it."""
    lines: list[FloatArray] = []
    radii: list[float] = []
    advance = Body.advance

    def watched(body: Body, t_ns: int) -> None:
        before = body.advanced_ns
        advance(body, t_ns)
        if body.advanced_ns > before:
            state = body.record.state
            places = np.linspace(state.centreline_mm[:-1], state.centreline_mm[1:], 8)
            lines.append(places.reshape(-1, 3))
            radii.append(state.radius_mm)

    monkeypatch.setattr(Body, "advance", watched)

    def nearest(arm: str) -> float:
        lowest, highest = POSTS[arm]
        places = np.array(lines)
        away = np.linalg.norm(places - np.clip(places, lowest, highest), axis=2).min(axis=1)
        return float((away - np.array(radii)).min())

    return nearest


@pytest.mark.parametrize("arm", POSTS)
def test_it_follows_its_circle_to_a_millimetre(lab: TestLab, nearest_mm: Nearest, arm: str) -> None:
    result = lab.run(f"builtin:{arm}_circle", trajectory=BRISKLY)
    assert result.holds == 0
    assert result.cycle(1).mean_mm <= 1.0
    assert result.true_cycle(1).mean_mm <= 1.0
    assert nearest_mm(arm) < -0.5, "what stands there in the other experiment would be in the way"


@pytest.mark.long
@pytest.mark.parametrize("arm", POSTS)
def test_it_goes_round_what_is_in_its_way(lab: TestLab, nearest_mm: Nearest, arm: str) -> None:
    result = lab.run(f"builtin:{arm}_past_post", trajectory=ONCE)
    assert result.holds == 0
    assert nearest_mm(arm) > 0.0
    assert result.cycle(1).mean_mm <= 2.5
