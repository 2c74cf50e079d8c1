"""A short, repeatable round of what `python -m tests.fuzz` does at length."""

import random

import pytest

from tests.fuzz.targets import ALL, WHOLE_DEVICES

ROUNDS = 300


@pytest.mark.parametrize("name", ALL)
def test_arbitrary_bytes_raise_nothing_but_the_codecs_own_error(name: str) -> None:
    source = random.Random(name)
    for _ in range(ROUNDS // (10 if name in WHOLE_DEVICES else 1)):
        ALL[name](source.randbytes(source.randrange(200)))
        printable = bytes(source.choices(range(32, 127), k=source.randrange(60)))
        ALL[name](printable + source.choice([b"\r", b"\n", b""]))


def test_the_names_of_slow_targets_exist() -> None:
    assert set(ALL) >= WHOLE_DEVICES
