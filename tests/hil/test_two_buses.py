"""An arm whose drives are on two CAN buses, from its tracker to its recording, as processes.

The same in virtual time is in tests/daemon/service/test_two_buses.py.
"""

from contextlib import suppress
from pathlib import Path
from typing import Final

import numpy as np
import pytest
import yaml

from daemon.remote.client.client_errors import RefusedError
from drivers.canopen.codec import cob_ids
from safety.states import OperatingState
from tests.daemon.service.test_two_buses import BROYDEN, CIRCLE, NODES, TWO_BUSES, recorded
from tests.hil.daemon_rig import Rig, short_folder

pytestmark = [pytest.mark.long, pytest.mark.hil, pytest.mark.xdist_group("two_buses")]

S = OperatingState
MOVES_WITHIN_S: Final = 60.0
ATTEMPTS: Final = 3


def patient(folder: Path) -> Path:
    """The shipped file, for a machine that gives nobody a turn for a moment; its zeros are looked
    for at the start, where each tendon is."""
    robot = yaml.safe_load(TWO_BUSES.read_text())
    for bus in robot["buses"].values():
        bus |= {"cycle_period_s": 0.02, "master_heartbeat_timeout_s": 2.0}
    for axis in robot["axes"]:
        axis["homing"] = {"method": 35, "referenced": "home_at_start"}
    robot["supervision"] |= {"loop_hold_after_s": 0.4, "loop_fault_after_s": 1.5}
    robot["emulation"]["patience_s"] = 1.5
    del robot["risk"]
    path = folder / "robot.yaml"
    path.write_text(yaml.safe_dump(robot))
    return path


def test_it_is_homed_follows_a_circle_and_stops_on_both_buses() -> None:
    with short_folder() as folder:
        one = Rig(folder, patient(folder))
        try:
            follows(one)
            assert one.energised
            one.user.do(one.client.stop())
            one.until_without_torque()
            there = one.actuators()
            assert one.state in (S.READY, S.STANDBY, S.ESTOP)
            np.testing.assert_allclose(one.actuators(), there, atol=0.02)
        finally:
            one.leave()
        place = max((folder / "runs").iterdir())
        stopped_ns = {}
        for bus, nodes in NODES.items():
            frames = recorded(place, bus)
            syncs = np.array([t_ns for t_ns, can_id, _ in frames if can_id == cob_ids.SYNC])
            assert abs(np.median(np.diff(syncs)) * 1e-6 - 20.0) < 2.0, bus
            for node in nodes:
                stopped_ns[bus, node] = last_quick_stop_ns(frames, node)
        assert np.ptp(list(stopped_ns.values())) < 100e6, "both are told within some cycles"


def follows(one: Rig) -> None:
    """Homed, armed, on its circle. On a busy machine it may come to a fault: then once more."""
    for _ in range(ATTEMPTS):
        one.until(
            lambda: one.causes() == {"not_referenced"} or one.state in (S.READY, S.FAULT), 60.0
        )
        homed(one)
        one.armed()
        one.user.do(one.client.load(CIRCLE, BROYDEN))
        one.user.do(one.client.start())
        one.until(lambda: moves(one) or one.state is S.FAULT, MOVES_WITHIN_S)
        if one.state is S.RUNNING:
            return
    raise AssertionError("it always came to a fault")


def set_up(one: Rig) -> bool:
    """Whether nothing is left to wait for."""
    return one.causes() == {"not_referenced"} or one.state in (S.READY, S.FAULT)


def homed(one: Rig) -> None:
    """All that do not know their zeros look for them."""
    while "not_referenced" in one.causes():
        one._acquire()
        with suppress(RefusedError):
            if one.state is S.FAULT:
                one.user.do(one.client.clear())
            one.user.do(one.client.home([], 60.0))


def moves(one: Rig) -> bool:
    """Whether it follows, its first motions over, every tendon on its way."""
    if one.state is S.HOLD:
        with suppress(RefusedError):
            one.user.do(one.client.resume())
    reference = one.status().reference
    if reference is None or reference.cycle < 0 or reference.note:
        return False
    return bool((np.abs(one.actuators()) > 0.2).all())


def last_quick_stop_ns(frames: list[tuple[int, int, bytes]], node: int) -> int:
    """When the node was told to stop quickly for the last time that it was not told so before."""
    words = [
        (t_ns, int.from_bytes(data[:2], "little"))
        for t_ns, can_id, data in frames
        if can_id == cob_ids.rpdo(node, 1) and len(data) >= 2
    ]
    stops = [word & 0x6 == 0x2 for _, word in words]
    begins = [i for i in range(1, len(stops)) if stops[i] and not stops[i - 1]]
    return words[begins[-1]][0]
