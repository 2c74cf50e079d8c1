"""An operator's whole story in a real Chromium, on emulated hardware in processes of its own."""

import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

import pytest

from tests import SHIPPED_ROBOTS
from tests.hil.daemon_rig import Daemon, short_folder
from tests.hil.processes import Lab, Process, command
from tests.page.browsing import Browsing, browsing, clicked, until

if TYPE_CHECKING:
    from pathlib import Path

    from playwright.sync_api import Browser

_ROBOT: Final = SHIPPED_ROBOTS / "tendon_arm.yaml"
_WITHIN_S: Final = 150.0
"""For what a busy machine interrupts again and again. Each tendon is pulled before the tip is led:
20 s on an idle one."""

pytestmark = pytest.mark.page


class Bench:
    """Lab, daemon and the page's server."""

    def __init__(self, folder: "Path") -> None:
        self.folder = folder
        with before_the_browser():
            self.lab = Lab(folder, robot=_ROBOT)
        self.lab.next_line()
        self.start_daemon()
        where = ["--runtime-dir", str(folder), "--runs", str(folder / "runs")]
        self.server = Process(command("dashboard", "tendon_arm", *where, "--port", "0"))
        self.address = self.server.next_line()[1].split()[1]

    def start_daemon(self) -> None:
        with before_the_browser():
            self.daemon = Daemon(self.folder, _ROBOT)
        self.daemon.wait_until_it_speaks()

    def leave(self) -> None:
        for process in (self.server, self.daemon, self.lab):
            process.leave()


@contextmanager
def before_the_browser() -> Iterator[None]:
    """What is started in it gets the processor before a browser.

    As root a browser raises what draws by 8 steps of nice. Without a graphics card that takes so
    long that a daemon's control loop comes too late beside it. Who is not root has no such browser.
    """
    usual = os.getpriority(os.PRIO_PROCESS, 0)
    try:
        os.setpriority(os.PRIO_PROCESS, 0, -10)
    except PermissionError:
        yield
        return
    try:
        yield
    finally:
        os.setpriority(os.PRIO_PROCESS, 0, usual)


@contextmanager
def bench(browser: "Browser") -> Iterator[tuple[Bench, Browsing]]:
    with short_folder() as folder:
        made = Bench(folder)
        try:
            with browsing(browser, made.address) as seen:
                yield made, seen
        finally:
            made.leave()


def run_until(seen: Browsing, true: Any, what: str) -> None:
    """While it runs; helped on where a busy machine has held it or switched the drives off."""

    def there() -> object:
        return _helped_on(seen) and true()

    until(there, lambda: f"{what}\n{seen.told()}", _WITHIN_S)


def test_an_operator_finds_arms_runs_holds_leads_stops_and_replays(browser: "Browser") -> None:
    with bench(browser) as (made, b):
        b.until_state("ready")
        until(lambda: b.probe()["drawn"] > 3 and b.probe()["body"], "the body is drawn")
        until(lambda: not b.stale, "it is live")
        assert b.page.locator("#watermark").is_visible()
        assert b.probe()["events"] > 3, "the events from before the page was there"
        assert b.probe()["body"]["components"], "the mixture's ellipsoids"
        assert "%" in b.page.locator("#figures").inner_text()
        b.picture("standby")
        arm = b.page.locator('[data-verb="arm"]')
        assert not arm.is_enabled() and "Take control" in str(arm.get_attribute("title"))
        b.take_control()
        b.press("arm", 0.3)
        time.sleep(0.5)
        assert b.state() in ("ready", "standby"), "a short press arms nothing"
        b.arm()
        b.page.locator("#experiment").select_option("chest_circle")
        b.page.locator("#numbers summary").click()
        b.page.locator('#parameters [data-name="cycle_s"]').fill("24")
        b.page.locator("#load").click()
        until(
            lambda: "48 s" in b.page.locator("#answer").inner_text(), "its own numbers are loaded"
        )
        b.page.locator("#numbers summary").click()
        _start(b)
        first = b.probe()["tip"]["tip_mm"]
        run_until(b, lambda: _apart(first, b.probe()["tip"]["tip_mm"]) > 3.0, "the tip moves")
        run_until(b, lambda: b.probe()["tip"].get("cycle", -1) >= 0, "it is led round the circle")
        time.sleep(3.0)
        run_until(b, lambda: _taken_while_it_runs(b), "it runs while its picture is taken")
        _hold(made, b)
        time.sleep(0.3)
        b.picture("hold")
        _lead(b)
        assert made.lab.inject("drive.can0/2.emergency=0x8611").returncode == 0
        reasons = b.page.locator("#reasons")
        until(lambda: b.state() == "fault" and "can0/2" in reasons.inner_text(), "a drive's fault")
        time.sleep(0.3)
        b.picture("fault")
        _arm_again(b)
        b.page.keyboard.press("Escape")
        says = b.page.locator("#stopsays")
        until(lambda: says.get_attribute("data-outcome") == "confirmed", "STOP is confirmed")
        assert "ms" in says.inner_text()
        b.until_state("ready", "standby")
        b.page.set_viewport_size({"width": 400, "height": 860})
        assert b.page.locator("#stop").is_visible()
        width = b.page.evaluate("document.documentElement.scrollWidth")
        assert width <= 400, f"the page is {width} wide on a phone"
        time.sleep(0.5)
        b.picture("phone")
        assert b.errors == []
        _replay(made, b)


def _taken_while_it_runs(b: Browsing) -> bool:
    b.picture("running")
    return b.state() == "running"


