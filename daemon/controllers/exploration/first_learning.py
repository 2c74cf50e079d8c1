"""What a controller that learns does before it knows anything: small motions, and what they show.

Axes babble. What the tip makes of it gives samples, a Jacobian that is fitted to them, and how late
the body is, unless that is known. Where it is later than it was taken to be the same motions are
looked at again.
"""

from collections.abc import Iterator
from typing import Final

import numpy as np

from config.tasks.controllers import Learner
from daemon.control.controller import ControllerError, Observation, Proposal
from daemon.control.tip_following import step_time
from daemon.controllers.exploration.first_motions import BodysLag, FirstMotions
from daemon.controllers.exploration.motor_babbling import Babbling
from daemon.controllers.exploration.tension_loss import TensionLoss
from daemon.learning.samples.motion import MotionSample
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector

_SAMPLES_PER_AXIS = 3
"""So many must babbling give before a Jacobian is fitted ..."""
_WORTH_GOING_ON, _WORTH_WHERE_VISIBLE = 0.8, 0.25
"""... and where it gave this share of them it goes on: a stiff body's tip goes less far. What comes
of noise alone, in motions of a hundredth of a millimetre, is a third of them in 5 s."""
_VISIBLY: Final = 0.2
"""Share of the tip's motion that is the axes', from which on a tip that goes too little is of a
stiff body and not held, and the motions go on wider: noise alone makes 0.02, 0.1 mm make 0.7, and
a short arm twice as stiff as the shipped one 0.37."""
_FEW_AFTER: Final = 0.25
"""Of their time: where the motions have not given as large a share of the samples by then they go
on wider at once ..."""
_WELL_SEEN: Final = 0.6
"""... or where less of what the tip does is theirs than this, so that they do not tell how late it
is. Of most bodies it is above 0.9."""
_FRAMES_PER_AXIS: Final = 20
"""... but not before so many: of fewer noise looks like the axes' motion."""
_WIDER: Final = 2.0
_WIDEST: Final = 0.25
"""Times, and up to which share of each axis' travel: as far as options let them be."""
_FARTHEST: Final = 0.13
"""Share of its distance from the base by which the tip may come away from where it was ..."""
_FASTEST_MM_S: Final = 120.0
"""... and how fast it may go, before the motions become calmer. Shipped robots go up to 0.11 of it,
and at 90 mm/s. A long arm of eleven chambers went 60 mm of 235 at 300 mm/s, out of the tracker's
sight and of its workspace."""
_FAST_FOR_S: Final = 0.1
"""So long it must have gone so fast to be where it is: a tracker that is far away shows a tip at
rest that goes at 140 mm/s."""
_CALMER: Final = 0.5
_CALMEST: Final = 1.0 / 16.0
_SETTLES_S: Final = 1.0
"""Then it is on its way back, and not asked again."""
_SEEN_AGAIN_AT_ONCE = 4
"""Frames of the first motions, of a body that is later than expected: all within a few seconds."""
_FIT_RIDGE = 1e-3


