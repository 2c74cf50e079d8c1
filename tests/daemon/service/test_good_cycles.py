"""What feeds a watchdog: cycles of a loop that goes on, and nothing else."""

import asyncio
from itertools import pairwise

import pytest

from tests.daemon.service.rig import Rig, on_a_rig


def test_every_cycle_of_a_sound_loop_counts() -> None:
    fed: list[int] = []

    async def story(rig: Rig) -> None:
        rig.service.dependencies.good_cycle = fed.append
        await asyncio.sleep(1.0)

    on_a_rig(story)
    assert len(fed) >= 99
    assert all(9_000_000 < after - before < 11_000_000 for before, after in pairwise(fed))


def test_a_loop_whose_supervision_fails_is_not_fed() -> None:
    fed: list[int] = []

    async def story(rig: Rig) -> None:
        def fails(_: int) -> None:
            raise RuntimeError("cannot look")

        rig.service.dependencies.good_cycle = fed.append
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(rig.service.monitors, "look", fails)
            await asyncio.sleep(0.05)
            fed.clear()
            await asyncio.sleep(1.0)
            assert fed == []

    on_a_rig(story)
