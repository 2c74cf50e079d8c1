"""Numbers and places as arguments of commands. argparse tells what is wrong with one."""

import argparse
import math
import re
from collections.abc import Callable
from typing import Final

_LONGEST_S: Final = 604_800.0
"""That somebody may want to wait: a week."""
_DIGITS: Final = 18
_NEGATIVE: Final = re.compile(r"^-[\d.].*$")
_LARGEST: Final = 1e5


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


# Places: numbers with commas between, `--to -10,5,190`.


def take_negative_numbers(parser: argparse.ArgumentParser) -> None:
    """So that what begins with a minus is no unknown option."""
    parser._negative_number_matcher = _NEGATIVE  # noqa: SLF001


def numbers(text: str) -> tuple[float, ...]:
    """As many as there are. Raises ArgumentTypeError."""
    try:
        values = tuple(float(word) for word in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not numbers with commas between") from None
    if not all(abs(value) < _LARGEST for value in values):
        raise argparse.ArgumentTypeError(f"'{text}' is not finite, or too large")
    return values


def so_many(count: int, names: str) -> Callable[[str], tuple[float, ...]]:
    """For an argument of `count` numbers, which the names tell."""

    def read(text: str) -> tuple[float, ...]:
        values = numbers(text)
        if len(values) != count:
            raise argparse.ArgumentTypeError(f"'{text}' is not {count} numbers: {names}")
        return values

    return read


def add_goal_arguments(parser: argparse.ArgumentParser) -> None:
    """Where a path that is planned shall lead."""
    place = so_many(3, "X,Y,Z")
    parser.add_argument(
        "--to", type=place, required=True, metavar="X,Y,Z", help="where the tip shall be, mm"
    )
    parser.add_argument(
        "--pointing", type=place, metavar="X,Y,Z", help="which way the tip shall point there"
    )
    parser.add_argument(
        "--via", type=place, action="append", default=[], metavar="X,Y,Z",
        help="a place that the tip passes before; may be said again",
    )  # fmt: skip
