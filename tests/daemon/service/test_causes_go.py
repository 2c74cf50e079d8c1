"""Every cause can go: whatever was wrong and whenever power changed, READY is reached without a
restart once all is well."""

import asyncio
import random

import pytest

from daemon.messages import Arm, Clear, Disarm, Inject, Start, Stop
from safety.causes import Cause
from safety.states import OperatingState
from tests.daemon.service.rig import SMALL_CIRCLE, Rig, on_a_rig
from tests.safety.gate.gate_rig import ToldRisk

S = OperatingState

FAULTS = (
    "drive.can0/2.blocked=1.5s",
    "drive.can0/1.dead=0.7s",
    "drive.can0/3.sto=0.6s",
    "drive.can0/4.warning=0.5s",
    "drive.can0/5.tpdo_stop=0.4s",
    "drive.can0/6.heartbeat_stop=0.6s",
    "drive.can0/1.emergency=0x7121",
    "drive.can0/2.short_emergency=0x7121",
    "drive.can0/6.reset",
    "drive.can0/3.refuses_enable=1s",
    "tracker.missing=0.8s",
    "tracker.missing=4s",
    "tracker.frozen=0.5s",
    "drive.can0/4.setting=0x605A,0,5",
    "bus.can0.foreign_master=0.7s",
    "bus.can0.foreign_master=0.2s,nmt",
    "bus.can0.foreign_write=3,0x605A,0,5",
    "bus.can0.unplug=0.5s",
    "bus.can0.down=0.5s",
    "bus.can0.passive=0.5s",
)
MOMENTARY = (Cause.CONTROLLER_FAILED, Cause.OPERATOR_HOLD, Cause.INTERNAL_ERROR)


async def all_is_well_again(rig: Rig, told: str) -> None:
    """Faults are over, the operator stops and clears: the robot is READY, and can be armed."""
    await rig.ask(Stop())
    await asyncio.sleep(8.0)
    await rig.ask(Clear(token=rig.token))
    try:
        await rig.until_state(S.READY, within_s=5.0)
    except AssertionError as error:
        raise AssertionError(f"{told}: {error}") from None
    await rig.do(Arm)
    await rig.do(Disarm)


@pytest.mark.parametrize("power_goes_by", ["stop", "disarm", "fault"])
@pytest.mark.parametrize("risk", [1.0, float("nan")], ids=["too high", "unavailable"])
def test_what_the_gate_said_of_the_last_step_does_not_outlive_the_power(
    risk: float, power_goes_by: str
) -> None:
    source = ToldRisk(0.0)

    async def scene(rig: Rig) -> None:
        await rig.running()
        await asyncio.sleep(0.2)
        source.risk = risk
        steps = rig.service.loop.steps
        await rig.until(lambda: rig.service.loop.steps > steps)
        if power_goes_by == "fault":
            rig.service.supervisor.checks.internal_error(rig.service.clock.now_ns(), "")
        else:
            await rig.do(Stop if power_goes_by == "stop" else Disarm)
        await asyncio.sleep(1.5)
        source.risk = 0.0
        if power_goes_by == "fault":
            await rig.do(Clear)
        await rig.until_state(S.READY, within_s=1.0)

    on_a_rig(scene, risk=source)


def test_a_refusal_of_the_last_step_before_power_off_is_taken_back() -> None:
    async def scene(rig: Rig) -> None:
        await rig.running()
        rig.service.supervisor.failsafe.set(
            Cause.GATE_REFUSED, True, rig.service.clock.now_ns(), "gate", "velocity: axis 0"
        )
        await rig.do(Stop)
        await asyncio.sleep(3.0)
        assert "gate_refused" not in rig.causes
        await rig.until_state(S.READY, within_s=1.0)

    on_a_rig(scene)


def test_what_is_left_after_a_clear_is_told() -> None:
    async def scene(rig: Rig) -> None:
        await rig.running()
        rig.service.supervisor.checks.internal_error(rig.service.clock.now_ns(), "")
        await rig.until_state(S.FAULT)
        await rig.do(Inject, fault="tracker.missing=10s")
        await asyncio.sleep(4.0)
        answer = await rig.do(Clear)
        told, names = answer.text.split(": ")
        assert told == "not ready yet"
        assert {"tracker_late", "tracker_quality"} <= set(names.split(", "))

    on_a_rig(scene)


@pytest.mark.parametrize(
    "seed", [0, 3, *(pytest.param(seed, marks=pytest.mark.long) for seed in (1, 2))]
)
def test_any_sequence_of_faults_causes_and_power_changes_ends_in_ready(seed: int) -> None:
    chance = random.Random(seed)
    source = ToldRisk(0.0)

    async def scene(rig: Rig) -> None:
        told: list[str] = []

        async def act() -> None:
            match chance.randrange(5):
                case 0:
                    fault = chance.choice(FAULTS)
                    told.append(fault)
                    await rig.ask(Inject(token=rig.token, fault=fault))
                case 1:
                    source.risk = chance.choice([1.0, float("nan"), 0.0])
                    told.append(f"risk {source.risk}")
                case 2:
                    name = chance.choice(MOMENTARY)
                    told.append(str(name))
                    checks, t_ns = rig.service.supervisor.checks, rig.service.clock.now_ns()
                    if name is Cause.OPERATOR_HOLD:
                        checks.operator_hold(t_ns)
                    elif name is Cause.CONTROLLER_FAILED:
                        checks.controller_failed(t_ns, "")
                    else:
                        checks.internal_error(t_ns, "")
                case 3:
                    verb = chance.choice([Stop, Disarm, Clear])
                    told.append(verb.__name__)
                    await rig.ask(verb(token=rig.token))
                case _:
                    told.append("Arm, Start")
                    await rig.ask(Arm(token=rig.token))
                    await rig.ask(Start(token=rig.token))

        await rig.running(SMALL_CIRCLE | {"radius_mm": 25.0})
        for _ in range(12):
            await act()
            await asyncio.sleep(chance.uniform(0.0, 1.2))
        source.risk = 0.0
        await all_is_well_again(rig, ", ".join(told))

    on_a_rig(scene, risk=source, seed=seed + 1)
