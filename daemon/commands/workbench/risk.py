"""`tentacled risk query`: body_point_risk of any mixture in any mesh, so that it can be checked.

How likely a random point of the body is in something solid. Not how likely the body touches it.
"""

import argparse
import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daemon.commands.outcome.result import Result

if TYPE_CHECKING:
    from safety.risk.body_point import BodyPointBounds, BodyPointValue
    from safety.risk.model.mixture import Mixture
    from safety.risk.surroundings.environment import Environment

_EXPLAINED = """\
MIXTURE.json is of this form:

{form}
The mesh must be closed, and no body in it overlap another. Its normals point
into free space; --free says otherwise. Printed are:

printed_bound    equation 9: over each component's free region, Σ (1 − Φ(b)),
                 at most one
certified_bound  the same regions, integrated: never below the truth, at most
                 the printed bound
near_exact       the value itself, to about four digits
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from daemon.workbench.body_model.evaluation.mixture_file import FORM

    parts = parser.add_subparsers(dest="word", metavar="WHAT", required=True)
    query = parts.add_parser(
        "query",
        help="body_point_risk of a mixture in a mesh, as JSON",
        description="How likely a random point of the body is in something solid, as JSON.",
        epilog=_EXPLAINED.format(form=FORM),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    query.add_argument("--mixture", type=Path, required=True, metavar="MIXTURE.json")
    query.add_argument("--mesh", type=Path, required=True, metavar="MESH.stl", help="or .obj, .ply")
    query.add_argument(
        "--free",
        choices=("inside", "outside"),
        help="where the body may be: inside the outermost surface, or outside of it",
    )
    query.add_argument(
        "--unit", choices=("mm", "cm", "m", "in"), default="mm", help="of the mesh (default: mm)"
    )


def run(arguments: argparse.Namespace) -> Result:
    # Compiled code and mesh files are slow to come: `--help` does without.
    from daemon.risk.mesh_file import read_environment
    from daemon.workbench.body_model.evaluation.mixture_file import read_mixture
    from safety.risk.body_point import BodyPointRisk
    from safety.risk.model.mixture import MixtureError

    mixture = read_mixture(arguments.mixture)
    if mixture.dimensions != 3:
        raise MixtureError(f"{arguments.mixture}: means have 3 coordinates")
    environment = read_environment(arguments.mesh, arguments.free, unit=arguments.unit)
    risk = BodyPointRisk(environment)
    bounds, value = risk.bounds(mixture), risk.near_exact(mixture)
    if bounds.mean_in_solid.all():
        other = "outside" if environment.solid_around else "inside"
        print(
            f"every mean is in something solid; if {arguments.mesh} is free on the other side, "
            f"say --free {other}",
            file=sys.stderr,
        )
    summary = _summary(mixture, environment, bounds, value)
    return Result(summary, json.dumps(summary, indent=2))


def _summary(
    mixture: "Mixture",
    environment: "Environment",
    bounds: "BodyPointBounds",
    value: "BodyPointValue",
) -> dict[str, Any]:
    components = [
        {
            "weight": float(mixture.weights[k]),
            "mean_in_solid": bool(bounds.mean_in_solid[k]),
            "union_bound": float(bounds.unions[k]),
            "near_exact": float(value.by_component[k]),
            "planes": int(bounds.planes[k]),
            "distance_in_standard_deviations": _number(bounds.distances[k]),
            "nearest_mm": [_number(x) for x in bounds.nearest_mm[k]],
        }
        for k in range(mixture.components)
    ]
    return {
        "printed_bound": bounds.printed,
        "certified_bound": bounds.certified,
        "near_exact": value.value,
        "what": "probability that a random point of the body is in something solid",
        "free": "inside" if environment.solid_around else "outside",
        "triangles": len(environment.triangles),
        "components": components,
    }


def _number(x: float) -> float | None:
    """JSON has no NaN and no infinity."""
    return float(x) if math.isfinite(x) else None
