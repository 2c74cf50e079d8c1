"""An arm whose drives are on two CAN buses: each bus has the rhythm, and each hears the stop."""

import asyncio
import struct
from pathlib import Path
from typing import Any, Final

import numpy as np

from daemon.messages import Acquire, Arm, Stop
from daemon.recording.format.channels import RAW_CAN, read_can_payload
from daemon.recording.run_folder import RUN_FILE
from daemon.recording.run_reader import RunReader
from drivers.canopen.codec import cob_ids
from safety.permit import PermittedStep
from safety.states import OperatingState
from tests import SHIPPED_ROBOTS
from tests.daemon.service.rig import Rig, on_a_rig, stand_still

TWO_BUSES: Final = SHIPPED_ROBOTS / "three_tendon_arm.yaml"
NODES: Final = {"can0": (1, 2), "can1": (1,)}
CIRCLE: Final[dict[str, Any]] = {
    "kind": "circle",
    "center_mm": [0.0, 0.0, 148.7],
    "radius_mm": 10.0,
    "cycle_s": 15.0,
}
BROYDEN: Final[dict[str, Any]] = {
    "kind": "broyden",
    "explore_together": False,
    "explore_share": 0.04,
    "damping_mm": 100.0,
    "posture_gain_per_s": 1.0,
}
S = OperatingState


def test_each_bus_has_its_sync_and_the_stop_goes_to_every_drive(tmp_path: Path) -> None:
    told_ns: list[int] = []

    async def scene(rig: Rig) -> None:
        await rig.running(CIRCLE, BROYDEN)
        before = rig.shafts()
        await rig.until(lambda: bool(np.ptp(np.subtract(rig.shafts(), before)) > 20.0))
        told_ns.append(rig.service.clock.now_ns())
        await rig.do(Stop)
        await rig.until(lambda: all(not state.energised for state in rig.power))
        assert rig.state in (S.READY, S.STANDBY, S.ESTOP)
        still = rig.shafts()
        await rig.until(lambda: rig.service.clock.now_ns() > told_ns[0] + 2_000_000_000)
        assert rig.shafts() == still

    on_a_rig(scene, path=TWO_BUSES, folder=tmp_path)
    for bus, nodes in NODES.items():
        frames = recorded(tmp_path, bus)
        syncs = np.array([t_ns for t_ns, can_id, _ in frames if can_id == cob_ids.SYNC])
        periods_ms = np.diff(syncs[-200:]) * 1e-6
        assert abs(np.median(periods_ms) - 10.0) < 0.5, bus
        for node in nodes:
            at_ns = quick_stop_ns(frames, node, told_ns[0])
            assert at_ns - told_ns[0] < 15_000_000, f"{bus}/{node}"


def recorded(folder: Path, bus: str) -> list[tuple[int, int, bytes]]:
    """All frames of it: time in ns, identifier, data."""
    reader = RunReader(folder / RUN_FILE)
    return [
        (t_ns, frame.can_id, frame.data)
        for message in reader.messages([f"{RAW_CAN}{bus}"])
        for t_ns, frame in read_can_payload(message.data)
    ]


def quick_stop_ns(frames: list[tuple[int, int, bytes]], node: int, from_ns: int) -> int:
    """When the node was first told to stop quickly: bit 2 of its control word low, bit 1 high."""
    words = (
        (t_ns, struct.unpack_from("<H", data)[0])
        for t_ns, can_id, data in frames
        if can_id == cob_ids.rpdo(node, 1) and t_ns >= from_ns and len(data) >= 2
    )
    return next(t_ns for t_ns, word in words if word & 0x6 == 0x2)


def test_a_step_goes_to_both_buses_where_the_process_stands_still_between_them() -> None:
    async def scene(rig: Rig) -> None:
        await rig.running(CIRCLE, BROYDEN)
        before = rig.shafts()
        await rig.until(lambda: bool(np.ptp(np.subtract(rig.shafts(), before)) > 20.0))
        first, channels = rig.service.hardware.buses[0], rig.service.loop.channels
        write, steps = first.write, list[PermittedStep]()

        def written_slowly(step: PermittedStep) -> None:
            first.write = write  # type: ignore[method-assign]
            write(step)
            steps.append(step)
            stand_still(0.014)  # a step of 25 ms is fresh for half of its time

        first.write = written_slowly  # type: ignore[method-assign]
        await rig.until(lambda: bool(steps))
        now_ns = rig.service.clock.now_ns()
        await asyncio.sleep(0.01)  # each bus has had a cycle
        soon = [steps[0].targets(now_ns + later_ms * 1_000_000) for later_ms in (0, 20)]
        for channel, now, then in zip(channels, *soon, strict=True):
            assert channel.target_counts is not None
            assert min(now, then) <= channel.target_counts <= max(now, then), channel.axis.name
        now_ns = rig.service.clock.now_ns()
        assert rig.service.loop.target_counts(now_ns) == steps[0].targets(now_ns)

    on_a_rig(scene, path=TWO_BUSES)


def test_no_axis_is_enabled_while_one_on_the_other_bus_cannot_be() -> None:
    async def scene(rig: Rig) -> None:
        await rig.do(Acquire)
        rig.lab.inject("drive.can1/1.stuck_statusword=60s")
        arming = asyncio.create_task(rig.refused(Arm))
        while not arming.done():
            assert not any(channel.following for channel in rig.service.loop.channels)
            await asyncio.sleep(0.005)

    on_a_rig(scene, path=TWO_BUSES)
