"""Where more of an error is expected than is tolerated the daemon follows a path more slowly, and
says so."""

import asyncio
from typing import Any

import pytest

from daemon.messages import Status
from safety.states import OperatingState
from tests.daemon.service.rig import Rig, on_a_rig

CYCLE_S = 4.0
FAST_CIRCLE = {
    "kind": "circle",
    "center_mm": [0.0, 0.0, 190.0],
    "radius_mm": 10.0,
    "cycle_s": CYCLE_S,
}
LED: dict[str, Any] = {"kind": "constant_curvature", "lead": True, "max_tip_speed_mm_s": 60.0}


def gone_round(controller: dict[str, Any]) -> tuple[Rig, list[float], list[Status]]:
    """The rig; of each step on the path what was expected; and what was told on the way."""
    told: list[Status] = []

    async def scene(rig: Rig) -> None:
        await rig.running(FAST_CIRCLE, controller)
        async with asyncio.timeout(90.0):
            while rig.state is OperatingState.RUNNING:
                status = rig.status
                if status.reference is not None and status.reference.cycle >= 0:
                    told.append(status)
                await asyncio.sleep(0.05)

    rig = on_a_rig(scene)
    on_path = [tip for tip in rig.tips if tip.cycle >= 0 and tip.state == "running"]
    expected = [tip.expected_mm for tip in on_path if tip.expected_mm is not None]
    return rig, expected, told


def paces(told: list[Status]) -> set[float]:
    return {status.reference.pace for status in told if status.reference is not None}


def lasted_s(rig: Rig) -> float:
    on_path = [tip for tip in rig.tips if tip.cycle >= 0 and tip.state == "running"]
    return (on_path[-1].t_ns - on_path[0].t_ns) * 1e-9


def test_a_path_is_slowed_as_far_as_that_helps_and_everybody_is_told() -> None:
    rig, expected, told = gone_round({**LED, "slow_above_mm": 0.05})
    assert lasted_s(rig) > 1.5 * CYCLE_S
    assert 0.3 < min(paces(told)) < 0.7
    assert len(expected) > 100
    assert all(one > 0.0 for one in expected)
    assert all(status.expected_mm is not None for status in told[:-1])
    events = [event for event in rig.told_events if event.name == "slowed"]
    assert [event.present for event in events] == [True, False]
    assert events[0].text == "the circle is followed more slowly than it says"
    assert events[0].detail.endswith("mm off are expected")


@pytest.mark.parametrize("slow_above_mm", [50.0, pytest.param(None, marks=pytest.mark.long)])
def test_whoever_does_not_want_that_has_the_path_in_its_time(slow_above_mm: float | None) -> None:
    rig, expected, told = gone_round({**LED, "slow_above_mm": slow_above_mm})
    assert lasted_s(rig) == pytest.approx(CYCLE_S, abs=0.1)
    assert paces(told) == {1.0}
    assert expected
    assert not any(event.name == "slowed" for event in rig.told_events)


def test_who_does_not_lead_expects_nothing() -> None:
    rig, expected, told = gone_round({**LED, "lead": False})
    assert not expected
    assert paces(told) == {1.0}
    assert rig.status.expected_mm is None
