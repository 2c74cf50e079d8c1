"""How the source tree is cut: `python -m tests.structure [--tree DIR] [--json | --before FILE]`.

Counts files, lines, folders, circles of imports and arguments of kernels of any checkout, and runs
its daemon once in virtual time to see what one tracker reply and one `start` pass through. What
`--json` prints for one checkout, `--before` sets beside another's figures.
"""

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.structure import passages
from tests.structure.imports import circles, single_importers
from tests.structure.sources import Figures, functions, read_sources, sizes

ROOT = Path(__file__).parents[2]


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.structure", description=__doc__)
    parser.add_argument("--tree", type=Path, default=ROOT, metavar="DIR", help="the checkout")
    parser.add_argument("--json", action="store_true", help="everything, names included")
    parser.add_argument("--before", type=Path, metavar="FILE", help="an earlier --json, beside it")
    parser.add_argument("--without-passages", action="store_true", help="read only, run nothing")
    arguments = parser.parse_args()
    figures = measure(arguments.tree.resolve(), run=not arguments.without_passages)
    if arguments.json:
        print(json.dumps(figures, indent=1))
        return 0
    before = None if arguments.before is None else json.loads(arguments.before.read_text())
    print("\n".join(lines(figures, before)))
    return 0


def measure(root: Path, *, run: bool = True) -> Figures:
    """All figures of the checkout at `root`."""
    sources = read_sources(root)
    figures: Figures = {
        "sizes": sizes(sources),
        "functions": functions(sources),
        "circles": circles(sources),
        "single_importers": single_importers(sources),
    }
    return figures | ({"passages": _passages(root)} if run else {})


def _passages(root: Path) -> Figures:
    """In a process of its own, because it imports the other checkout's modules."""
    program = [sys.executable, str(passages.__file__), str(root)]
    environment = os.environ | {"PYTHONPATH": str(root)}
    done = subprocess.run(program, cwd=root, env=environment, capture_output=True, text=True)
    if done.returncode:
        return {"failed": done.stderr.strip().splitlines()[-1:]}
    found: Figures = json.loads(done.stdout)
    return found


def lines(figures: Figures, before: Figures | None = None) -> Iterator[str]:
    """As people read it: counts, and names where there are few."""
    for part, values in figures.items():
        yield f"{part.replace('_', ' ')}"
        earlier = {} if before is None else dict(_flat(before.get(part, {})))
        for name, value in _flat(values):
            told = _told(value)
            if before is None:
                yield f"  {name:<58} {told}"
            else:
                yield f"  {name:<58} {_told(earlier.pop(name, '-')):>12}  ->  {told}"
        for name, value in earlier.items():
            yield f"  {name:<58} {_told(value):>12}  ->  -"


def _flat(values: Figures, above: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in values.items():
        if name == "passed":
            continue
        if isinstance(value, dict):
            yield from _flat(value, f"{above}{name}: ")
        elif isinstance(value, list) and above + name != "failed":
            yield f"{above}{name}", len(value)
            for number, one in enumerate(value, start=1):
                yield f"{above}{name} {number}", one
        else:
            yield f"{above}{name}", value


def _told(value: object) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)


if __name__ == "__main__":
    sys.exit(main())
