"""One page in a real browser, asked for what it knows and pressed as an operator would."""

import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from playwright.sync_api import Browser, ConsoleMessage, Locator, Page, ViewportSize

CHROMIUM: Final = shutil.which("chromium") or shutil.which("chromium-browser")
PICTURES: Final = Path(__file__).parents[2] / "docs" / "pictures"
"""What the pictures in the documentation are made by, so that they are never old."""
PATIENCE_S: Final = 60.0
_TAKES_HOLD_WITHIN_S: Final = 0.5
_PRESSED_WITHIN_S: Final = 2.0
DESKTOP: Final["ViewportSize"] = {"width": 1500, "height": 1180}
_WHOLE: Final["ViewportSize"] = {"width": 1500, "height": 1420}


def until(
    true: Callable[[], object],
    what: str | Callable[[], object] = "it",
    within_s: float = PATIENCE_S,
) -> None:
    """The page's rules forbid what playwright would evaluate to wait: so look again and again.

    what: is waited for; asked only when it has not come.
    """
    ends_s = time.monotonic() + within_s
    while not true():
        if time.monotonic() > ends_s:
            raise AssertionError(what() if callable(what) else what)
        time.sleep(0.03)


def clicked(button: "Locator") -> bool:
    """Press it if it can be pressed now. Returns whether it was.

    What can be pressed changes with the robot's state: between a look and a press as well, and then
    the browser would wait for it far longer than the state lasts.
    """
    from playwright.sync_api import TimeoutError as StillWaiting

    if not button.is_enabled():
        return False
    try:
        button.click(timeout=1000.0 * _PRESSED_WITHIN_S)
    except StillWaiting:
        return False
    return True


