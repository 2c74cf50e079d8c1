"""What the pages tell people to type is understood, and the files it names are there."""

import re
from pathlib import Path

import pytest

from daemon.commands.terminal.command_line import main, parsed
from tests.docs.blocks import ROOT, blocks_of, commands_of, pages, prose_of, words_of

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


QUICK = frozenset({"certificates", "check", "environment", "init", "plugins", "service"})
"""Commands of a second at most; `make hil` runs the others."""


def quick_lines(page: str) -> list[str]:
    """Commands that are run in one folder, in their order."""
    blocks = [block for block in blocks_of(page, "sh") if block.mark in {"run", "long"}]
    lines = [line for block in blocks for line in block.commands]
    return [line for line in lines if line.split()[1] in QUICK or line.endswith("--list")]


@pytest.mark.parametrize("page", [page for page in PAGES if quick_lines(page)])
def test_quick_commands_end_well_in_an_empty_folder(
    page: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    for line in quick_lines(page):
        if line.startswith("tentacled inject"):  # asks a lab
            continue
        try:
            code: object = main(words_of(line))
        except SystemExit as end:
            code = end.code
        assert code == 0, f"{line}: {capsys.readouterr()}"


def test_make_has_the_targets_that_are_named() -> None:
    targets = set(re.findall(r"(?m)^([a-z]+):", (ROOT / "Makefile").read_text()))
    named = {line.split()[1] for _, line in COMMANDS if line.startswith("make ")}
    for page in PAGES:
        named |= set(re.findall(r"`make ([a-z]+)`", prose_of(page)))
    assert named
    assert named <= targets
