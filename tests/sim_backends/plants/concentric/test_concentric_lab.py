"""The tubes behind their emulated drives, as the daemon meets them."""

import asyncio
from pathlib import Path
from typing import Any

import numpy as np

from daemon.control.controller import Observation, Proposal
from daemon.host.clock import MonotonicClock
from daemon.messages import Load, Start
from safety.states import OperatingState
from sim_backends.lab.lab_ports import LabPorts
from sim_backends.plants.concentric.concentric_tubes import ConcentricTubes
from sim_backends.plants.plant import FloatArray
from tests import SHIPPED_ROBOTS
from tests.daemon.service.rig import Rig, on_a_rig

TUBES = SHIPPED_ROBOTS / "concentric_tubes.yaml"
S = OperatingState


def test_the_lab_holds_the_tubes_with_the_shipped_figures() -> None:
    async def scene(rig: Rig) -> None:
        assert isinstance(rig.lab.body._plant, ConcentricTubes)
        record = rig.lab.body.record
        assert (record.state.radius_mm, record.state.snaps, record.plant_failures) == (1.4, 0, 0)

    on_a_rig(scene, path=TUBES)


def test_armed_drives_hold_the_tubes_and_show_their_torques() -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        await asyncio.sleep(0.3)
        true = rig.lab.body.record.state.actuator_forces
        shown = [c.scale.force(c.torque_permille) for c in rig.service.loop.channels]
        resolution = [abs(c.scale.force(1)) for c in rig.service.loop.channels]
        np.testing.assert_array_less(np.abs(np.array(shown) - true), np.array(resolution) + 1e-9)
        assert rig.lab.body.record.plant_failures == 0

    on_a_rig(scene, path=TUBES)


CONTROLLER: dict[str, Any] = {
    "kind": "broyden",
    "explore_together": False,
    "explore_share": 0.02,
    "settle_s": 0.3,
    "damping_mm": 20.0,
}
CIRCLE: dict[str, Any] = {
    "kind": "circle",
    "center_mm": [78.0, 0.0, 171.0],
    "radius_mm": 8.0,
    "cycle_s": 20.0,
}


async def driven(rig: Rig, per_s: list[float], for_s: float) -> FloatArray:
    """RUNNING with somebody at the controls; returns the way of the tip, (n, 3) mm."""
    await rig.armed()
    await rig.do(Load, trajectory=CIRCLE, controller=CONTROLLER)
    await rig.do(Start)
    await rig.until_state(S.RUNNING)
    controller = rig.service.loop.controller
    assert controller is not None

    def propose(observation: Observation) -> Proposal:
        return Proposal(np.array(per_s) * observation.dt_s)

    controller.propose = propose  # type: ignore[method-assign]
    way = []
    for _ in range(round(for_s / 0.05)):
        await asyncio.sleep(0.05)
        way.append(rig.lab.body.record.state.tip.position_mm)
    return np.array(way)


def test_all_tubes_turned_together_turn_the_body_and_not_its_shape() -> None:
    """Base roll: three axes that start in the same cycle, so no tube is twisted against another."""

    async def scene(rig: Rig) -> None:
        way = await driven(rig, [0.5, 0.5, 0.5, 0.0, 0.0], 4.0)
        radius = np.hypot(way[:, 0], way[:, 1])
        turned = np.unwrap(np.arctan2(way[:, 1], way[:, 0]))
        assert 1.5 < turned[-1] - turned[0] < 2.0
        assert np.ptp(radius) < 0.6, "but for its weight"
        assert np.ptp(rig.lab.body.record.actuators[:3]) < 1e-3
        assert rig.lab.body.record.plant_failures == 0
        assert rig.causes == set()

    on_a_rig(scene, path=TUBES)


def test_a_rotation_goes_on_past_half_a_turn_and_stops_at_the_end_of_its_travel() -> None:
    """Positions are counted, not wrapped: not in the drive, nor its velocity, nor its following
    error."""

    async def scene(rig: Rig) -> None:
        way = await driven(rig, [0.0, 0.0, 0.9, 0.0, 0.0], 9.0)
        angle = rig.lab.body.record.actuators[2]
        assert 2.0 * np.pi - 0.01 < angle < 2.0 * np.pi + 0.02
        assert np.linalg.norm(way[-1] - way[0]) < 10.0, "once round"
        assert np.linalg.norm(way - way[0], axis=1).max() > 40.0
        steps = np.linalg.norm(np.diff(way, axis=0), axis=1)
        assert steps.max() < 10.0, "it never went back the other way round"
        assert not rig.events("cause", "drive_following_error")
        assert rig.lab.body.record.state.snaps == 0

    on_a_rig(scene, path=TUBES)


def test_the_carriages_push_the_body_forward_and_the_inner_tube_out() -> None:
    async def scene(rig: Rig) -> None:
        way = await driven(rig, [0.0, 0.0, 0.0, 2.0, 2.0], 3.0)
        moved = way[-1] - way[0]
        np.testing.assert_allclose(moved[:2], 0.0, atol=0.1)
        assert 3.0 < moved[2] < 6.5
        assert rig.lab.body.record.plant_failures == 0

    on_a_rig(scene, path=TUBES)


def test_what_the_lab_tells_others_says_how_near_a_snap_is() -> None:
    async def scene(rig: Rig) -> None:
        told = LabPorts(rig.lab, Path("/nowhere"), MonotonicClock())._state({})
        assert told["snaps"] == 0
        assert told["stability"] == rig.lab.body.record.state.stability > 0.1

    on_a_rig(scene, path=TUBES)
