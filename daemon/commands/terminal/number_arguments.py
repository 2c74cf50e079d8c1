"""Numbers as arguments of commands. argparse tells what is wrong with one."""

import argparse
import math
from collections.abc import Callable
from typing import Final

_LONGEST_S: Final = 604_800.0
"""That somebody may want to wait: a week."""
_DIGITS: Final = 18


def whole_number(least: int, most: int) -> Callable[[str], int]:
    """For an argument that counts or names something."""

    def read(text: str) -> int:
        digits = text.removeprefix("-")
        readable = digits.isascii() and digits.isdecimal() and len(digits) < _DIGITS
        if not readable or not least <= int(text) <= most:
            raise argparse.ArgumentTypeError(f"{text!r} is no whole number from {least} to {most}")
        return int(text)

    return read


port_number: Final = whole_number(0, 65_535)
"""Of TCP; 0 is any that is free."""


def seed_number(text: str) -> int:
    """Of what is drawn at random. Raises ArgumentTypeError."""
    try:
        number = int(text)
    except ValueError:
        number = -1
    if number < 0:
        raise argparse.ArgumentTypeError(f"{text!r} is no seed: 0, 1, 2, ...")
    return number


def seconds(text: str) -> float:
    """A time to wait, as it is written. Raises ArgumentTypeError."""
    return _time(text, 0.0)


def cycle_seconds(text: str) -> float:
    """How long once round a path takes. Raises ArgumentTypeError."""
    return _time(text, 1.0)


def _time(text: str, least_s: float) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not least_s <= value <= _LONGEST_S:
        span = f"from {least_s:g} to {_LONGEST_S:.0f} s"
        raise argparse.ArgumentTypeError(f"{text!r} is no time {span}")
    return value
