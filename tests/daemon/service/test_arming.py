"""Arming asks for the risk where the body stands, and an operator may lead out what touches."""

import asyncio
from collections.abc import Sequence

import pytest

from daemon.messages import Acquire, Arm, Load, Start
from safety.risk_source import Leaving, Nearest, RiskReading
from safety.states import OperatingState
from tests.daemon.service.rig import MODEL, SMALL_CIRCLE, Rig, on_a_rig
from tests.safety.gate.gate_rig import ToldRisk

TOUCHES = Nearest(-3.14, 42.0, (1.0, 2.0, 30.0), (4.0, 5.0, 31.0), ())


def touching(u_from: Sequence[float], u_to: Sequence[float]) -> RiskReading:
    """Something touches, and every way leads out."""
    del u_from, u_to
    out = Leaving(at_start=0.9, added=0.0)
    return RiskReading(0.9, None, 0.001, "a wall", "", TOUCHES, leaving=out)


def test_a_body_that_touches_something_is_not_armed_unawares() -> None:
    async def scene(rig: Rig) -> None:
        await rig.do(Acquire)
        refusal = await rig.refused(Arm)
        assert refusal.name == "contact"
        for words in (
            "clearance -3.1 mm at 42 mm along the body, there (1, 2, 30) mm",
            "the risk is 0.9, and 0.05 is allowed",
            "arm with --despite-contact",
        ):
            assert words in refusal.text
        assert rig.in_state(OperatingState.READY)
        assert not any(channel.state.energised for channel in rig.service.loop.channels)

    on_a_rig(scene, risk=ToldRisk(touching))


def test_a_body_that_touches_something_can_be_led_out() -> None:
    async def scene(rig: Rig) -> None:
        await rig.do(Acquire)
        await rig.do(Arm, despite_contact=True)
        await rig.do(Load, trajectory=SMALL_CIRCLE, controller=MODEL)
        await rig.do(Start)
        before = rig.shafts()
        await asyncio.sleep(2.0)
        assert rig.in_state(OperatingState.RUNNING)
        assert rig.shafts() != before

    on_a_rig(scene, risk=ToldRisk(touching))


@pytest.mark.parametrize("risk", [float("nan"), 7.0])
def test_a_body_whose_risk_is_not_known_is_not_armed_unawares(risk: float) -> None:
    async def scene(rig: Rig) -> None:
        await rig.do(Acquire)
        refusal = await rig.refused(Arm)
        assert refusal.name == "contact"
        assert f"is not known here: {risk} is not a probability" in refusal.text
        await rig.do(Arm, despite_contact=True)

    on_a_rig(scene, risk=ToldRisk(risk))


def test_a_body_at_no_more_than_the_allowed_risk_is_armed() -> None:
    async def scene(rig: Rig) -> None:
        await rig.do(Acquire)
        await rig.do(Arm)

    on_a_rig(scene, risk=ToldRisk(0.05))
