"""What `status` and `probe` show in a window of 80 columns and 24 lines: nothing is lost."""

import asyncio
import sys
from collections.abc import Callable
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace
from rich.console import Console, RenderableType

from daemon.commands.terminal.tour import _line
from daemon.commands.views.page import LivePage, Size, cut, grid, paragraph, print_page, table
from daemon.commands.views.probe_snapshot import Observer, event, snapshot
from daemon.commands.views.probe_view import view
from daemon.commands.views.status_view import status_view
from daemon.messages import Inject, Reason, RiskStatus, Status
from daemon.robot.checked_robot import check_robot
from daemon.robot.hardware import Hardware, Listeners
from daemon.robot.lab_connections import LabConnections
from safety.states import OperatingState as S
from sim_backends.lab.lab import Lab
from sim_backends.virtual_time import run_in_virtual_time, virtual_clock
from tests import SHIPPED_ROBOTS, SOFT_ARM
from tests.daemon.service.rig import Rig, on_a_rig

pytestmark = pytest.mark.xdist_group("views")  # whose robots are played once for all tests

TENDON_ARM = SHIPPED_ROBOTS / "tendon_arm.yaml"
SMALL = Size(80, 23)
"""Beside the line of the cursor."""


def printed(shown: RenderableType, size: Size = SMALL) -> list[str]:
    """The lines, each with what a window of this size would show."""
    out = StringIO()
    console = Console(width=size.width, height=size.height, file=out, force_terminal=False)
    console.print(shown)
    lines = out.getvalue().splitlines()
    assert size.height is None or len(lines) <= size.height, "\n".join(lines)
    assert all(len(line) <= size.width for line in lines)
    return lines


def joined(lines: list[str]) -> str:
    """Without the breaks between words."""
    return " ".join(" ".join(lines).split())


# Of the status: a real daemon's, in virtual time.


def status_of(scene_of: Any) -> Status:
    """What a daemon says after this has happened to it."""
    found: list[Status] = []

    async def scene(rig: Rig) -> None:
        await scene_of(rig)
        found.append(rig.status)

    on_a_rig(scene)
    return found[0]


async def nothing(rig: Rig) -> None:
    await rig.running()
    await asyncio.sleep(25.0)


async def much(rig: Rig) -> None:
    """Three faults at once, while the robot moves."""
    await rig.running()
    for fault in (
        "tracker.missing=20s",
        "drive.can0/3.heartbeat_stop=20s",
        "bus.can0.foreign_master=20s",
    ):
        await rig.do(Inject, fault=fault)
    await rig.until_state(S.FAULT)
    await asyncio.sleep(5.0)


@pytest.fixture(scope="module")
def healthy() -> Status:
    return status_of(nothing)


@pytest.fixture(scope="module")
def broken() -> Status:
    return status_of(much)


def test_a_healthy_robot_is_seen_with_all_its_figures(healthy: Status) -> None:
    lines = printed(status_view(healthy, SMALL))
    text = joined(lines)
    assert lines[0].split() == ["RUNNING", "soft_arm", "SIMULATED", "tentacled", healthy.version]
    for axis in healthy.axes:
        row = next(line for line in lines if line.startswith(axis.name)).split()
        assert row[1:3] == ["operation", "enabled"]
        assert row[3:5] == [f"{axis.actual:.3f}", f"{axis.target:.3f}"]
        assert row[-1] == "mL"
    for label in ("tip", "reference", "error", "following", "tracker", "risk", "loop", "lease"):
        assert sum(line.startswith(f"{label} ") for line in lines) == 1
    assert healthy.recording is not None
    assert Path(healthy.recording).name in text
    assert "circle, constant_curvature: cycle 1" in text
    assert "…" not in text


def test_what_turns_is_told_in_radians_and_newton_millimetres() -> None:
    found: list[Status] = []

    async def scene(rig: Rig) -> None:
        await rig.armed()
        found.append(rig.status)

    on_a_rig(scene, path=SHIPPED_ROBOTS / "concentric_tubes.yaml")
    lines = printed(status_view(found[0], Size(100, None)))
    for axis in found[0].axes:
        turns = axis.name.startswith("rotation")
        row = next(line for line in lines if line.startswith(f"{axis.name} "))
        cells = row.split()
        assert ("rad" if turns else "mm") in cells
        assert ("rad" in cells) is turns
        assert cells[-1] == ("mm" if turns else "N"), "of its torque, or its force"
        assert row.endswith(" N mm") is turns


