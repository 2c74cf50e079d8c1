"""Places as arguments of commands, numbers with commas between: `--to -10,5,190`."""

import argparse
import re
from collections.abc import Callable
from typing import Final

_NEGATIVE: Final = re.compile(r"^-[\d.].*$")
_LARGEST: Final = 1e5


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
