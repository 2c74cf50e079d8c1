"""What a step does in which order: nothing that can wait keeps the drives waiting."""

import asyncio
from typing import Any

import pytest

from daemon.loop.reasons_to_hold import ReasonsToHold
from daemon.messages import Load, Start
from drivers.cia402.drive_bus import DriveBus
from safety.states import OperatingState
from tests.daemon.service.grazing import BROYDEN, TENDONS
from tests.daemon.service.rig import Rig, on_a_rig


def test_the_gate_and_the_tip_are_judged_when_the_targets_are_on_their_way(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    done: list[str] = []

    def noted(owner: type, name: str) -> None:
        method = getattr(owner, name)

        def call(*arguments: Any) -> Any:
            done.append(name)
            return method(*arguments)

        monkeypatch.setattr(owner, name, call)

    noted(DriveBus, "write")
    noted(ReasonsToHold, "judge_gate")
    noted(ReasonsToHold, "judge_tip")

    async def scene(rig: Rig) -> None:
        await rig.armed()
        await rig.do(Load, trajectory=TENDONS.circle, controller=BROYDEN)
        await rig.do(Start)
        await rig.until_state(OperatingState.RUNNING)
        done.clear()
        await asyncio.sleep(1.0)
        steps = len(done) // 3
        assert steps > 20
        assert done == steps * ["write", "judge_gate", "judge_tip"]

    on_a_rig(scene, path=TENDONS.file)
