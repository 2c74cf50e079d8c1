"""What everybody needs to see, to reach and to hear: on a desk, on a phone, in the dark."""

import io
import re
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray
from PIL import Image

from daemon.messages import Reason
from tests.page.browsing import Browsing, browsing, until
from tests.page.stage import Stage

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Route

Array = NDArray[np.float64]

pytestmark = pytest.mark.page

_CONTRASTS: Final = (Path(__file__).parent / "contrast.js").read_text()
_HOLD: Final = Reason(
    name="setpoint_late",
    severity="hold",
    subject="operator",
    text="the set-points have stopped",
    remedy="take hold of the tip again",
)


def too_pale(seen: Browsing) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = seen.page.evaluate(_CONTRASTS)
    assert len(found) > 40
    return [one for one in found if one["ratio"] < one["wanted"]]


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_every_text_stands_out_from_its_ground(browser: "Browser", on: Stage, scheme: str) -> None:
    with browsing(browser, on.address, color_scheme=scheme) as seen:
        seen.until_live()
        assert too_pale(seen) == []
        seen.arm()
        on.robot.reasons = [_HOLD]
        for state in ("running", "hold", "fault"):
            on.robot.state = state
            seen.until_state(state)
            time.sleep(0.2)
            assert too_pale(seen) == [], state
        seen.page.keyboard.press("Escape")
        says = seen.page.locator("#stopsays")
        until(lambda: says.get_attribute("data-outcome") == "confirmed")
        assert too_pale(seen) == []


def test_everything_is_reached_by_the_tab_key_and_has_a_name(browser: "Browser", on: Stage) -> None:
    with browsing(browser, on.address) as seen:
        seen.until_live()
        seen.arm()
        wanted = set(
            seen.page.evaluate(
                "[...document.querySelectorAll('button, select, input, a, summary')]"
                ".filter(e => e.checkVisibility() && !e.disabled)"
                ".map((e, n) => { e.dataset.tabbed = n; return String(n); })"
            )
        )
        reached, nameless = set(), []
        for _ in range(2 * len(wanted) + 20):
            seen.page.keyboard.press("Tab")
            told = seen.page.evaluate(
                "(() => { const e = document.activeElement; return [e.dataset.tabbed || '',"
                " e.id, getComputedStyle(e).outlineStyle] })()"
            )
            if told[0]:
                reached.add(told[0])
                if told[2] == "none":
                    nameless.append(told[1])
        assert reached == wanted and not nameless, "what has the focus is drawn so"
        unnamed = seen.page.evaluate(
            "[...document.querySelectorAll('button, select, input, a, meter, progress, section')]"
            ".filter(e => e.checkVisibility() && !(e.ariaLabel || e.textContent.trim()"
            " || (e.labels && e.labels.length))).map(e => e.outerHTML.slice(0, 80))"
        )
        assert unnamed == [], "a screen reader has nothing to say of these"


def test_no_key_but_esc_acts_while_something_has_the_focus(browser: "Browser", on: Stage) -> None:
    with browsing(browser, on.address) as seen:
        seen.until_live()
        seen.arm()
        done = list(on.robot.verbs())
        for focused in ("#filter", "#robot", "#experiment", "#copy"):
            seen.page.locator(focused).focus()
            for key in ("a", "s", "ArrowUp", "Home", "Enter" if focused == "#filter" else "x"):
                seen.page.keyboard.press(key)
        assert on.robot.verbs() == done
        seen.page.locator("#filter").focus()
        seen.page.keyboard.press("Escape")
        until(lambda: on.robot.stopped_ns, "Esc is STOP wherever the focus is")


def test_events_are_filtered_and_copied(browser: "Browser", on: Stage) -> None:
    allowed = ["clipboard-read", "clipboard-write"]
    with browsing(browser, on.address, permissions=allowed) as seen:
        seen.until_live()
        seen.arm()
        rows = seen.page.locator("#events li")
        until(lambda: rows.count() >= 2)
        seen.page.locator("#filter").fill("armed now")
        until(lambda: {"armed now" in row for row in rows.all_inner_texts()} == {True})
        seen.page.locator("#copy").click()
        copied = ""

        def came() -> bool:
            nonlocal copied
            copied = seen.page.evaluate("navigator.clipboard.readText()")
            return "armed now" in copied

        until(came)
        assert len(copied.splitlines()) >= 2 and "\tstate\tarmed\t" in copied, "all of them"


