"""Links between the pages lead to files and headings that are there."""

import re
from importlib.util import find_spec

import pytest

from tests.benchmarks.__main__ import PARTS
from tests.docs.blocks import ROOT, pages, text_of


def anchors(page: str) -> set[str]:
    """What GitHub and the site call the headings of a page."""
    bare = re.sub(r"(?ms)^ *```.*?^ *```$", "", text_of(page))
    return {
        re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-")
        for title in re.findall(r"(?m)^#+ (.*)$", bare)
    }


@pytest.mark.parametrize("page", pages())
def test_links_lead_to_files_and_headings(page: str) -> None:
    bare = re.sub(r"(?ms)^ *```.*?^ *```$", "", text_of(page))
    for link in re.findall(r"\]\(([^)\s]+)\)", bare):
        if link.startswith(("http:", "https:")):
            continue
        name, _, anchor = link.partition("#")
        target = ((ROOT / page).parent / name).resolve() if name else ROOT / page
        assert target.exists(), link
        assert target.is_relative_to(ROOT), link
        if anchor:
            assert anchor in anchors(target.relative_to(ROOT).as_posix()), link


def test_every_page_is_listed() -> None:
    """The list is the site's navigation, too: `docs/conf.py`."""
    listed = re.findall(r"\]\(([^)#]+\.md)\)", text_of("docs/index.md"))
    there_are = {page.removeprefix("docs/") for page in pages()} - {"README.md", "index.md"}
    assert set(listed) == there_are
    assert len(listed) == len(set(listed))


@pytest.mark.parametrize("page", [page for page in pages() if "/reference/" not in page])
def test_files_and_programs_that_are_named_are_there(page: str) -> None:
    folders = "config|safety|drivers|sim_backends|daemon|tests|docs"
    for name in re.findall(rf"`((?:{folders})/[\w./-]*)`", text_of(page)):
        assert (ROOT / name).exists(), name
    for module, words in re.findall(r"python -m (tests[\w.]*)((?: [a-z]\w*)*)", text_of(page)):
        assert find_spec(module) is not None, module
        if module == "tests.benchmarks":
            assert set(words.split()) <= set(PARTS), words
