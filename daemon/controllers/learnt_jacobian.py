"""How the tip answers to the axes, as far as it was learnt: what all learning controllers go by.

Where pre-training has been, its forward model tells the Jacobian, by a cubic of all axes or by its
receptive fields, whichever foretells motions better, corrected by what was seen in the last moment.
Elsewhere there is a Jacobian that is carried along and corrected by every motion, as the controller
`broyden` has it; without a model that is all there is.

The fields stay as pre-training made them. New ones, born while a trajectory is followed, would see
motions along it and no others, and tell nonsense about all other directions.
"""

from collections.abc import Mapping
from math import sqrt
from typing import Final, Protocol

import numpy as np

from config.tasks.controllers import Learner
from daemon.control.axis_speeds import Foresight
from daemon.control.controller import ControllerError, Observation
from daemon.control.jacobian_estimate import JacobianEstimate
from daemon.control.jacobian_kernels import in_rows
from daemon.control.lag.answer import surely_right
from daemon.control.task import POSE, POSITION, task_of
from daemon.control.tip_following import TipFollower
from daemon.learning.forward.cubic_shape import CubicShape
from daemon.learning.forward.forward_model import slopes_by_step
from daemon.learning.forward.pretrained_model import PretrainedModel
from daemon.learning.lwpr.model import Lwpr, with_memory
from daemon.learning.samples.motion import MotionSample
from drivers.pose import Vector


class TipJacobian(Protocol):
    """What a controller that learns from motions asks of what it learns: Jacobians are (3, m), mm
    per mm or rad."""

    believed: float
    """The share of what the last motions have told of the model's errors that counts."""
    forward: Lwpr | None
    """The forward model of receptive fields, where it goes by one."""

    @property
    def known(self) -> bool:
        """Whether there is a Jacobian at all."""
        ...

    @property
    def modelled(self) -> bool:
        """Whether an exploration tells what a motion should do."""
        ...

    def begin(self, model: PretrainedModel) -> None:
        """Go by what pre-training knows from now on."""
        ...

    def measured(self, jacobian: Vector) -> None:
        """There is no model, but this is how the tip answers here."""
        ...

    def covered(self, tip_mm: Vector, u: Vector) -> float:
        """How far the model is believed here, 0 to 1."""
        ...

    def at(self, tip_mm: Vector, u: Vector) -> Vector:
        """The Jacobian here."""
        ...

    def learn(self, sample: MotionSample) -> None:
        """Take a motion."""
        ...

    def forget_correction(self) -> None:
        """Go by the model as pre-training left it, where it is."""
        ...

    def body_changed(self) -> None:
        """Something was hung on or taken off: what comes next tells more than what was known."""
        ...

    def to_arrays(self) -> dict[str, Vector]:
        """What was learnt besides the model."""
        ...

    def restore(self, arrays: Mapping[str, Vector]) -> None:
        """Go on from `to_arrays`. Raises KeyError, and ValueError for other axes."""
        ...


# What a Jacobian lacks here and now, found by the motions of the last moment.
#
# A learnt model knows how the Jacobian J changes from place to place; a load, creep or another
# body change all of it a little. The difference E is corrected by every motion x → d: as little
# as possible, and where it is uncertain rather than where it was just measured, E + (d − (J + E)
# x) xᵀP / (xᵀP x + r). P, how uncertain the rows of E are by direction, shrinks along what was
# measured and grows with the distance moved. While the axes go on, E fades where nothing new is
# told about it: the model is then the better guess.


_UNEXPLAINED: Final = 0.6, 0.1
"""Hysteresis and curvature: the part of a motion of the tip that no Jacobian explains, while the
model is right, and where the body is another than the model's. What a model that is right seems to
lack is mostly that; a load that was hung on shall be learnt at once."""
_RIGHT: Final = 0.3, 0.45
"""Shares of the last motions that the model lacks where it is right, and where it is not. Chosen:
with 14 g at the tip they are 0.12 to 0.23, with 30 g 0.32 to 0.46."""
_CHANGED_KEPT: Final = 0.998
"""From motion to motion, of a change that was seen: what is hung on stays, and is another body at
each place of a path. A metre of one is five hundred of them."""
FIRST_STD_MM = 20.0
"""Of a Jacobian's elements, mm per travel, before anything corrects them: hysteresis more than
noise."""
_LARGEST_STD_MM = 200.0
_SLOWEST, _FASTEST, _TURNED = -0.5, 2.0, 0.7
"""How much less, and how much more, than J has it a step may move the tip, and how far aside. There
are directions in which the tip hardly moves, and noise would soon turn them round; and who believes
that the axes do less than they do asks for too much."""


