"""A controller without a model: it measures the Jacobian, and corrects it by what it sees.

A sample for the correction ends only when axes and tip have gone far enough: from one frame to the
next there is mostly noise.
"""

from itertools import chain
from math import isfinite
from pathlib import Path

import numpy as np

from config.controllers import Broyden
from config.robot import Robot
from daemon.control.controller import Observation, Proposal
from daemon.control.tip_following import TipFollower
from daemon.controllers.exploration import Exploration
from daemon.controllers.fixed_model_file import load_model, model_metadata, save_model
from daemon.controllers.jacobian_correction import FIRST_STD_MM
from daemon.controllers.jacobian_estimate import JacobianEstimate
from daemon.npz_file import ModelError
from drivers.pose import Vector


class BroydenController:
    """A `Controller`."""

    name = "broyden"

    def __init__(self, options: Broyden, robot: Robot) -> None:
        self._options = options
        self._metadata = model_metadata(self.name, robot)
        self._follower = TipFollower(options, robot)
        self._travel = self._follower.axes.travel
        self._exploration = Exploration(options, self._follower.axes)
        self._estimate: JacobianEstimate | None = None
        self._anchor: tuple[Vector, Vector] | None = None

    @property
    def ready(self) -> bool:
        return self._estimate is not None

    @property
    def jacobian(self) -> Vector | None:
        """(3, m) mm per mm or rad; None before it is measured."""
        return None if self._estimate is None else self._estimate.jacobian / self._travel

    def reset(self, observation: Observation) -> None:
        self._follower.reset(observation)
        self._exploration.reset()
        self._anchor = None

    def observe(self, observation: Observation) -> None:
        measured = chain(observation.u.tolist(), observation.tip_mm.tolist())
        if not (observation.believed and all(map(isfinite, measured))):
            return
        if self._estimate is None:
            self._exploration.observe(observation)
            if self._exploration.done:
                self._begin(self._exploration.jacobian, np.eye(len(self._travel)) * FIRST_STD_MM**2)
            return
        here = (observation.u / self._travel, observation.tip_mm)
        if self._anchor is None:
            self._anchor = here
            return
        moved, tip_moved = here[0] - self._anchor[0], here[1] - self._anchor[1]
        if (
            float(moved @ moved) >= self._options.sample_travel_share**2
            and float(tip_moved @ tip_moved) >= self._options.sample_tip_mm**2
        ):
            self._estimate.correct(moved, tip_moved)
            self._anchor = here

    def propose(self, observation: Observation) -> Proposal:
        if self._estimate is None:
            return Proposal(self._exploration.propose(observation), self._exploration.note)
        jacobian = self._estimate.jacobian / self._travel
        tip_step = self._follower.tip_step(observation)
        return Proposal(self._follower.axis_step(jacobian, tip_step, observation))

    def learn(self, budget_s: float) -> None:
        """Nothing waits: a sample is worked in as it comes."""

    def save(self, path: Path) -> None:
        if self._estimate is None:
            raise ModelError("there is nothing to save: the Jacobian is not measured yet")
        estimate = self._estimate
        arrays = {"jacobian": estimate.jacobian, "covariance": estimate.covariance}
        save_model(path, self._metadata, arrays)

    def load(self, path: Path) -> None:
        count = len(self._travel)
        shapes = {"jacobian": (3, count), "covariance": (count, count)}
        arrays = load_model(path, self._metadata, shapes)
        self._begin(arrays["jacobian"], arrays["covariance"])

    def _begin(self, jacobian: Vector, covariance: Vector) -> None:
        self._estimate = JacobianEstimate(
            jacobian, covariance, self._options.sample_noise_mm, self._options.drift_mm
        )
        self._anchor = None
