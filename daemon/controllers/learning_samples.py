"""Which motions a controller may learn from while it works.

The sampler leaves out what cannot have been a motion of the axes. Here is asked besides whether
what was seen has anything to do with what the axes did: a load that is hung on, a push, a tip
that sticks, a tracker that repeats itself all move the tip otherwise than any Jacobian near the
known one would.
"""

from dataclasses import replace
from typing import Final

import numpy as np

from config.tasks.controllers import Learner
from daemon.control.controller import Observation
from daemon.controllers.learnt_jacobian import TipJacobian
from daemon.learning.samples.motion import MotionSample
from daemon.learning.samples.motion_samples import MotionSampler, SamplingSettings
from drivers.pose import Vector

_MOST_DIFFERENT: Final = 0.85
"""Share of the tip's motion, seen or expected, whichever is more, by which both may differ: a
Jacobian turned by 50°, or one that is six times too large or too small."""
_AGREE_AFTER: Final = 10
"""So many in a row that are doubted are believed: then it is the Jacobian that is wrong."""
_ELSEWHERE: Final = 4.0
"""Times the noise by which a tip that is seen again may be off where it was extrapolated to. With a
tracker's noise of 0.2 mm one that goes on as before is off by up to 0.5 mm at 100 Hz and 1.3 mm at
40 Hz; a jump is not believed from 1.25 and 1.65 mm on."""


class LearningSamples:
    """Takes frames, gives samples to learn from."""

    def __init__(
        self, sampling: SamplingSettings, travel: Vector, noise_mm: float, jacobian: TipJacobian
    ) -> None:
        """noise_mm: of one coordinate of a motion. jacobian: what is expected of a motion."""
        self._sampler = MotionSampler(sampling, travel)
        self._noise_mm = noise_mm
        self._jacobian = jacobian
        self._unseen: Observation | None = None
        """The last one, if its tip is only extrapolated."""
        self._doubted_in_a_row = 0
        self.doubted = 0
        """How many samples were left out."""

    def break_off(self) -> None:
        """What comes next has nothing to do with what came before."""
        self._sampler.break_off()
        self._unseen = None

    def add(self, observation: Observation) -> MotionSample | None:
        """Take a frame; a sample if one is ready.

        One that is not believed tells nothing, and takes nothing from those before it unless the
        tip is then elsewhere: on a fast tracker's line there are several a second.
        """
        if not observation.believed:
            self._unseen = observation
            return None
        unseen, self._unseen = self._unseen, None
        if unseen is not None and self._elsewhere(unseen, observation):
            self._sampler.break_off()
        sample = self._sampler.add(observation.t_ns, observation.tip_mm, observation.u)
        if sample is None or not self._jacobian.modelled:
            # Without a model there is only what the last motions have told. Who believes those
            # that agree with it, and no others, stays wrong where the Jacobian changes.
            return sample
        if self._plausible(sample):
            self._doubted_in_a_row = 0
            return sample
        self.doubted += 1
        self._doubted_in_a_row += 1
        return sample if self._doubted_in_a_row > _AGREE_AFTER else None

    def _elsewhere(self, unseen: Observation, observation: Observation) -> bool:
        """Whether the tip, which is seen again, was not on its way there. No number: it was not."""
        on_s = 1e-9 * (observation.t_ns - unseen.t_ns)
        due_mm = unseen.tip_mm + on_s * unseen.tip_velocity_mm_s
        off_mm = float(np.linalg.norm(observation.tip_mm - due_mm))
        return not off_mm <= _ELSEWHERE * self._noise_mm

    def _plausible(self, sample: MotionSample) -> bool:
        seen = sample.delta_tip_mm
        expected = self._jacobian.at(sample.tip_mm, sample.u) @ sample.delta_u
        moved_mm = max(float(np.linalg.norm(seen)), float(np.linalg.norm(expected)))
        differs_mm = float(np.linalg.norm(seen - expected))
        return differs_mm <= _MOST_DIFFERENT * max(moved_mm, 2.0 * self._noise_mm)


def sampling_with(base: SamplingSettings, options: Learner) -> SamplingSettings:
    """`base`, but with motions as long as `options` say."""
    return replace(
        base,
        tip_mm=options.sample_tip_mm,
        travel_share=options.sample_travel_share,
        longest_s=options.sample_longest_s,
        lag_s=base.lag_s if options.lag_s is None else options.lag_s,
    )
