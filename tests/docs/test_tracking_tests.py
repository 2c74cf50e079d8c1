"""What docs/tracking-tests.md shows of a failing test is what pytest says.

`python -m tests.docs.test_tracking_tests` prints what is to stand there.
"""

import os
import re
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import pytest

from tests.docs.blocks import ROOT, blocks_of

PAGE: Final = "docs/tracking-tests.md"
_NUMBER: Final = re.compile(r"\d+\.\d+")
_CLOSE: Final = 0.03
"""Another processor may round otherwise, and take a step more."""


def shown() -> dict[str, str]:
    """The page's blocks by their language."""
    return {block.language: block.text for block in blocks_of(PAGE, "yaml", "python", "text")}


def said(folder: Path) -> str:
    """By pytest, of the page's test; without how long it took and where its folders are."""
    page = shown()
    (folder / "circle.yaml").write_text(page["yaml"])
    (folder / "test_circle.py").write_text(page["python"])
    plugin = ["-p", "no:tentacled", "-p", "daemon.testing.pytest_plugin"]
    quiet = ["-p", "no:cacheprovider", "-p", "no:randomly", f"--basetemp={folder / 'tmp'}", "-q"]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *plugin, *quiet, "--tentacled-artifacts", "kept"],
        cwd=folder,
        env=_at_a_terminal(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1, done.stdout + done.stderr
    text = done.stdout.replace(f"{folder}/", "").replace(str(folder), ".")
    text = re.sub(r"0x[0-9a-f]+", "0x…", text)
    text = re.sub(r"\d+ failed in [\d.]+s.*", "1 failed", text)
    return "\n".join(line.rstrip() for line in text.strip().splitlines())


def _at_a_terminal() -> dict[str, str]:
    """What pytest does not shorten on a CI server (its documentation names the two variables)."""
    environment = {k: v for k, v in os.environ.items() if k not in ("CI", "BUILD_NUMBER")}
    return environment | {"PYTHONPATH": str(ROOT), "COLUMNS": "80", "PYTEST_ADDOPTS": ""}


@pytest.mark.long
def test_a_failing_test_says_what_the_page_shows(tmp_path: Path) -> None:
    now, then = said(tmp_path), shown()["text"].strip()
    assert _NUMBER.sub("N", now) == _NUMBER.sub("N", then), now
    figures = [[float(number) for number in _NUMBER.findall(text)] for text in (now, then)]
    assert figures[0] == pytest.approx(figures[1], rel=_CLOSE)


if __name__ == "__main__":
    with TemporaryDirectory() as name:
        print(said(Path(name).resolve()))
