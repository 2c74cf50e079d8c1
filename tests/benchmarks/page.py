"""The operator's page: how old what it shows is, how soon it stops, and what it costs the daemon.

In a real Chromium; where there is none, what needs one is left out and says so. The pages draw with
the processor that the robot's own processes run on, which a rig would not let them do.
"""

import shutil
import tempfile
import time
from bisect import bisect_left
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from math import ceil
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Any, Final

from tests.benchmarks.daemon import (
    STARTS_WITHIN_S,
    emulated_robot,
    loop_times,
    quick_stops_ns,
    spinning_in_a_hurry,
    until_running,
)
from tests.benchmarks.timing import Figures, percentiles, pieces
from tests.daemon.recording.synthetic_run import make_run
from tests.hil.daemon_rig import User
from tests.hil.processes import Process, command

if TYPE_CHECKING:
    from playwright.sync_api import Page

_CHROMIUM: Final = shutil.which("chromium") or shutil.which("chromium-browser")
_NONE: Final = {"left_out": "there is no Chromium: apt-get install chromium"}
_SIZE: Final = {"width": 1500, "height": 1180}
_PERIOD_S: Final = 0.01
_RUNS_FOR_S: Final = (0.2, 0.4)
_STOPS_WITHIN_NS: Final = 500_000_000
"""A later quick stop is another one's."""
_PRESSED: Final = """
addEventListener("keydown", (event) => {
  window.pressed = performance.timeOrigin + event.timeStamp;
}, true);
const seen = () => {
  const probe = window.probe && window.probe();
  const live = document.body && !document.body.classList.contains("stale");
  if (live && probe && probe.status && probe.drawn) window.usable = performance.now();
  else setTimeout(seen, 5);
};
seen();
"""


def measure(tiny: bool = False) -> Figures:
    """All figures of the page."""
    measured_s, stops, recorded_s = (1.0, 1, 10.0) if tiny else (20.0, 200, 400.0)
    counts = (0, 1) if tiny else (0, 1, 5)
    named = {f"pages_{count}": partial(beside_pages, count, measured_s) for count in counts}
    floor = {"floor": partial(spinning_in_a_hurry, measured_s / 4)}
    stop = {"stop": partial(stops_by_page, stops), "replay": partial(replayed, recorded_s)}
    return pieces(floor | named | stop)


def beside_pages(count: int, measured_s: float) -> Figures:
    """The daemon's time keeping beside so many pages, and how old what one of them shows is."""
    if count and _CHROMIUM is None:
        return dict(_NONE)
    with _bench() as (user, server, address), _pages(address, count) as opened:
        user.do(until_running(user.client))
        usable_ms = [_usable_ms(page) for page in opened]
        time.sleep(min(2.0, measured_s))
        for page in opened:
            page.evaluate("window.drawnTimes()")
        time.sleep(measured_s)
        drawn_ms = opened[0].evaluate("window.drawnTimes()") if opened else []
        figures = loop_times(user.do(user.client.status()).loop)
        figures["server_rss_mb"] = round(_rss_mb(server.process.pid), 1)
    if usable_ms:
        figures["usable_after_ms"] = percentiles(usable_ms)
    if drawn_ms:
        figures["measured_to_drawn_ms"] = percentiles(drawn_ms)
        figures["drawn_per_s"] = round(len(drawn_ms) / measured_s, 1)
    return figures


def stops_by_page(stops: int) -> Figures:
    """From the key to the quick stop on the bus; and a client's own, in every fourth turn."""
    if _CHROMIUM is None:
        return dict(_NONE)
    by_chance, asked = Random(0), []
    with _bench() as (user, _, address), _pages(address, 1) as (page,):
        _usable_ms(page)
        runs = set()
        for turn in range(4 * ceil(stops / 3)):
            runs.add(Path(user.do(until_running(user.client))))
            time.sleep(by_chance.uniform(*_RUNS_FOR_S))  # no picture is drawn in step with it
            by_page = turn % 4 < 3
            asked_ns = time.monotonic_ns()
            if by_page:
                page.keyboard.press("Escape")
                offset_ns = time.time_ns() - time.monotonic_ns()
                asked_ns = round(float(page.evaluate("window.pressed")) * 1e6) - offset_ns
            else:
                user.do(user.client.stop())
            asked.append((by_page, asked_ns))
        time.sleep(1.0)  # what is recorded is written within half a second
        stopped_ns = sorted(t_ns for run in runs for t_ns in quick_stops_ns(run))
    return {
        "by_page_ms": percentiles(_took_ms([ns for by_page, ns in asked if by_page], stopped_ns)),
        "by_client_ms": percentiles(_took_ms([ns for page, ns in asked if not page], stopped_ns)),
    }


