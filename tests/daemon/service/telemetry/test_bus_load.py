"""The load of a bus is told as it was over the last second, and is what was foreseen of it."""

import asyncio

from daemon.messages import Loop
from daemon.robot.checked_robot import check_robot
from tests import SOFT_ARM
from tests.daemon.service.rig import Rig, on_a_rig


def test_the_load_is_about_what_the_budget_foresees() -> None:
    async def scene(rig: Rig) -> None:
        await asyncio.sleep(4.0)
        assert [bus.name for bus in rig.status.loop.buses] == ["can0"]
        told = [message.status.buses[0].load for message in rig.told if isinstance(message, Loop)]
        foreseen = check_robot(SOFT_ARM).budgets["can0"].load
        assert len(told) >= 3
        assert 0.25 * foreseen < told[-1] <= foreseen, "which counts on the worst"

    on_a_rig(scene)
