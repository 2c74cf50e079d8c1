"""How the tip answers to the axes, as far as it was learnt: what all learning controllers go by.

Where pre-training has been, its forward model tells the Jacobian, by a cubic of all axes or by its
receptive fields, whichever foretells motions better, corrected by what was seen in the last moment.
Elsewhere there is a Jacobian that is carried along and corrected by every motion, as the controller
`broyden` has it; without a model that is all there is.

The fields stay as pre-training made them. New ones, born while a trajectory is followed, would see
motions along it and no others, and tell nonsense about all other directions.
"""

from collections.abc import Mapping
from typing import Final, Protocol

import numpy as np

from config.tasks.controllers import Learner
from daemon.control.axis_speeds import Foresight
from daemon.control.jacobian_estimate import FIRST_STD_MM, JacobianCorrection, JacobianEstimate
from daemon.control.jacobian_kernels import in_rows
from daemon.control.tip_following import TipFollower
from daemon.learning.forward.cubic_shape import CubicShape
from daemon.learning.forward.forward_model import slopes_by_step
from daemon.learning.forward.pretrained_model import PretrainedModel
from daemon.learning.forward.stop_operators import HeldBack
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

    @property
    def contradicted(self) -> bool:
        """Whether the model tells nothing of the last motions."""
        ...

    @property
    def held_back(self) -> HeldBack | None:
        """What the body of an exploration keeps back where axes turn; None: nothing is made up for
        there."""
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

    def learn(self, sample: MotionSample, gains: Vector) -> None:
        """Take a motion, as it was told: (3,) gains of it came, which are made up for."""
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


_COVERED_ABOVE = 0.01
"""Largest weight of a field from which on the forward model is believed in full."""
CARRIED_DRIFT_MM: Final = 25.0
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

    @property
    def contradicted(self) -> bool:
        """Whether the forward model tells nothing of the last motions, corrected as it is."""
        return self.modelled and self._correction.contradicted

    @property
    def held_back(self) -> HeldBack:
        """Of the body that the cubic is of. Fields are of motions as they are: nobody knows."""
        if self._shape is not None:
            return self._shape.held_back
        return HeldBack(None, np.zeros_like(self._travel), self._travel)

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

    def body_changed(self) -> None:
        """The next motions are learnt from at once."""
        self._correction.changed = 1.0

    def learn(self, sample: MotionSample, gains: Vector) -> None:
        """Take a motion, as it was told: (3,) gains of it came, which are made up for."""
        middle_mm = sample.tip_mm + 0.5 * sample.delta_tip_mm
        middle_u = sample.u + 0.5 * sample.delta_u
        moved = sample.delta_u / self._travel
        share = self.covered(middle_mm, middle_u)
        if share > 0.0:
            modelled = self._modelled(middle_mm, middle_u)
            self._correction.rescale(modelled, gains)
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
            "correction_told": np.array(self._correction.told_mm2),
            "correction_changed": np.array(self._correction.changed),
            "correction_gains": self._correction.gains,
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
        self._correction.told_mm2 = float(arrays.get("correction_told", np.zeros(())))
        self._correction.changed = float(arrays.get("correction_changed", np.zeros(())))
        gains = np.array(arrays.get("correction_gains", np.ones(3)))
        if gains.shape != (3,) or not (gains > 0.0).all():
            raise ValueError("the gains besides which it corrects are not three above 0")
        self._correction.gains = gains
        self._carry(arrays["carried"])
        assert self._carried is not None
        self._carried.covariance = in_rows(arrays["carried_covariance"])

    # Axes count in shares of their travel from here on.

    def _at(self, tip_mm: Vector, u: Vector, share: float) -> Vector:
        assert self._carried is not None
        if share <= 0.0:
            return self._carried.jacobian
        counting = self._correction.counting if self._options.leads else 1.0
        believed = self.believed * counting
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
            CARRIED_DRIFT_MM,
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
"""Of a place, in which a model's motions tell where the axes were."""
_PIECES: Final = 10
_DRAWN: Final = 0.3
"""The way from there to the place is gone in so many pieces, in each of them so far to the posture:
20 mm upwards are as much as the whole of a soft arm's travel, and a Jacobian changes twofold."""


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
        piece_mm = (tip_mm - seen_mm) / _PIECES
        for k in range(_PIECES):
            slopes = jacobian.at(seen_mm + k * piece_mm, u)
            drawn = _DRAWN * (follower.posture - u)
            u = follower.axes_nearer(slopes, piece_mm - slopes @ drawn, u + drawn)
        return np.asarray(u)

    def known(tip_mm: Vector, u: Vector) -> Vector | None:
        return jacobian.at(tip_mm, u) if jacobian.covered(tip_mm, u) >= 1.0 else None

    return Foresight(begin, known, follower.axis_velocity)
