"""A Jacobian that is corrected by every motion: Broyden's rank-one rule, with a memory.

Broyden changes the Jacobian J as little as possible so that it explains the last motion x → d:
J + (d − J x) xᵀ / xᵀx. That believes noise in full, and forgets as much about directions that were
just measured as about others. Here the change goes along P x instead of x, where P is how uncertain
the rows of J are by direction: J + (d − J x) xᵀP / (xᵀP x + r). P shrinks along what was measured
and grows with the distance moved. Without noise r and with P = 1 this is Broyden's own rule.
"""

from math import sqrt
from typing import Final

import numpy as np

from daemon.control import jacobian_kernels as kernels
from daemon.control.jacobian_kernels import in_rows
from daemon.control.lag.answer import surely_right
from daemon.control.task import rank_of
from drivers.pose import Vector

FIRST_STD_MM: Final = 20.0
"""Of a Jacobian's elements, mm per travel, before anything corrects them: hysteresis more than
noise."""

_RELATIVE_NOISE = 0.1
"""Hysteresis and curvature: the part of a motion of the tip that no Jacobian explains."""
_WORST_CONDITION = 1e3
"""A change that would leave the tip so much harder to move one way than another is dropped."""
_LARGEST_STD_MM = 300.0
"""More uncertain than this is unknown anyway."""


class JacobianEstimate:
    """Axes count in shares of their range: elements of J are mm per whole range."""

    def __init__(
        self, jacobian: Vector, covariance: Vector, noise_mm: float, drift_mm: float
    ) -> None:
        """jacobian: (r, m) of a task of r coordinates. covariance: (m, m) mm², of each row.

        noise_mm: of one coordinate of a motion. drift_mm: how far an element may wander while the
        axes go through their whole range; standard deviations.
        """
        self.jacobian = in_rows(jacobian)
        self.covariance = in_rows(covariance)
        self._rank = min(rank_of(len(self.jacobian)), self.jacobian.shape[1])
        self._noise_variance = noise_mm**2
        self._drift_variance = drift_mm**2

    def correct(self, moved: Vector, tip_moved: Vector) -> None:
        """Take a motion: (m,) of the axes, (r,) of the tip."""
        jacobian, covariance = kernels.corrected(
            self.jacobian,
            self.covariance,
            moved,
            tip_moved,
            self._drift_variance,
            _LARGEST_STD_MM**2,
            self._noise_variance,
            _RELATIVE_NOISE**2,
        )
        if kernels.condition(jacobian, self._rank) < _WORST_CONDITION:
            self.jacobian, self.covariance = jacobian, covariance


# What a Jacobian lacks here and now, found by the motions of the last moment.
#
# A learnt model knows how the Jacobian J changes from place to place; a load, creep or another
# body change all of it a little. The difference E is corrected by every motion x → d: as little
# as possible, and where it is uncertain rather than where it was just measured, E + (d − (J + E)
# x) xᵀP / (xᵀP x + r). P, how uncertain the rows of E are by direction, shrinks along what was
# measured and grows with the distance moved. While the axes go on, E fades where nothing new is
# told about it: the model is then the better guess.
#
# Whoever leads a body finds in some seconds how much more or less than told comes along each axis
# of space, G, and makes up for it. What moves the tip is G (J + E), and d is what was told: a
# difference that both had found would be made up for twice, and paths with 14 g at the tip be up to
# 12 % further off than without E.


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
_LARGEST_LACKING_STD_MM: Final = 200.0
_SLOWEST, _FASTEST, _TURNED = -0.5, 2.0, 0.7
"""How much less, and how much more, than J has it a step may move the tip, and how far aside. There
are directions in which the tip hardly moves, and noise would soon turn them round; and who believes
that the axes do less than they do asks for too much."""


