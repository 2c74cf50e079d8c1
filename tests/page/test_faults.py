"""What breaks round the page: it says so at once, and nothing goes on by itself afterwards."""

import signal
import time
from functools import partial
from typing import TYPE_CHECKING

import pytest

from tests.daemon.remote.rig import ROBOT
from tests.hil.processes import Process, command
from tests.page.browsing import browsing, until
from tests.page.stage import Stage, stage

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator

pytestmark = pytest.mark.page

_TWENTY_SOCKETS = """
(() => {
  const base = location.origin.replace(/^http/, "ws");
  window.counts = Array(20).fill(0);
  for (let n = 0; n < 20; n++) {
    const page = String(n).padStart(32, "0");
    const own = new WebSocket(`${base}/ws?robot=little_arm&page=${page}`);
    own.onmessage = () => { window.counts[n] += 1; };
  }
})()
"""

_ALL_IS_OLD = """
(() => {
  const parse = JSON.parse;
  JSON.parse = (text) => {
    const told = parse(text);
    return told && told.n ? { ...told, problem: "the robot is away" } : told;
  };
})()
"""
_COUNT_WHAT_IS_ENABLED = """
(() => {
  window.enabled = [];
  for (const button of document.querySelectorAll('[data-verb="disarm"], #control')) {
    const told = () => { if (!button.disabled) window.enabled.push(button.textContent); };
    new MutationObserver(told).observe(button, { attributeFilter: ["disabled"] });
  }
})()
"""


def outcome_is(says: "Locator", outcome: str) -> bool:
    return says.get_attribute("data-outcome") == outcome


def test_a_daemon_that_dies_and_comes_back_is_picked_up_and_nobody_is_in_control(
    browser: "Browser",
    on: Stage,
) -> None:
    with browsing(browser, on.address) as seen:
        seen.until_live()
        seen.arm()
        on.close_robot()
        disarm = seen.page.locator('[data-verb="disarm"]')
        # Both: a page that had fallen behind shows its last messages late, and is live once more.
        until(lambda: seen.stale and not disarm.is_enabled(), "it greys out")
        assert seen.page.locator("#stop").is_enabled()
        assert "Control was lost" in seen.page.locator("#answer").inner_text()
        on.open_robot()
        seen.until_live()
        assert not seen.probe()["inControl"], "nothing is taken again by itself"
        assert seen.page.locator("#control").is_enabled()


def test_a_daemon_that_comes_back_tells_its_workspace_anew_and_its_events_once(
    browser: "Browser", on: Stage
) -> None:
    with browsing(browser, on.address) as seen:
        seen.until_live()
        seen.arm()
        rows = seen.page.locator("#events li")
        until(lambda: rows.count() == len(on.robot.events), "its events are listed")
        on.close_robot()
        until(lambda: seen.stale, "it is gone")
        on.robot.workspace_mm = [[-20.0, 20.0], [-20.0, 20.0], [60.0, 140.0]]
        on.open_robot()
        seen.until_live()
        until(lambda: seen.probe()["workspace"] == on.robot.workspace_mm, "its workspace is drawn")
        assert rows.count() == len(on.robot.events), "what was listed before is not listed again"
    on.close_robot()


def test_what_is_told_of_old_data_enables_nothing_even_for_a_moment(
    browser: "Browser", on: Stage
) -> None:
    with browsing(browser, on.address) as seen:
        seen.until_live()
        seen.arm()
        disarm = seen.page.locator('[data-verb="disarm"]')
        until(disarm.is_enabled, "it may be switched off")
        seen.page.evaluate(_ALL_IS_OLD)
        until(lambda: seen.stale and not disarm.is_enabled(), "it greys out")
        frames = seen.probe()["frames"]
        seen.page.evaluate(_COUNT_WHAT_IS_ENABLED)
        until(lambda: seen.probe()["frames"] > frames + 20, "it is told more")
        assert seen.page.evaluate("window.enabled") == []


