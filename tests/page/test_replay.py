"""A recording in a real browser: open in a moment, and dragged along without a stutter."""

import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from tests.daemon.recording.synthetic_run import make_run, make_surrounded_run
from tests.hil.processes import Process, command
from tests.page.browsing import Browsing, browsing, until

if TYPE_CHECKING:
    from collections.abc import Iterator

    from playwright.sync_api import Browser

pytestmark = pytest.mark.page

_LONG_S = 400.0


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> "Iterator[str]":
    """Of the page of a recording of 400 s, as `tentacled dashboard --replay` prints it."""
    folder: Path = tmp_path_factory.mktemp("runs") / "soft_arm-2020"
    folder.mkdir()
    with ThreadPoolExecutor(1) as pool:  # the browser's own loop runs in this thread
        pool.submit(make_run, folder, 3, _LONG_S / 3).result()
    server = Process(command("dashboard", "nobody", "--port", "0", "--replay", str(folder)))
    try:
        yield server.next_line()[1].split()[1]
    finally:
        server.leave()


def opened(seen: Browsing) -> dict[str, Any]:
    until(lambda: seen.probe().get("replay"), "it is open")
    told: dict[str, Any] = seen.probe()["replay"]
    return told


def t_of(seen: Browsing) -> float:
    return float(seen.probe()["replay"]["t"])


def test_it_opens_soon_and_follows_the_hand(browser: "Browser", address: str) -> None:
    with browsing(browser, address) as seen:
        replay = opened(seen)
        assert replay["duration"] == pytest.approx(_LONG_S, abs=6.0)
        assert replay["opened_ms"] < 8000.0, "2 s on an idle machine: `benchmarks page`"
        box = seen.page.locator("#moment").bounding_box()
        assert box is not None
        y = box["y"] + box["height"] / 2
        seen.page.mouse.move(box["x"] + 20, y)
        seen.page.mouse.down()
        shown, began_s = seen.probe()["replay"]["shown"], time.monotonic()
        for step in range(120):
            seen.page.mouse.move(box["x"] + 20 + step * (box["width"] - 40) / 120, y)
        took_s = time.monotonic() - began_s
        seen.page.mouse.up()
        frames = seen.probe()["replay"]["shown"] - shown
        assert frames / took_s > 8.0, f"{frames} frames in {took_s:.1f} s: 20 on an idle machine"
        assert t_of(seen) > 0.9 * replay["duration"]
        assert seen.errors == []


def test_every_part_of_the_page_is_in_step(browser: "Browser", address: str) -> None:
    with browsing(browser, address) as seen:
        opened(seen)
        seen.page.locator("#worst").click()
        until(lambda: (seen.probe()["tip"] or {}).get("error_mm"), "the worst moment is shown")
        found = seen.probe()
        assert f"{found['tip']['error_mm']:.2f} mm" in str(
            seen.page.locator("#worst").get_attribute("title")
        )
        assert found["body"]["centreline_mm"] and found["status"]["state"] == "running"
        cursor = seen.page.locator("#ploterror .cursor")
        assert cursor.is_visible()
        at_worst = cursor.bounding_box()
        held = seen.page.locator("#events").get_by_role("button", name="has lost the tip")
        held.click()
        until(lambda: seen.state() == "hold", "the moment of the event")
        now = cursor.bounding_box()
        assert at_worst and now and abs(now["x"] - at_worst["x"]) > 5.0
        assert "HOLD" in seen.page.locator("#state").inner_text()
        current = seen.page.locator("#events li.current")
        assert "has lost the tip" in current.inner_text()
        seen.page.locator("#eventafter").click()
        until(lambda: seen.state() == "running", "the next event")
        seen.page.locator("#eventbefore").click()
        until(lambda: seen.state() == "hold", "and the one before")


def test_it_plays_at_any_speed_and_back(browser: "Browser", address: str) -> None:
    with browsing(browser, address) as seen:
        opened(seen)
        seen.page.locator("#eventafter").click()
        seen.page.locator("#speed").select_option("10")
        before_s, began_s = t_of(seen), time.monotonic()
        seen.page.locator("#play").click()
        time.sleep(2.0)
        seen.page.locator("#play").click()
        passed_s = time.monotonic() - began_s
        assert 5.0 * passed_s < t_of(seen) - before_s < 12.0 * passed_s
        there_s = t_of(seen)
        time.sleep(0.3)
        assert t_of(seen) == there_s, "paused"
        seen.page.locator("#speed").select_option("-1")
        seen.page.locator("#play").click()
        until(lambda: t_of(seen) < there_s - 0.5, "backwards")


def test_keys_move_along_it_but_not_from_a_field(browser: "Browser", address: str) -> None:
    with browsing(browser, address) as seen:
        opened(seen)
        before_s = t_of(seen)
        seen.page.keyboard.press("ArrowRight")
        until(lambda: t_of(seen) == pytest.approx(before_s + 1.0))
        seen.page.locator("#filter").focus()
        seen.page.keyboard.press("ArrowRight")
        seen.page.keyboard.press(" ")
        time.sleep(0.2)
        assert t_of(seen) == pytest.approx(before_s + 1.0) and not seen.probe()["replay"]["playing"]
        seen.page.locator("#moment").focus()
        seen.page.keyboard.press("End")
        until(lambda: t_of(seen) > _LONG_S - 5.0)


def shows(seen: Browsing, room: dict[str, object]) -> bool:
    return bool(seen.probe()["room"] == room)


def test_what_is_round_the_body_is_that_of_the_moment(browser: "Browser", tmp_path: Path) -> None:
    folder = tmp_path / "soft_arm-2020"
    folder.mkdir()
    with ThreadPoolExecutor(1) as pool:
        pool.submit(make_surrounded_run, folder, 10.0).result()
    server = Process(command("dashboard", "nobody", "--port", "0", "--replay", str(folder)))
    try:
        with browsing(browser, server.next_line()[1].split()[1]) as seen:
            opened(seen)
            said = seen.page.locator("#surroundings")
            rooms = [
                ("1", {"mesh": "room.stl", "bytes": 134, "regions": 0}, "room.stl"),
                ("6", {"mesh": "other.stl", "bytes": 184, "regions": 1}, "other.stl, 1 region"),
                ("9", {"mesh": "lost.stl", "bytes": 0, "regions": 0}, "lost.stl, the file"),
            ]
            for moment, room, words in [*rooms, *reversed(rooms)]:
                seen.page.locator("#moment").fill(moment)
                until(partial(shows, seen, room), said.inner_text)
                assert said.inner_text().startswith(words)
            assert seen.errors == []
    finally:
        server.leave()


def test_a_recording_that_is_none_is_explained(browser: "Browser", tmp_path: Path) -> None:
    (tmp_path / "kept.mcap").write_bytes(b"nothing of the kind")
    run = str(tmp_path / "kept.mcap")
    server = Process(command("dashboard", "nobody", "--port", "0", "--replay", run))
    try:
        with browsing(browser, server.next_line()[1].split()[1]) as seen:
            headline = seen.page.locator("#headline")
            until(lambda: "cannot be replayed" in headline.inner_text(), "it says so")
            assert "kept.mcap" in headline.inner_text()
    finally:
        server.leave()