def test_events_that_the_list_has_no_room_for_are_counted(browser: "Browser", on: Stage) -> None:
    with browsing(browser, on.address) as seen:
        seen.until_live()
        for number in range(230):
            on.robot.tell("note", "said", f"happening {number}")
        rows = seen.page.locator("#events li")
        until(lambda: "happening 229" in rows.first.inner_text())
        assert rows.count() == 201
        left = re.match(r"\s*(\d+) earlier ones are not listed", rows.last.inner_text())
        assert left is not None and int(left[1]) >= 30


def test_where_the_body_gives_way_and_what_that_takes_is_told_where_the_eyes_are(
    browser: "Browser", on: Stage
) -> None:
    with browsing(browser, on.address) as seen:
        seen.until_live()
        seen.arm()
        seen.press("start")
        figures, why = seen.page.locator("#figures"), seen.page.locator("#banner .why")
        until(lambda: "nowhere" in figures.inner_text(), "it goes straight")
        assert not seen.probe()["ring"]
        on.robot.aside = {"aside_arc_mm": 60.0, "aside_clearance_mm": 1.5, "given_up_mm": 0.25}
        until(lambda: "gives way" in why.inner_text(), "it gives way")
        for said in ("60 mm", "1.5 mm", "0.25 mm"):
            assert said in why.inner_text() and said in figures.inner_text()
        until(lambda: seen.probe()["ring"], "and the part is ringed")
        assert 50.0 < seen.probe()["ring"][2] < 70.0, "60 mm along a body that goes up"
        on.robot.aside = {}
        until(lambda: "gives way" not in why.inner_text() and not seen.probe()["ring"])


SHAPES: Final[dict[str, dict[str, Any]]] = {
    "ball": {"centre_mm": [-45.0, 0.0, 80.0], "radius_mm": 12.0},
    "box": {
        "centre_mm": [-45.0, 0.0, 110.0],
        "size_mm": [12.0, 12.0, 12.0],
        "turned": [1, 1, 0, 0],
    },
    "capsule": {"from_mm": [-20.0, 0.0, 130.0], "to_mm": [0.0, 0.0, 130.0], "radius_mm": 6.0},
    "cylinder": {"from_mm": [30.0, 0.0, 120.0], "to_mm": [50.0, 0.0, 135.0], "radius_mm": 6.0},
    "half_space": {"point_mm": [0.0, 0.0, 36.0], "normal": [0.0, 0.0, 2.0]},
}
MIDDLES: Final = {
    "ball": (-45.0, 0.0, 80.0),
    "box": (-45.0, 0.0, 110.0),
    "capsule": (-10.0, 0.0, 130.0),
    "cylinder": (40.0, 0.0, 127.5),
    "moving": (45.0, 0.0, 65.0),
}


def colours(seen: Browsing, places: Mapping[str, Sequence[float]]) -> dict[str, Array]:
    """(3,) of what is drawn there, the mean of a few pixels."""
    shot = Image.open(io.BytesIO(seen.page.locator("#scene").screenshot())).convert("RGB")
    pixels = np.asarray(shot, np.float64)
    found = {}
    for name, place in places.items():
        x, y = seen.page.evaluate("(place) => window.placeOnScreen(place)", list(place))
        here = pixels[round(y) - 2 : round(y) + 3, round(x) - 2 : round(x) + 3]
        found[name] = here.reshape(-1, 3).mean(axis=0)
    return found


def test_regions_and_what_moves_are_drawn_where_they_are_and_go_again(
    browser: "Browser", on: Stage
) -> None:
    with browsing(browser, on.address) as seen:
        seen.until_live()
        seen.page.locator('[data-view="front"]').click()
        until(lambda: seen.probe()["drawn"] > 2)
        seen.page.evaluate("window.beFine(true)")  # all of them: finer lines are other colours
        empty = colours(seen, MIDDLES)

        def other_than_empty() -> set[str]:
            now = colours(seen, MIDDLES)
            return {name for name in now if np.abs(now[name] - empty[name]).max() > 15.0}

        on.robot.moving_mm = [[60.0, 0.0, 65.0, -30.0, 0.0, 0.0, 6.0]]
        until(lambda: other_than_empty() == {"moving"}, other_than_empty)
        regions = [{"kind": kind, "keep": "out", "name": "", **one} for kind, one in SHAPES.items()]
        on.call(lambda: on.robot.surrounded_by(*regions))
        until(lambda: other_than_empty() == set(MIDDLES), other_than_empty)
        on.robot.moving_mm = []
        on.call(lambda: on.robot.surrounded_by())
        until(lambda: not other_than_empty(), other_than_empty)
        assert seen.errors == []


