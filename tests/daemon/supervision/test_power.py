"""The power of all drives, led a cycle at a time, whatever becomes of one of them."""

import asyncio
from itertools import pairwise

from daemon.supervision.power import Power, PowerPhase
from tests.drivers.cia402.rig import Rig, on_a_rig


def test_a_lost_drive_that_keeps_its_torque_is_switched_off_once_when_it_is_back() -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        power = Power([rig.master])
        phases: list[PowerPhase] = []

        async def lead(seconds: float) -> None:
            for _ in range(round(seconds / 0.01)):
                power.cycle(rig.clock.now_ns())
                phases.append(power.phase)
                await asyncio.sleep(0.01)

        power.enable(rig.clock.now_ns())
        await lead(1.0)
        rig.inject("drive.can0/1.heartbeat_stop=3s")  # it hears us, and holds after its quick stop
        await rig.until(lambda: ("node_lost", "can0/1") in rig.holding())
        power.stop(rig.clock.now_ns())
        await lead(2.0)
        assert (rig.master.energised, power.confirmed) == (True, False)
        await lead(5.0)
        assert (rig.master.energised, power.confirmed) == (False, True)
        changes = [after for before, after in pairwise(phases) if after is not before]
        off = [PowerPhase.SWITCHING_OFF, PowerPhase.LEFT_ALONE]
        assert changes == [PowerPhase.ENABLED, PowerPhase.STOPPING, *off, *off]

    on_a_rig(test)
