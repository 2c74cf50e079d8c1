"""Waypoint files: every bad line is told, with its place."""

from pathlib import Path

import numpy as np
import pytest

from daemon.reference.waypoints import WaypointError, read_waypoints


def written(tmp_path: Path, text: str | bytes) -> Path:
    path = tmp_path / "way.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def problems(path: Path, *, closed: bool = False) -> tuple[str, ...]:
    with pytest.raises(WaypointError) as caught:
        read_waypoints(path, closed=closed)
    return caught.value.problems


def test_comments_blank_lines_and_a_byte_order_mark_are_passed_over(tmp_path: Path) -> None:
    text = "\ufeff# made by hand\n\nt,x,y,z\n5,1,2,3\n\n# half-way\n6.5, 4, 5, 6\n"
    times, points = read_waypoints(written(tmp_path, text), closed=False)
    np.testing.assert_array_equal(times, [0.0, 1.5])
    np.testing.assert_array_equal(points, [[1, 2, 3], [4, 5, 6]])


def test_words_may_be_quoted_as_tables_are_often_written(tmp_path: Path) -> None:
    path = written(tmp_path, '"t","x","y","z"\n"0","1","2","3"\n5,4,5,6\n')
    times_s, points_mm = read_waypoints(path, closed=False)
    assert (times_s.tolist(), points_mm.tolist()) == ([0, 5], [[1, 2, 3], [4, 5, 6]])


def test_every_bad_line_is_told_with_its_number(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        "t, x, y, z\n0, 0, 0, 180\n1, 0, zero, 180\n2, 0, 180\n3, nan, 0, 180\n"
        "0, 1, 1, 180\n4, 1, 1, 1\n",
    )
    assert problems(path) == (
        f"{path}:3: y is not a number",
        f"{path}:4: needs 4 numbers, and has 3",
        f"{path}:5: x is not finite",
        f"{path}:6: t is not after the one before",
    )


def test_the_header_says_what_the_columns_are(tmp_path: Path) -> None:
    path = written(tmp_path, "x, y, z, t\n0,0,0,0\n1,1,1,1\n")
    (problem,) = problems(path)
    assert problem.startswith(f"{path}:1: the header must be `t, x, y, z`")


@pytest.mark.parametrize("text", ["", "t,x,y,z\n", "t,x,y,z\n0,1,2,3\n"])
def test_one_point_is_no_way(tmp_path: Path, text: str) -> None:
    (problem,) = problems(written(tmp_path, text))
    assert "needs two points or more" in problem


def test_what_is_repeated_must_close(tmp_path: Path) -> None:
    path = written(tmp_path, "t,x,y,z\n0,0,0,180\n1,5,0,180\n2,0.5,0,180\n")
    assert read_waypoints(path, closed=False)[0][-1] == 2.0
    (problem,) = problems(path, closed=True)
    assert problem.startswith(f"{path}:4: ")
    assert "0.50 mm apart" in problem


def test_a_file_that_cannot_be_read_is_told(tmp_path: Path) -> None:
    assert "No such file" in problems(tmp_path / "absent.csv")[0]
    assert "not UTF-8" in problems(written(tmp_path, b"t,x,y,z\n\xff\xfe"))[0]
    assert len(problems(tmp_path)) == 1
