"""`tentacled mdn collect ROBOT.yaml --out CLOUDS.npz`: what cameras see of an emulated body.

With `--from FOLDER`, what they have seen of a real one:
see `daemon.workbench.body_model.clouds.cloud_table`.
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daemon.commands.outcome.failures import UsageError
from daemon.commands.outcome.result import Result
from daemon.commands.terminal.argument_types import seed_number
from daemon.commands.terminal.work_sharing import add_scheduler_argument, share, workers_of
from daemon.robot.checked_robot import add_robot_argument, robot_with_warnings_told

if TYPE_CHECKING:
    from config.robot import Robot
    from daemon.workbench.body_model.clouds.cloud_dataset import CloudDataset
    from daemon.workbench.body_model.clouds.cloud_import import ImportSettings

_OF_TEN_TO_TEST = 0.1
_CONFIGURATIONS, _STARTS = 2530, 12


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_robot_argument(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="CLOUDS.npz")
    parser.add_argument(
        "--configurations",
        type=int,
        metavar="N",
        help=f"a tenth of them is for tests (default: {_CONFIGURATIONS}, as in the paper)",
    )
    parser.add_argument(
        "--starts",
        type=int,
        metavar="N",
        help=f"from which each is come to (default: {_STARTS})",
    )
    parser.add_argument(
        "--points", type=int, default=256, metavar="N", help="kept of each cloud (default: 256)"
    )
    parser.add_argument(
        "--seed", type=seed_number, default=1, metavar="N", help="default: %(default)s"
    )
    parser.add_argument(
        "--processes", type=int, default=2, metavar="N", help="default: %(default)s"
    )
    add_scheduler_argument(parser)
    parser.add_argument(
        "--share",
        type=share,
        metavar="I/N",
        help="only every N-th part, for one of N machines: put their CLOUDS.npz.parts into one "
        "folder afterwards; the same again fits bodies to all clouds, and without --share ends it",
    )
    parser.add_argument(
        "--bodies",
        type=int,
        default=0,
        metavar="N",
        help="of the same design, one by chance for each start: the model is then of any of them "
        "(default: the robot file's own alone)",
    )
    real = parser.add_argument_group(
        "clouds of a real body",
        "PLY or NPZ files in the base frame, with a table configurations.csv of the columns file, "
        "one for each axis, and if known start_<axis> for each, and test (1 or 0). What is not "
        "said of the body is as in the robot file's emulation.",
    )
    real.add_argument("--from", dest="folder", type=Path, metavar="FOLDER")
    real.add_argument("--unit", choices=("mm", "cm", "m"), default="mm", help="default: mm")
    for option, what in (
        ("--length-mm", "of the body"),
        ("--radius-mm", "of what of it may touch"),
        ("--tube-radius-mm", "of what is seen of it"),
        ("--disk-radius-mm", "of disks on it, the last one at its tip"),
    ):
        real.add_argument(option, type=float, metavar="X", help=what)
    real.add_argument("--disks", type=int, metavar="N", help="how many there are")
    real.add_argument(
        "--tip-load-g", type=float, default=0.0, metavar="X", help="that hung at the tip"
    )
    real.add_argument(
        "--seen-on", metavar="DAY", help="such as 2026-11-21; risk.oldest_days asks for it"
    )


def run(arguments: argparse.Namespace) -> Result:
    return _emulated(arguments) if arguments.folder is None else _imported(arguments)


def _imported(arguments: argparse.Namespace) -> Result:
    from daemon.commands.terminal.compiled import telling_progress
    from daemon.files import check_can_be_made
    from daemon.host.processes import worker_processes
    from daemon.workbench.body_model.clouds.cloud_import import import_clouds

    checked = robot_with_warnings_told(arguments.robot)
    robot = checked.file.robot
    if arguments.configurations is not None or arguments.starts is not None:
        raise UsageError("--configurations and --starts are as the table has them")
    try:
        settings = _import_settings(arguments, robot)
        if arguments.processes < 1:
            raise ValueError("there must be a process")
    except ValueError as error:
        raise UsageError(str(error)) from None
    check_can_be_made(arguments.out)
    with telling_progress() as bar, worker_processes(arguments.processes) as workers:
        made = import_clouds(robot, arguments.folder, settings, workers, bar)
    made.save(arguments.out)
    clouds = made.clouds_mm.shape[0] * made.clouds_mm.shape[1]
    miss_mm = made.provenance["imported"]["miss_mm"]
    return Result(
        {**_figures(arguments, made, clouds), "miss_mm": miss_mm},
        f"{arguments.out}: {len(made)} configurations ({int(made.test.sum())} to test with), "
        f"{clouds} clouds of {settings.points} points, "
        f"{miss_mm:.2f} mm off the bodies that were fitted to them",
    )


def _figures(arguments: argparse.Namespace, made: "CloudDataset", clouds: int) -> dict[str, Any]:
    return {
        "written": arguments.out,
        "configurations": len(made),
        "test": int(made.test.sum()),
        "clouds": clouds,
    }


def _import_settings(arguments: argparse.Namespace, robot: "Robot") -> "ImportSettings":
    """Raises ValueError."""
    from daemon.workbench.body_model.clouds.centreline_fit import VisibleSurface
    from daemon.workbench.body_model.clouds.cloud_import import ImportSettings, surface_of

    length, radius, tube = arguments.length_mm, arguments.radius_mm, arguments.tube_radius_mm
    disks, disk_radius = arguments.disks, arguments.disk_radius_mm
    if (known := surface_of(robot)) is not None:
        surface, body_radius = known
        length, radius = length or surface.length_mm, radius or body_radius
        tube = tube or surface.tube_radius_mm
        disks = surface.disks if disks is None else disks
        disk_radius = disk_radius or surface.disk_radius_mm
    tube = tube or radius
    if not length or not radius or not tube:
        raise ValueError("no emulation says how long and thick it is: --length-mm, --radius-mm")
    seen = VisibleSurface(length, tube, disks or 0, disk_radius or 0.0)
    return ImportSettings(
        seen,
        radius,
        arguments.unit,
        arguments.points,
        arguments.seed,
        arguments.tip_load_g,
        arguments.seen_on,
    )


def _emulated(arguments: argparse.Namespace) -> Result:
    # The plant's compiled code is slow to come: `--help` does without.
    from daemon.commands.terminal.compiled import telling_progress
    from daemon.files import check_can_be_made
    from daemon.host.processes import WHOLE
    from daemon.workbench.body_model.clouds.collection import CollectionSettings
    from daemon.workbench.body_model.clouds.parallel_collection import collect_share
    from sim_backends.plants.shooting import warm_up

    checked = robot_with_warnings_told(arguments.robot)
    try:
        wanted, starts = arguments.configurations, arguments.starts
        wanted = _CONFIGURATIONS if wanted is None else wanted
        test = round(_OF_TEN_TO_TEST * wanted)
        settings = CollectionSettings(
            wanted - test,
            test,
            _STARTS if starts is None else starts,
            arguments.points,
            arguments.seed,
            arguments.bodies,
        )
        if arguments.processes < 1:
            raise ValueError("there must be a process")
    except ValueError as error:
        raise UsageError(str(error)) from None
    check_can_be_made(arguments.out)
    away = arguments.scheduler
    with telling_progress() as bar, workers_of(away, arguments.processes) as workers:
        if away is None:
            warm_up()  # here, once, and not in each process
        mine = arguments.share or WHOLE
        made = collect_share(checked.file, settings, arguments.out, workers, bar, mine)
    if made is None:
        text = f"share {mine} is in {arguments.out}.parts: the others' parts are not all there yet"
        return Result({"share": str(mine), "parts": f"{arguments.out}.parts"}, text)
    clouds, block = len(made) * settings.starts, int(made.block.sum())
    return Result(
        {**_figures(arguments, made, clouds), "block": block},
        f"{arguments.out}: {len(made)} configurations ({int(made.test.sum())} to test with, "
        f"{block} in the block), {clouds} clouds of {settings.points} points",
    )