def _took_ms(asked_ns: list[int], stopped_ns: list[int]) -> list[float]:
    """Of each STOP that something stopped for: a stall may have switched the drives off before."""
    took = []
    for ns in asked_ns:
        place = bisect_left(stopped_ns, ns)
        if place < len(stopped_ns) and stopped_ns[place] - ns < _STOPS_WITHIN_NS:
            took.append((stopped_ns[place] - ns) * 1e-6)
    return took


def replayed(recorded_s: float) -> Figures:
    """How soon a recording is open, and how many moments of it are shown while it is dragged."""
    if _CHROMIUM is None:
        return dict(_NONE)
    with tempfile.TemporaryDirectory() as name:
        size = make_run(Path(name), cycles=3, cycle_s=recorded_s / 3).stat().st_size
        run = ["dashboard", "nobody", "--port", "0", "--replay", name]
        with _served(run) as (_, address), _pages(address, 1) as (page,):
            _until(page, "window.probe && window.probe().replay")
            opened_ms = page.evaluate("window.probe().replay.opened_ms")
            per_s = _dragged(page, min(5.0, recorded_s / 10))
    return {
        "recorded_s": recorded_s,
        "recording_mb": round(size * 1e-6, 1),
        "opened_ms": round(opened_ms, 1),
        "shown_per_s_while_dragged": round(per_s, 1),
    }


def _dragged(page: "Page", for_s: float) -> float:
    box = page.locator("#moment").bounding_box()
    assert box is not None
    y, width = box["y"] + box["height"] / 2, box["width"] - 40
    page.mouse.move(box["x"] + 20, y)
    page.mouse.down()
    shown, began_s, step = page.evaluate("window.probe().replay.shown"), time.monotonic(), 0
    while time.monotonic() - began_s < for_s:
        step += 1
        page.mouse.move(box["x"] + 20 + (step * 3) % width, y)
    more = page.evaluate("window.probe().replay.shown") - shown
    page.mouse.up()
    return float(more) / (time.monotonic() - began_s)


@contextmanager
def _bench() -> Iterator[tuple[User, Process, str]]:
    """Lab and daemon of a soft arm, the page's server, and a client that commands."""
    with emulated_robot(_PERIOD_S, True) as (directory, _):
        where = ["dashboard", "soft_arm", "--runtime-dir", str(directory), "--port", "0"]
        with _served(where) as (server, address):
            user = User(directory)
            try:
                yield user, server, address
            finally:
                user.close()


@contextmanager
def _served(words: list[str]) -> Iterator[tuple[Process, str]]:
    server = Process(command(*words))
    try:
        yield server, server.next_line()[1].split()[1]
    finally:
        server.leave()


@contextmanager
def _pages(address: str, count: int) -> Iterator[list["Page"]]:
    """In one browser, each as large as on a desk."""
    if not count:
        yield []
        return
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=_CHROMIUM, args=["--no-sandbox"])
        context = browser.new_context(viewport=_SIZE)  # type: ignore[arg-type]
        context.add_init_script(_PRESSED)
        opened = [context.new_page() for _ in range(count)]
        for page in opened:
            page.goto(address)
        yield opened
        browser.close()


def _until(page: "Page", true: str) -> Any:
    ends_s = time.monotonic() + STARTS_WITHIN_S
    while not (found := page.evaluate(true)):
        assert time.monotonic() < ends_s, f"never {true}"
        time.sleep(0.05)
    return found


def _usable_ms(page: "Page") -> float:
    """From the beginning of its loading to the first picture of live data."""
    return float(_until(page, "window.usable"))


def _rss_mb(pid: int) -> float:
    """Of a process and those that it has made."""
    threads = Path(f"/proc/{pid}/task").iterdir()
    children = [int(one) for task in threads for one in (task / "children").read_text().split()]
    return _own_rss_mb(pid) + sum(_rss_mb(child) for child in children)


def _own_rss_mb(pid: int) -> float:
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024
    raise ValueError("it has ended")
