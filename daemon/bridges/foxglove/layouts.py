"""Layouts that are shipped: panels with topics that a viewer does not switch on by itself."""

import json
from importlib.resources import files
from typing import Final

VIEWERS: Final = ("foxglove", "lichtblick")
"""Each has a format of its own."""


def layout(viewer: str) -> str:
    """A JSON file's text, of one of VIEWERS."""
    path = files("daemon.bridges.foxglove") / "layouts" / f"{viewer}.json"
    text = path.read_text(encoding="utf-8")
    json.loads(text)
    return text
