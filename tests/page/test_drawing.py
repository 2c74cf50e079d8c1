"""The picture of the robot: how it lies, what is near, and how old that is."""

from typing import TYPE_CHECKING

import pytest

from tests.page.browsing import browsing, until
from tests.page.stage import Stage

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.page

_WIDTHS = """
async (line) => {
  const { Drawing } = await import("/static/drawing.js");
  const drawing = new Drawing(document.createElement("canvas"));
  drawing.body({ centreline_mm: line, radius_mm: line.map(() => 5) });
  const places = drawing.bodyMesh.geometry.getAttribute("position").array, round = 21;
  return line.map((at, n) => Math.max(...Array.from({ length: round }, (_, k) => {
    const from = 3 * (n * round + k);
    return Math.hypot(...at.map((value, axis) => places[from + axis] - value));
  })));
}
"""


@pytest.mark.parametrize(
    "line",
    [
        [[0, 0, 0], [50, 0, 0], [100, 0, 0]],
        [[0, 0, 0], [-50, 0, 0], [-50, 0, 0], [-100, 0, 0]],
        [[0, 0, 0], [0, 0, 50], [50, 0, 50], [100, 0, 50]],
    ],
)
def test_a_body_is_as_thick_as_it_is_whatever_way_it_lies(
    browser: "Browser", on: Stage, line: list[list[float]]
) -> None:
    with browsing(browser, on.address) as seen:
        widths = seen.page.evaluate(_WIDTHS, line)
        assert widths == pytest.approx([5.0] * len(line), abs=1e-3)


def test_what_was_near_in_the_last_step_is_not_shown_of_a_robot_that_stands(
    browser: "Browser", on: Stage
) -> None:
    with browsing(browser, on.address) as seen:
        seen.until_live()
        bar, figures = seen.page.locator("#clearance"), seen.page.locator("#figures")
        until(bar.is_visible, "how near it is")
        until(lambda: "9.0 mm" in figures.inner_text(), figures.inner_text)
        on.robot.steps = False
        until(lambda: not bar.is_visible(), "nothing is known of now")
        until(lambda: "9.0 mm" not in figures.inner_text(), figures.inner_text)
        on.robot.steps = True
        until(bar.is_visible, "it steps again")


def test_the_picture_s_age_does_not_depend_on_whose_clock_is_right(
    browser: "Browser", on: Stage
) -> None:
    ahead = (
        "const now = Date.now, begun = performance.timeOrigin + 3600000;"
        "Date.now = () => now() + 3600000;"
        "Object.defineProperty(performance, 'timeOrigin', { value: begun });"
    )
    with browsing(browser, on.address) as seen:
        seen.page.add_init_script(ahead)
        seen.page.route("**/drawing_worker.js", lambda route: route.abort())
        seen.page.reload()
        seen.until_live()
        until(lambda: len(seen.page.evaluate("window.drawnTimes()")), "pictures are drawn")
        until(lambda: (ages := seen.page.evaluate("window.drawnTimes()")) and max(ages) < 5000.0)
