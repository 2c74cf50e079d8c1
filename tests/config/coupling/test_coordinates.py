"""Coordinates of a robot file: what they must be to the axes, and where a file is told wrong."""

from math import pi
from pathlib import Path

import pytest

from config.loader import load_robot
from tests import SHIPPED_ROBOTS, SOFT_ARM
from tests.config.edited import problems_of

TUBES = SHIPPED_ROBOTS / "concentric_tubes.yaml"


def test_the_tubes_are_seen_as_the_paper_has_them() -> None:
    coordinates = load_robot(TUBES).robot.coordinates
    assert [(q.name, q.unit, q.period) for q in coordinates] == [
        ("roll", "rad", None),
        ("alpha_21", "rad", 2 * pi),
        ("alpha_31", "rad", 2 * pi),
        ("insertion", "mm", None),
        ("d_31", "mm", None),
    ]
    assert [q.at_zero for q in coordinates] == [0.0, 0.0, 0.0, 0.0, 53.5]


def test_a_robot_needs_none() -> None:
    assert load_robot(SOFT_ARM).robot.coordinates == []


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (
            "moves: {rotation_2: 1.0}",
            "moves: {rotatoin_2: 1.0}",
            "coordinates[1].moves.rotatoin_2: there is no axis 'rotatoin_2' "
            "(did you mean 'rotation_2'?)",
        ),
        (
            "moves: {rotation_2: 1.0}",
            "moves: {carriage_inner: 1.0}",
            "coordinates[1].moves.carriage_inner: 'carriage_inner' is in mm, and 'alpha_21' in "
            "rad: an angle moves axes of its unit",
        ),
        (
            "moves: {carriage_inner: 1.0}",
            "moves: {rotation_1: 1.0}",
            "coordinates[4].moves.rotation_1: 'rotation_1' is in rad, and 'd_31' in mm: a length "
            "moves axes of its unit",
        ),
        (
            "moves: {rotation_2: 1.0}",
            "moves: {rotation_2: 1.0, rotation_1: 0.0}",
            "coordinates[1].moves.rotation_1: 0 moves nothing: leave it out",
        ),
        (
            "moves: {rotation_2: 1.0}",
            "moves: {rotation_3: 2.0}",
            "coordinates[2].moves: 'alpha_31' moves the axes as the others do together: nobody "
            "could tell them apart",
        ),
        (
            "moves: {carriage_inner: 1.0}",
            "moves: {carriage_pair: 1.0, carriage_inner: 1.0}",
            "coordinates[4].moves: 'd_31' moves the axes as the others do together: nobody could "
            "tell them apart",
        ),
        (
            "name: alpha_31",
            "name: alpha_21",
            "coordinates[2].name: there is already a coordinate 'alpha_21'",
        ),
        (
            "name: alpha_31",
            "name: rotation_1",
            "coordinates[2].name: there is already an axis 'rotation_1'",
        ),
        (
            "name: alpha_31",
            "name: alpha_31, at_zero_mm: 1.0",
            "coordinates[2].at_zero_mm: unknown key (did you mean 'at_zero_rad'?)",
        ),
    ],
)
def test_what_does_not_fit_is_told(tmp_path: Path, old: str, new: str, expected: str) -> None:
    problems = problems_of(tmp_path, TUBES, (old, new))
    line, column, text = problems[0].split(":", 2)
    assert text.strip() == expected
    first = TUBES.read_text().split("\ncoordinates:")[0].count("\n") + 3
    assert int(line) == first + int(expected[len("coordinates[")])
    assert int(column) > 1


def test_there_are_as_many_as_axes_and_each_axis_is_moved(tmp_path: Path) -> None:
    last = TUBES.read_text().split("coordinates:")[1].split("\n\n")[0].splitlines()[-1]
    assert any(
        "coordinates: 4 coordinates cannot say where 5 axes are" in problem
        for problem in problems_of(tmp_path, TUBES, (last, ""))
    )
    still = "moves: {rotation_1: 1.0, rotation_2: 1.0, rotation_3: 1.0}"
    assert any(
        "coordinates: none of them moves the axis 'rotation_1'" in problem
        for problem in problems_of(
            tmp_path, TUBES, (still, "moves: {rotation_2: 1.0, rotation_3: 1.0}")
        )
    )
