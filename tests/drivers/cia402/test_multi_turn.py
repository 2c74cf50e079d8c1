"""Axes that turn on and on: nothing begins anew after a turn, in the drive or on the way to it."""

import asyncio
from itertools import pairwise
from math import pi

import pytest
from pydantic import TypeAdapter

from config.axis import Axis
from config.emulation.lab import EmulatedDrives, Quirk
from drivers.axis_scale import axis_scale, count_limits
from drivers.cia402 import objects
from safety.gate import Gate, Measured
from safety.risk_source import NoModel
from tests.drivers.cia402.rig import Rig, on_a_rig

STEP_S = 0.025
TURNS = 4
MODES = pytest.mark.parametrize("mode", ["csp", "csv", "pv"])
MAKES = pytest.mark.parametrize("quirks", [(), ("counts_modulo_turn",)])


def rotations(mode: str) -> list[Axis]:
    return [
        TypeAdapter[Axis](Axis).validate_python(
            {
                "name": f"rotation_{number}",
                "kind": "tube_rotation",
                "drive": {
                    "bus": "can0",
                    "node": number,
                    "counts_per_turn": 4000,
                    "rated_torque_nmm": 400.0,
                    "mode": mode,
                    "inverted": number == 2,
                },
                "gear_ratio": 2.5,
                "travel_rad": [-2.0 * pi * (TURNS + 1), 2.0 * pi * (TURNS + 1)],
                "max_velocity_rad_s": 3.0,
                "max_acceleration_rad_s2": 30.0,
                "quick_stop_deceleration_rad_s2": 60.0,
                "following_error_rad": 0.3,
            }
        )
        for number in (1, 2)
    ]


@MODES
@MAKES
def test_several_turns_there_and_back_are_one_long_way(
    mode: str, quirks: tuple[Quirk, ...]
) -> None:
    async def test(rig: Rig) -> None:
        await rig.enabled()
        scales = [axis_scale(axis) for axis in rig.axes]
        limits = [count_limits(axis) for axis in rig.axes]
        gate = Gate(limits, [s.counts_per_unit for s in scales], [None] * 2, NoModel(), 1.0, 1.0)
        told: list[list[float]] = []
        sdo = rig.master.nodes[1].sdo

        async def to(angle_rad: float) -> None:
            targets = [float(scale.counts(angle_rad)) for scale in scales]
            way_rad = abs(angle_rad - scales[0].position(rig.positions()[0]))
            for _ in range(round((way_rad / 3.0 + 2.0) / STEP_S)):
                counts = rig.positions()
                now_ns = rig.clock.now_ns()
                measured = Measured(counts, [None, None])
                decision = gate.decide(targets, measured, now_ns, round(STEP_S * 1e9))
                assert decision.step is not None, decision.refused
                rig.master.write(decision.step)
                await asyncio.sleep(STEP_S)
                told.append([s.position(c) for s, c in zip(scales, rig.positions(), strict=True)])
            assert told[-1] == pytest.approx([angle_rad] * 2, abs=2e-3)
            # What the drive itself says, in the same units, and where its shaft really is.
            position = int.from_bytes(
                await sdo.read(objects.POSITION_ACTUAL), "little", signed=True
            )
            assert position == pytest.approx(scales[0].counts(angle_rad), abs=3)
            rig.bus.advance(rig.clock.now_ns())
            shafts = [drive.axes[0].position_counts for drive in rig.drives]
            assert shafts == pytest.approx(targets, abs=3.0)
            error = int.from_bytes(await sdo.read(0x60F4), "little", signed=True)
            assert abs(error) <= 3

        for turns in (TURNS, -TURNS, 0.25):
            await to(2.0 * pi * turns)
        changes = [
            abs(b - a) for one, other in pairwise(told) for a, b in zip(one, other, strict=True)
        ]
        assert max(changes) < 3.0 * 2 * STEP_S, "no angle jumps by a turn"
        assert not rig.names() & {"drive_following_error", "drive_fault", "drive_emergency"}

    on_a_rig(test, robot_axes=rotations(mode), options=EmulatedDrives(quirks=quirks))


def test_that_it_counts_on_is_read_back_before_each_arming() -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        assert await rig.master.check_settings(1.0) == []
        rig.inject("drive.can0/1.setting=0x607B,2,3999")
        (differs,) = await rig.master.check_settings(1.0)
        assert differs.startswith(
            "can0/1 0x607B:02 (no modulo counting) reads 3999, not 2147483647"
        )

    on_a_rig(test, robot_axes=rotations("csp"))


def test_a_drive_that_counts_modulo_a_turn_would_show_it() -> None:
    """So that the tests above show something."""

    async def test(rig: Rig) -> None:
        await rig.operational()
        rig.inject("drive.can0/1.setting=0x607B,1,0")
        rig.inject("drive.can0/1.setting=0x607B,2,3999")
        axis = rig.drives[0].axes[0]
        axis.drag_to(4000.0 * 2 + 100)
        await asyncio.sleep(0.1)
        assert rig.positions()[0] == 100
        assert axis.position_counts == 8100

    on_a_rig(test, robot_axes=rotations("csp"))
