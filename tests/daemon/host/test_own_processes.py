"""Processes of our own are started until they speak, and ended whatever happened."""

import asyncio
from pathlib import Path

import pytest

from daemon.host.processes import OwnProcesses, ProcessError
from daemon.robot.lab_connections import ask
from tests import SOFT_ARM


@pytest.mark.hil
def test_a_process_is_ready_when_it_has_started_and_gone_when_it_has_ended(
    tmp_path: Path,
) -> None:
    async def scene() -> None:
        lab = OwnProcesses(["emulate", str(SOFT_ARM), "--runtime-dir", str(tmp_path)])
        try:
            await lab.start()
            answer = await asyncio.to_thread(ask, tmp_path, {"do": "state"})
            assert answer["ok"]
        finally:
            await lab.end()
        await lab.end()

    asyncio.run(scene())
    assert not (tmp_path / "lab.json").exists()


@pytest.mark.hil
def test_one_that_cannot_start_is_named_and_the_others_are_not_started(tmp_path: Path) -> None:
    async def scene() -> None:
        processes = OwnProcesses(["check", str(tmp_path / "no.yaml")], ["run", "never"])
        try:
            with pytest.raises(ProcessError, match="`tentacled check` ended at once"):
                await processes.start()
            assert len(processes._running) == 1
        finally:
            await processes.end()

    asyncio.run(scene())
