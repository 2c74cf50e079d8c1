"""Has everything compiled that a lab and a daemon compile, and says how far that is.

Processes that find it compiled start in a second, and need not say anything. As a program:
`python -m daemon.commands.terminal.compiled`, and beside it, on another core, the same with `risk`.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Final

from config.loader import RobotFile
from daemon.commands.terminal.progress_line import ProgressLine
from daemon.host.clock import MonotonicClock

_STEP_NS: Final = 25_000_000
"""Of a tracker at 40 Hz."""
_WITH_A_MODEL: Final = "builtin:tendon_arm"


@contextmanager
def telling_progress() -> Iterator[ProgressLine]:
    """A line for long work, which also tells of what is compiled for it."""
    # numba, which who asks for help alone does not wait for.
    from daemon.host.compilation import compilation_told

    with ProgressLine() as line, compilation_told(line.between()):
        yield line


def compile_all(file: RobotFile | None = None) -> None:
    """What is compiled already is loaded: tenths of a second.

    file: of the robot whose lab is wanted too.
    """
    # What is compiled takes its time to be imported too.
    from daemon.controllers.make_controller import warm_up
    from sim_backends.lab.bodies import LabError
    from sim_backends.lab.lab import Lab
    from sim_backends.plants.shooting import warm_up as warm_up_plant

    warm_up_plant()
    warm_up()
    if file is not None:
        with suppress(LabError):  # which its own process will tell
            body = Lab(file.robot, file.path, MonotonicClock()).body
            body.advance(body.advanced_ns + _STEP_NS)


def compile_risk() -> None:
    """What a gate tells the risk with: of the shipped arm whose file names a model."""
    from config.loader import load_robot
    from daemon.risk.body_risk_source import make_risk_source
    from daemon.robot.shipped_files import shipped_files

    make_risk_source(load_robot(shipped_files("robots")[_WITH_A_MODEL]), MonotonicClock())


if __name__ == "__main__":
    with telling_progress():
        if "risk" in sys.argv[1:]:
            compile_risk()
        else:
            compile_all()