class FirstLearning:
    """Proposes first motions, and keeps what they show."""

    def __init__(self, options: Learner, axes: AxisRanges, seed: int, expected_s: float) -> None:
        """expected_s: so late the body is taken to be until they tell otherwise."""
        self.samples: list[MotionSample] = []
        self._samples_before = 0
        """How many there were when it was gone on with."""
        self._options = options
        self._axes = axes
        self._seed = seed
        self._expected_s = expected_s
        self._reach_share = options.babbling.reach_share
        self._calm = 1.0
        """Share of their reach and speed that motions have, so that the tip is calm."""
        self._babbling = self._new_babbling()
        self._looked_early = False
        """Whether these motions were looked at before they were over."""
        self._motions = None if options.lag_s is not None else FirstMotions(axes.scale, expected_s)
        """None: it is known how late the body is."""
        self._begun_mm: Vector | None = None
        """(3,) where the tip was; None: motion has not begun."""
        self._tension_loss = TensionLoss()
        self._settles_s = 0.0

    @property
    def looks_back(self) -> bool:
        """Whether the motions are over, and still to tell how late the body is."""
        motions = self._motions
        return motions is not None and self._babbling.done and not motions.told

    @property
    def over(self) -> bool:
        """Whether they have been made, and have told how late the body is."""
        return self._babbling.done and not self.looks_back

    @property
    def lag(self) -> BodysLag | None:
        """As they have told it; None: it is as it was taken to be, or known."""
        motions = self._motions
        return None if motions is None or motions.lag == motions.expected else motions.lag

    def begin(self, enough: bool) -> None:
        """Motion begins. enough: whether no more of them are needed."""
        if self._motions is not None:
            self._motions.break_off()
        if self.over and not enough:
            self.go_on()
        self._babbling.reset()
        self._begun_mm = None

    def go_within(self, axes: AxisRanges) -> None:
        """More is known of what the axes do against each other; nothing has moved yet."""
        self._axes = axes
        self._babbling = self._new_babbling()

    def go_on(self) -> None:
        """More of them are needed, round where they went."""
        self._babbling = self._new_babbling(self._babbling.home)
        self._looked_early = False
        if self._motions is not None:
            self._motions.go_on()

    def know_how_late(self) -> None:
        """How late the body is, is not asked any more."""
        self._motions = None

    def propose(self, observation: Observation) -> Proposal:
        """The next step, while they are not over."""
        if self.looks_back:
            note = "works out how late the body follows"
            return Proposal(np.zeros(self._axes.count), note, 0)
        self._keep_calm(observation)
        self._go_wider_early()
        return Proposal(self._babbling.propose(observation), self._babbling.note, 0)

    def _keep_calm(self, observation: Observation) -> None:
        """A supple body goes further and faster than its axes' shares would have it, and stiff
        tendons go slack: what was shown so is forgotten, and motions begin anew, from where they
        began, with half of both."""
        tip_mm = observation.tip_mm
        if self._begun_mm is None:
            self._begun_mm, self._settles_s = tip_mm, 0.0
            self._tension_loss.begin(observation.tensions_n)
        self._settles_s -= step_time(observation)
        away_mm = np.linalg.norm(tip_mm - self._begun_mm)
        far = away_mm > _FARTHEST * np.linalg.norm(self._begun_mm)
        speed_mm_s = np.linalg.norm(observation.tip_velocity_mm_s)
        fast = speed_mm_s > _FASTEST_MM_S and away_mm > _FASTEST_MM_S * _FAST_FOR_S
        loose = self._tension_loss.grave(observation.tensions_n, step_time(observation))
        if not (far or fast or loose) or self._settles_s > 0.0 or self._calm <= _CALMEST:
            return
        self._calm *= _CALMER
        self._settles_s = _SETTLES_S
        self._babbling = self._new_babbling(self._babbling.home)
        self.samples, self._samples_before = [], 0
        if self._motions is not None:
            self._motions = FirstMotions(self._axes.scale, self._expected_s)

    def _go_wider_early(self) -> None:
        """Of motions that show too little, or too much noise, the rest would, too."""
        babbling, motions = self._babbling, self._motions
        enough = babbling.frames >= _FRAMES_PER_AXIS * self._axes.count
        if self._looked_early or not enough or babbling.share_done < _FEW_AFTER:
            return
        self._looked_early = True
        if motions is None:
            return
        given = len(self.samples) - self._samples_before
        few = given < _FEW_AFTER * self._needed
        explained = motions.share_explained()
        if explained > _VISIBLY and (few or explained < _WELL_SEEN) and self._wider():
            self.go_on()

    def _wider(self) -> bool:
        """Whether motions may be wider than they were, and then are from the next on."""
        may_be = self._reach_share < _WIDEST and self._calm == 1.0
        if may_be:
            self._reach_share = min(_WIDER * self._reach_share, _WIDEST)
        return may_be

    def see(self, observation: Observation) -> None:
        """Take a frame."""
        if self._motions is not None:
            self._motions.see(observation)

    @property
    def asked(self) -> bool:
        """Whether it was asked how late the body is since the last of the motions."""
        return self._motions is None or self._motions.asked

    def ask(self) -> bool:
        """Whether it is otherwise late than it was taken to be: then `again` gives the motions, and
        their samples come anew."""
        otherwise = self._motions is not None and self._motions.ask()
        if otherwise:
            self.samples = []
        return otherwise

    def again(self) -> Iterator[Observation | None]:
        """The next frames, `u` as the tip shows it; None: what comes does not go on from what came.
        As many as are looked at at once."""
        motions = self._motions
        assert motions is not None
        for _ in range(_SEEN_AGAIN_AT_ONCE):
            yield motions.next_again()
            if motions.told:
                return

    def jacobian(self) -> Vector | None:
        """(3, m) mm per mm or rad of all samples, by least squares. None: they were nearly enough,
        or the tip went little but visibly, and it is gone on; then with wider motions.

        Raises ControllerError where they were too few.
        """
        samples = self.samples
        if len(samples) >= self._needed:
            return _fitted_jacobian(samples, self._axes)
        before, self._samples_before = self._samples_before, len(samples)
        visibly = self._motions is not None and self._motions.explained > _VISIBLY
        worth = _WORTH_WHERE_VISIBLE if visibly else _WORTH_GOING_ON
        wider = visibly and self._wider()
        if wider or len(samples) - before >= worth * self._needed:
            self.go_on()
            return None
        raise ControllerError(
            f"the first motions gave {len(samples)} samples: see what holds the tip, or let them "
            f"be longer or wider (babbling)"
        )

    @property
    def _needed(self) -> int:
        return _SAMPLES_PER_AXIS * self._axes.count

    def _new_babbling(self, home: Vector | None = None) -> Babbling:
        options = self._options.babbling
        wide = {
            "reach_share": self._calm * self._reach_share,
            "speed_share": self._calm * options.speed_share,
            "dither_share": self._calm * options.dither_share,
        }
        return Babbling(options.model_copy(update=wide), self._axes, self._seed, home)


def _fitted_jacobian(samples: list[MotionSample], axes: AxisRanges) -> Vector:
    """(3, m) mm per mm or rad. What all tendons do together bends no body: hardly any of it was
    done, and what is fitted to that is friction and noise. A tip that is led by it goes the other
    way where one tendon may not be let go of any further and the others have to make its step."""
    travel = axes.scale
    moved = np.array([axes.less_together(sample.delta_u, 0.0) for sample in samples]) / travel
    tip_moved = np.array([sample.delta_tip_mm for sample in samples])
    gram = moved.T @ moved
    ridge = _FIT_RIDGE * np.trace(gram) / len(gram)
    solution = np.linalg.solve(gram + ridge * np.eye(len(gram)), moved.T @ tip_moved)
    return np.asarray(solution.T / travel)