_WORTH_KEPT: Final = 0.9
"""From motion to motion, of what tells how good the difference is: the last ten count."""
_DOUBT: Final = 1.0
"""Standard errors by which a share must be above nothing."""


class JacobianCorrection:
    """Axes count in shares of their travel: elements are mm per whole travel."""

    def __init__(self, axes: int, noise_mm: float, drift_mm: float, reach: float) -> None:
        """noise_mm: of one coordinate of a motion. drift_mm: how far an element may wander while
        the axes go through their whole travel. reach: after so many travels a third is left."""
        self.difference = np.zeros((3, axes))
        """(3, m) E."""
        self.covariance = FIRST_STD_MM**2 * np.eye(axes)
        """(m, m) P, mm², of each row."""
        self.foretold = np.zeros(4)
        """Over the last motions, before they were learnt from, mm²: what E said times what J
        lacked, what E said squared, what J lacked squared; and how many coordinates that were."""
        self.went_mm2 = 0.0
        """The tip's motions squared, over the same."""
        self.changed = 0.0
        """How far the body was seen to become another one, 0 to 1."""
        self._noise_variance = noise_mm**2
        self._drift_variance = drift_mm**2
        self._reach = reach

    def correct(self, jacobian: Vector, moved: Vector, tip_moved: Vector) -> None:
        """Take a motion: (m,) of the axes, (3,) of the tip. jacobian: (3, m) J there."""
        said, lacked = self.difference @ moved, tip_moved - jacobian @ moved
        seen = np.array([said @ lacked, said @ said, lacked @ lacked, float(len(lacked))])
        self.foretold = _WORTH_KEPT * self.foretold + seen
        self.changed *= _CHANGED_KEPT
        went_mm2 = float(tip_moved @ tip_moved)
        self.went_mm2 = _WORTH_KEPT * self.went_mm2 + went_mm2
        travelled = float(np.linalg.norm(moved))
        kept = float(np.exp(-travelled / self._reach))
        difference = kept * self.difference
        covariance = kept**2 * self.covariance
        covariance += self._drift_variance * travelled * np.eye(len(moved))
        covariance *= min(1.0, _LARGEST_STD_MM**2 / float(covariance.diagonal().max()))
        along = covariance @ moved
        noise = self._noise_variance + self._unexplained**2 * went_mm2
        gain = along / (float(moved @ along) + noise)
        difference += np.outer(tip_moved - (jacobian + difference) @ moved, gain)
        covariance -= np.outer(gain, along)
        self.difference = _limited(difference, jacobian)
        self.covariance = 0.5 * (covariance + covariance.T)

    @property
    def _unexplained(self) -> float:
        """The part of a motion that no Jacobian is taken to explain.

        Little where something was seen to be hung on. Where motions alone say that the body is
        another one, as much as E has left of late: a hysteresis says so as well, and would be
        learnt from every motion anew, and wrong at the next turn.
        """
        (most, least), (right, wrong) = _UNEXPLAINED, _RIGHT
        agreed, said, lacked, _ = self.foretold.tolist()
        went_mm2 = max(self.went_mm2, 1e-9)
        left = sqrt(max(lacked - 2.0 * agreed + said, 0.0) / went_mm2)
        other = min(max((sqrt(lacked / went_mm2) - right) / (wrong - right), 0.0), 1.0)
        seen = most + self.changed * (least - most)
        return min(seen, most + other * (min(max(left, least), most) - most))

    @property
    def worth(self) -> float:
        """The share of E, 0 to 1, that would surely have been right to believe of late.

        The s for which J + s E explains the last motions best, less its standard error. An E that
        follows a hysteresis is wrong as soon as that turns; who believes it asks for nonsense.
        """
        return min(max(surely_right(self.foretold, _DOUBT), 0.0), 1.0)