def test_what_is_expected_is_shown_and_how_far_a_path_is_slowed_for_it(healthy: Status) -> None:
    assert healthy.reference is not None
    plain = joined(printed(status_view(replace(healthy, expected_mm=None), SMALL)))
    assert "expected" not in plain
    assert "slowed" not in plain
    slowed = replace(healthy.reference, pace=0.6, cycle=0, note="", trajectory="star")
    shown = replace(healthy, error_mm=0.98, expected_mm=1.34, reference=slowed)
    lines = printed(status_view(shown, Size(100, None)))
    assert "error      0.98 mm, about 1.3 mm expected" in lines
    following = next(line for line in lines if line.startswith("following"))
    assert following.endswith("s, slowed to 60%")


def test_no_model_of_the_risk_is_called_that_and_has_no_figure(healthy: Status) -> None:
    line = next(line for line in printed(status_view(healthy, SMALL)) if line.startswith("risk"))
    assert line == "risk       no model of what the body may touch; 100% of the step let through"
    known = RiskStatus(
        source="soft_arm.npz", contact_risk=0.0312, threshold=0.05, scale=0.5, detail="14.2 mm room"
    )
    shown = joined(printed(status_view(replace(healthy, risk=known), SMALL)))
    assert "contact 0.0312 (most 0.05), 50% of the step let through, by soft_arm.npz" in shown
    assert "14.2 mm room" in shown


@pytest.mark.parametrize(
    ("state", "rate_hz", "told"),
    [
        ("closed", 0.0, "no frames: it is closed, the newest tip 12.3 s old"),
        ("setting up", 38.0, "no frames: it is setting up, the newest tip 12.3 s old"),
        ("tracking", 0.0, "no frames: it is silent, the newest tip 12.3 s old"),
    ],
)
def test_a_tracker_that_brings_no_frames_is_told_so(
    healthy: Status, state: str, rate_hz: float, told: str
) -> None:
    tracker = replace(healthy.tracker, state=state, rate_hz=rate_hz, age_s=12.3)
    lines = printed(status_view(replace(healthy, tracker=tracker), SMALL))
    assert f"tracker    {told}" in lines


def test_several_causes_leave_room_for_the_robot(broken: Status) -> None:
    lines = printed(status_view(broken, SMALL))
    text = joined(lines)
    assert lines[0].startswith("  FAULT  ")
    leads = [reason for reason in broken.reasons if not reason.follows_from]
    assert len(leads) >= 2
    for reason in leads:
        assert reason.text in text, reason
    assert leads[0].remedy in text
    for axis in broken.axes:
        assert axis.name in text
        assert f"{axis.name} {axis.actual:.2f}" in text or f"{axis.actual:.3f}" in text
    assert any(line.startswith("tracker ") for line in lines)


def test_however_many_causes_there_are_the_first_come_with_help_and_all_are_counted(
    broken: Status,
) -> None:
    reasons = [
        replace(reason, name=f"{reason.name}_{number}", follows_from="")
        for number in range(7)
        for reason in broken.reasons
    ]
    lines = printed(status_view(replace(broken, reasons=reasons), SMALL))
    text = joined(lines)
    assert reasons[0].text in text
    assert reasons[0].remedy in text
    assert "more: " in text
    assert any(line.startswith("lease ") for line in lines)
    whole = printed(status_view(replace(broken, reasons=reasons), Size(80)), Size(80))
    assert len(whole) > 2 * len(lines)
    assert "more: " not in joined(whole)


def test_a_long_text_is_broken_between_words_and_not_cut(healthy: Status) -> None:
    words = " ".join(f"word{number}" for number in range(60))
    reason = Reason(
        name="x", severity="hold", subject="gate", text="it is so", remedy=words, since_s=1.0
    )
    lines = printed(status_view(replace(healthy, reasons=[reason]), SMALL))
    assert words in joined(lines)


