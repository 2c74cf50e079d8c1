"""`tentacled explore ROBOT.yaml --out DATA.npz`: random motions of a robot, to learn from.

Emulated devices stand in for the robot, in virtual time or in real. A rig is explored by its
daemon: load and start an experiment file whose controller is `waypoint_exploration`, then make data
of the recording with `--from`.
"""

import argparse
import sys
import tempfile
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import ValidationError

from config.exploration import WaypointExploration
from config.loader import RobotFile
from daemon.cli import EXIT_FAILED, EXIT_OK, EXIT_USAGE
from daemon.robot_argument import add_robot_argument, robot_or_explain

if TYPE_CHECKING:
    from daemon.learning.dataset import Dataset

_DEFAULT = WaypointExploration(kind="waypoint_exploration")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_robot_argument(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="DATA.npz")
    parser.add_argument(
        "--waypoints",
        type=int,
        default=_DEFAULT.waypoints,
        metavar="N",
        help="random places of the axes to go to (default: %(default)s)",
    )
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="default: %(default)s")
    parser.add_argument(
        "--share",
        type=float,
        default=_DEFAULT.travel_share,
        metavar="SHARE",
        help="of each axis' travel, in its middle, that the places are from (default: all of it)",
    )
    parser.add_argument(
        "--dither",
        type=float,
        default=_DEFAULT.dither_share,
        metavar="SHARE",
        help="of each axis' travel that it swings by on its way (default: %(default)s)",
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
        "--from",
        dest="recorded",
        type=Path,
        metavar="RUN",
        help="explore nothing: take what a recorded run of this robot has seen",
    )


def run(arguments: argparse.Namespace) -> int:
    # All of the daemon and its emulators: `--help` does without.
    from daemon.experiment.trial import TrialError
    from daemon.learning.dataset import DatasetError

    checked = robot_or_explain(arguments.robot)
    if checked is None:
        return EXIT_FAILED
    try:
        options = WaypointExploration(
            kind="waypoint_exploration",
            waypoints=arguments.waypoints,
            travel_share=arguments.share,
            dither_share=arguments.dither,
        )
        if not (arguments.tip_load >= 0.0 and arguments.seed >= 0):
            raise ValueError("neither a load nor a seed is below 0")
    except ValidationError as error:
        for problem in error.errors():
            print(f"{problem['loc'][0]}: {problem['msg']}", file=sys.stderr)
        return EXIT_USAGE
    except ValueError as error:
        print(error, file=sys.stderr)
        return EXIT_USAGE
    try:
        dataset = _seen(checked.file, options, arguments)
        dataset.save(arguments.out)
    except FileExistsError:
        print(f"{arguments.run} is there already: name a new folder", file=sys.stderr)
        return EXIT_FAILED
    except (TrialError, DatasetError, OSError) as error:
        print(error, file=sys.stderr)
        return EXIT_FAILED
    frames = dataset.frames
    print(f"{arguments.out}: {len(frames)} frames, {frames.duration_s:.0f} s of motion")
    return EXIT_OK


def _seen(
    file: RobotFile, options: WaypointExploration, arguments: argparse.Namespace
) -> "Dataset":
    from daemon.experiment.trial import TrialError
    from daemon.exploration.explore import dataset_of_run, explore

    if arguments.recorded is not None:
        return dataset_of_run(arguments.recorded, file, {"run": str(arguments.recorded)})
    if file.robot.emulation is None:
        raise TrialError(
            f"{file.path} has no 'emulation': let its daemon explore, and take the run with --from"
        )
    with _folder(arguments.run) as folder:
        return explore(
            file,
            options,
            arguments.seed,
            Path(folder),
            lambda line: print(line, flush=True),
            tip_load_g=arguments.tip_load,
            real_time=arguments.real_time,
        )


def _folder(kept: Path | None) -> "nullcontext[str] | tempfile.TemporaryDirectory[str]":
    if kept is None:
        return tempfile.TemporaryDirectory(prefix="tentacled-")
    kept.mkdir(parents=True)
    return nullcontext(str(kept))