def _limited(difference: Vector, jacobian: Vector) -> Vector:
    """E = G J + rest, where J times the rest is zero, with G = S + A in its limits."""
    changed = difference @ np.linalg.pinv(jacobian)
    turned = 0.5 * (changed - changed.T)
    values, vectors = np.linalg.eigh(changed - turned)
    beyond = vectors * (values - np.clip(values, _SLOWEST, _FASTEST)) @ vectors.T
    angle = float(np.linalg.norm(turned)) / np.sqrt(2.0)
    if angle > _TURNED:
        beyond += (1.0 - _TURNED / angle) * turned
    return np.asarray(difference - beyond @ jacobian)


_COVERED_ABOVE = 0.01
"""Largest weight of a field from which on the forward model is believed in full."""
_CARRIED_DRIFT_MM = 25.0
"""As for `broyden`: nothing tells how the Jacobian changes from place to place."""


class LearntJacobian:
    """A `TipJacobian`."""

    def __init__(
        self, options: Learner, travel: Vector, memory_samples: float | None = None
    ) -> None:
        """travel: (m,) of the axes. memory_samples: how many a field of the model remembers while
        it goes on learning; None: fields stay as they are."""
        self.forward: Lwpr | None = None
        """Inputs [p, u, Δu], output Δp."""
        self.believed = 1.0
        """The share of what the last motions have told of the model's errors that counts."""
        self._shape: CubicShape | None = None
        """What tells the Jacobian instead of the fields, where it is the better guess."""
        self._memory_samples = memory_samples
        self._options = options
        self._travel = travel
        self._correction = self._no_correction()
        self._carried: JacobianEstimate | None = None
        self._x = np.zeros(3 + 2 * len(travel))

    @property
    def known(self) -> bool:
        """Whether there is a Jacobian at all."""
        return self._carried is not None

    @property
    def modelled(self) -> bool:
        """Whether a forward model tells what a motion should do."""
        return self.forward is not None

    def begin(self, model: PretrainedModel) -> None:
        """Go by its forward model from now on."""
        memory = self._memory_samples
        self.forward = forward = model.lwpr if memory is None else with_memory(model.lwpr, memory)
        self._shape = model.shape if memory is None else None  # which does not go on learning
        self._correction = self._no_correction()
        places = 3 + len(self._travel)
        middle = forward.centres.mean(axis=0) * np.array(forward.settings.norm_in[:places])
        self._carry(self._modelled(middle[:3], middle[3:]))

    def measured(self, jacobian: Vector) -> None:
        """There is no model, but this is how the tip answers here."""
        self._carry(jacobian * self._travel)

    def covered(self, tip_mm: Vector, u: Vector) -> float:
        """How far the forward model is believed here, 0 to 1."""
        if self.forward is None:
            return 0.0
        return min(self.forward.activation(self._input(tip_mm, u)) / _COVERED_ABOVE, 1.0)

    def at(self, tip_mm: Vector, u: Vector) -> Vector:
        """The Jacobian here."""
        return self._at(tip_mm, u, self.covered(tip_mm, u)) / self._travel

    def forget_correction(self) -> None:
        """Go by the forward model as pre-training left it, where it is."""
        self._correction = self._no_correction()

    def body_changed(self) -> None:
        """The next motions are learnt from at once."""
        self._correction.changed = 1.0

    def learn(self, sample: MotionSample) -> None:
        """Take a motion."""
        middle_mm = sample.tip_mm + 0.5 * sample.delta_tip_mm
        middle_u = sample.u + 0.5 * sample.delta_u
        moved = sample.delta_u / self._travel
        share = self.covered(middle_mm, middle_u)
        if share > 0.0:
            modelled = self._modelled(middle_mm, middle_u)
            self._correction.correct(modelled, moved, sample.delta_tip_mm)
        if share < 1.0:
            assert self._carried is not None
            self._carried.correct(moved, sample.delta_tip_mm)
        else:
            self._carry(self._at(middle_mm, middle_u, share))
        if self._memory_samples is not None and self.forward is not None:
            inputs = np.concatenate([sample.tip_mm, sample.u, sample.delta_u])
            self.forward.update(inputs, sample.delta_tip_mm)

    def to_arrays(self) -> dict[str, Vector]:
        """What was learnt besides the forward model."""
        assert self._carried is not None
        return {
            "correction": self._correction.difference,
            "correction_covariance": self._correction.covariance,
            "correction_foretold": self._correction.foretold,
            "correction_went": np.array(self._correction.went_mm2),
            "correction_changed": np.array(self._correction.changed),
            "carried": self._carried.jacobian,
            "carried_covariance": self._carried.covariance,
        }

    def restore(self, arrays: Mapping[str, Vector]) -> None:
        """Go on from `to_arrays`. Raises KeyError, and ValueError for other axes."""
        m = len(self._travel)
        shapes = [arrays[name].shape for name in ("correction", "carried")]
        squares = [arrays[f"{name}_covariance"].shape for name in ("correction", "carried")]
        if shapes != 2 * [(3, m)] or squares != 2 * [(m, m)]:
            raise ValueError(f"its Jacobian is not for {m} axes")
        self._correction.difference = np.array(arrays["correction"])
        self._correction.covariance = np.array(arrays["correction_covariance"])
        self._correction.foretold = np.array(arrays.get("correction_foretold", np.zeros(4)))
        self._correction.went_mm2 = float(arrays.get("correction_went", np.zeros(())))
        self._correction.changed = float(arrays.get("correction_changed", np.zeros(())))
        self._carry(arrays["carried"])
        assert self._carried is not None
        self._carried.covariance = in_rows(arrays["carried_covariance"])

    # Axes count in shares of their travel from here on.

    def _at(self, tip_mm: Vector, u: Vector, share: float) -> Vector:
        assert self._carried is not None
        if share <= 0.0:
            return self._carried.jacobian
        worth = self._correction.worth if self._options.lead else 1.0
        believed = self.believed * worth
        corrected = self._modelled(tip_mm, u) + believed * self._correction.difference
        return np.asarray(share * corrected + (1.0 - share) * self._carried.jacobian)

    def _modelled(self, tip_mm: Vector, u: Vector) -> Vector:
        assert self.forward is not None
        if self._shape is not None:
            return self._shape.jacobian(u) * self._travel
        return slopes_by_step(self.forward, tip_mm, u) * self._travel

    def _input(self, tip_mm: Vector, u: Vector) -> Vector:
        m = len(self._travel)
        self._x[:3] = tip_mm
        self._x[3 : 3 + m] = u
        return self._x

    def _carry(self, jacobian: Vector) -> None:
        """Nothing is known but this. It is corrected without the limits of a model's correction:
        those keep what has come together near the model, and from sample to sample they would turn
        a Jacobian that has no model to stay near."""
        self._carried = JacobianEstimate(
            jacobian,
            FIRST_STD_MM**2 * np.eye(len(self._travel)),
            self._options.sample_noise_mm,
            _CARRIED_DRIFT_MM,
        )

    def _no_correction(self) -> JacobianCorrection:
        options = self._options
        return JacobianCorrection(
            len(self._travel),
            options.sample_noise_mm,
            options.correction_drift_mm,
            options.correction_reach,
        )