def test_the_tendon_arm_s_status_fits_too(broken: Status) -> None:
    file = check_robot(TENDON_ARM).file
    axes = [
        replace(broken.axes[0], name=axis.name, volume_ml=None, force=9.71, actual=-12.345)
        for axis in file.robot.axes
    ]
    lines = printed(status_view(replace(broken, robot=file.robot.robot, axes=axes), SMALL))
    for axis in axes:
        assert f"{axis.name} -12.3" in joined(lines) or axis.name in joined(lines)
    none = replace(broken, robot=file.robot.robot, axes=axes, reasons=[], stopped_by=[])
    rows = printed(status_view(none, SMALL))
    assert [line.split()[0] for line in rows[-len(axes) :]] == [axis.name for axis in axes]
    assert "mL" not in joined(rows)


@pytest.mark.parametrize("width", [60, 80, 120])
@pytest.mark.parametrize("height", [12, 18, 23, 40])
def test_no_window_is_overrun(broken: Status, width: int, height: int) -> None:
    size = Size(width, height)
    text = joined(printed(status_view(broken, size), size))
    assert "FAULT" in text
    assert broken.reasons[0].text in text


def test_the_tour_s_line_fits_too(healthy: Status) -> None:
    far = replace(healthy, error_mm=123.456, tip_mm=[-123.4, -123.4, -123.4])
    line = _line(far)
    assert len(line) < 80
    assert line.startswith("running ")
    assert "error 123.46 mm" in line
    assert line.endswith(f"{healthy.loop.rate_hz:.0f} Hz")


# Of the probe: real drivers beside emulated devices, in virtual time.


def probed(robot: Path, *faults: str) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """A snapshot 6 s after the start, and the events; faults come after 3 s."""

    async def scene() -> tuple[dict[str, Any], list[dict[str, Any]]]:
        file, clock = check_robot(robot).file, virtual_clock()
        lab = Lab(file.robot, file.path, clock, 1)
        lab.start()
        observer = Observer(clock)
        events: list[dict[str, Any]] = []
        listeners = Listeners(
            observer.on_frame,
            lambda change: events.append(dict(event(change, clock.now_ns() * 1e-9))),
        )
        hardware = Hardware(file, file.robot, LabConnections(lab, clock), clock, listeners)
        running = asyncio.create_task(hardware.run())
        await asyncio.sleep(3.0)
        snapshot(file.robot.robot, hardware, observer, 3.0)
        for fault in faults:
            lab.inject(fault)
        await asyncio.sleep(3.0)
        told = dict(snapshot(file.robot.robot, hardware, observer, 6.0))
        running.cancel()
        await asyncio.wait([running], timeout=100.0)
        lab.stop()
        return told, events

    return run_in_virtual_time(scene())


@pytest.mark.parametrize("robot", sorted(SHIPPED_ROBOTS.glob("*.yaml")), ids=lambda path: path.stem)
def test_a_healthy_robot_is_probed_on_one_page(robot: Path) -> None:
    told, events = probed(robot)
    lines = printed(view(told, events[-6:], SMALL))
    text = joined(lines)
    assert "tracker tracking" in lines[0]
    assert lines[1].rstrip().endswith(told["tracker"]["control_unit"]), "and nothing else"
    for axis in told["axes"]:
        row = next(line for line in lines if line.startswith(f"{axis['name']} "))
        for part in (axis["node"], axis["drive_state"], f"{axis['position']:.3f} {axis['unit']}"):
            assert part in row
    for tool in told["tracker"]["tools"]:
        assert all(f"{value:.2f}" in text for value in tool["position_mm"])
    assert "nothing is wrong" in text
    assert "100 Hz" in text
    assert "…" not in text


@pytest.mark.parametrize("robot", sorted(SHIPPED_ROBOTS.glob("*.yaml")), ids=lambda path: path.stem)
def test_what_is_wrong_is_probed_with_its_remedies_on_one_page(robot: Path) -> None:
    drives = [axis.drive for axis in check_robot(robot).file.robot.axes]
    *_, second, third = (f"{drive.bus}/{drive.node}" for drive in drives)
    told, events = probed(
        robot,
        "tracker.missing=20s",
        f"drive.{second}.heartbeat_stop=20s",
        f"drive.{third}.emergency=0x8611",
    )
    lines = printed(view(told, events[-6:], SMALL))
    text = joined(lines)
    assert len(told["conditions"]) >= 3
    for condition in told["conditions"]:
        assert condition["text"] in text
        assert condition["subject"] in text
    assert told["conditions"][0]["remedy"] in text
    for axis in told["axes"]:
        assert axis["name"] in text
    assert "100 Hz" in text


