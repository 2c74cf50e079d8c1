"""Coupled limits of a robot file: what they must be, and where a file is told wrong."""

from pathlib import Path

import pytest

from config.loader import load_robot
from tests import SHIPPED_ROBOTS, SOFT_ARM
from tests.config.edited import problems_of

TUBES = SHIPPED_ROBOTS / "concentric_tubes.yaml"
TEXT = TUBES.read_text()
COLLARS = """    kind: length
    sum: {d_31: 1.0}
    lowest_mm: 0.5
    highest_mm: 86.5
"""
GUARD = """    sum: {d_31: 1.0}
    lowest_mm: 25.0
"""
OPPOSITE = "sum: {alpha_31: 1.0}, near_rad: 3.1416, within_rad: 1.2"


def test_the_tubes_limits_are_those_of_the_facts() -> None:
    collars, guard = load_robot(TUBES).robot.coupled_limits
    assert (collars.name, collars.unit, collars.lowest, collars.highest) == (
        "collar_clearance",
        "mm",
        0.5,
        86.5,
    )
    assert (guard.name, guard.lowest, guard.highest) == ("snap_guard", 25.0, None)
    assert [(one.near, one.within) for one in guard.only_while] == [(3.1416, 1.2)] * 2


def test_a_robot_needs_none() -> None:
    assert load_robot(SOFT_ARM).robot.coupled_limits == []


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (
            GUARD,
            GUARD.replace("d_31", "d_13"),
            "coupled_limits[1].sum.d_13: there is no axis or coordinate 'd_13' "
            "(did you mean 'd_31'?)",
        ),
        (
            GUARD,
            GUARD.replace("d_31: 1.0", "alpha_31: 1.0"),
            "coupled_limits[1].sum.alpha_31: 'alpha_31' is in rad, and this sum in mm",
        ),
        (
            GUARD,
            GUARD.replace("1.0", "0.0"),
            "coupled_limits[1].sum.d_31: 0 adds nothing: leave it out",
        ),
        (
            GUARD,
            GUARD.replace("lowest_mm", "lowest_rad"),
            "coupled_limits[1].lowest_rad: unknown key (did you mean 'lowest_mm'?)",
        ),
        (
            COLLARS,
            COLLARS.replace("    lowest_mm: 0.5\n    highest_mm: 86.5\n", ""),
            "coupled_limits[0]: bounds nothing: give lowest_mm, highest_mm or both",
        ),
        (
            COLLARS,
            COLLARS.replace("86.5", "0.4"),
            "coupled_limits[0].highest_mm: must be above lowest_mm, 0.5 mm",
        ),
        (
            COLLARS,
            COLLARS.replace("86.5", "0.505"),
            "coupled_limits[0].highest_mm: leaves less than the 0.0078 mm that whole counts need",
        ),
        (
            COLLARS,
            COLLARS.replace("{d_31: 1.0}", "{d_31: 1.0, carriage_inner: -1.0, carriage_pair: 1.0}"),
            "coupled_limits[0].sum: no axis is left in this sum: its coordinates cancel each other",
        ),
        (
            OPPOSITE,
            OPPOSITE.replace("alpha_31", "alpha_32"),
            "coupled_limits[1].only_while[0].sum.alpha_32: there is no axis or coordinate "
            "'alpha_32' (did you mean 'alpha_31'?)",
        ),
        (
            OPPOSITE,
            OPPOSITE.replace("within_rad: 1.2", "within_rad: 3.2"),
            "coupled_limits[1].only_while[0].within_rad: must be less than half of the period, "
            "3.14159 rad: as it is, the condition is always met",
        ),
        (
            OPPOSITE,
            OPPOSITE.replace("within_rad: 1.2", "within_mm: 1.2"),
            "coupled_limits[1].only_while[0].within_rad: this key is required and is not there",
        ),
        (
            "name: snap_guard",
            "name: collar_clearance",
            "coupled_limits[1].name: there is already a coupled limit 'collar_clearance'",
        ),
        (
            "    reason: tube 3 bends against the pair and would snap\n",
            "",
            "coupled_limits[1].reason: this key is required and is not there",
        ),
        (
            COLLARS,
            COLLARS.replace("0.5", "60.0"),
            "coupled_limits[0].lowest_mm: with all axes at their zeros, where homing ends, the sum "
            "is 53.5 mm, and 60 is the lowest: move a zero, or the bound",
        ),
        (
            COLLARS,
            COLLARS.replace("86.5", "50.0"),
            "coupled_limits[0].highest_mm: with all axes at their zeros, where homing ends, the "
            "sum is 53.5 mm, and 50 is the highest: move a zero, or the bound",
        ),
        (
            "travel_mm: [-43.5, 23.5]",
            "travel_mm: [-70.0, 50.0]",
            "axes[4].travel_mm: the coupled limits leave only [-63, 43] of it: write that, and the "
            "drive keeps it without anybody's help",
        ),
    ],
)
def test_what_does_not_fit_is_told(tmp_path: Path, old: str, new: str, expected: str) -> None:
    problems = problems_of(tmp_path, TUBES, (old, new))
    texts = [problem.split(":", 2)[2].strip() for problem in problems]
    assert expected in texts
    line = int(problems[texts.index(expected)].split(":")[0])
    first, last = (
        next(number for number, text in enumerate(TEXT.splitlines(), 1) if text.startswith(key))
        for key in ("coupled_limits:", "homing_order:")
    )
    assert (first < line < last) == expected.startswith("coupled_limits")