def test_keys_that_were_held_while_the_server_was_away_count_as_released(
    browser: "Browser", on: Stage
) -> None:
    with browsing(browser, on.address) as seen:
        seen.until_live()
        seen.arm()
        seen.begin_teleoperation()
        seen.page.locator("#scene").focus()
        seen.push_until("ArrowUp", lambda: len(on.robot.came_s) > 3, "set-points come")
        on.close_robot()
        until(lambda: seen.probe()["held"] == "", "it lets go", 3.0)
        on.robot.begin_anew()
        on.open_robot()
        seen.until_live()
        seen.arm()
        seen.begin_teleoperation()
        count = len(on.robot.came_s)
        seen.page.keyboard.down("ArrowUp")  # it is down already: what a held key repeats
        time.sleep(0.6)
        assert len(on.robot.came_s) == count and seen.probe()["held"] == "", "still pressed"
        seen.push_until(
            "ArrowRight", lambda: len(on.robot.came_s) > count + 3, "a key pressed anew leads"
        )
        heights = [setpoint.position_mm[2] for _, setpoint in on.robot.setpoints]
        assert max(heights) - min(heights) < 0.1, "the one from before does not"
        seen.page.keyboard.up("ArrowRight")
        seen.page.keyboard.up("ArrowUp")


def test_the_lease_is_kept_by_a_worker_where_the_page_s_own_timers_are_slowed_down(
    browser: "Browser",
) -> None:
    slow = (
        "const whole = window.setInterval;"
        "window.setInterval = (f, ms, ...more) => whole(f, Math.max(ms, 60000), ...more);"
    )
    with stage(lease_s=1.0) as on, browsing(browser, on.address) as seen:
        seen.page.add_init_script(slow)
        seen.page.reload()
        until(lambda: seen.probe().get("status"), "it is told of the robot")
        seen.page.evaluate("document.querySelector('#control').disabled = false")
        seen.page.locator("#control").click()
        until(lambda: seen.probe()["inControl"], "it is in control")
        time.sleep(3.0)
        now_ns = on.robot.clock.now_ns()
        assert on.robot.lease.holder(now_ns) == "local", "3 s of a lease of 1 s"


def test_each_of_several_robots_is_shown_commanded_and_stopped_by_its_name(
    browser: "Browser",
) -> None:
    with stage() as on, browsing(browser, on.address) as seen:
        seen.until_live()
        other = on.add_robot("other_arm")
        pick = seen.page.locator("#robot")
        until(lambda: pick.locator("option").count() == 2, "both are found")
        second = pick.locator("option").nth(1)
        until(lambda: "ready" in second.inner_text(), "with their states")
        seen.arm()
        pick.select_option("other_arm")
        assert seen.page.locator("#stopwhom").inner_text() == "Stops other_arm.", "at once"
        until(lambda: seen.state() == "ready" and not seen.stale, "the other one is shown")
        assert not seen.probe()["inControl"], "control is of one robot"
        seen.arm()
        seen.page.keyboard.press("Escape")
        says = seen.page.locator("#stopsays")
        until(lambda: other.stopped_ns, lambda: f"{says.inner_text()}\n{seen.told()}", 10.0)
        assert not on.robot.stopped_ns
        pick.select_option(ROBOT)
        until(lambda: seen.state() in ("armed", "hold"), "and the first one is as it was")


def test_a_frozen_server_greys_the_page_within_a_second_and_the_lease_runs_out(
    browser: "Browser",
) -> None:
    with stage(lease_s=1.0) as on, browsing(browser, on.address) as seen:
        seen.until_live()
        seen.arm()
        on.server.process.send_signal(signal.SIGSTOP)
        try:
            until(lambda: seen.stale, "it greys out", 1.0)
            assert seen.page.locator("#stop").is_enabled()
            until(lambda: on.robot.state == "hold", "the robot holds by the lease", 3.0)
            told = seen.page.locator("#connection")
            until(lambda: "server does not answer" in told.inner_text(), told.inner_text, 8.0)
        finally:
            on.server.process.send_signal(signal.SIGCONT)
        seen.until_live()
        time.sleep(0.5)
        assert not seen.probe()["inControl"] and on.robot.state == "hold"


