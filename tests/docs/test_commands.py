"""What the pages tell people to type is understood, and the files it names are there."""

import re

import pytest

from daemon.commands.terminal.command_line import parsed
from tests.docs.blocks import ROOT, commands_of, pages, prose_of, words_of

PAGES = [page for page in pages() if "/reference/" not in page]
COMMANDS = list(dict.fromkeys((page, line) for page in PAGES for line in commands_of(page)))
OURS = [(page, line) for page, line in COMMANDS if line.startswith("tentacled ")]


def test_there_are_examples_of_everything() -> None:
    assert len(OURS) >= 35
    used = {line.split()[1] for _, line in OURS}
    for word in ("emulate", "probe", "run", "status", "load", "experiment", "explore", "mdn"):
        assert word in used


@pytest.mark.parametrize(("page", "line"), OURS)
def test_a_command_is_understood(page: str, line: str) -> None:
    assert page
    try:
        parsed(words_of(line))
    except SystemExit as end:  # as `--list` ends
        assert end.code == 0


@pytest.mark.parametrize(("page", "line"), OURS)
def test_the_shipped_files_that_a_command_names_are_there(page: str, line: str) -> None:
    for word in line.split():
        if word.startswith("config/"):
            assert (ROOT / word).is_file(), page


def test_make_has_the_targets_that_are_named() -> None:
    targets = set(re.findall(r"(?m)^([a-z]+):", (ROOT / "Makefile").read_text()))
    named = {line.split()[1] for _, line in COMMANDS if line.startswith("make ")}
    for page in PAGES:
        named |= set(re.findall(r"`make ([a-z]+)`", prose_of(page)))
    assert named
    assert named <= targets
