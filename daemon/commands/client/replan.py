"""`tentacled replan --to X,Y,Z`: a path from where the robot stands, among what is round it now."""

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from daemon.commands.outcome.failures import CommandError
from daemon.commands.outcome.result import Result
from daemon.commands.terminal.argument_types import (
    add_goal_arguments,
    seconds,
    take_negative_numbers,
)
from daemon.commands.terminal.remote_arguments import (
    add_target_arguments,
    answer_result,
    run_talk,
)
from daemon.files import check_can_be_made, write_whole

if TYPE_CHECKING:
    from daemon.messages import Answer
    from daemon.remote.client.client import RobotClient

_EXPLAINED = """\
While the robot is armed or held. The running daemon has it planned beside its
loop, with its own surroundings; nothing moves by it. With --load the path is
made ready, and `tentacled start` follows it, in a hold too. The controller is
the one that --controller names, or the one that needs to know nothing.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog, parser.formatter_class = _EXPLAINED, argparse.RawDescriptionHelpFormatter
    take_negative_numbers(parser)
    add_target_arguments(parser)
    add_goal_arguments(parser)
    parser.add_argument(
        "--tip-speed", type=float, default=8.0, metavar="X", help="mm/s, at most (default: 8)"
    )
    parser.add_argument(
        "--most-risk", type=float, default=0.05, metavar="X",
        help="contact risk that the whole path may have, upper limit (default: 0.05)",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, metavar="PATH.json", help="keep the path here, too")
    parser.add_argument("--load", action="store_true", help="make it ready")
    parser.add_argument(
        "--controller", metavar="KIND", help="with --load: with its options' own defaults"
    )
    parser.add_argument(
        "--timeout",
        type=seconds,
        default=150.0,
        metavar="S",
        help="how long to wait for the answer",
    )


def run(arguments: argparse.Namespace) -> Result:
    if arguments.out is not None:
        check_can_be_made(arguments.out)

    async def talk(client: "RobotClient") -> Result:
        answer = await client.plan(
            arguments.to,
            arguments.via,
            arguments.pointing,
            tip_speed_mm_s=arguments.tip_speed,
            most_risk=arguments.most_risk,
            within_s=arguments.timeout,
        )
        if arguments.out is not None:
            if answer.path is None:
                text = (
                    f"it is planned, but too long for an answer: {answer.file}, in the daemon's "
                    "own folder (`run --files`), is the path"
                )
                raise CommandError("failed", text, place=str(arguments.out))
            content = json.dumps(answer.path, separators=(",", ":"))
            write_whole(arguments.out, (content + "\n").encode())
        if arguments.load:
            controller = None if arguments.controller is None else {"kind": arguments.controller}
            await client.load({"kind": "planned", "file": answer.file}, controller)
        return _told(answer, loaded=arguments.load)

    return run_talk(arguments, talk)


def _told(answer: "Answer", loaded: bool) -> Result:
    result = answer_result(answer)
    figures = (answer.path or {}).get("figures", {})
    lines = [f"{answer.file}: {answer.text}{', loaded' if loaded else ''}"]
    if "contact_risk_upper_limit" in figures:
        lines.append(
            f"contact risk of the whole path at most {figures['contact_risk_upper_limit']:.2%}, "
            f"clearance {figures['clearance_5_percent_mm']:.1f} mm (one body in twenty has no more)"
        )
    return Result(result.data, "\n".join(lines), result.code)
