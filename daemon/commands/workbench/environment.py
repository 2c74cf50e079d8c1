"""`tentacled environment KIND --out MESH.stl`: surroundings to try the risks in."""

import argparse
import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Final

from daemon.commands.outcome.failures import CommandError, UsageError, about
from daemon.commands.outcome.result import Result
from daemon.commands.terminal.argument_types import seed_number, whole_number

if TYPE_CHECKING:
    from safety.risk.surroundings.environment import InsertionPort, Mesh

_MOST_TRIANGLES: Final = 300_000
"""As many as a daemon reads."""
_KINDS = {
    "chest": "a cavity like that of a chest; the arm comes in at the origin, along z",
    "room": "the inside of a box",
    "box": "a solid box",
    "balls": "solid balls beside an arm that is straight",
    "slot": "two plates with an arm between them",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    summary = "; ".join(f"{kind}: {what}" for kind, what in _KINDS.items())
    parser.add_argument("kind", choices=_KINDS, metavar="KIND", help=summary)
    parser.add_argument(
        "--out", type=Path, required=True, metavar="MESH.stl", help="or .obj, .ply; in mm"
    )
    parser.add_argument(
        "--triangles", type=whole_number(12, _MOST_TRIANGLES), default=5000, metavar="N",
        help="about so many (default: 5000)",
    )  # fmt: skip
    parser.add_argument(
        "--seed", type=seed_number, default=0, metavar="S", help="of what is uneven"
    )
    parser.add_argument(
        "--size-mm", type=float, nargs=3, default=(200.0, 160.0, 240.0), metavar=("X", "Y", "Z"),
        help="of box and room (default: 200 160 240)",
    )  # fmt: skip
    parser.add_argument(
        "--centre-mm", type=float, nargs=3, default=(0.0, 0.0, 120.0), metavar=("X", "Y", "Z"),
        help="of box and room (default: 0 0 120)",
    )  # fmt: skip
    parser.add_argument(
        "--balls", type=whole_number(1, 12), default=6, metavar="N", help="how many (default: 6)"
    )
    parser.add_argument("--gap-mm", type=float, default=30.0, metavar="MM", help="of the slot")


def run(arguments: argparse.Namespace) -> Result:
    # Compiled code and mesh files are slow to come: `--help` does without.
    from daemon.files import check_can_be_made
    from daemon.risk.mesh_file import write_mesh
    from safety.risk.surroundings.environment import EnvironmentFaultError, environment

    check_can_be_made(arguments.out)
    try:
        mesh, port = _made(arguments)
        checked = environment(*mesh)
        with about(arguments.out):
            write_mesh(arguments.out, mesh)
    except (EnvironmentFaultError, ValueError) as error:
        place = str(arguments.out)
        raise CommandError("failed", f"{place}: {error}", place=place) from None
    summary = {
        "mesh": str(arguments.out),
        "triangles": len(mesh.triangles),
        "free": "inside" if checked.solid_around else "outside",
        "insertion_port": None if port is None else asdict(port),
    }
    return Result(summary, json.dumps(summary, indent=2))


def _made(arguments: argparse.Namespace) -> "tuple[Mesh, InsertionPort | None]":
    """Mesh and insertion port. Raises UsageError, ValueError where the wishes cannot be met."""
    from daemon.workbench.body_model.evaluation import shapes

    count = arguments.triangles
    cuts = max(1, round((count / 12) ** 0.5))
    size, centre = arguments.size_mm, arguments.centre_mm
    if not all(0.0 < length_mm < math.inf for length_mm in (*size, arguments.gap_mm)):
        raise UsageError("sizes and gaps must be positive")
    if not all(map(math.isfinite, centre)):
        raise UsageError("--centre-mm takes three numbers")
    match arguments.kind:
        case "chest":
            return shapes.chest(count + count % 2, arguments.seed), shapes.CHEST_PORT
        case "room":
            return shapes.turned(shapes.box(size, centre, cuts)), None
        case "box":
            return shapes.box(size, centre, cuts), None
        case "balls":
            return shapes.balls(arguments.balls, count, arguments.seed), None
        case _:
            cuts = max(1, round((count / 24) ** 0.5))
            return shapes.slot(arguments.gap_mm, cuts), None
