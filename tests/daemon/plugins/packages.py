"""Packages with one kind each, as somebody else would write them."""

from pathlib import Path
from textwrap import dedent, indent

from tests.installed_package import write_package

OPTIONS = """
from typing import Literal

from config.documents.kinds import Kind, KindOptions
from config.emulation.plants import PlantOptions
from config.tasks.trajectory import Periodic


class Mine(KindOptions):
    \"\"\"Goes nowhere. Which is enough.\"\"\"

    kind: Literal["mine"]
    gain: float = 1.0


class MyBody(PlantOptions):
    kind: Literal["mine"]
    length_mm: float = 100.0
    body_radius_mm: float = 5.0


class MyPath(Periodic):
    kind: Literal["mine"]
    height_mm: float = 190.0


MINE = Kind(Mine, "other_people.maker:make")
BODY = Kind(MyBody, "other_people.maker:make")
PATH = Kind(MyPath, "other_people.maker:make")
"""

CONTROLLER = """
import sys
import time

import numpy as np

from daemon.control.controller import ControllerError, Proposal


class Controller:
    name = "mine"
    ready = True

    def __init__(self, axes):
        self.axes, self.asked = axes, 0

    def reset(self, observation):
        pass

    def observe(self, observation):
        pass

    def propose(self, observation):
        self.asked += 1
{propose}

    def learn(self):
{learn}

    def save(self, path):
        pass

    def load(self, path):
        pass


def make(options, robot, seed):
{make}
    return Controller(len(robot.axes))
"""

NOTHING = "return Proposal(np.zeros(self.axes))"


def controller_package(
    folder: Path,
    propose: str = NOTHING,
    learn: str = "pass",
    make: str = "pass",
    options: str = OPTIONS,
    maker: str | None = None,
) -> Path:
    """A package whose controller `mine` does this."""
    body = indent(dedent(propose), " " * 8)
    source = CONTROLLER.format(
        propose=body, learn=indent(dedent(learn), " " * 8), make=indent(dedent(make), " " * 4)
    )
    modules = {"kinds": options, "maker": source if maker is None else maker}
    points = {"tentacled.controllers": {"mine": "other_people.kinds:MINE"}}
    return write_package(folder, "other_people", modules, points)


PLANT = """
import numpy as np

from drivers.pose import Pose
from sim_backends.plants.plant import BodyState


class Plant:
    def __init__(self, axes):
        self.actuator_count = {count}
        self.steps = 0

    def reset(self):
        self.steps = 0

    def step(self, actuators, load, dt_s):
        self.steps += 1
        line = np.array([[0.0, 0.0, 0.0], [actuators[0], actuators[1], 100.0]])
        state = BodyState(
            line, Pose(line[-1].copy(), np.array([1.0, 0.0, 0.0, 0.0])), np.zeros({count}), 5.0
        )
{step}
        return state


def make(options, robot):
    axes = len(robot.axes)
    return Plant(axes)
"""


def plant_package(folder: Path, step: str = "pass", count: str = "6") -> Path:
    """A package whose plant `mine` does this after its first ten steps."""
    late = indent("if self.steps > 10:\n" + indent(dedent(step), " " * 4), " " * 8)
    modules = {"kinds": OPTIONS, "maker": PLANT.format(step=late, count=count)}
    points = {"tentacled.plants": {"mine": "other_people.kinds:BODY"}}
    return write_package(folder, "other_people", modules, points)


PATH = """
import numpy as np

from daemon.reference.trajectories import Cycle


def make(options, base, cycles):
    rate = 2.0 * np.pi / options.cycle_s

    def at(t_s):
        {at}
        angle = rate * t_s
        place = np.array([10.0 * np.sin(angle), 0.0, options.height_mm])
        return place, np.array([10.0 * rate * np.cos(angle), 0.0, 0.0])

    return Cycle(at)
"""


def path_package(folder: Path, at: str = "pass", maker: str | None = None) -> Path:
    """A package whose trajectory `mine` does this at each time."""
    modules = {"kinds": OPTIONS, "maker": PATH.format(at=at) if maker is None else maker}
    points = {"tentacled.trajectories": {"mine": "other_people.kinds:PATH"}}
    return write_package(folder, "other_people", modules, points)
