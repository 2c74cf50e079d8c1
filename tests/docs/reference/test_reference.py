"""The pages that are made from the code are what the code is."""

import pytest

from config.documents.kinds import GROUPS, entries
from daemon.remote.access import OPERATOR, User, access_control
from daemon.remote.keys import ANY_ROBOT_ALIVE, Keys
from safety.causes import Cause
from tests.docs.reference import COMMAND, FOLDER, PAGES, page
from tests.docs.reference.markdown import Schema, kind_of_value, schema_table, table


@pytest.mark.parametrize("name", PAGES)
def test_the_written_page_is_the_one_that_the_code_makes(name: str) -> None:
    written = (FOLDER / f"{name}.md").read_text(encoding="utf-8")
    assert written == page(name), f"renew it: {COMMAND}"


def test_there_is_no_other_page() -> None:
    assert sorted(path.stem for path in FOLDER.iterdir()) == sorted(PAGES)


def test_nothing_is_left_out() -> None:
    assert all(f"`{one.value}`" in page("causes") for one in Cause)
    assert all(f"### {kind}\n" in page("kinds") for group in GROUPS for kind in entries(group))
    assert "## tentacled mdn\n" in page("commands")
    assert "### tentacled mdn collect\n" in page("commands")
    assert "| `--despite-contact` |" in page("commands")


def test_every_key_that_a_user_may_use_is_in_the_table() -> None:
    rules = access_control(Keys("robot"), [User("user", OPERATOR)])["rules"]
    keys = {key.removesuffix("/*") for rule in rules for key in rule["key_exprs"]}
    told = page("messages").lower()
    assert "tentacled/robot/obstacles/user" in keys
    assert [key for key in keys - {ANY_ROBOT_ALIVE} if f"| `{key}" not in told] == []


def test_a_table_stands_whatever_is_in_its_cells() -> None:
    assert table(("a", "b"), [("x | y", "two\nlines")]).splitlines() == [
        "| a | b |",
        "| --- | --- |",
        "| x \\| y | two lines |",
    ]


@pytest.mark.parametrize(
    ("schema", "words"),
    [
        (
            {"type": "number", "exclusiveMinimum": 0, "maximum": 4294967295},
            "number, > 0, ≤ 4294967295",
        ),
        ({"enum": ["csp", "csv"]}, "`csp`, `csv`"),
        ({"anyOf": [{"$ref": "#/$defs/Bus"}, {"type": "null"}]}, "[Bus](#bus)"),
        (
            {"type": "array", "items": {"type": "string"}, "minItems": 1},
            "list of string, at least 1",
        ),
        ({"type": "array", "prefixItems": [{"type": "number"}] * 3}, "list of 3: number"),
        ({"type": "object", "patternProperties": {"^a$": {"type": "integer"}}}, "by name: integer"),
    ],
)
def test_a_schema_is_told_in_words(schema: Schema, words: str) -> None:
    assert kind_of_value(schema) == words


def test_what_is_needed_and_what_stands_for_it_are_told() -> None:
    schema = {
        "required": ["port"],
        "properties": {
            "port": {"type": "string", "description": "Where <it> is."},
            "rate": {"type": "integer", "default": 5},
        },
    }
    assert schema_table(schema, told={"rate": "How often."}).splitlines()[2:] == [
        "| `port` | string | needed | Where \\<it\\> is. |",
        "| `rate` | integer | `5` | How often. |",
    ]