_UNSEEN: Final = 0.4
"""Share of the difference that counts where nothing was seen to change the body: motions say as
much of what friction keeps back as of the axes. With 0.8 a mismatched body's paths are 5 % nearer
than without any, and some of a worn body's with 14 g 3 % further off; with 0.4 3 % and none."""
_WORTH_KEPT: Final = 0.9
"""From motion to motion, of what tells how good the difference is: the last ten count."""
_DOUBT: Final = 1.0
"""Standard errors by which a share must be above nothing."""
_ELSEWHERE: Final = 0.5
"""Cosine between what J said of the last motions and what came: below it they went elsewhere ..."""
_NOT_MADE_UP_FOR: Final = 0.8
"""... where this share of them is lacking still with all of E. Late bodies with loads, hysteresis
and play, whose models are of other ones, come to 0.66; an arm that is turned by a right angle to
1.3."""
_CAME: Final = 0.2
"""Of what J says of the last motions, that came at least where that says something of J: a tip that
is held fast does not."""
_JUDGED_COORDINATES: Final = 25.0
"""Of the last motions, three each with the older ones counting less: seventeen of them."""


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
        """The tip's motions squared, over the same ..."""
        self.told_mm2 = 0.0
        """... and those that J said."""
        self.changed = 0.0
        """How far the body was seen to become another one, 0 to 1."""
        self.gains = np.ones(3)
        """(3,) G that is made up for."""
        self._noise_variance = noise_mm**2
        self._drift_variance = drift_mm**2
        self._reach = reach

    def rescale(self, jacobian: Vector, gains: Vector) -> None:
        """From now on (3,) G is made up for. What moves the tip, where J is (3, m), stays as it
        was."""
        kept = (self.gains / gains)[:, None]
        self.difference = kept * (jacobian + self.difference) - jacobian
        self.gains = gains

    def correct(self, jacobian: Vector, moved: Vector, tip_moved: Vector) -> None:
        """Take a motion: (m,) of the axes, (3,) of the tip. jacobian: (3, m) J there."""
        told = jacobian @ moved
        said, lacked = self.difference @ moved, tip_moved - told
        seen = np.array([said @ lacked, said @ said, lacked @ lacked, float(len(lacked))])
        self.foretold = _WORTH_KEPT * self.foretold + seen
        self.changed *= _CHANGED_KEPT
        went_mm2 = float(tip_moved @ tip_moved)
        self.went_mm2 = _WORTH_KEPT * self.went_mm2 + went_mm2
        self.told_mm2 = _WORTH_KEPT * self.told_mm2 + float(told @ told)
        travelled = float(np.linalg.norm(moved))
        kept = float(np.exp(-travelled / self._reach))
        difference = kept * self.difference
        covariance = kept**2 * self.covariance
        covariance += self._drift_variance * travelled * np.eye(len(moved))
        covariance *= min(1.0, _LARGEST_LACKING_STD_MM**2 / float(covariance.diagonal().max()))
        along = covariance @ moved
        noise = self._noise_variance + self._unexplained**2 * went_mm2
        gain = along / (float(moved @ along) + noise)
        difference += np.outer(tip_moved - (jacobian + difference) @ moved, gain)
        covariance -= np.outer(gain, along)
        self.difference = _limited(difference, jacobian)
        self.covariance = 0.5 * (covariance + covariance.T)

    @property
    def contradicted(self) -> bool:
        """Whether the last motions went elsewhere than J says, and E does not make up for it."""
        seen = self.foretold[3] > _JUDGED_COORDINATES
        if not (seen and self.went_mm2 > _CAME**2 * self.told_mm2):
            return False
        along_mm2 = 0.5 * (self.told_mm2 + self.went_mm2 - float(self.foretold[2]))
        elsewhere = along_mm2 < _ELSEWHERE * sqrt(self.told_mm2 * self.went_mm2)
        return elsewhere and self._shares[1] > _NOT_MADE_UP_FOR

    @property
    def _shares(self) -> tuple[float, float]:
        """Of the last motions, that J lacked, and that were lacking still with E."""
        agreed, said, lacked, _ = self.foretold.tolist()
        went_mm2 = max(self.went_mm2, 1e-9)
        left = max(lacked - 2.0 * agreed + said, 0.0)
        return sqrt(lacked / went_mm2), sqrt(left / went_mm2)

    @property
    def _unexplained(self) -> float:
        """The part of a motion that no Jacobian is taken to explain.

        Little where something was seen to be hung on. Where motions alone say that the body is
        another one, as much as E has left of late: a hysteresis says so as well, and would be
        learnt from every motion anew, and wrong at the next turn.
        """
        (most, least), (right, wrong) = _UNEXPLAINED, _RIGHT
        lacked, left = self._shares
        other = min(max((lacked - right) / (wrong - right), 0.0), 1.0)
        seen = most + self.changed * (least - most)
        return min(seen, most + other * (min(max(left, least), most) - most))

    @property
    def worth(self) -> float:
        """The share of E, 0 to 1, that would surely have been right to believe of late.

        The s for which J + s E explains the last motions best, less its standard error. An E that
        follows a hysteresis is wrong as soon as that turns; who believes it asks for nonsense.
        """
        return min(max(surely_right(self.foretold, _DOUBT), 0.0), 1.0)

    @property
    def counting(self) -> float:
        """The share of E, 0 to 1, to go by: a part of what it is worth, unless the body was seen to
        become another one."""
        return self.worth * (_UNSEEN + self.changed * (1.0 - _UNSEEN))


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
