"""An operator's whole story in a real Chromium, on emulated hardware in processes of its own."""

import shutil
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import pytest

from tests import SHIPPED_ROBOTS
from tests.hil.daemon_rig import Daemon, short_folder
from tests.hil.processes import Lab, Process, command

if TYPE_CHECKING:
    from playwright.sync_api import BrowserContext, ConsoleMessage, Page

_CHROMIUM: Final = shutil.which("chromium") or shutil.which("chromium-browser")
_PICTURES: Final = Path(__file__).parents[2] / "docs" / "pictures"
"""What the pictures in the documentation are made by, so that they are never old."""
_ROBOT: Final = SHIPPED_ROBOTS / "tendon_arm.yaml"
_PATIENCE_S: Final = 60.0

pytestmark = [
    pytest.mark.page,
    pytest.mark.skipif(_CHROMIUM is None, reason="there is no Chromium: apt-get install chromium"),
]


def until(true: Callable[[], object], what: str, within_s: float = _PATIENCE_S) -> None:
    """The page's rules forbid what playwright would evaluate to wait: so look again and again."""
    ends_s = time.monotonic() + within_s
    while not true():
        assert time.monotonic() < ends_s, what
        time.sleep(0.05)


class Bench:
    """Lab, daemon, the page's server and a browser before it."""

    def __init__(self, folder: Path, context: "BrowserContext") -> None:
        self.foreign: list[str] = []
        self.folder = folder
        self.lab = Lab(folder, robot=_ROBOT)
        self.lab.next_line()
        self.daemon = Daemon(folder, _ROBOT)
        self.daemon.wait_until_it_speaks()
        self.server = Process(
            command("dashboard", "tendon_arm", "--runtime-dir", str(folder), "--port", "0")
        )
        self.address = self.server.next_line()[1].split()[1]
        self.base = self.address.partition("?")[0]
        context.route("**/*", self._only_ours)
        self.page = self.opened(context)

    def _only_ours(self, route: Any) -> None:
        if route.request.url.startswith((self.base, "data:", "blob:")):
            route.continue_()
        else:
            self.foreign.append(route.request.url)
            route.abort()

    def opened(self, context: "BrowserContext") -> "Page":
        page = context.new_page()
        self.errors: list[str] = []
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", self._heard)
        page.goto(self.address)
        return page

    def _heard(self, said: "ConsoleMessage") -> None:
        if said.type == "error":
            self.errors.append(said.text)

    def probe(self) -> dict[str, Any]:
        found: dict[str, Any] = self.page.evaluate("window.probe ? window.probe() : {}")
        return found

    def state(self) -> str:
        return str((self.probe().get("status") or {}).get("state"))

    def until_state(self, *states: str) -> None:
        until(lambda: self.state() in states, f"{states}, and it is {self.state()}")

    def press(self, verb: str, hold_s: float = 0.0) -> None:
        button = self.page.locator(f'[data-verb="{verb}"]')
        until(button.is_enabled, f"{verb}: {button.get_attribute('title')}")
        if not hold_s:
            button.click()
            return
        box = button.bounding_box()
        assert box is not None
        self.page.mouse.move(box["x"] + 20, box["y"] + 15)
        self.page.mouse.down()
        time.sleep(hold_s)
        self.page.mouse.up()

    def picture(self, name: str) -> None:
        _PICTURES.mkdir(parents=True, exist_ok=True)
        self.page.screenshot(path=str(_PICTURES / f"{name}.png"))

    def leave(self) -> None:
        for process in (self.server, self.daemon, self.lab):
            process.leave()


@contextmanager
def bench() -> Iterator[Bench]:
    api = pytest.importorskip("playwright.sync_api")
    with short_folder() as folder, api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=_CHROMIUM, args=["--no-sandbox"])
        made = None
        try:
            context = browser.new_context(viewport={"width": 1500, "height": 1180})
            made = Bench(folder, context)
            yield made
        finally:
            if made is not None:
                made.leave()
            browser.close()


def test_an_operator_finds_arms_runs_holds_and_stops_a_robot() -> None:
    with bench() as b:
        b.until_state("ready")
        until(lambda: b.probe()["drawn"] > 3 and b.probe()["body"], "the body is drawn")
        assert b.page.locator("body.stale").count() == 0
        assert b.page.locator("#watermark").is_visible()
        assert b.probe()["events"] > 3, "the events from before the page was there"
        assert b.probe()["body"]["components"], "the mixture's ellipsoids"
        b.picture("standby")
        arm = b.page.locator('[data-verb="arm"]')
        assert not arm.is_enabled() and "Take control" in str(arm.get_attribute("title"))
        b.page.locator("#control").click()
        until(lambda: b.probe()["inControl"], "the page is in control")
        b.press("arm", 0.3)
        time.sleep(0.5)
        assert b.state() == "ready", "a short press arms nothing"
        b.press("arm", 1.2)
        b.until_state("armed")
        b.page.locator("#experiment").select_option("chest_circle")
        b.page.locator("#load").click()
        b.press("start")
        b.until_state("running")
        first = b.probe()["tip"]["tip_mm"]
        until(lambda: _apart(first, b.probe()["tip"]["tip_mm"]) > 3.0, "the tip moves")
        time.sleep(4.0)
        b.picture("running")
        b.press("hold")
        b.until_state("hold")
        b.picture("hold")
        b.press("resume")
        b.until_state("running")
        b.page.keyboard.press("Escape")
        says = b.page.locator("#stopsays")
        until(lambda: says.get_attribute("data-outcome") == "confirmed", "STOP is confirmed")
        assert "ms" in says.inner_text()
        b.until_state("ready", "standby")
        b.picture("stopped")
        b.page.set_viewport_size({"width": 400, "height": 860})
        assert b.page.locator("#stop").is_visible()
        width = b.page.evaluate("document.documentElement.scrollWidth")
        assert width <= 400, f"the page is {width} wide on a phone"
        time.sleep(0.5)
        b.picture("phone")
        assert b.foreign == [] and b.errors == []


def test_a_page_whose_server_hangs_greys_out_and_the_robot_holds() -> None:
    with bench() as b:
        b.until_state("ready")
        b.page.locator("#control").click()
        until(lambda: b.probe()["inControl"], "the page is in control")
        b.press("arm", 1.2)
        b.until_state("armed")
        b.page.locator("#experiment").select_option("chest_circle")
        b.page.locator("#load").click()
        b.press("start")
        b.until_state("running")
        b.server.process.send_signal(signal.SIGSTOP)
        try:
            until(lambda: b.page.locator("body.stale").count() == 1, "it greys out", 2.0)
            assert b.page.locator("#stop").is_enabled()
            assert not b.page.locator('[data-verb="hold"]').is_enabled()
            time.sleep(6.0)
        finally:
            b.server.process.send_signal(signal.SIGCONT)
        until(lambda: b.page.locator("body.stale").count() == 0, "it is live again")
        b.until_state("hold", "armed", "ready", "standby")
        assert not b.probe()["inControl"], "nothing resumes by itself"


def _apart(one: list[float], other: list[float]) -> float:
    return float(sum((a - b) ** 2 for a, b in zip(one, other, strict=True)) ** 0.5)
