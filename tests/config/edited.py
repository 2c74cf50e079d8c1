"""Shipped robot files with something in them replaced, and what is wrong with them then."""

from pathlib import Path

import pytest

from config.documents.problems import ConfigError
from config.loader import load_robot


def problems_of(folder: Path, shipped: Path, *changes: tuple[str, str]) -> list[str]:
    """The problems with each first replaced by its second: line:column, key and text."""
    text = shipped.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    file = folder / "robot.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError) as raised:
        load_robot(file)
    return [str(problem).removeprefix(f"{file}:") for problem in raised.value.problems]
