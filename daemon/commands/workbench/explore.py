"""`tentacled explore ROBOT.yaml --out DATA.npz`: random motions of a robot, to learn from.

Some seconds of designed motions, all axes at once, tell enough to begin with: what is learnt from
them goes on learning while it follows. With `--waypoints` the axes go to random places of all of
their travel instead, for as long as that takes.

Emulated devices stand in for the robot, in virtual time or in real. A rig is explored by its
daemon: load and start an experiment file whose controller is `designed_exploration` or
`waypoint_exploration`, then make data of the recording with `--from`.
"""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import ValidationError

from config.loader import RobotFile
from config.tasks.exploration import DesignedExploration, WaypointExploration
from daemon.commands.outcome.failures import UsageError, about
from daemon.commands.outcome.result import Result
from daemon.commands.terminal.argument_types import seed_number
from daemon.host.stop_signals import all_like_ctrl_c
from daemon.robot.checked_robot import add_robot_argument, robot_with_warnings_told

if TYPE_CHECKING:
    from daemon.learning.samples.dataset import Dataset
    from daemon.workbench.pretraining.explore import Exploring
    from daemon.workbench.pretraining.parts import ExplorationParts

_DESIGNED = DesignedExploration(kind="designed_exploration")
_RANDOM = WaypointExploration(kind="waypoint_exploration")
_OPTIONS = {
    "duration_s": "duration",
    "waypoints": "waypoints",
    "travel_share": "share",
    "dither_share": "dither",
}
"""What is called otherwise on the command line."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_robot_argument(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="DATA.npz")
    parser.add_argument(
        "--duration",
        type=float,
        metavar="S",
        help=f"of designed motions (default: {_DESIGNED.lasts_s(6):g}, more with over six axes)",
    )
    parser.add_argument(
        "--waypoints",
        type=int,
        metavar="N",
        help="random places of the axes to go to instead; 80 take five minutes of a soft arm",
    )
    parser.add_argument(
        "--seed", type=seed_number, default=1, metavar="N", help="default: %(default)s"
    )
    parser.add_argument(
        "--share",
        type=float,
        metavar="SHARE",
        help="of each axis' travel, in its middle, that the places are from (default: "
        f"{_DESIGNED.travel_share:g}, of random places {_RANDOM.travel_share:g})",
    )
    parser.add_argument(
        "--dither",
        type=float,
        metavar="SHARE",
        help="of each axis' travel that it swings by on its way (default: "
        f"{_DESIGNED.dither_share:g}, between random places {_RANDOM.dither_share:g})",
    )
    parser.add_argument(
        "--tip-load", type=float, default=0.0, metavar="G", help="what hangs on the emulated tip"
    )
    parser.add_argument(
        "--real-time", action="store_true", help="with the devices in a process of their own"
    )
    parser.add_argument(
        "--run", type=Path, metavar="DIR", help="keep the recording, in a new folder"
    )
    parser.add_argument(
        "--resume",
        action="store_true",
        help="go on with what was interrupted, whatever ended it",
    )
    parser.add_argument(
        "--from",
        dest="recorded",
        type=Path,
        metavar="RUN",
        help="explore nothing: take what a recorded run of this robot has seen",
    )


def run(arguments: argparse.Namespace) -> Result:
    checked = robot_with_warnings_told(arguments.robot)
    try:
        options = _options(arguments)
        if not (arguments.tip_load >= 0.0 and arguments.seed >= 0):
            raise ValueError("neither a load nor a seed is below 0")
    except ValidationError as error:
        problems = [f"--{_OPTIONS[str(one['loc'][0])]}: {one['msg']}" for one in error.errors()]
        raise UsageError("\n".join(problems)) from None
    except ValueError as error:
        raise UsageError(str(error)) from None
    with about(arguments.recorded or arguments.out):
        frames = _seen(checked.file, options, arguments).frames
    return Result(
        {"written": arguments.out, "frames": len(frames), "duration_s": frames.duration_s},
        f"{arguments.out}: {len(frames)} frames, {frames.duration_s:.0f} s of motion",
    )


def _options(arguments: argparse.Namespace) -> "Exploring":
    """Raises ValueError, of which pydantic's is one."""
    if arguments.waypoints is not None and arguments.duration is not None:
        raise ValueError("--duration is of designed motions, and --waypoints of random ones: one")
    asked = {
        "duration_s": arguments.duration,
        "waypoints": arguments.waypoints,
        "travel_share": arguments.share,
        "dither_share": arguments.dither,
    }
    given = {name: value for name, value in asked.items() if value is not None}
    kind = _DESIGNED if arguments.waypoints is None else _RANDOM
    return type(kind).model_validate({"kind": kind.kind, **given})


def _seen(file: RobotFile, options: "Exploring", arguments: argparse.Namespace) -> "Dataset":
    from daemon.files import check_can_be_made, make_folder
    from daemon.workbench.pretraining.explore import dataset_of_run

    make_folder(arguments.out.parent)
    check_can_be_made(arguments.out)
    if arguments.recorded is not None:
        dataset = dataset_of_run(arguments.recorded, file, {"run": str(arguments.recorded)})
        dataset.save(arguments.out)
        return dataset
    if file.robot.emulation is None:
        raise UsageError(
            f"{file.path} has no 'emulation': let its daemon explore, and take the run with --from"
        )
    return _explored(file, options, arguments)


def _explored(file: RobotFile, options: "Exploring", arguments: argparse.Namespace) -> "Dataset":
    """What is interrupted, or fails on the way, is kept to go on from."""
    from daemon.learning.samples.dataset import DatasetError
    from daemon.workbench.pretraining.parts import ExplorationParts

    load_g, real_time = arguments.tip_load, arguments.real_time
    parts = ExplorationParts(arguments.out, file, options, arguments.seed, load_g, real_time)
    if arguments.run is not None and arguments.run.exists():
        raise DatasetError(f"{arguments.run} is there already: name a new folder")
    if arguments.resume:
        parts.check()
        print(f"{parts.how_far} are there already", flush=True)
    else:
        _begin(parts)
    try:
        with all_like_ctrl_c():
            _explore(parts, file if real_time else None)
        dataset = parts.dataset()
        dataset.save(arguments.out)
    except BaseException:
        _keep(parts)
        raise
    parts.end(arguments.run)
    return dataset


def _explore(parts: "ExplorationParts", file: RobotFile | None) -> None:
    """file: of the robot, for real time."""
    from daemon.commands.terminal.compiled import compile_all, telling_progress
    from daemon.commands.terminal.progress_line import Aside

    with telling_progress() as progress:
        if file is None:
            parts.explore(progress.tell, progress)
            return
        compile_all(file)  # here, where it is told: the lab's process is waited for
        with Aside(progress) as aside:
            parts.explore(aside.tell, aside)


def _begin(parts: "ExplorationParts") -> None:
    from daemon.learning.samples.dataset import DatasetError

    try:
        parts.begin()
    except FileExistsError:
        raise DatasetError(
            f"an interrupted exploration is kept in {parts.folder}: go on with --resume, or remove "
            f"it"
        ) from None


def _keep(parts: "ExplorationParts") -> None:
    if not parts.done:
        parts.end(None)
        return
    print(
        f"ended after {parts.how_far}; they are kept in {parts.folder}: the same "
        f"command with --resume goes on",
        file=sys.stderr,
    )
