"""`tentacled init controller|robot DIR`: something whole to begin with, which works as it stands.

A controller is a small package with its options, its tracking test and an experiment. A robot is
the shipped file with its drives' EDS file and an experiment, to be changed.
"""

import argparse
import re
from importlib.metadata import version
from importlib.resources import files
from importlib.util import find_spec
from keyword import iskeyword
from pathlib import Path
from typing import Final

from config.documents.kinds import CONTROLLERS, entries
from daemon.commands.outcome.failures import UsageError
from daemon.commands.outcome.result import Result
from daemon.files import make_folder

_NAME: Final = re.compile(r"[a-z][a-z0-9_]{0,62}")
_EXPERIMENTS: Final = {
    "soft_arm": "rectangle",
    "tendon_arm": "tendon_circle",
    "concentric_tubes": "ctr_circle",
    "one_segment_arm": "one_segment_circle",
    "three_tendon_arm": "three_tendon_circle",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("what", choices=("controller", "robot"), metavar="controller|robot")
    parser.add_argument("folder", type=Path, metavar="DIR", help="made new; it gives the name")
    parser.add_argument(
        "--like",
        choices=tuple(_EXPERIMENTS),
        default="soft_arm",
        metavar="ROBOT",
        help=f"the shipped robot to begin with: {', '.join(_EXPERIMENTS)} (soft_arm)",
    )


def run(arguments: argparse.Namespace) -> Result:
    folder: Path = arguments.folder
    name = folder.absolute().name.replace("-", "_")
    if not _NAME.fullmatch(name):
        text = "must be a lower-case word: letters, digits and _ after a letter"
        raise UsageError(f"{folder}: its name is the {arguments.what}'s, and {text}")
    if arguments.what == "controller" and name in entries(CONTROLLERS):
        raise UsageError(f"there is a controller {name} already: take another name")
    if arguments.what == "controller" and (iskeyword(name) or find_spec(name) is not None):
        raise UsageError(f"Python has a word or a module {name} already: take another name")
    make_folder(folder.parent)
    folder.mkdir()
    made = _controller(name) if arguments.what == "controller" else _robot(name, arguments.like)
    for path, text in made.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_text(text, encoding="utf-8")
    paths = [folder / path for path in made]
    lines = [*map(str, paths), _NEXT[arguments.what].format(folder=folder)]
    if arguments.what == "robot" and f"robot: {name}\n" not in made["robot.yaml"]:
        lines.append(
            f"it is still called {arguments.like}, as the models that are shipped for it are of "
            f"that name: `robot: {name}` in robot.yaml renames it, and goes with models of its own"
        )
    return Result({"made": paths}, "\n".join(lines))


_NEXT: Final = {
    "controller": (
        "now: pip install --editable {folder}, tentacled plugins, pytest {folder}, and\n"
        "tentacled experiment {folder}/circle.yaml --out circle"
    ),
    "robot": (
        "now: tentacled check {folder}/robot.yaml, and\n"
        "tentacled experiment {folder}/experiment.yaml --out run"
    ),
}


# A robot: shipped files, that name each other instead of what is shipped.


def _robot(name: str, like: str) -> dict[str, str]:
    robot = _shipped(f"robots/{like}.yaml")
    experiment = _shipped(f"experiments/{_EXPERIMENTS[like]}.yaml")
    robot = robot.replace("$schema=../robot.schema.json", "$schema=robot.schema.json")
    robot = robot.replace("builtin:stepper.eds  #", "stepper.eds  #")
    if ".npz" not in robot + experiment:  # what is learnt goes with the name of whose it is
        robot = re.sub(r"(?m)^robot: \w+$", f"robot: {name}", robot)
    experiment = experiment.replace(f"robot: builtin:{like}", "robot: robot.yaml")
    return {
        "robot.yaml": robot,
        "stepper.eds": _shipped("eds/stepper.eds"),
        "robot.schema.json": _shipped("robot.schema.json"),
        "experiment.yaml": experiment,
    }


def _shipped(path: str) -> str:
    return (files("config") / path).read_text(encoding="utf-8")


# A controller: forty lines that follow a circle, and what makes them a package.


def _controller(name: str) -> dict[str, str]:
    title = "".join(word.capitalize() for word in name.split("_"))
    needs = version("tentacled")
    texts = {
        "pyproject.toml": _PYPROJECT,
        "README.md": _README,
        f"{name}/__init__.py": _PACKAGE,
        f"{name}/kinds.py": _KINDS,
        f"{name}/controller.py": _CONTROLLER,
        "circle.yaml": _CIRCLE,
        "tests/test_tracking.py": _TEST,
    }
    return {
        path: text.replace("NAME", name).replace("TITLE", title).replace("VERSION", needs)
        for path, text in texts.items()
    }


_PYPROJECT: Final = """\
[build-system]
requires = ["setuptools>=77"]
build-backend = "setuptools.build_meta"

[project]
name = "NAME"
version = "0.1.0"
dependencies = ["tentacled>=VERSION", "numpy"]

[project.entry-points."tentacled.controllers"]
NAME = "NAME.kinds:KIND"

[tool.setuptools]
packages = ["NAME"]
"""

_README: Final = """\
# NAME

A controller for tentacled. `pip install --editable .`, then `tentacled plugins` shows it, `pytest`
tests it, and `controller: {kind: NAME}` in an experiment runs it. What it may use is `daemon.api`.
"""

_PACKAGE: Final = '"""The controller NAME."""\n'

_KINDS: Final = '''\
"""What an experiment may say of the controller. It is read wherever a file names it: import little.
"""

from typing import Literal

from daemon.api import Kind, TipFollowing


class TITLEOptions(TipFollowing):
    """Moves each axis a little, and follows with what the tip did."""

    kind: Literal["NAME"]

    probe_share: float = 0.06
    """How far each axis is moved first, as a share of its range."""


KIND = Kind(TITLEOptions, "NAME.controller:make", api=1)
'''

_CONTROLLER: Final = '''\
"""Moves each axis a little, keeps what the tip did as its Jacobian, and follows with it."""

import numpy as np

from daemon.api import Proposal, TipFollower

MOVING, SETTLING = 20, 30  # frames, of which there are 40 a second


class TITLEController:
    name = "NAME"

    def __init__(self, options, robot):
        self.law = TipFollower(options, robot)
        self.probe = options.probe_share * self.law.axes.scale
        self.jacobian = np.zeros((3, len(self.probe)))  # mm per mm or rad
        self.axis = self.frames = 0

    @property
    def ready(self):  # until then the reference waits
        return self.axis == len(self.probe)

    def reset(self, observation):
        self.law.reset(observation)

    def observe(self, observation):
        pass  # to learn from: called for every frame

    def propose(self, observation):
        if self.ready:
            step = self.law.axis_step(self.jacobian, self.law.tip_step(observation), observation)
            return self.law.proposal(step, observation)
        return Proposal(self.next_probe(observation), f"axis {self.axis + 1} of {len(self.probe)}")

    def next_probe(self, observation):
        if self.frames == 0:
            self.before = observation.tip_mm.copy(), observation.u.copy()
        self.frames += 1
        step = np.zeros(len(self.probe))
        if self.frames <= MOVING:
            step[self.axis] = self.probe[self.axis] / MOVING
        elif self.frames == MOVING + SETTLING:
            tip_mm, u = self.before
            moved = observation.u[self.axis] - u[self.axis]
            self.jacobian[:, self.axis] = (observation.tip_mm - tip_mm) / moved
            self.axis, self.frames = self.axis + 1, 0
        return step

    def learn(self):  # in spare time, half a millisecond at the most
        self.law.work_off()

    def save(self, path):
        np.save(path, self.jacobian)

    def load(self, path):
        self.jacobian, self.axis = np.load(path), len(self.probe)


def make(options, robot, seed):
    return TITLEController(options, robot)
'''

_CIRCLE: Final = """\
experiment: NAME_circle
robot: builtin:soft_arm
trajectory: {kind: circle, center_mm: [0, 0, 185], radius_mm: 15, cycle_s: 30}
controller: {kind: NAME}
"""

_TEST: Final = '''\
"""The tip follows a circle, also on another arm of the same design."""

import pytest


@pytest.mark.tentacled_seeds(1, plants=2)
def test_circle(lab, seed, plant):
    result = lab.run("../circle.yaml", seed=seed, plant=plant)
    assert result.cycle(1).mean_mm < 1.0
    assert result.holds == 0
'''