_NEAR_MM: Final = 20.0
"""Of a place, in which a model's motions tell where the axes were: as far as a Jacobian holds."""


def learnt_foresight(
    model: PretrainedModel, jacobian: TipJacobian, follower: TipFollower
) -> Foresight:
    """What a forward model and its motions say of a path that nobody has gone yet."""
    motions = model.motions

    def begin(tip_mm: Vector) -> Vector | None:
        """From that motion near the place which is nearest to the posture."""
        away_mm = np.linalg.norm(motions.tip_mm - tip_mm, axis=1)
        near = np.flatnonzero(away_mm <= _NEAR_MM)
        if not near.size:
            return None
        drawn = (motions.u[near] - follower.posture) / follower.axes.scale
        here = near[np.argmin((drawn**2).sum(axis=1) + (away_mm[near] / _NEAR_MM) ** 2)]
        seen_mm, u = motions.tip_mm[here], motions.u[here]
        return follower.axes_nearer(jacobian.at(seen_mm, u), tip_mm - seen_mm, u)

    def known(tip_mm: Vector, u: Vector) -> Vector | None:
        return jacobian.at(tip_mm, u) if jacobian.covered(tip_mm, u) >= 1.0 else None

    return Foresight(begin, known, follower.axis_velocity)


# How the tip's direction answers to the axes: models that were learnt are of its position.
#
# Where a reference says where to point, the direction's rows are fitted to the first motions, and
# then corrected by every motion, as the controller `broyden` does it: position and direction
# together, so that the tip's whole task is what a motion is held against.