def test_a_server_that_is_killed_is_told_and_another_one_is_a_new_beginning(
    browser: "Browser",
) -> None:
    with stage(lease_s=1.0) as on, browsing(browser, on.address) as seen:
        seen.until_live()
        seen.arm()
        on.server.kill()
        until(lambda: seen.stale, "it greys out", 1.5)
        until(lambda: on.robot.state == "hold", "the robot holds by the lease", 3.0)
        seen.page.keyboard.press("Escape")
        says = seen.page.locator("#stopsays")
        until(lambda: says.get_attribute("data-outcome") == "no answer", "STOP tells that too")
        assert "emergency stop" in says.inner_text()
        told = seen.page.locator("#connection")
        until(lambda: "server does not answer" in told.inner_text(), told.inner_text)
        port = on.base.rpartition(":")[2].strip("/")
        another = Process(command("dashboard", "--runtime-dir", str(on.folder), "--port", port))
        try:
            until(lambda: "open the address" in told.inner_text(), told.inner_text)
        finally:
            another.leave()


def test_stop_is_told_though_telemetry_and_picture_hang(browser: "Browser", on: Stage) -> None:
    with browsing(browser, on.address) as seen:
        seen.until_live()
        seen.page.route("**/ws*", lambda route: route.abort())
        seen.page.evaluate("window.requestAnimationFrame = () => 0")
        seen.page.keyboard.press("Escape")
        says = seen.page.locator("#stopsays")
        until(lambda: says.get_attribute("data-outcome") == "confirmed", "STOP is confirmed")
        assert on.robot.stopped_ns


def test_stop_and_words_go_on_where_the_drawing_hangs(browser: "Browser", on: Stage) -> None:
    with browsing(browser, on.address) as seen:
        seen.until_live()
        seen.arm()
        assert seen.probe()["beside"], "it is drawn beside the page"
        seen.hang_the_drawing(8.0)
        source = seen.page.locator("#source")
        until(lambda: "picture hangs" in source.inner_text(), "it says so", 5.0)
        assert not seen.stale and seen.probe()["age"] < 0.5
        seen.press("start")
        until(lambda: "RUNNING" in seen.page.locator("#state").inner_text(), "words go on", 2.0)
        seen.page.keyboard.press("Escape")
        says = seen.page.locator("#stopsays")
        until(lambda: outcome_is(says, "confirmed"), "STOP is confirmed", 2.0)
        assert "picture hangs" in source.inner_text(), "all this time"
        until(lambda: "picture hangs" not in source.inner_text(), "and it is drawn again", 15.0)


def test_stop_is_a_request_where_its_line_hangs_and_its_line_where_requests_do(
    browser: "Browser", on: Stage
) -> None:
    with browsing(browser, on.address) as seen:
        says = seen.page.locator("#stopsays")
        confirmed = partial(outcome_is, says, "confirmed")
        heard: list[object] = []
        seen.page.route_web_socket(
            "**/stop", lambda line: line.on_message(lambda said: heard.append(said))
        )
        seen.page.reload()
        seen.until_live()
        seen.page.keyboard.press("Escape")
        until(confirmed, "a line that is open and brings nothing")
        assert len(heard) == 1 and len(on.robot.stopped_ns) == 1
    with browsing(browser, on.address) as seen:
        says = seen.page.locator("#stopsays")
        seen.page.route("**/api/stop", lambda route: route.abort())
        seen.until_live()
        seen.page.keyboard.press("Escape")
        until(partial(outcome_is, says, "confirmed"), "requests that do not get through")
        assert len(on.robot.stopped_ns) == 2


