"""What is done to a lab from outside is heard by the daemon beside it, once, in order."""

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from daemon.robot.lab_connections import LabListener, no_lab
from sim_backends.lab.lab import Diary
from sim_backends.lab.lab_ports import ControlServer, Request

WITHIN_S = 20.0


def server_of(diary: Diary) -> ControlServer:
    def entries(request: Request) -> Mapping[str, Any]:
        return {"count": diary.count, "entries": diary.after(int(request["after"]))}

    return ControlServer({"diary": entries})


async def until(heard: list[str], count: int) -> None:
    async with asyncio.timeout(WITHIN_S):
        while len(heard) < count:
            await asyncio.sleep(0.01)


def test_what_is_done_to_a_lab_is_heard_and_what_was_done_before_is_not(tmp_path: Path) -> None:
    async def scene() -> None:
        diary, heard = Diary(), list[str]()
        diary.note("before")
        server = server_of(diary)
        await server.listen(tmp_path / "control.sock")
        listener = LabListener(tmp_path, heard.append)
        listener.start()
        await asyncio.sleep(0.6)
        diary.note("14.2 g at the tip")
        diary.note("tracker.missing=1s")
        await until(heard, 2)
        assert heard == ["14.2 g at the tip", "tracker.missing=1s"]
        diary.note("0 g at the tip")
        await until(heard, 3)
        listener.end()
        diary.note("after")
        await asyncio.sleep(0.6)
        assert heard[2:] == ["0 g at the tip"]
        await server.close()

    asyncio.run(scene())


def test_a_lab_that_begins_anew_is_heard_again(tmp_path: Path) -> None:
    async def scene() -> None:
        heard = list[str]()
        listener = LabListener(tmp_path, heard.append)
        listener.start()
        await asyncio.sleep(0.4)
        for text in ("one", "two"):
            diary = Diary()
            server = server_of(diary)
            await server.listen(tmp_path / "control.sock")
            await asyncio.sleep(0.8)
            diary.note(text)
            await until(heard, 1 if text == "one" else 2)
            await server.close()
            (tmp_path / "control.sock").unlink(missing_ok=True)
        listener.end()
        assert heard == ["one", "two"]

    asyncio.run(scene())


def test_where_no_lab_is_it_is_said_how_to_start_one(tmp_path: Path) -> None:
    async def scene() -> None:
        robot = Path("arm.yaml")
        said = no_lab(tmp_path, robot)
        assert said == f"no lab is running in {tmp_path}: `tentacled emulate arm.yaml` starts it"
        server = server_of(Diary())
        await server.listen(tmp_path / "control.sock")
        assert no_lab(tmp_path, robot) == ""
        await server.close()
        assert no_lab(tmp_path, robot) == said

    asyncio.run(scene())


def test_a_diary_forgets_what_is_old() -> None:
    diary = Diary()
    for number in range(1, 1501):
        diary.note(str(number))
    assert diary.count == 1500
    assert diary.after(0)[0] == (501, "501")
    assert diary.after(1498) == [(1499, "1499"), (1500, "1500")]
    assert diary.after(1500) == []