def test_a_phone_has_one_column_and_stop_in_its_corner(browser: "Browser", on: Stage) -> None:
    phone = {"viewport": {"width": 390, "height": 780}, "has_touch": True, "is_mobile": True}
    with browsing(browser, on.address, **phone) as seen:
        seen.until_live()
        assert seen.page.evaluate("document.documentElement.scrollWidth") <= 390
        stop = seen.page.locator("#stop")
        for scrolled in (0, 10_000):
            seen.page.evaluate(f"scrollTo(0, {scrolled})")
            box = stop.bounding_box()
            assert box is not None and min(box["width"], box["height"]) >= 64
            assert box["x"] + box["width"] > 340 and box["y"] + box["height"] > 690
        stop.tap()
        until(lambda: on.robot.stopped_ns, "one press")


def test_the_narrowest_phone_tells_the_state_whole_beside_stop(
    browser: "Browser", on: Stage
) -> None:
    phone = {"viewport": {"width": 320, "height": 568}, "has_touch": True, "is_mobile": True}
    with browsing(browser, on.address, **phone) as seen:
        seen.until_live()
        assert seen.page.evaluate("document.documentElement.scrollWidth") <= 320
        fits = "(all, e = document.getElementById('stopstate')) => e.scrollHeight <= e.clientHeight"
        until(lambda: seen.page.locator("#stopstate").inner_text(), "the state")
        assert seen.page.evaluate(fits)
        box = seen.page.locator("#stopstate").bounding_box()
        assert box is not None and box["width"] > 100, "a state is not broken in two"


_NO_WEBGL: Final = """
const whole = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
  return String(kind).startsWith("webgl") ? null : whole.call(this, kind, ...more);
};
"""
_NO_OFFSCREEN: Final = "delete HTMLCanvasElement.prototype.transferControlToOffscreen"


def without_webgl_in_workers(seen: Browsing) -> None:
    """As in a browser whose workers cannot draw in three dimensions."""

    def spoil(route: "Route") -> None:
        answer = route.fetch()
        route.fulfill(
            response=answer,
            body="OffscreenCanvas.prototype.getContext = () => null;" + answer.text(),
        )

    seen.page.route("**/drawing_worker.js", spoil)


def led_and_stopped(seen: Browsing, on: Stage) -> None:
    """Whatever the picture is drawn by: the tip is led in it, and STOP is confirmed."""
    seen.arm()
    seen.begin_teleoperation()
    x, y = seen.grab()
    seen.page.mouse.move(x + 40, y, steps=3)
    until(lambda: on.robot.tip[0] > 2.0, "the tip is led in this picture too")
    seen.page.keyboard.press("Escape")
    says = seen.page.locator("#stopsays")
    until(lambda: says.get_attribute("data-outcome") == "confirmed", "STOP is confirmed")


def test_long_words_and_markup_of_reasons_are_shown_whole_and_as_words(
    browser: "Browser", on: Stage
) -> None:
    path = "/srv/" + "a_very_long_name_" * 20
    reason = replace(_HOLD, text=f"<img src=x onerror=alert(1)> {path}", remedy=path)
    for width in (1280, 360):
        with browsing(browser, on.address, viewport={"width": width, "height": 800}) as seen:
            on.robot.reasons = [reason]
            for name in ("headline", "remedy", "reasons"):
                shown = seen.page.locator(f"#{name}")
                until(lambda shown=shown: path in shown.inner_text(), shown.inner_text)  # type: ignore[misc]
                assert shown.evaluate("e => e.scrollWidth <= e.clientWidth"), (name, width)
            assert seen.page.locator("main img").count() == 0 and seen.errors == []


def test_without_webgl_the_robot_is_drawn_flat_and_everything_works(
    browser: "Browser", on: Stage
) -> None:
    with browsing(browser, on.address) as seen:
        seen.page.add_init_script(_NO_WEBGL)
        without_webgl_in_workers(seen)
        seen.page.reload()
        seen.until_live()
        assert seen.probe()["flat"] and "no WebGL" in seen.page.locator("#source").inner_text()
        led_and_stopped(seen, on)


@pytest.mark.parametrize("lacks", ["offscreen canvas", "webgl in workers"])
def test_a_browser_whose_workers_cannot_draw_draws_the_same_in_the_page(
    browser: "Browser", on: Stage, lacks: str
) -> None:
    with browsing(browser, on.address) as seen:
        assert seen.probe().get("beside") is not False
        if lacks == "offscreen canvas":
            seen.page.add_init_script(_NO_OFFSCREEN)
        else:
            without_webgl_in_workers(seen)
        seen.page.reload()
        seen.until_live()
        found = seen.probe()
        assert not found["beside"] and not found["flat"]
        until(lambda: seen.probe()["drawn"] > found["drawn"] + 3, "it is drawn in the page")
        assert seen.page.locator("#scene canvas").count() == 1
        led_and_stopped(seen, on)
        others = [error for error in seen.errors if "creating WebGL context" not in error]
        assert others == [], "what three says of a worker without WebGL is none"


