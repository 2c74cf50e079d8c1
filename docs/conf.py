"""The site of these pages: `make docs`. Its navigation is the list in `index.md`."""

import re
from collections.abc import Iterator
from importlib.metadata import version as version_of

from sphinx.application import Sphinx

project = "tentacled"
author = "tentacled"
version = release = version_of("tentacled")

extensions = ["myst_parser"]
myst_heading_anchors = 4
nitpicky = True
highlight_language = "text"

html_theme = "furo"
html_title = "tentacled"
html_copy_source = False
html_show_copyright = False
html_show_sphinx = False


def navigation(text: str) -> Iterator[str]:
    """A hidden table of contents for each section of the list of pages."""
    for section in text.split("\n## ")[1:]:
        title, _, body = section.partition("\n")
        found = re.findall(r"\[[^\]]+\]\(([^)#]+)\.md\)", body)
        if found:
            yield "\n".join(
                ["", "```{toctree}", ":hidden:", f":caption: {title}", "", *found, "```"]
            )


def add_navigation(app: Sphinx, name: str, source: list[str]) -> None:
    """Where the pages are listed they are also put into the site's navigation."""
    del app
    if name == "index":
        source[0] += "\n".join(navigation(source[0]))


def setup(app: Sphinx) -> None:
    """Called by Sphinx."""
    app.connect("source-read", add_navigation)
