"""The argument `--seed`, of what is drawn at random."""

import argparse


def seed_number(text: str) -> int:
    """Of `--seed`: argparse tells what is wrong with it."""
    try:
        number = int(text)
    except ValueError:
        number = -1
    if number < 0:
        raise argparse.ArgumentTypeError(f"{text!r} is no seed: 0, 1, 2, ...")
    return number
