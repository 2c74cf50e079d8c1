"""What is given to one worker, and what may be divided."""

import pytest

from tests.distribution import FileScheduling, piece_of

SECONDS = {"tests/test_quick.py": 0.5, "tests/test_long.py": 30.0}


@pytest.mark.parametrize("file", ["tests/test_quick.py", "tests/test_that_nobody_measured.py"])
def test_tests_of_a_file_go_to_one_worker(file: str) -> None:
    one, other = (piece_of(f"{file}::{test}", SECONDS) for test in ("test_a", "test_b[x::y]"))
    assert one == other == file


@pytest.mark.parametrize("file", ["tests/test_long.py", "tests/hil/test_stalls.py"])
def test_tests_of_a_long_file_and_those_in_real_time_are_divided(file: str) -> None:
    one, other = (piece_of(f"{file}::{test}", SECONDS) for test in ("test_a", "test_b"))
    assert one != other


def test_a_group_that_tests_name_stays_together_across_files() -> None:
    names = ("tests/test_quick.py::test_a@arm", "tests/test_long.py::test_b@arm")
    asked = FileScheduling.__new__(FileScheduling)  # workers are of no matter here
    asked._seconds = SECONDS
    assert {asked._split_scope(name) for name in names} == {"arm"}
    assert asked._split_scope("tests/test_quick.py::test_a") == "tests/test_quick.py"
