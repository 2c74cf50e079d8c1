"""The tendon-driven arm behind its emulated drives: the daemon feels the tendons."""

import asyncio
from typing import Any

import numpy as np
import pytest

from config.axis import TendonMotor
from daemon.control.controller import Observation, Proposal
from daemon.messages import Load, Start
from drivers.axis_scale import axis_scale
from safety.states import OperatingState
from sim_backends.plants.plant import FloatArray, TipLoad
from sim_backends.plants.tendon_arm.tendon_arm import TendonArm
from tests import SHIPPED_ROBOTS
from tests.daemon.service.rig import Rig, on_a_rig

TENDON_ARM = SHIPPED_ROBOTS / "tendon_arm.yaml"
S = OperatingState

CONTROLLER: dict[str, Any] = {"kind": "broyden", "explore_share": 0.02, "settle_s": 0.3}
CIRCLE: dict[str, Any] = {
    "kind": "circle",
    "center_mm": [0.0, 0.0, 198.5],
    "radius_mm": 12.0,
    "cycle_s": 15.0,
}


def shown(rig: Rig) -> FloatArray:
    """(m,) N as the master hears the drives."""
    return np.array([c.scale.force(c.torque_permille) for c in rig.service.loop.channels])


def true_tension(rig: Rig) -> FloatArray:
    """(m,) N that the tendons pull the motors with."""
    return rig.lab.body.record.state.actuator_forces


def push(rig: Rig, newtons: float) -> None:
    rig.lab.body.load = TipLoad(force_n=(newtons, 0.0, 0.0))


async def driven(rig: Rig, mm_s: list[float]) -> None:
    """RUNNING, with somebody at the controls who has no idea of tendons."""
    await rig.armed()
    await rig.do(Load, trajectory=CIRCLE, controller=CONTROLLER)
    await rig.do(Start)
    await rig.until_state(S.RUNNING)
    controller = rig.service.loop.controller
    assert controller is not None

    def propose(observation: Observation) -> Proposal:
        return Proposal(np.array(mm_s) * observation.dt_s)

    controller.propose = propose  # type: ignore[method-assign]


def test_the_lab_holds_the_tendon_arm_with_the_shipped_figures() -> None:
    async def scene(rig: Rig) -> None:
        assert isinstance(rig.lab.body._plant, TendonArm)
        assert rig.lab.body.record.state.radius_mm == 15.0

    on_a_rig(scene, path=TENDON_ARM)


def test_energised_drives_show_the_tension_and_others_do_not() -> None:
    async def scene(rig: Rig) -> None:
        np.testing.assert_array_equal(shown(rig), 0.0)
        await rig.armed()
        await asyncio.sleep(0.2)
        resolution = [abs(c.scale.force(1)) for c in rig.service.loop.channels]
        assert resolution == pytest.approx([0.02] * 4)
        np.testing.assert_allclose(shown(rig), true_tension(rig), atol=0.011)
        np.testing.assert_allclose(shown(rig), 2.0, atol=0.011)
        push(rig, 0.1)
        await asyncio.sleep(0.2)
        np.testing.assert_allclose(shown(rig), true_tension(rig), atol=0.011)
        assert shown(rig)[0] < 1.6 < 2.2 < shown(rig)[1]

    on_a_rig(scene, path=TENDON_ARM)


def test_the_torque_of_a_tendon_is_its_tension_times_the_spools_radius_over_the_gear() -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        await asyncio.sleep(0.2)
        for channel, tension_n in zip(rig.service.loop.channels, true_tension(rig), strict=True):
            axis = channel.axis
            assert isinstance(axis, TendonMotor)
            torque_nmm = channel.torque_permille * axis.drive.rated_torque_nmm / 1000.0
            expected = tension_n * axis.spool_radius_mm / axis.gear_ratio
            assert torque_nmm == pytest.approx(expected, abs=0.021)
            assert axis_scale(axis).force(channel.torque_permille) == pytest.approx(
                tension_n, abs=0.011
            )

    on_a_rig(scene, path=TENDON_ARM)


def test_pulling_too_much_ends_in_a_fault_that_names_the_tendon() -> None:
    async def scene(rig: Rig) -> None:
        await driven(rig, [4.0, 4.0, 4.0, 0.0])
        await rig.until(lambda: bool(rig.events("cause", "tendon_over_tension")), 10.0)
        assert rig.events("cause", "tendon_over_tension")[0].subject.startswith("straight")
        await rig.until_state(S.FAULT)
        assert 9.7 < true_tension(rig).max() < 10.6, "the gate has let it go no further"

    on_a_rig(scene, path=TENDON_ARM)


def test_letting_out_too_much_holds_and_names_the_tendon() -> None:
    async def scene(rig: Rig) -> None:
        await driven(rig, [0.0, 0.0, -2.0, 0.0])
        await rig.until(lambda: bool(rig.events("cause", "tendon_slack")), 10.0)
        assert rig.events("cause", "tendon_slack")[0].subject == "straight_3"
        await rig.until_state(S.HOLD)
        assert 0.0 <= true_tension(rig)[2] < 0.11
        assert rig.lab.body.record.actuators[2] > -2.5, "the gate has let out no more"

    on_a_rig(scene, path=TENDON_ARM)


def test_a_push_at_the_body_is_seen_by_its_drives() -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        push(rig, 0.6)
        await rig.until(lambda: bool(rig.events("cause", "tendon_slack")), 5.0)
        assert rig.events("cause", "tendon_slack")[0].subject == "straight_1"
        push(rig, 3.0)
        await rig.until_state(S.FAULT, within_s=5.0)
        assert "tendon_over_tension" in rig.causes
        assert rig.lab.body.record.plant_failures == 0, rig.lab.body.record.last_failure

    on_a_rig(scene, path=TENDON_ARM)


def test_a_controller_without_a_model_follows_a_small_circle_with_it() -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        await rig.do(Load, trajectory=CIRCLE, controller=CONTROLLER)
        await rig.do(Start)
        await rig.until_state(S.RUNNING)
        await rig.until_state(S.ARMED, S.HOLD, S.STANDBY, within_s=60.0)
        assert rig.in_state(S.ARMED), rig.causes

    rig = on_a_rig(scene, path=TENDON_ARM)
    errors = [tip.error_mm for tip in rig.tips if tip.cycle == 0 and tip.error_mm is not None]
    assert len(errors) > 500
    assert np.mean(errors) < 2.0
    assert not rig.events("cause", "tendon_slack")
    assert rig.lab.body.record.plant_failures == 0
