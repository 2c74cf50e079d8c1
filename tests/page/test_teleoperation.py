"""Leading the tip by hand in a real browser: whatever takes the hand away ends it, at once."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import pytest

from tests.page.browsing import Browsing, browsing, until
from tests.page.stage import Stage, stage

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.page

_IN_FLIGHT_S = 0.3
"""No set-point may come later than this after the hand was taken away."""
_PAD = """
window.pads = [null];
navigator.getGamepads = () => { window.looked = true; return window.pads; };
window.pad = (pressed, axes) => {
  window.looked = false;
  const buttons = Array.from({ length: 17 }, (_, n) => ({ pressed: n === 5 && pressed }));
  window.pads = [{ index: 0, connected: true, buttons, axes }];
};
"""


@contextmanager
def leading(browser: "Browser", on: Stage, pads: bool = False) -> Iterator[Browsing]:
    with browsing(browser, on.address) as seen:
        if pads:
            seen.page.add_init_script(_PAD)
            seen.page.reload()
        seen.until_live()
        seen.arm()
        seen.begin_teleoperation()
        yield seen


def comes_no_more(on: Stage, since_s: float) -> None:
    time.sleep(0.8)
    late = [at_s - since_s for at_s in on.robot.came_s if at_s > since_s + _IN_FLIGHT_S]
    assert not late, f"set-points came {late} s after the hand was gone"
    until(lambda: on.robot.state == "hold", "the robot holds")


def moving(on: Stage, seen: Browsing) -> None:
    """The pointer holds the tip, and set-points come."""
    count = len(on.robot.came_s)
    seen.drag_until(lambda: len(on.robot.came_s) > count + 5, "set-points come", 60.0)


def pad(seen: Browsing, pressed: bool) -> None:
    """The stick is pushed to the right, and the page has seen it."""
    seen.page.evaluate(f"window.pad({str(pressed).lower()}, [1, 0, 0, 0])")
    until(lambda: seen.page.evaluate("window.looked"), "the page looks at its gamepads")


def test_the_tip_is_dragged_in_a_plane_and_holds_when_it_is_let_go(
    browser: "Browser", on: Stage
) -> None:
    with leading(browser, on) as seen:
        before = on.robot.tip.copy()
        moving(on, seen)
        until(lambda: on.robot.tip[0] - before[0] > 3.0, "the tip follows to the right")
        assert abs(on.robot.tip[1] - before[1]) < 0.01, "it is led in the plane of x and z"
        assert on.robot.state == "running"
        seen.page.mouse.up()
        comes_no_more(on, time.monotonic())
        assert on.robot.verbs()[-1] == "hold", "it does not wait for the set-points to grow old"
        moving(on, seen)
        until(lambda: on.robot.state == "running", "taking hold again goes on")


def test_a_robot_that_holds_by_itself_is_taken_hold_of_anew(browser: "Browser", on: Stage) -> None:
    with leading(browser, on) as seen:
        moving(on, seen)
        until(lambda: on.robot.state == "running", "it is led")
        until(lambda: seen.state() == "running", "and the page knows")
        time.sleep(0.8)
        on.robot.state = "hold"
        until(
            lambda: seen.probe()["held"] == "", "the page does not lead what does not follow", 3.0
        )
        assert "the robot holds" in seen.page.locator("#hand").inner_text()
        seen.page.mouse.up()
        moving(on, seen)
        until(lambda: on.robot.state == "running", "taking hold again goes on")


def test_between_two_grips_it_may_stand_armed_but_not_be_switched_off(
    browser: "Browser", on: Stage
) -> None:
    with leading(browser, on) as seen:
        on.robot.settles = True
        until(lambda: on.robot.state == "armed", "nobody has led it")
        for _ in range(2):
            moving(on, seen)
            until(lambda: on.robot.state == "running", "taking hold goes on")
            seen.page.mouse.up()
            until(lambda: on.robot.state == "armed", "it was let go")
        seen.press("disarm")
        seen.until_state("ready")
        seen.arm()
        time.sleep(0.3)
        assert not seen.page.locator("body.leadable").count(), "switched on again: begun again"


def test_whatever_takes_the_page_away_lets_go(browser: "Browser", on: Stage) -> None:
    hidden = (
        "Object.defineProperty(document, 'hidden', {value: true, configurable: true});"
        "document.dispatchEvent(new Event('visibilitychange'));"
        "Object.defineProperty(document, 'hidden', {value: false, configurable: true});"
    )
    lost = "document.querySelector('#scene').dispatchEvent(new PointerEvent('%s', {pointerId: 1}))"
    with leading(browser, on) as seen:
        for event in (
            "window.dispatchEvent(new Event('blur'))",
            hidden,
            "window.dispatchEvent(new Event('pagehide'))",
            lost % "lostpointercapture",
            lost % "pointercancel",
        ):
            moving(on, seen)
            gone_s = time.monotonic()
            seen.page.evaluate(event)
            assert seen.probe()["held"] == "", event
            seen.page.mouse.move(700, 500, steps=3)
            comes_no_more(on, gone_s)
            seen.page.mouse.up()


def test_a_picture_that_is_not_drawn_any_more_is_led_by_nobody(
    browser: "Browser", on: Stage
) -> None:
    with leading(browser, on) as seen:
        moving(on, seen)
        seen.hang_the_drawing(8.0)
        until(lambda: seen.probe()["held"] == "", "frames come, and none of them is seen", 5.0)
        assert "too old" in seen.page.locator("#hand").inner_text()


def test_keys_lead_only_while_they_are_held_and_the_picture_has_them(
    browser: "Browser", on: Stage
) -> None:
    with leading(browser, on) as seen:
        keys = seen.page.keyboard
        seen.page.locator("#scene").focus()
        before = on.robot.tip.copy()
        seen.push_until("ArrowUp", lambda: on.robot.tip[2] - before[2] > 1.0, "up along z")
        keys.up("ArrowUp")
        comes_no_more(on, time.monotonic())
        seen.push_until("ArrowRight", lambda: seen.probe()["held"] == "keys", "held once more")
        gone_s = time.monotonic()
        seen.page.locator("#filter").focus()  # the key's release will never be heard there
        comes_no_more(on, gone_s)
        keys.up("ArrowRight")
        count = len(on.robot.came_s)
        keys.press("ArrowRight")
        seen.page.locator("#load").focus()
        keys.down("ArrowRight")
        time.sleep(0.3)
        keys.up("ArrowRight")
        assert len(on.robot.came_s) == count, "no key leads where something else has the focus"


def test_a_gamepad_leads_while_its_shoulder_is_held_and_not_when_it_is_unplugged(
    browser: "Browser",
    on: Stage,
) -> None:
    with leading(browser, on, pads=True) as seen:
        before = on.robot.tip.copy()
        pad(seen, pressed=False)
        time.sleep(0.3)
        assert not on.robot.came_s, "a stick alone leads nothing"

        def grip() -> None:
            pad(seen, pressed=False)
            pad(seen, pressed=True)

        seen.hold_until(grip, lambda: on.robot.tip[0] - before[0] > 1.0, "it follows the stick")
        gone_s = time.monotonic()
        seen.page.evaluate("window.pads = [null]")
        comes_no_more(on, gone_s)
        pad(seen, pressed=True)
        comes_no_more(on, time.monotonic())
        assert seen.probe()["held"] == "", "held while it comes back: not taken for a grip"


def test_a_tab_that_is_closed_while_it_drags_leads_no_more(browser: "Browser", on: Stage) -> None:
    with leading(browser, on) as seen:
        moving(on, seen)
        gone_s = time.monotonic()
        seen.page.close(run_before_unload=False)
        comes_no_more(on, gone_s)
        until(
            lambda: on.robot.lease.holder(on.robot.clock.now_ns()) is None, "control is given back"
        )


def test_a_page_that_hangs_is_an_operator_who_has_gone(browser: "Browser") -> None:
    with stage(lease_s=1.0) as on, browsing(browser, on.address) as seen:
        seen.until_live()
        seen.arm()
        seen.begin_teleoperation()
        moving(on, seen)
        gone_s = time.monotonic()
        seen.page.evaluate(
            "setTimeout(() => { const end = Date.now() + 4000; while (Date.now() < end); }, 0)"
        )
        time.sleep(2.5)
        assert on.robot.lease.holder(on.robot.clock.now_ns()) is None, "nobody renews for it"
        assert on.robot.state == "hold"
        late = [at_s - gone_s for at_s in on.robot.came_s if at_s > gone_s + _IN_FLIGHT_S]
        assert not late, late
        time.sleep(3.0)
        assert not seen.probe()["inControl"] and seen.probe()["held"] == "", (
            "nothing goes on by itself"
        )