_FRAMES_PER_AXIS: Final = 20
"""So many must the first motions give before rows are fitted: two seconds of motion for four axes.
"""
_RIDGE: Final = 1e-4
"""Of the mean square of the axes' motion."""
_MOVED_SHARE: Final = 0.005
"""A motion ends when the axes have gone so far, in shares of their range, and the tip too."""
_TASK_SHARE: Final = 0.5
"""Of the tip's way in a sample of the controller's: nothing but motions tells how the rows change.
"""


class PointingJacobian:
    """Axes count in shares of their range, directions in mm (`pointing_mm_per_rad`)."""

    def __init__(self, options: Learner, scale: Vector) -> None:
        """scale: (m,) how far each axis goes for a share of 1."""
        self._options = options
        self._scale = scale
        self._estimate: JacobianEstimate | None = None
        self._anchor: tuple[Vector, Vector] | None = None
        self._first: list[tuple[Vector, Vector]] = []
        """(m,) axes and (6,) task of all frames of the first motions."""

    @property
    def known(self) -> bool:
        """Whether it is known how the direction answers."""
        return self._estimate is not None

    @property
    def rows(self) -> Vector | None:
        """(3, m) mm of direction per mm or rad of the axes; None: not known."""
        if self._estimate is None:
            return None
        return np.asarray(self._estimate.jacobian[POSITION:] / self._scale)

    def break_off(self) -> None:
        """What comes next has nothing to do with what came before."""
        self._anchor = None

    def observe(self, observation: Observation) -> None:
        """Take a frame that is believed."""
        seen = task_of(observation, POSE, self._options.pointing_mm_per_rad)
        if seen is None or not (np.isfinite(seen).all() and np.isfinite(observation.u).all()):
            return
        here = observation.u / self._scale, seen
        if self._estimate is None:
            self._first.append(here)
            return
        if self._anchor is None:
            self._anchor = here
            return
        moved, turned = here[0] - self._anchor[0], here[1] - self._anchor[1]
        long_enough_mm = _TASK_SHARE * self._options.sample_tip_mm
        if float(moved @ moved) >= _MOVED_SHARE**2 and float(turned @ turned) >= long_enough_mm**2:
            self._estimate.correct(moved, turned)
            self._anchor = here

    def begin(self) -> None:
        """The first motions are over. Raises ControllerError where they showed too little."""
        axes = len(self._scale)
        if len(self._first) < _FRAMES_PER_AXIS * axes:
            raise ControllerError(
                f"the first motions showed the tip's direction {len(self._first)} times: see what "
                "hides the sensor at the tip, or let them be longer (babbling)"
            )
        us, tasks = (np.array(column) for column in zip(*self._first, strict=True))
        us, tasks = us - us.mean(axis=0), tasks - tasks.mean(axis=0)
        gram = us.T @ us
        ridge = _RIDGE * float(np.trace(gram)) / axes
        jacobian = np.linalg.solve(gram + ridge * np.eye(axes), us.T @ tasks).T
        self._go_on(jacobian, FIRST_STD_MM**2 * np.eye(axes))

    def to_arrays(self) -> dict[str, Vector]:
        """What was learnt, directions by themselves, in radians; empty: nothing yet."""
        if self._estimate is None:
            return {}
        jacobian = self._estimate.jacobian.copy()
        jacobian[POSITION:] /= self._options.pointing_mm_per_rad
        return {"pointing": jacobian, "pointing_covariance": self._estimate.covariance}

    def restore(self, arrays: Mapping[str, Vector]) -> None:
        """Go on from `to_arrays`, or from nothing. Raises KeyError, ValueError for other axes."""
        if "pointing" not in arrays:
            return
        m = len(self._scale)
        jacobian, covariance = np.array(arrays["pointing"]), arrays["pointing_covariance"]
        if jacobian.shape != (POSE, m) or covariance.shape != (m, m):
            raise ValueError(f"what it knows of the direction is not for {m} axes")
        jacobian[POSITION:] *= self._options.pointing_mm_per_rad
        self._go_on(jacobian, covariance)

    def _go_on(self, jacobian: Vector, covariance: Vector) -> None:
        self._first.clear()
        self._anchor = None
        self._estimate = JacobianEstimate(
            in_rows(jacobian),
            in_rows(covariance),
            self._options.sample_noise_mm,
            _CARRIED_DRIFT_MM,
        )