def test_a_disturbed_line_to_the_tracker_shows_in_its_counts() -> None:
    told, _ = probed(SOFT_ARM, "tracker.bad_crc=3", "tracker.no_reply=2")
    text = joined(printed(view(told, [], SMALL)))
    assert "3 CRC errors" in text
    assert f"{told['tracker']['counters']['timeouts']} replies missing" in text


def test_a_bus_that_is_gone_makes_one_condition_of_many_drives() -> None:
    told, _ = probed(SOFT_ARM, "bus.can0.unplug=20s")
    text = joined(printed(view(told, [], SMALL)))
    for condition in told["conditions"]:
        assert condition["text"] in text


# Into a pipe.


LONG = "a_very_long_name_of_an_axis_that_nobody_has_to_type_again_and_again_but_reads_in_a_table"


Written = Callable[[], str]


@pytest.fixture
def into_a_pipe(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Written:
    """Which has no columns, and nobody says how many there are. What was written since."""
    monkeypatch.delenv("COLUMNS", raising=False)
    monkeypatch.setattr(sys, "__stdout__", None)
    return lambda: capsys.readouterr().out


def test_nothing_that_goes_into_a_pipe_is_cut(healthy: Status, into_a_pipe: Written) -> None:
    named = replace(healthy, axes=[replace(healthy.axes[0], name=LONG)])
    with LivePage() as live:
        for _ in range(2):
            live.show(status_view(named, Size.of_terminal()))
    text = into_a_pipe()
    rows = [line for line in text.splitlines() if line.startswith(LONG)]
    assert len(rows) == 2
    assert all(row.endswith(" mL") for row in rows)
    assert "…" not in text


def test_the_last_page_of_a_probe_into_a_pipe_is_written_whole_and_alone(
    into_a_pipe: Written,
) -> None:
    told, events = probed(SOFT_ARM, "drive.can0/3.emergency=0x8611")
    last = {**events[-1], "detail": LONG, "present": True}
    with LivePage(last_alone=True) as live:
        for t_s in (1.0, 2.0):
            live.show(view({**told, "t_s": t_s}, [last], Size.of_terminal()))
        assert not into_a_pipe()
    text = into_a_pipe()
    lines = text.splitlines()
    assert lines[0].startswith("soft_arm   2.0 s")
    assert lines[-1].endswith(LONG)
    assert "…" not in text


def test_who_says_how_many_columns_there_are_gets_no_more(
    into_a_pipe: Written, monkeypatch: pytest.MonkeyPatch, healthy: Status
) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    print_page(status_view(healthy, Size.of_terminal()))
    assert max(map(len, into_a_pipe().splitlines())) <= 60


# The lines themselves.


def test_a_paragraph_keeps_its_words_styles_and_width() -> None:
    spans = (("can0/3: ", "red"), ("the node's heartbeat has stopped and " * 4, "dim"))
    lines = paragraph(Size(40), *spans, indent=4)
    assert all(line.cell_len <= 40 for line in lines)
    assert joined([line.plain for line in lines]) == joined(["".join(text for text, _ in spans)])
    assert all(line.plain.startswith("    ") for line in lines[1:])
    assert {str(span.style) for span in lines[0].spans} == {"red", "dim"}
    assert {str(span.style) for span in lines[-1].spans} == {"dim"}


def test_a_table_gives_way_in_its_first_column_only() -> None:
    rows = [[("a_very_long_name_of_an_axis", ""), ("12.345 mm", "")]]
    head, row = table(("axis", "actual"), rows, (1,), width=20)
    assert row.plain == "a_very_l…  12.345 mm"
    assert head.plain == "axis          actual"


def test_cells_stand_side_by_side() -> None:
    lines = grid(["one 1", "three 3", "five 5"], 18)
    assert [line.plain for line in lines] == ["one 1    three 3", "five 5"]
    assert grid([], 18) == []


def test_a_path_is_cut_at_its_beginning() -> None:
    assert cut("/runs/a/soft_arm-2026", 14, tail=True) == "…soft_arm-2026"
    assert cut("soft", 14) == "soft"
    assert cut("soft_arm", 5) == "soft…"
