"""A control step in data: what was sensed, what was asked for, and the messages that tell of it."""

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from daemon.control.avoidance import Aside
from daemon.control.task import angle_between, tip_axis
from daemon.estimation.pose_filter import TipEstimate
from daemon.messages import Axes, Risk, Tip
from daemon.reference.reference import Aim
from drivers.aurora.frame import TrackerFrame
from drivers.cia402.axis_channel import AxisChannel
from drivers.pose import Pose, Vector
from safety.gate import Decision, Measured
from safety.risk_source import Nearest, RiskAnswers, TipComparison
from safety.states import OperatingState

SLIDING: Final = "sliding"
"""The reason that is told where a step was turned aside."""


class Sensed(NamedTuple):
    """What the devices say at one step."""

    frame: TrackerFrame
    dt_s: float
    u: Vector
    """(m,) at the time of the frame."""
    targets: Vector
    """(m,) where the axes are told to be now."""
    measured: Measured

    @property
    def tensions_n(self) -> Vector | None:
        """(m,) NaN where an axis is no tendon; None: no axis is one."""
        pulls = self.measured.tension_n
        if all(pull is None for pull in pulls):
            return None
        return np.array([np.nan if pull is None else pull for pull in pulls])


class RequestedStep(NamedTuple):
    """The step that the controller asks for; the gate makes a `PermittedStep` of it."""

    delta_u: Vector
    aside: Aside | None = None
    """What it was turned aside for, to go along something that is near; None: it was not."""


class RiskAsked(NamedTuple):
    """Who was asked about a step, and against what."""

    source: str
    threshold: float
    compared: TipComparison | None
    """The last word on whether the tip is where the model of the body has it."""
    minute_risk: float | None = None
    path_risk: float | None = None


def tip_message(
    sequence: int,
    state: OperatingState,
    frame: TrackerFrame,
    tip: TipEstimate | None,
    aim: Aim | None,
    believed: bool,
    expected_mm: float | None = None,
) -> Tip:
    """Where the tip is, and where it should be. believed: the filter took the frame. expected_mm:
    how far off the controller expects it to be."""
    tip_mm, reference_mm = place_mm(tip), place_mm(aim)
    return Tip(
        sequence=sequence,
        t_ns=frame.t_ns,
        state=state.value,
        measured_mm=place_mm(frame.tip),
        tip_mm=tip_mm,
        velocity_mm_s=None if tip is None else tip.velocity_mm_s.tolist(),
        quaternion=None if tip is None else tip.quaternion.tolist(),
        reference_mm=reference_mm,
        error_mm=distance_mm(tip_mm, reference_mm),
        cycle=-1 if aim is None else aim.cycle,
        age_s=None if tip is None else tip.age_s,
        believed=believed,
        expected_mm=expected_mm,
        **_pointing(frame.tip, tip, aim),
    )


def angle_rad(tip: TipEstimate | None, aim: Aim | None) -> float | None:
    """Between the tip's direction and its reference; None where the tip may point anywhere."""
    if tip is None or aim is None or aim.direction is None:
        return None
    return angle_between(tip_axis(tip.quaternion), aim.direction)


def _pointing(measured: Pose | None, tip: TipEstimate | None, aim: Aim | None) -> dict[str, Any]:
    """Nothing where the tip may point anywhere."""
    if aim is None or aim.direction is None:
        return {}
    return {
        "measured_quaternion": None if measured is None else measured.quaternion.tolist(),
        "direction": None if tip is None else tip_axis(tip.quaternion).tolist(),
        "reference_direction": aim.direction.tolist(),
        "error_rad": angle_rad(tip, aim),
    }


def axes_message(
    sequence: int,
    sensed: Sensed,
    channels: Sequence[AxisChannel],
    requested: RequestedStep | None,
    decision: Decision | None,
) -> Axes:
    """Where the axes are and are told to be, what was asked for, and what the gate let through."""
    permitted = None
    if decision is not None and decision.step is not None:
        step = decision.step
        permitted = [
            channel.scale.position(end - start)
            for channel, start, end in zip(channels, step.from_counts, step.to_counts, strict=True)
        ]
    return Axes(
        sequence=sequence,
        t_ns=sensed.frame.t_ns,
        actual=sensed.u.tolist(),
        target=sensed.targets.tolist(),
        proposed=None if requested is None else requested.delta_u.tolist(),
        permitted=permitted,
        force=[channel.scale.force(channel.torque_permille) for channel in channels],
    )


def risk_message(
    sequence: int, t_ns: int, requested: RequestedStep, decision: Decision, asked: RiskAsked
) -> Risk:
    """What the gate made of a step that was asked for, and why. t_ns: of the frame."""
    return Risk(
        sequence=sequence,
        t_ns=t_ns,
        source=asked.source,
        contact_risk=decision.risk,
        body_point_risk=decision.body_point_risk,
        threshold=asked.threshold,
        scale=decision.scale,
        reasons=[*decision.limits, *([SLIDING] if requested.aside is not None else [])],
        detail=decision.risk_detail,
        minute_risk=asked.minute_risk,
        path_risk=asked.path_risk,
        **_aside_details(requested.aside),
        **_risk_details(decision.nearest, asked.compared),
        **_answers(decision.answers),
    )


def place_mm(known: Pose | TipEstimate | Aim | None) -> list[float] | None:
    """Where that is, as a message has it."""
    return None if known is None else known.position_mm.tolist()


def distance_mm(one: list[float] | None, other: list[float] | None) -> float | None:
    """None where one of the places is not known."""
    return None if one is None or other is None else math.dist(one, other)


def _aside_details(aside: Aside | None) -> dict[str, Any]:
    """As a message has it."""
    if aside is None:
        return {}
    return {
        "aside_arc_mm": aside.arc_mm,
        "aside_clearance_mm": aside.clearance_mm,
        "given_up_mm": aside.given_up_mm,
    }


def _answers(answers: RiskAnswers | None) -> dict[str, Any]:
    """As a message has it."""
    if answers is None:
        return {}
    model, given_tip, decided_by = answers
    return {"model_risk": model, "given_tip_risk": given_tip, "decided_by": decided_by}


def _risk_details(nearest: Nearest | None, tip: TipComparison | None) -> dict[str, Any]:
    """As a message has it."""
    compared_tip: dict[str, Any] = {}
    if tip is not None:
        compared_tip = {"tip_statistic": tip.statistic, "tip_off_mm": tip.off_mm}
    if nearest is None:
        return compared_tip
    return compared_tip | {
        "clearance_mm": nearest.clearance_mm,
        "arc_mm": nearest.arc_mm,
        "place_mm": list(nearest.place_mm),
        "obstacle_mm": list(nearest.obstacle_mm),
        "means_mm": [list(mean) for mean in nearest.means_mm] or None,
    }
