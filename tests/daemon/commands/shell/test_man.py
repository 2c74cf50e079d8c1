"""Manual pages: one for each command, with all that it takes; groff reads them and is content."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from daemon.commands.outcome.exit_codes import EXIT_OK, EXIT_USAGE, MEANINGS
from daemon.commands.shell.roff import manual_pages
from daemon.commands.terminal.command_line import command_parser, leaves, main

PAGES = manual_pages()
LEAVES = dict(leaves(command_parser()))


def test_each_command_has_a_page_with_all_that_it_takes() -> None:
    assert set(PAGES) == {
        "tentacled.1",
        *(f"tentacled-{name.replace(' ', '-')}.1" for name in LEAVES),
    }
    for name, leaf in LEAVES.items():
        page = PAGES[f"tentacled-{name.replace(' ', '-')}.1"].replace("\\", "")
        for action in leaf._actions:
            for option in set(action.option_strings) - {"-h", "--help"}:
                assert option in page, (name, option)
        assert f"tentacled-{name.replace(' ', '-')}" in PAGES["tentacled.1"].replace("\\", "")


def test_the_exit_codes_are_in_every_page() -> None:
    for page in PAGES.values():
        for code in MEANINGS:
            assert f"\n\\fB{code}\\fR\n" in page


@pytest.mark.skipif(shutil.which("groff") is None, reason="groff is not here")
@pytest.mark.parametrize("name", PAGES)
def test_groff_reads_it_without_complaint(name: str) -> None:
    words = ["groff", "-man", "-ww", "-Tutf8"]
    done = subprocess.run(words, input=PAGES[name], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    assert "EXIT STATUS" in re.sub(".\b", "", done.stdout)  # bold is struck twice


def test_the_command_writes_them_all_or_prints_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["man", "--write", str(tmp_path)]) == EXIT_OK
    assert {path.name for path in (tmp_path / "man1").iterdir()} == set(PAGES)
    capsys.readouterr()
    assert main(["man", "tentacled-run"]) == EXIT_OK
    assert capsys.readouterr().out.strip() == PAGES["tentacled-run.1"].strip()
    assert main(["man", "tentacled-rnu"]) == EXIT_USAGE
