"""Damaged copies of the shipped files: `check` explains each, or it can be built. No traceback.

`python -m tests.experiments.check_mutations --files 10000`
"""

import argparse
import random
import re
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Final

from config.documents.problems import ConfigError
from daemon.commands.host.check import check
from daemon.robot.checked_robot import check_robot
from daemon.workbench.experiments.construction import experiment_problems, robot_problems
from daemon.workbench.experiments.experiment_file import load_experiment
from tests import SHIPPED_ROBOTS

_CONFIG: Final = SHIPPED_ROBOTS.parent
KINDS: Final = ("robots", "experiments", "scenarios", "studies")
_VALUES: Final = (
    *("0", "-1", "1", "2", "3", "127", "128", "1.0e-9", "1.0e+9", "1.0e+300", "-0.5", ".inf"),
    *(".nan", "true", "null", "''", "x", "[]", "{}", "[1.0, 2.0]", "[0, 0, 0]", "{a: 1}", "~"),
    *("9" * 30, "9" * 5000, "x" * 300, "../../x", "builtin:nothing", "/dev/null", "/", "lab:x"),
    *("é", '"\\0"', "[[[[[[1]]]]]]", "on", "0x10", "1:30", "2026-01-01", "!!python/none x"),
)
_SCALAR: Final = re.compile(r"(?<=[:,\[{] )([^\s,\[\]{}#&*]+)")


def shipped(kind: str) -> list[Path]:
    return sorted((_CONFIG / kind).glob("*.yaml"))


def mutated(text: str, chance: random.Random) -> str:
    """With one to three things wrong in it, or other than they were."""
    for _ in range(chance.randint(1, 3)):
        text = chance.choice((_value, _value, _value, _line_gone, _line_twice, _key, _cut))(
            text, chance
        )
    return text


def _value(text: str, chance: random.Random) -> str:
    places = list(_SCALAR.finditer(text))
    if not places:
        return text
    place = chance.choice(places)
    number = re.fullmatch(r"-?\d+(\.\d+)?", place[0])
    if number and chance.random() < 0.5:
        factor = chance.choice((-1.0, 0.0, 0.01, 0.5, 0.9, 1.1, 2.0, 100.0))
        value = float(place[0]) * factor
        new = repr(value) if "." in place[0] else str(round(value))
    else:
        new = chance.choice(_VALUES)
    return text[: place.start()] + new + text[place.end() :]


def _line_gone(text: str, chance: random.Random) -> str:
    lines = text.splitlines(keepends=True)
    if len(lines) > 1:
        del lines[chance.randrange(len(lines))]
    return "".join(lines)


def _line_twice(text: str, chance: random.Random) -> str:
    lines = text.splitlines(keepends=True) or ["\n"]
    lines.insert(chance.randrange(len(lines) + 1), chance.choice(lines))
    return "".join(lines)


def _key(text: str, chance: random.Random) -> str:
    keys = list(re.finditer(r"\b[a-z_]+(?=:)", text))
    if not keys:
        return text
    place = chance.choice(keys)
    new = place[0][: len(place[0]) // 2] + chance.choice(("", "x", place[0]))
    return text[: place.start()] + new + text[place.end() :]


def _cut(text: str, chance: random.Random) -> str:
    if len(text) < 2 or chance.random() >= 0.2:
        return text
    return text[: chance.randrange(1, len(text))]


def tried(folder: Path, kind: str, source: Path, text: str) -> bool:
    """Whether `check` lets it pass. Raises AssertionError where it passes and cannot be built."""
    path = folder / source.name
    path.write_text(text, encoding="utf-8", errors="surrogateescape")
    try:
        check(path)
    except ConfigError as error:
        assert error.problems
        assert all(str(problem) for problem in error.problems)
        return False
    if kind == "robots":
        assert not robot_problems(check_robot(path).file)
    elif kind == "experiments":
        assert not experiment_problems(load_experiment(path))
    return True


def try_many(count: int, seed: int) -> Counter[str]:
    """How many of each kind passed, and how many were explained."""
    chance, found = random.Random(seed), Counter[str]()
    sources = [(kind, path) for kind in KINDS for path in shipped(kind)]
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        for kind in KINDS:  # files name each other by place
            (root / kind).mkdir()
            for path in shipped(kind):
                (root / kind / path.name).write_text(path.read_text())
        for number in range(count):
            kind, source = chance.choice(sources)
            before = source.read_text()
            text = mutated(before, chance)
            try:
                passed = tried(root / kind, kind, source, text)
            except BaseException:
                print(f"file {number} of seed {seed}, from {source}:\n{text}", file=sys.stderr)
                raise
            found[f"{kind} {'sound' if passed else 'explained'}"] += 1
            (root / kind / source.name).write_text(before)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--files", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    for what, count in sorted(try_many(arguments.files, arguments.seed).items()):
        print(f"{what}: {count}")


if __name__ == "__main__":
    main()
