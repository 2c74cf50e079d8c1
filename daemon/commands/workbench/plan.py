"""`tentacled plan ROBOT.yaml --to X,Y,Z --out path.json`: a path that keeps the body away."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from config.control import PlacedMesh, Port, Surface
from config.loader import RobotFile
from config.paths import named_model
from daemon.commands.outcome.exit_codes import EXIT_FAILED
from daemon.commands.outcome.failures import UsageError
from daemon.commands.outcome.result import Result
from daemon.commands.terminal.argument_types import (
    add_goal_arguments,
    numbers,
    take_negative_numbers,
)
from daemon.robot.checked_robot import add_robot_argument, robot_with_warnings_told

if TYPE_CHECKING:
    from daemon.host.progress import Progress
    from daemon.risk.body_risk_source import RiskFiles
    from daemon.workbench.planning.goals import TipGoal
    from daemon.workbench.planning.plan import Candidate, Plan
    from daemon.workbench.planning.planner import Planner

_EXPLAINED: Final = """\
The path is looked for in the space of the axes, among places that the body's
model knows, so that the body as a whole keeps away from the surroundings. What
is told of it:

contact risk     how likely any part of the body touches anything anywhere on
                 the whole path: one body per draw, led from end to end
body_point_risk  equation 10 of Thompson et al. over the path's waypoints: not
                 how likely the body touches, and more with every waypoint

Where there is no path, the reason and the place that blocks are told, and the
exit code is 1. Coordinates are mm in the base sensor's frame.
"""
_PRESETS: Final = ("optimised", "thompson")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog, parser.formatter_class = _EXPLAINED, argparse.RawDescriptionHelpFormatter
    take_negative_numbers(parser)
    add_robot_argument(parser)
    add_goal_arguments(parser)
    parser.add_argument(
        "--from", type=numbers, dest="start", metavar="U,U,...",
        help="where the axes are, mm or rad (default: 0, or the end of travel nearest to it)",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, metavar="PATH.json", help="what `load` takes")
    parser.add_argument(
        "--surroundings", type=Path, metavar="MESH.stl", help="instead of the robot file's"
    )
    parser.add_argument("--free", choices=("inside", "outside"), help="side of such a mesh")
    port = parser.add_mutually_exclusive_group()
    port.add_argument(
        "--port", type=numbers, metavar="X,Y,...",
        help="where the body comes in, X,Y,Z,DX,DY,DZ,RADIUS,DEPTH, of which DX,DY,DZ is "
        "the way inwards (default: the robot file's)",
    )  # fmt: skip
    port.add_argument("--no-port", action="store_true", help="there is no way in")
    parser.add_argument(
        "--model", type=named_model, metavar="MODEL.npz", help="instead of the robot file's"
    )
    parser.add_argument(
        "--preset", choices=_PRESETS, default=_PRESETS[0],
        help="`thompson`: the paper's own method, to compare with (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--pareto", action="store_true", help="tell what length costs in risk, before refining"
    )
    for name, kind, default, purpose in (
        ("most-risk", float, 0.05, "contact risk that the whole path may have, upper limit"),
        ("prefer-mm", float, 300.0, "by which the way may be longer for e times less risk"),
        ("tip-speed", float, 8.0, "mm/s, at most"),
        ("waypoints", int, 20, "while it is optimised, and of equation 10"),
        ("samples", int, 1000, "bodies that are led along the whole path"),
        ("seed", int, 1, "of all that is random"),
    ):
        metavar = "N" if kind is int else "X"
        help_text = f"{purpose} (default: %(default)s)"
        parser.add_argument(
            f"--{name}", type=kind, default=default, metavar=metavar, help=help_text
        )


def run(arguments: argparse.Namespace) -> Result:
    if (wrong := _wrong_usage(arguments)) is not None:
        raise UsageError(wrong)
    checked = robot_with_warnings_told(arguments.robot)
    # What solves and draws is compiled when it comes: `--help` does without.
    from daemon.commands.terminal.compiled import telling_progress
    from daemon.files import check_can_be_made
    from daemon.risk.body_risk_source import read_risk_files

    if arguments.out is not None:
        check_can_be_made(arguments.out)
    with telling_progress() as progress:
        files = read_risk_files(
            checked.file,
            surface=_surface(arguments, checked.file),
            model=arguments.model,
        )
        return _planned(arguments, checked.file, files, progress)


def _planned(
    arguments: argparse.Namespace, file: RobotFile, files: "RiskFiles", progress: "Progress"
) -> Result:
    import numpy as np

    from daemon.reference.planned_path import write_path
    from daemon.workbench.planning.blocked import Blocked
    from daemon.workbench.planning.body_in_place import BodyInPlace
    from daemon.workbench.planning.plan import Settings, figures_of, path_of
    from daemon.workbench.planning.planner import Planner

    settings = Settings(
        waypoints=arguments.waypoints,
        samples=arguments.samples,
        mm_per_nat=arguments.prefer_mm,
        most_risk=arguments.most_risk,
        tip_mm_s=arguments.tip_speed,
        seed=arguments.seed,
    )
    body = BodyInPlace(file.robot, files.model.model, files.environment, files.grid)
    planner = Planner(body, settings, progress)
    ranges = body.ranges
    start = np.clip(np.zeros(ranges.count), ranges.lowest, ranges.highest)
    if arguments.start is not None:
        start = np.array(arguments.start)
        if start.size != ranges.count:
            raise UsageError(f"--from has {start.size} numbers, and there are {ranges.count} axes")
    goals = _goals(arguments)
    if arguments.pareto:
        front = planner.pareto(start, goals)
        if not isinstance(front, Blocked):
            _tell_front(front)
    course: tuple[float, ...] = ()
    if arguments.preset == "thompson":
        found, course = _as_in_the_paper(planner, start, goals, progress)
    else:
        found = planner.plan(start, goals)
    if isinstance(found, Blocked):
        return Result(found.summary(), found.text, EXIT_FAILED)
    figures = figures_of(found, settings, arguments.preset, course)
    if arguments.out is not None:
        pointing = arguments.pointing is not None
        write_path(arguments.out, path_of(found, figures, file.robot, files.identity, pointing))
    written = [] if arguments.out is None else [str(arguments.out)]
    return Result({**figures, "written": written}, "\n".join([_told(found, figures), *written]))


def _as_in_the_paper(
    planner: "Planner", start: Any, goals: "list[TipGoal]", progress: "Progress"
) -> "tuple[Any, tuple[float, ...]]":
    """The plan, or why there is none; and equation 10 after each iteration."""
    from daemon.workbench.planning.blocked import Blocked
    from daemon.workbench.planning.gaussian_process import ITERATIONS, lowered
    from daemon.workbench.planning.path_risk import resampled

    nominal = planner.nominal(start, goals)
    if isinstance(nominal, Blocked):
        return nominal, ()
    settings, body = planner.settings, planner.body
    waypoints = resampled(body, nominal.waypoints, settings.waypoints)
    found = lowered(body, waypoints, ITERATIONS, settings.seed, progress)
    return planner.figured(found.waypoints, nominal), found.course


def _goals(arguments: argparse.Namespace) -> "list[TipGoal]":
    import numpy as np

    from daemon.workbench.planning.goals import TipGoal

    direction = None
    if arguments.pointing is not None:
        direction = np.array(arguments.pointing)
        direction = direction / np.linalg.norm(direction)
    goals = [TipGoal(np.array(one)) for one in arguments.via]
    return [*goals, TipGoal(np.array(arguments.to), direction)]


def _surface(arguments: argparse.Namespace, file: RobotFile) -> Surface | None:
    """Other surroundings than the robot file's, where any are asked for."""
    own = file.robot.risk.surface
    said = (arguments.surroundings, arguments.free, arguments.port)
    if all(one is None for one in said) and not arguments.no_port:
        return None
    if arguments.surroundings is None and own is None:
        raise UsageError("this robot file names no surroundings: say them with --surroundings")
    surface = own or Surface(mesh="")
    update: dict[str, Any] = {}
    if arguments.surroundings is not None:
        # Unit and place are those of its own file, whatever the robot file's mesh has.
        update |= PlacedMesh(mesh=str(arguments.surroundings.absolute())).model_dump()
        update["free"] = arguments.free
    elif arguments.free is not None:
        update["free"] = arguments.free
    if arguments.no_port:
        update["port"] = None
    elif arguments.port is not None:
        x, y, z, dx, dy, dz, radius_mm, depth_mm = arguments.port
        update["port"] = Port(
            centre_mm=(x, y, z), inwards=(dx, dy, dz), radius_mm=radius_mm, depth_mm=depth_mm
        )
    return surface.model_copy(update=update)