def test_limits_that_exclude_each_other_are_told_at_the_one_that_leaves_no_room(
    tmp_path: Path,
) -> None:
    other = "  - {name: other, reason: it is so, kind: length, sum: {d_31: 2.0}, highest_mm: 0.9}\n"
    (problem,) = problems_of(tmp_path, TUBES, ("homing_order:", f"{other}homing_order:"))
    assert problem.endswith(
        "coupled_limits[2]: nowhere within the axes' travels can 'other' be kept, beside "
        "'collar_clearance', 'snap_guard'"
    )


def test_a_limit_may_be_kept_beside_its_band_alone(tmp_path: Path) -> None:
    """No carriage comes so far out, but the tubes can be turned away."""
    file = tmp_path / "robot.yaml"
    turned_away = TEXT.replace(GUARD, GUARD.replace("25.0", "500.0"))
    file.write_text(turned_away)
    assert load_robot(file).robot.coupled_limits[1].lowest == 500.0
    always = turned_away.replace("within_rad: 1.2", "within_rad: 3.1, comes_round: false")
    always = always.replace("near_rad: 3.1416", "near_rad: 0.0")
    (problem,) = problems_of(tmp_path, TUBES, (TEXT, always.replace("6.2832", "1.5")))
    assert "coupled_limits[1]: nowhere within the axes' travels can 'snap_guard' be kept" in problem


def test_a_drive_that_goes_its_own_way_cannot_keep_a_coupled_limit(tmp_path: Path) -> None:
    problems = problems_of(
        tmp_path,
        TUBES,
        ("drive: {<<: *drive, node: 4}", "drive: {<<: *drive, node: 4, mode: pp}"),
    )
    assert any(
        "the drive of 'carriage_pair' is in mode pp and goes its own way" in p for p in problems
    )


def test_axes_that_share_a_coupled_limit_are_homed_one_after_the_other(tmp_path: Path) -> None:
    (problem,) = problems_of(
        tmp_path,
        TUBES,
        ("[[carriage_pair], [carriage_inner],", "[[carriage_inner, carriage_pair],"),
    )
    assert problem.endswith(
        "homing_order[0]: carriage_pair and carriage_inner share the coupled limit "
        "'collar_clearance', which counts on one of them standing still: home one after the other"
    )


def test_axes_of_one_limit_go_on_equally_long_when_nothing_is_sent_any_more(tmp_path: Path) -> None:
    """Else the one that stops first leaves the other to go beyond."""
    faster = "mode: csv, setpoint_timeout_s: 0.4"
    only_one = ("drive: {<<: *drive, node: 4}", f"drive: {{<<: *drive, node: 4, {faster}}}")
    problems = problems_of(tmp_path, TUBES, only_one)
    expected = (
        "coupled_limits[0]: when nothing is sent any more, 'carriage_pair' goes on for 0.4 s and "
        "'carriage_inner' for 0 s: give axes that are coupled the same mode and setpoint_timeout_s"
    )
    assert any(expected in problem for problem in problems), problems
    file = tmp_path / "together.yaml"
    node = "      node: 1\n"
    assert TEXT.count(node) == 1
    file.write_text(TEXT.replace(node, f"{node}      mode: csv\n      setpoint_timeout_s: 0.4\n"))
    assert {axis.drive.goes_on_s for axis in load_robot(file).robot.axes} == {0.4}
