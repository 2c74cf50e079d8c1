"""The faults themselves: that they are made, one at a time, and that the list of them is true."""

import ast

import pytest

from tests.mutation.__main__ import EQUIVALENT, all_names, read_equivalent
from tests.mutation.mutants import mutants_of, names_of

SOURCE = '''
"""Words."""
LIMIT: Final = 3


def clip(a: int, b: int | None) -> int:
    """More words."""
    if a < b and not a == 2.0:
        self.a = a - 1
        return max(a, b)
    return None
'''
FAULTS = [
    "module: 3 -> 4",
    "clip: if a < b and (not a == 2.0) -> if True",
    "clip: if a < b and (not a == 2.0) -> if False",
    "clip: a < b and (not a == 2.0) -> a < b or not a == 2.0",
    "clip: a < b and (not a == 2.0) -> not a == 2.0",
    "clip: a < b and (not a == 2.0) -> a < b",
    "clip: a < b -> a <= b",
    "clip: a < b -> a >= b",
    "clip: not a == 2.0 -> a == 2.0",
    "clip: a == 2.0 -> a != 2.0",
    "clip: 2.0 -> 3.5",
    "clip: self.a = a - 1 -> pass",
    "clip: a - 1 -> a + 1",
    "clip: 1 -> 2",
    "clip: return max(a, b) -> return None",
    "clip: max(a, b) -> min(a, b)",
]


def test_every_part_of_a_file_has_its_faults() -> None:
    assert [mutant.name for mutant in mutants_of(SOURCE)] == FAULTS
    assert list(names_of(SOURCE)) == FAULTS


def test_a_mutant_has_one_fault_and_the_others_none_of_it() -> None:
    sound = ast.unparse(ast.parse(SOURCE)).splitlines()
    for mutant in mutants_of(SOURCE):
        faulty = mutant.source.splitlines()
        differ = [number for number, line in enumerate(sound) if line != faulty[number]]
        assert len(differ) == 1, mutant.name


def test_a_mutant_knows_its_line() -> None:
    lines = {mutant.name: mutant.line for mutant in mutants_of(SOURCE)}
    assert lines["module: 3 -> 4"] == 3
    assert lines["clip: self.a = a - 1 -> pass"] == 9
    assert lines["clip: max(a, b) -> min(a, b)"] == 10


def test_faults_that_read_alike_are_told_apart() -> None:
    assert [mutant.name for mutant in mutants_of("a = x + x\nb = x + x\n")] == [
        "module: x + x -> x - x",
        "module: x + x -> x - x #2",
    ]


def test_a_fault_on_the_list_has_a_reason() -> None:
    text = "# a remark\n\na: x -> y\n    because\n    of this\nb: x -> y\n    of that\n"
    assert read_equivalent(text) == {"a: x -> y": "because of this ", "b: x -> y": "of that "}
    with pytest.raises(ValueError, match="no reason is given for a: x -> y"):
        read_equivalent("a: x -> y\nb: x -> y\n    of that\n")


def test_what_is_on_the_list_is_still_in_the_source() -> None:
    assert set(read_equivalent(EQUIVALENT.read_text())) <= all_names()
