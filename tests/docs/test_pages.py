"""What the pages say is done, in an empty folder, with the installed wheel."""

import ast
import re
import tomllib
from collections.abc import Iterator

import pytest
import yaml

from tests.docs.blocks import MARKS, blocks_of, pages, prose_of, text_of
from tests.docs.running import Installed, installed_for_readers, reader, runnable

PAGES = [page for page in pages() if page != "docs/api.md" and "/reference/" not in page]
SHOWN_ELSEWHERE = frozenset({"docs/tracking-tests.md"})
"""Whose blocks belong together, and are run by a test of their own."""
RUN = [
    page for page in PAGES if runnable(blocks_of(page), long=False) and page not in SHOWN_ELSEWHERE
]
NOT_RUN = {
    "docs/bring-up.md": 3,
    "docs/experiments.md": 1,
    "docs/faults.md": 1,
    "docs/getting-started.md": 2,
    "docs/learning.md": 1,
    "docs/operate.md": 1,
    "docs/planning.md": 1,
    "docs/risk.md": 2,
    "docs/testing.md": 1,
    "README.md": 2,
}
"""How many blocks of a page cannot be run: they need a rig, root, another program, hours, or the
checkout with its make. Whoever adds one looks for another way first."""


@pytest.mark.parametrize("page", PAGES)
def test_blocks_are_of_a_known_language_and_sound(page: str) -> None:
    for block in blocks_of(page):
        match block.language:
            case "python":
                ast.parse(block.text)
            case "yaml":
                yaml.safe_load(block.text)
            case "toml":
                tomllib.loads(block.text)
            case _:
                assert block.language in {"", "text", "sh", "c"}, block
                remark = block.language == "sh" and block.text.startswith("#")
                assert not remark or block.mark in MARKS.values(), block


def test_few_blocks_are_left_out() -> None:
    found = {
        page: sum(block.mark == "not run" for block in blocks_of(page, "sh")) for page in PAGES
    }
    assert {page: number for page, number in found.items() if number} == NOT_RUN


@pytest.fixture(scope="module")
def installed() -> Iterator[Installed]:
    with installed_for_readers() as installed:
        yield installed


@pytest.mark.hil
@pytest.mark.long
@pytest.mark.parametrize("page", RUN)
def test_a_page_can_be_followed(page: str, installed: Installed) -> None:
    with reader(installed) as somebody:
        for block in runnable(blocks_of(page), long=False):
            somebody.reads(block)


def test_a_rig_begins_with_its_emergency_stop_circuit_and_no_stop_of_ours_is_called_one() -> None:
    titles = [line for line in text_of("docs/bring-up.md").splitlines() if line.startswith("## ")]
    assert "emergency stop circuit" in titles[0]
    for page in ("README.md", "docs/bring-up.md", "docs/limits.md", "docs/operate.md"):
        assert re.search(r"(?i)no\b[* ]+emergency stop circuit", prose_of(page)), page
    for page in PAGES:
        for words in re.findall(r"(?i)[\w* ]*emergency stop(?! circuit)[\w ]*", prose_of(page)):
            assert "press" in words.lower() or "hand on" in words.lower(), f"{page}: {words}"