def _wrong_usage(arguments: argparse.Namespace) -> str | None:
    if arguments.port is not None:
        if len(arguments.port) != 8:
            return "--port: needs eight numbers, X,Y,Z,DX,DY,DZ,RADIUS,DEPTH"
        if not arguments.port[6] > 0.0 or arguments.port[7] < 0.0 or not any(arguments.port[3:6]):
            return "--port: needs a direction and a positive radius and depth"
    if arguments.pointing is not None and not any(arguments.pointing):
        return "--pointing: 0,0,0 is no direction"
    if not 0.0 < arguments.most_risk <= 1.0:
        return "--most-risk: is a probability, above 0"
    if not arguments.tip_speed > 0.0 or not arguments.prefer_mm >= 0.0:
        return "--tip-speed must be positive, and --prefer-mm not negative"
    if not 4 <= arguments.waypoints <= 200 or not 100 <= arguments.samples <= 100_000:
        return "--waypoints: 4 to 200; --samples: 100 to 100000"
    return None if arguments.seed >= 0 else "--seed: 0 or more"


def _tell_front(front: "list[Candidate]") -> None:
    """Paths of the roadmap of which none is better in both."""
    print(f"{'mm per factor e':>16}{'length':>12}{'contact risk':>14}{'upper limit':>13}")
    for one in front:
        print(
            f"{one.mm_per_nat:>16g}{one.length_mm:>9.0f} mm{one.risk.probability:>14.2%}"
            f"{one.risk.upper_limit:>13.2%}"
        )


def _told(plan: "Plan", figures: dict[str, Any]) -> str:
    risk, worst = plan.risk, plan.risk.worst
    nearest = ", ".join(f"{x:.0f}" for x in worst.nearest_mm)
    return "\n".join(
        [
            f"{len(plan.u)} places in {plan.t_s[-1]:.1f} s, {plan.length_mm:.0f} mm of the body's "
            "way",
            f"contact risk of the whole path {risk.probability:.2%} "
            f"(95 %: {risk.lowest:.2%} to {risk.highest:.2%}; upper limit as the gate has it "
            f"{risk.upper_limit:.2%}); before refining {plan.before.probability:.2%}",
            f"clearance {risk.clearance_mm:.1f} mm (one body in twenty has no more), nearest at "
            f"{worst.arc_mm:.0f} mm along the body to ({nearest}) mm",
            f"body_point_risk (equation 10) over {figures['waypoints']} waypoints "
            f"{plan.printed:.1%}, before {plan.printed_before:.1%}: not a chance of touching",
        ]
    )
