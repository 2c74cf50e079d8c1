"""Set-points from a page: only of the one in control, while it is heard, from a fresh picture."""

import asyncio
import json
from pathlib import Path

import aiohttp

from daemon.dashboard import robot_link
from daemon.host.clock import run_in_real_time
from tests.daemon.dashboard.test_server import OTHER, PAGE, VIEWER, Served, served
from tests.daemon.remote.rig import until

Stream = aiohttp.ClientWebSocketResponse[bool]
_HERE = [1.0, 2.0, 100.0]


async def newest(stream: Stream) -> dict[str, object]:
    """The next frame, as the page has it."""
    told: dict[str, object] = json.loads((await stream.receive()).data)
    return told


async def lead(stream: Stream, seen: object, place: object = None, **more: object) -> None:
    await stream.send_str("heart")
    said = {"set": _HERE if place is None else place, "seen": seen, **more}
    await stream.send_str(json.dumps(said))


async def refused(stream: Stream) -> str:
    """Why the hand is not followed, as the page is told."""
    async with asyncio.timeout(5.0):
        while not (why := str((await newest(stream))["hand"])):
            pass
    return why


def verbs(page: Served) -> list[str]:
    return [word for word in page.robot.verbs() if word in ("hold", "resume", "teleoperate")]


def test_the_hand_s_set_points_arrive_and_are_valid_for_a_moment(tmp_path: Path) -> None:
    async def test() -> None:
        async with served(tmp_path, 60.0) as page, page.stream() as stream:
            assert (await page.do("take"))["ok"] and (await page.do("teleoperate"))["ok"]
            async with asyncio.timeout(20.0):  # on a busy machine some are made too late to count
                while len(page.robot.setpoints) < 5:
                    await lead(stream, (await newest(stream))["n"])
            sent = [setpoint for _, setpoint in page.robot.setpoints]
            assert sent[-1].position_mm == _HERE and sent[-1].valid_s <= 0.25
            assert [setpoint.sequence for setpoint in sent] == sorted(s.sequence for s in sent)

    run_in_real_time(test())


def test_what_was_made_from_an_old_picture_is_not_sent(tmp_path: Path) -> None:
    async def test() -> None:
        async with served(tmp_path, 60.0) as page, page.stream() as stream:
            assert (await page.do("take"))["ok"]
            old = (await newest(stream))["n"]
            for _ in range(30):
                await newest(stream)
            await lead(stream, old)
            assert "too old" in await refused(stream)
            for never in (-1, 10**9):
                await lead(stream, never)
                await asyncio.sleep(0.1)
            assert page.robot.setpoints == []
            await lead(stream, (await newest(stream))["n"])
            await until(lambda: len(page.robot.setpoints) == 1)

    run_in_real_time(test())


def test_only_the_page_in_control_leads(tmp_path: Path) -> None:
    async def test() -> None:
        async with (
            served(tmp_path, 60.0) as page,
            page.stream() as one,
            page.stream(OTHER) as other,
        ):
            assert (await page.do("take"))["ok"]
            await lead(other, (await newest(other))["n"])
            assert "not in control" in await refused(other)
            async with page.http.ws_connect(
                f"{page.base}/ws?robot=little_arm&page={PAGE}", headers=page.sent(VIEWER)
            ) as watching:
                await lead(watching, (await newest(watching))["n"])
                await asyncio.sleep(0.2)
                assert page.robot.setpoints == [], "a viewer with another's number leads nothing"
            assert (await newest(one))["n"]

    run_in_real_time(test())


def test_a_page_that_is_not_heard_leads_nothing(tmp_path: Path) -> None:
    async def test() -> None:
        async with served(tmp_path, 60.0) as page, page.stream() as stream:
            assert (await page.do("take"))["ok"]
            for _ in range(int(robot_link.HEARD_WITHIN_S / 0.03) + 5):
                seen = (await newest(stream))["n"]
            await stream.send_str(json.dumps({"set": _HERE, "seen": seen}))
            assert "not in control" in await refused(stream)
            assert page.robot.setpoints == []

    run_in_real_time(test())


def test_letting_go_holds_and_taking_hold_again_resumes_after_it(tmp_path: Path) -> None:
    async def test() -> None:
        async with served(tmp_path, 60.0) as page, page.stream() as stream:
            assert (await page.do("take"))["ok"]
            await stream.send_str(json.dumps({"let_go": True}))
            await lead(stream, (await newest(stream))["n"], grab=True)
            await until(lambda: verbs(page) == ["hold", "resume"])
            async with page.stream(OTHER) as other:
                await other.send_str(json.dumps({"let_go": True}))
                await asyncio.sleep(0.2)
            assert verbs(page) == ["hold", "resume"], "another page holds nothing"

    run_in_real_time(test())


def test_a_hand_whose_first_picture_was_too_old_resumes_with_its_next_one(tmp_path: Path) -> None:
    async def test() -> None:
        async with served(tmp_path, 60.0) as page, page.stream() as stream:
            assert (await page.do("take"))["ok"]
            await lead(stream, -1, grab=True)
            assert "too old" in await refused(stream)
            assert verbs(page) == []
            await lead(stream, (await newest(stream))["n"])
            await until(lambda: verbs(page) == ["resume"])
            await lead(stream, (await newest(stream))["n"])
            await asyncio.sleep(0.2)
            assert verbs(page) == ["resume"], "once for each grip"

    run_in_real_time(test())


def test_what_is_no_set_point_does_nothing(tmp_path: Path) -> None:
    async def test() -> None:
        async with served(tmp_path, 60.0) as page, page.stream() as stream:
            assert (await page.do("take"))["ok"]
            seen = (await newest(stream))["n"]
            for place in ([1, 2], "here", [1, 2, "z"], [1, 2, 3, 4], {"x": 1}):
                await lead(stream, seen, place)
            for text in ("{", "[]", "nonsense", '{"set": [1, 2, NaN], "seen": 1}', "null"):
                await stream.send_str(text)
            await lead(stream, (await newest(stream))["n"])
            await until(lambda: len(page.robot.setpoints) == 1)

    run_in_real_time(test())


def test_a_page_that_shows_nothing_gets_four_frames_and_the_newest_when_it_is_back(
    tmp_path: Path,
) -> None:
    async def test() -> None:
        async with served(tmp_path, 60.0) as page, page.stream() as stream:
            first = int(str((await newest(stream))["n"]))
            await stream.send_str(json.dumps({"got": first}))
            await asyncio.sleep(1.0)  # thirty frames' time
            numbers: list[object] = []
            while len(numbers) < 60:
                try:
                    async with asyncio.timeout(0.3):
                        numbers.append((await newest(stream))["n"])
                except TimeoutError:
                    break
            assert len(numbers) <= 6, numbers
            await stream.send_str(json.dumps({"got": numbers[-1]}))
            told = await newest(stream)
            assert int(str(told["dropped"])) > 20 and float(str(told["age_s"])) < 0.3

    run_in_real_time(test())