class Browsing:
    """A page, what it has complained of, and what it has asked of others."""

    def __init__(self, page: "Page", address: str) -> None:
        self.page = page
        self.base = address.partition("?")[0]
        self.foreign: list[str] = []
        """Requests to anybody but the page's own server."""
        self.errors: list[str] = []
        page.context.route("**/*", self._only_ours)
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("console", self._heard)
        page.goto(address)

    def _only_ours(self, route: Any) -> None:
        if route.request.url.startswith((self.base, "data:", "blob:")):
            route.continue_()
        else:
            self.foreign.append(route.request.url)
            route.abort()

    def _heard(self, said: "ConsoleMessage") -> None:
        if said.type == "error":
            self.errors.append(said.text)

    def probe(self) -> dict[str, Any]:
        """What the page knows."""
        found: dict[str, Any] = self.page.evaluate("window.probe ? window.probe() : {}")
        return found

    def state(self) -> str:
        return str((self.probe().get("status") or {}).get("state"))

    @property
    def stale(self) -> bool:
        return self.page.locator("body.stale").count() == 1

    def until_state(self, *states: str) -> None:
        until(lambda: self.state() in states, lambda: f"{states}, and {self.told()}")

    def told(self) -> str:
        """What an operator reads of the robot's state, for whoever wonders why a test failed."""
        shown = ("state", "connection", "holder", "headline", "remedy", "answer", "reasons", "hand")
        texts = {name: self.page.locator(f"#{name}").inner_text() for name in shown}
        texts["events"] = self.page.locator("#events").inner_text()[:1500]
        return "\n".join(f"{name}: {text}" for name, text in texts.items())

    def until_live(self) -> None:
        until(lambda: not self.stale and self.probe().get("status"), "the page is live")

    def take_control(self) -> None:
        """Once more where the last page was still about to give it back."""
        control, tried_s = self.page.locator("#control"), 0.0

        def taken() -> bool:
            nonlocal tried_s
            if self.probe()["inControl"]:
                return True
            if control.is_enabled() and time.monotonic() > tried_s + 2.0:
                tried_s = time.monotonic()
                clicked(control)
            return False

        until(taken, lambda: f"the page is in control\n{self.told()}")

    def press(self, verb: str, hold_s: float = 0.0) -> None:
        """Press a command's button, for so long."""
        button = self.page.locator(f'[data-verb="{verb}"]')

        def pressed() -> bool:
            if hold_s and button.is_enabled():
                self.hold_down(verb, hold_s)
                return True
            return not hold_s and clicked(button)

        until(pressed, lambda: f"{verb}: {button.get_attribute('title')}\n{self.told()}")

    def hold_down(self, verb: str, hold_s: float) -> None:
        """A command's button, whatever comes of it."""
        button = self.page.locator(f'[data-verb="{verb}"]')
        button.scroll_into_view_if_needed()
        box = button.bounding_box()
        assert box is not None
        self.page.mouse.move(box["x"] + 20, box["y"] + 15)
        self.page.mouse.down()
        time.sleep(hold_s)
        self.page.mouse.up()

    def arm(self) -> None:
        """Take control and press long enough; once more where a busy machine was not ready yet."""

        def armed() -> bool:
            if self.state() in ("ready", "standby"):
                if not self.probe()["inControl"]:
                    self.take_control()
                if self.page.locator('[data-verb="arm"]').is_enabled():
                    self.hold_down("arm", 1.2)
            return self.state() == "armed"

        until(armed, lambda: f"it is armed\n{self.told()}")

    def begin_teleoperation(self) -> None:
        """From ARMED: until the tip may be taken hold of."""
        self.press("teleoperate")
        until(lambda: self.page.locator("body.leadable").count(), "the tip may be led")

    def hang_the_drawing(self, for_s: float) -> None:
        """What draws beside the page does nothing else for so long."""
        (drawing,) = [one for one in self.page.workers if "drawing" in one.url]
        hang = f"const end = Date.now() + {1000 * for_s}; while (Date.now() < end);"
        drawing.evaluate(f"setTimeout(() => {{ {hang} }}, 0); 0")

    def tip_in_window(self) -> tuple[float, float]:
        """Where in the window the tip is drawn."""
        scene = self.page.locator("#scene")
        scene.scroll_into_view_if_needed()
        box = scene.bounding_box()
        assert box is not None
        x, y = self.probe()["tipOnScreen"]
        return box["x"] + x, box["y"] + y

    def grab(self) -> tuple[float, float]:
        """Take hold of the tip with the pointer. Returns where that is."""
        place: tuple[float, float] | None = None

        def held() -> bool:
            nonlocal place
            place = self.try_to_grab()
            return place is not None

        until(held, lambda: f"the tip is held\n{self.told()}")
        assert place is not None
        return place

    def try_to_grab(self) -> tuple[float, float] | None:
        """None: a busy machine has shown too old a picture, or has not seen the tip."""
        if self.probe()["tipOnScreen"] is None:
            return None
        x, y = self.tip_in_window()
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        ends_s = time.monotonic() + _TAKES_HOLD_WITHIN_S
        while time.monotonic() < ends_s:
            if self.probe()["held"] == "pointer":
                return x, y
            time.sleep(0.03)
        self.page.mouse.up()
        return None

    def hold_until(
        self, take_hold: Callable[[], object], true: Callable[[], object], what: str
    ) -> None:
        """Take hold of the tip until something has come of it; once more where a busy machine has
        shown too old a picture and let go."""

        def come() -> object:
            if not self.probe()["held"]:
                take_hold()
            return true()

        until(come, lambda: f"{what}\n{self.told()}")

    def drag_until(self, true: Callable[[], object], what: str, across_px: float) -> None:
        """Drag the tip so far to the right, until something has come of it."""

        def take_hold() -> None:
            self.page.mouse.up()
            x, y = self.grab()
            self.page.mouse.move(x + across_px, y, steps=4)

        self.hold_until(take_hold, true, what)

    def push_until(self, key: str, true: Callable[[], object], what: str) -> None:
        """Hold a key down until something has come of it."""

        def take_hold() -> None:
            self.page.keyboard.up(key)
            self.page.keyboard.down(key)

        self.hold_until(take_hold, true, what)

    def picture(self, name: str) -> None:
        """For the documentation: on a desk as high as it takes to see everything."""
        PICTURES.mkdir(parents=True, exist_ok=True)
        before = self.page.viewport_size
        assert before is not None
        if before == DESKTOP:
            self.page.set_viewport_size(_WHOLE)
        self.page.evaluate("scrollTo(0, 0); window.beFine(true)")
        time.sleep(0.4)
        self.page.screenshot(path=str(PICTURES / f"{name}.png"))
        self.page.evaluate("window.beFine(false)")
        self.page.set_viewport_size(before)


@contextmanager
def browsing(browser: "Browser", address: str, **options: Any) -> Iterator[Browsing]:
    """options: of the browser's context. Nothing may be asked of others."""
    context = browser.new_context(**{"viewport": DESKTOP, **options})
    try:
        one = Browsing(context.new_page(), address)
        yield one
        assert one.foreign == [], "the page works with no internet"
    finally:
        context.close()