def test_the_robot_is_looked_at_from_where_one_likes(browser: "Browser", on: Stage) -> None:
    with browsing(browser, on.address) as seen:
        seen.until_live()
        until(lambda: seen.probe()["tipOnScreen"])
        seen_from = {"free": seen.probe()["tipOnScreen"]}
        for view in ("front", "side", "top"):
            seen.page.locator(f'[data-view="{view}"]').click()
            seen_from[view] = seen.probe()["tipOnScreen"]
        assert len({tuple(place) for place in seen_from.values()}) > 2
        before = seen.probe()["drawn"]
        scene = seen.page.locator("#scene").bounding_box()
        assert scene is not None
        x, y = scene["x"] + 0.8 * scene["width"], scene["y"] + 0.5 * scene["height"]
        seen.page.mouse.move(x, y)
        seen.page.mouse.down()
        seen.page.mouse.move(x + 120, y - 90, steps=4)
        seen.page.mouse.up()
        turned = seen.probe()["tipOnScreen"]
        assert turned not in seen_from.values(), "turned by hand"
        until(lambda: seen.probe()["drawn"] > before, "and drawn so")
        on.robot.tip[:] = (30.0, 0.0, 110.0)
        seen.page.locator("#follow").click()
        middle = [scene["width"] / 2, scene["height"] / 2]
        until(lambda: _apart(seen.probe()["tipOnScreen"], middle) < 30.0, "its tip is followed")


def _apart(one: list[float], other: list[float]) -> float:
    return float(sum((a - b) ** 2 for a, b in zip(one, other, strict=True)) ** 0.5)


def test_a_picture_of_another_size_is_drawn_without_the_page_s_own_turn(
    browser: "Browser", on: Stage
) -> None:
    with browsing(browser, on.address) as seen:
        seen.until_live()
        seen.page.evaluate("window.requestAnimationFrame = () => 0")
        time.sleep(0.2)
        before = seen.probe()["drawn"]
        seen.page.set_viewport_size({"width": 1100, "height": 900})
        until(lambda: seen.probe()["drawn"] > before, "drawn with its size, not at some later turn")


def test_the_browser_is_asked_for_no_more_pictures_than_are_drawn(
    browser: "Browser", on: Stage
) -> None:
    with browsing(browser, on.address) as seen:
        seen.until_live()
        seen.page.evaluate(
            "window.asked = 0; const whole = window.requestAnimationFrame;"
            "window.requestAnimationFrame = (f) => { window.asked += 1; return whole(f); }; 0"
        )
        before = seen.probe()["drawn"]
        time.sleep(2.0)
        asked, drawn = seen.page.evaluate("window.asked"), seen.probe()["drawn"] - before
        assert drawn > 3
        assert asked <= 1.5 * drawn + 5, (
            "whatever is pressed waits for each, and for empty ones too"
        )


def test_the_list_of_recordings_takes_the_focus_from_nobody(browser: "Browser", on: Stage) -> None:
    runs = on.folder / "runs"
    for name in ("arm-1", "arm-2"):
        (runs / name).mkdir(parents=True, exist_ok=True)
        (runs / name / "run.mcap").write_bytes(b"one")
    often = (
        "const whole = window.setInterval;"
        "window.setInterval = (f, ms, ...more) => whole(f, Math.min(ms, 200), ...more);"
    )
    with browsing(browser, on.address) as seen:
        seen.page.add_init_script(often)
        seen.page.reload()
        listed = seen.page.locator("#runs tr")
        until(lambda: listed.count() == 2, "both are listed")
        seen.page.get_by_role("link", name="Replay arm-1").focus()
        (runs / "arm-2" / "run.mcap").write_bytes(b"ten times as much" * 1000)
        (runs / "arm-3").mkdir()
        (runs / "arm-3" / "run.mcap").write_bytes(b"one")
        until(lambda: listed.count() == 3 and "17 kB" in listed.nth(1).inner_text(), "it is new")
        names = [listed.nth(n).locator("td").first.inner_text() for n in range(3)]
        assert names == ["arm-3", "arm-2", "arm-1"]
        focus = seen.page.evaluate("document.activeElement.getAttribute('aria-label')")
        assert focus == "Replay arm-1"
