"""What README tells people to type: commands are understood, and the files they name are there."""

import re
import shlex
import textwrap
from pathlib import Path

import pytest

from daemon.commands.terminal.command_line import parsed

ROOT = Path(__file__).parents[3]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(kind: str) -> list[str]:
    """The code blocks of a kind, without the indentation of what they stand in."""
    found: list[str] = []
    block: list[str] | None = None
    opened = ""
    for line in README.splitlines():
        bare = line.strip()
        if not bare.startswith("```"):
            if block is not None:
                block.append(line)
        elif block is None:
            opened, block = bare.removeprefix("```"), []
        else:
            found += [textwrap.dedent("\n".join([*block, ""]))] if opened == kind else []
            block = None
    return found


def shell_lines() -> list[str]:
    """Each command of the shell examples, whole and without its comment."""
    text = "\n".join([*blocks("sh"), *blocks("")]).replace("\\\n", " ")
    lines = [line.removeprefix("$ ").strip() for line in text.splitlines()]
    bare = [re.sub(r" +#.*$", "", line) for line in lines]
    parts = [part.strip() for line in bare for part in line.split(";")]
    return [part for part in parts if part.startswith(("tentacled ", "make "))]


def inline_commands() -> list[str]:
    """Commands with words of their own that stand in the text."""
    prose = re.sub(r"(?ms)^ *```.*?^ *```$", "", README)
    return sorted(set(re.findall(r"`(tentacled [a-z]+ [^`]+)`", " ".join(prose.split()))))


def commands() -> list[str]:
    found = [*shell_lines(), *inline_commands()]
    return list(dict.fromkeys(line for line in found if line.startswith("tentacled ")))


def test_there_are_examples_of_everything() -> None:
    assert len(commands()) >= 35
    used = {line.split()[1] for line in commands()}
    for word in ("emulate", "probe", "run", "status", "load", "experiment", "explore", "mdn"):
        assert word in used


@pytest.mark.parametrize("line", commands())
def test_a_command_is_understood(line: str) -> None:
    parsed(shlex.split(line)[1:])


@pytest.mark.parametrize("line", commands())
def test_the_shipped_files_that_a_command_names_are_there(line: str) -> None:
    for word in line.split():
        if word.startswith("config/"):
            assert (ROOT / word).is_file()


def test_make_has_the_targets_that_are_named() -> None:
    targets = set(re.findall(r"(?m)^([a-z]+):", (ROOT / "Makefile").read_text()))
    named = {line.split()[1] for line in shell_lines() if line.startswith("make ")}
    named |= set(re.findall(r"`make ([a-z]+)`", README))
    assert named
    assert named <= targets


def test_links_lead_to_files_and_headings() -> None:
    headings = {
        re.sub(r"[^a-z0-9 -]", "", title.lower()).replace(" ", "-")
        for title in re.findall(r"(?m)^#+ (.*)$", README)
    }
    for link in re.findall(r"\]\(([^)]+)\)", README):
        if link.startswith("#"):
            assert link[1:] in headings
        elif not link.startswith("http"):
            assert (ROOT / link).exists(), link
