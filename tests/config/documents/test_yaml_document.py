"""YAML is read once, with places, and its surprises are named."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from config.documents.yaml_document import parse_yaml


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("off", "write false, or 'off' for the text"),
        ("Yes", "write true, or 'Yes' for the text"),
        ("on", "write true, or 'on' for the text"),
        ("1e3", "write 1000 for the number"),
        ("-2.5E3", "write -2500 for the number"),
        ("1_0e1", "write 100 for the number"),
        ("0o17", "write 15"),
        ("010", "octal"),
        ("12:30:45", "base 60"),
        ("2020-01-01", "quote it as text"),
        ("0b", ""),
    ],
)
def test_what_yaml_1_1_reads_otherwise_is_refused_with_the_right_spelling(
    text: str, meant: str
) -> None:
    problems = parse_yaml(f"key: {text}\n", "f.yaml").problems
    if not meant:
        assert problems == []
        return
    (problem,) = problems
    assert (problem.line, problem.column, problem.key_path) == (1, 6, "key")
    assert meant in problem.message


@pytest.mark.parametrize("text", ["true", "False", "'off'", '"1e3"', "1000", "1.0e+3", "0", "~"])
def test_plain_spellings_pass(text: str) -> None:
    assert parse_yaml(f"key: {text}\n", "f.yaml").problems == []


def test_a_key_that_stands_twice_is_refused_where_it_stands_again() -> None:
    document = parse_yaml("a: 1\nb:\n  c: 1\n  c: 2\na: 3\n", "f.yaml")
    assert sorted((p.line, p.column, p.key_path) for p in document.problems) == [
        (4, 3, "b.c"),
        (5, 1, "a"),
    ]


def test_merged_mappings_give_way_to_keys_that_stand_here() -> None:
    text = "x: &x {a: 1, b: 2}\ny: &y {<<: *x, b: 3}\nz: {<<: [*y, *x], c: 4}\n"
    document = parse_yaml(text, "f.yaml")
    assert document.problems == []
    assert document.value == {
        "x": {"a": 1, "b": 2},
        "y": {"a": 1, "b": 3},
        "z": {"a": 1, "b": 3, "c": 4},
    }


def test_a_problem_in_a_merged_value_points_to_where_it_is_written() -> None:
    document = parse_yaml("x: &x\n  a: 1\ny: {<<: *x}\n", "f.yaml")
    assert document.problem(("y", "a"), "bad").line == 2


@pytest.mark.parametrize(
    "text",
    [
        "a: &a {b: *a}",
        "a: &a {b: &b {<<: *a}, <<: *b}",
        "&a {<<: *a}",
        "? [1, 2]\n: 3",
        "a: b: c",
        "\t- 1",
        "a: \x07",
        "",
        "--- 1\n--- 2",
        "[" * 5000,
        "a: !!python/object:os.system {}",
        "a: !!int x",
        "a: <<\n<<: 3",
    ],
)
def test_what_cannot_be_read_is_a_problem_and_never_an_exception(text: str) -> None:
    assert parse_yaml(text, "f.yaml").problems


def test_aliases_of_aliases_end() -> None:
    lines = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 9)]
    document = parse_yaml("\n".join(lines), "f.yaml")
    assert any("more than 100000 values" in problem.message for problem in document.problems)


@given(st.text(alphabet="abk:-{}[]&*!#|>'\"%@ \n\t0123.eE<,?~") | st.text())
def test_any_text_is_read_without_an_exception(text: str) -> None:
    parse_yaml(text, "f.yaml")