def _start(b: Browsing) -> None:
    until(lambda: _helped_on(b), lambda: f"it runs\n{b.told()}", _WITHIN_S)


def _helped_on(b: Browsing) -> bool:
    """One step towards RUNNING, as an operator would do it. Returns whether it runs."""
    state = b.state()
    if state in ("ready", "standby"):
        b.arm()
    for verb in {"armed": ["start"], "hold": ["resume"], "fault": ["clear"]}.get(state, []):
        if clicked(b.page.locator(f'[data-verb="{verb}"]')):
            time.sleep(0.3)
    return b.state() == "running"


def _hold(made: Bench, b: Browsing) -> None:
    """The tracker sees nothing for a while: held, and it says what helps."""
    remedy, ends_s = b.page.locator("#remedy"), 0.0

    def held() -> object:
        nonlocal ends_s
        if b.state() == "running" and time.monotonic() > ends_s:
            ends_s = time.monotonic() + 6.0
            assert made.lab.inject("tracker.missing=4s").returncode == 0
        elif b.state() not in ("running", "hold"):
            _start(b)
        return b.state() == "hold" and remedy.inner_text()

    until(held, lambda: f"it holds and says what helps\n{b.told()}", _WITHIN_S)


def _arm_again(b: Browsing) -> None:
    """After a fault: cleared, as often as it takes, and armed."""

    def ready() -> bool:
        clear = b.page.locator('[data-verb="clear"]')
        if b.state() in ("fault", "standby") and clicked(clear):
            time.sleep(0.5)
        return b.state() == "ready"

    until(ready, lambda: f"it is ready again\n{b.told()}", _WITHIN_S)
    b.arm()


def _lead(b: Browsing) -> None:
    """Teleoperated from where it is held: the tip follows the pointer, and holds after it."""
    before: list[float] | None = None

    def followed() -> bool:
        nonlocal before
        if not b.probe()["held"]:  # a busy machine has shown too old a picture, or has held
            b.page.mouse.up()
            _begin_by_hand(b)
            place = b.try_to_grab()
            if place is None:
                return False
            before = b.probe()["tip"]["tip_mm"]
            b.page.mouse.move(place[0] - 30, place[1], steps=3)
        tip = b.probe()["tip"]["tip_mm"]
        return bool(before and tip and _apart(before, tip) > 2.0)

    until(followed, lambda: f"the tip follows the hand\n{b.told()}", _WITHIN_S)
    b.page.mouse.up()
    b.until_state("hold", "armed")


def _begin_by_hand(b: Browsing) -> None:
    """Begun where it is held; armed before where a busy machine has switched the drives off."""

    def begun() -> object:
        if b.state() in ("ready", "standby"):
            b.arm()
        begin = b.page.locator('[data-verb="teleoperate"]')
        leadable = b.page.locator("body.leadable")
        if not leadable.count() and clicked(begin):
            time.sleep(0.3)
        return leadable.count()

    until(begun, lambda: f"the tip may be led\n{b.told()}", _WITHIN_S)


def _replay(made: Bench, b: Browsing) -> None:
    """What was just recorded, on a page of its own, with everything in it; and its report."""
    runs = (made.folder / "runs").iterdir()
    name = max(runs, key=lambda run: (run / "run.mcap").stat().st_size).name
    b.page.set_viewport_size({"width": 1500, "height": 1180})
    b.page.goto(f"{b.base}?replay={name}")
    headline = b.page.locator("#headline")
    until(lambda: b.probe().get("replay"), lambda: f"it is open: {headline.inner_text()}")
    b.page.locator("#worst").click()
    until(lambda: b.probe()["replay"]["t"] > 0.0 and b.probe()["body"])
    assert b.probe()["status"]["state"] == "running" and b.probe()["body"]["components"]
    assert b.page.locator("#cyclespanel").is_visible()
    b.page.locator("#play").click()
    shown = b.probe()["replay"]["shown"]
    until(lambda: b.probe()["replay"]["shown"] > shown + 10, "it plays")
    b.page.locator("#play").click()
    b.picture("replay")
    b.page.get_by_role("button", name="Make the report").click()
    link = b.page.get_by_role("link", name="Report of")
    until(lambda: link.count() == 1, "the report is there")
    with b.page.context.expect_page() as opened:
        link.click()
    report = opened.value
    report.wait_for_load_state()
    assert report.locator("h1").count() == 1
    assert (
        report.evaluate("getComputedStyle(document.querySelector('section')).borderRadius")
        == "10px"
    )


def test_a_page_whose_server_hangs_greys_out_and_the_robot_holds(browser: "Browser") -> None:
    with bench(browser) as (made, b):
        b.until_state("ready")
        b.arm()
        b.page.locator("#experiment").select_option("chest_circle")
        b.page.locator("#load").click()
        _start(b)
        made.server.process.send_signal(signal.SIGSTOP)
        try:
            until(lambda: b.stale, "it greys out", 2.0)
            assert b.page.locator("#stop").is_enabled()
            assert not b.page.locator('[data-verb="hold"]').is_enabled()
            time.sleep(6.0)
        finally:
            made.server.process.send_signal(signal.SIGCONT)
        until(lambda: not b.stale, "it is live again")
        b.until_state("hold", "armed", "ready", "standby")
        assert not b.probe()["inControl"], "nothing resumes by itself"


def _apart(one: list[float], other: list[float]) -> float:
    return float(sum((a - b) ** 2 for a, b in zip(one, other, strict=True)) ** 0.5)