def test_a_second_page_takes_over_and_the_first_one_commands_nothing_more(
    browser: "Browser", on: Stage
) -> None:
    with browsing(browser, on.address) as one, browsing(browser, on.address) as two:
        one.until_live()
        two.until_live()
        one.arm()
        one.begin_teleoperation()
        one.drag_until(lambda: len(on.robot.came_s) > 3, "the first leads", 40.0)
        control = two.page.locator("#control")
        until(lambda: control.inner_text() == "Take over" and control.is_enabled())
        assert not two.page.locator('[data-verb="hold"]').is_enabled()
        control.click()
        until(
            lambda: two.probe()["inControl"] and not one.probe()["inControl"], "it was taken over"
        )
        assert "hold" in on.robot.verbs(), "what moved was held first"
        told = one.page.locator("#answer")
        until(lambda: told.inner_text() == "Another page has taken control", told.inner_text)
        holder = one.page.locator("#holder")
        until(lambda: holder.inner_text() == "in control: another page", holder.inner_text)
        taken_s = time.monotonic()
        time.sleep(0.6)
        assert not [at_s for at_s in on.robot.came_s if at_s > taken_s + 0.3]
        assert one.probe()["held"] == ""
        assert not one.page.locator('[data-verb="resume"]').is_enabled()
        two.press("disarm")
        two.until_state("ready")


def test_a_slow_browser_is_left_frames_out_and_gets_no_queue(browser: "Browser", on: Stage) -> None:
    with browsing(browser, on.address) as seen:
        seen.until_live()
        hang = "const end = Date.now() + 3000; while (Date.now() < end);"
        seen.page.evaluate(f"setTimeout(() => {{ {hang} }}, 0)")
        until(lambda: seen.probe().get("frames"), "it is back", 10.0)
        before, began_s = seen.probe(), time.monotonic()
        time.sleep(1.0)
        after, passed_s = seen.probe(), time.monotonic() - began_s
        assert after["dropped"] > 40, f"{after['dropped']} were left out"
        came = after["frames"] - before["frames"]
        assert came < 45 * passed_s + 10, f"{came} frames: those of three seconds followed"
        assert after["age"] < 0.5 and not seen.stale
        behind = time.time() - after["tipSent"]
        assert behind < 1.0, f"what it shows was sent {behind:.1f} s ago"


def test_twenty_viewers_at_once_are_all_told_and_stop_is_as_quick(
    browser: "Browser", on: Stage
) -> None:
    with browsing(browser, on.address) as seen:
        seen.until_live()
        # Without the picture: twenty software renderers would measure the test's own machine.
        seen.page.evaluate(_TWENTY_SOCKETS)
        until(lambda: min(seen.page.evaluate("window.counts")) > 5, "all are told")
        before = seen.page.evaluate("window.counts")
        time.sleep(2.0)
        told = [b - a for a, b in zip(before, seen.page.evaluate("window.counts"), strict=True)]
        assert min(told) > 15, f"of two seconds: {told}"
        assert not seen.stale
        seen.page.keyboard.press("Escape")
        says = seen.page.locator("#stopsays")
        until(lambda: says.get_attribute("data-outcome") == "confirmed", "STOP is confirmed")
        taken_ms = int("".join(c for c in says.inner_text() if c.isdigit()))
        assert taken_ms < 500, says.inner_text()


def test_where_no_robot_is_stop_says_so(browser: "Browser") -> None:
    server = Process(command("dashboard", "nobody_here", "--port", "0"))
    try:
        with browsing(browser, server.next_line()[1].split()[1]) as seen:
            headline = seen.page.locator("#headline")
            until(lambda: "No robot runs" in headline.inner_text(), headline.inner_text)
            assert "tentacled run" in seen.page.locator("#remedy").inner_text()
            seen.page.keyboard.press("Escape")
            says = seen.page.locator("#stopsays")
            until(lambda: says.get_attribute("data-outcome") == "no answer")
    finally:
        server.leave()
