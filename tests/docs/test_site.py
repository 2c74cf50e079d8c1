"""`make docs`: a site that needs no network, and that is not built with a dead link."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.blocks import ROOT, pages

DOCS = ROOT / "docs"


def built(source: Path, site: Path) -> subprocess.CompletedProcess[str]:
    options = ("--fail-on-warning", "--keep-going", "--quiet")
    return subprocess.run(
        [sys.executable, "-m", "sphinx", *options, str(source), str(site)],
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.long
def test_it_is_built_without_a_warning_and_fetches_nothing(tmp_path: Path) -> None:
    told = built(DOCS, tmp_path)
    assert (told.returncode, told.stderr) == (0, "")
    for page in pages():
        if page.startswith("docs/"):
            name = page.removeprefix("docs/").removesuffix(".md")
            text = (tmp_path / f"{name}.html").read_text(encoding="utf-8")
            assert 'class="toctree-l1"' in text, page
            assert not re.findall(r'<(?:script|img|link)[^>]* (?:src|href)="(?:https?:)?//', text)


def test_a_dead_link_ends_it(tmp_path: Path) -> None:
    source = tmp_path / "docs"
    source.mkdir()
    shutil.copy(DOCS / "conf.py", source)
    (source / "index.md").write_text("# Site\n\n## Use\n\n- [A page](page.md)\n")
    (source / "page.md").write_text("# A page\n\n[There](index.md#use), [nowhere](index.md#us).\n")
    told = built(source, tmp_path / "site")
    assert told.returncode != 0
    assert re.findall(r"'(\w+)'", told.stderr) == ["index", "us"]
