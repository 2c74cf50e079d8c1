"""The controllers that an experiment or a client can choose, and what can be set on them."""

from typing import Annotated, Any, Final, Literal, Self, TypeVar

from pydantic import Field, model_validator

from config.documents.kinds import CONTROLLERS, Kind, KindError, KindOptions, Named, kind_of
from config.documents.model import ConfigModel, NotNegative, Positive, Vector3, checked_options
from config.tasks.exploration import DesignedExploration, MotorBabbling, WaypointExploration

Share = Annotated[float, Field(gt=0.0, le=1.0)]
PerAxis = Annotated[tuple[float, ...], Field(min_length=1, strict=False)]

Law = TypeVar("Law", bound="TipFollowing")


class AxisUse(KindOptions):
    """How the axes are used for whatever the tip is asked to do."""

    max_tip_speed_mm_s: Positive = 25.0
    """No step asks the tip to be faster than this, whatever the error."""

    posture: Literal["mid_travel", "start"] | PerAxis = "mid_travel"
    """Where the axes are drawn without moving the tip: the middle of their travel, where they were
    when the motion began, or the given positions (mm or rad, one per axis)."""

    posture_gain_per_s: NotNegative | None = None
    """Share of the way to the posture per second; where the body is led four times as much, to 0.4,
    unless axes turn round. 0: redundant axes are left alone. None: 0.1, and 1.0 where tendons pull
    against each other."""

    axis_weights: Annotated[tuple[Positive, ...], Field(min_length=1, strict=False)] | None = None
    """How dear the motion of each axis is, counted in shares of its range: the diagonal of N of
    Ho 2018, eq. 7. None: all alike."""

    def of_law(self, law: type[Law], **own: bool) -> Law:
        """What these options say of those of `law`, and `own`, for a controller that uses the axes
        as that law does."""
        common = type(self).model_fields.keys() & law.model_fields.keys()
        return law.model_validate({**{name: getattr(self, name) for name in common}, **own})


class ProportionalLaw(AxisUse):
    """A share of the tip's error, and its reference's own motion, by damped least squares."""

    gain_per_s: Positive = 3.0
    """Share of the tip's error that is asked for per second (K_P of Ho 2018, eq. 14)."""

    damping_mm: Positive | None = None
    """Damped least squares. Where the tip moves less than this in some direction while an axis goes
    through its range (its travel; a radian of what turns), that direction is given up gently
    instead of with huge steps. None: 8 mm, and where tendons pull against each other half of how
    far all of them move it: what only they together would do takes tension, or leaves one slack."""

    feed_forward: bool = True
    """Whether the reference's own motion is asked for as well as a share of the error."""


class TipFollowing(ProportionalLaw):
    """The law that turns a reference into a step of the tip, and this into a step of the axes."""

    pointing_mm_per_rad: Positive = 25.0
    """Where the reference says where the tip points as well: as how many mm an error of one radian
    counts. More points better where position and direction cannot both be had."""

    max_tip_turn_rad_s: Positive = 0.5
    """No step asks the tip to turn faster than this, whatever the error."""

    lead: bool = False
    """Whether the body's lag, and how much of what it is told it does, are found while it is
    followed, and led: the reference's motion is asked for so much earlier, and what was told and
    has not arrived counts as made. It allows twice the gain on a prompt body, and is what a body
    with a lag and dead time of several tenths of a second needs. Only with `feed_forward`."""

    probe: bool = True
    """With `lead`: whether some seconds of small motions, before anything is followed for the
    first time, show how late the body is. Not: it is found on the way. `broyden` finds it in the
    motions that it makes anyway."""

    by_cycles: bool = True
    """With `lead`: whether a path that is repeated is corrected, place by place, by what the tip
    was off there in the cycles before."""

    slow_above_mm: Positive | None = 1.0
    """With `lead`: where the tip is expected to be farther off than this (root mean square, by what
    it was off by lately), a trajectory is followed more slowly than it says, as far as that helps
    and down to a quarter. What axes at their ends, or in a direction that they hardly move, can do
    nothing about does not count. None: it keeps its time, however far off the tip is."""

    @property
    def leads(self) -> bool:
        """Whether there is something to lead: the reference's own motion is asked for."""
        return self.lead and self.feed_forward


class LearnedKinematics(TipFollowing):
    """A learnt model of where the tip is and points, inverted: damped least squares over its
    Jacobian, as Fagogenis, Bergeles and Dupont (IROS 2016) have it, which goes on learning."""

    kind: Literal["learned_kinematics"]

    model: Annotated[str, Field(min_length=1)]
    """What `tentacled kinematics` made, or such a controller saved: `builtin:` and the name of one
    that is shipped, or a file."""

    feedback: Literal["tracker", "model"] = "tracker"
    """What is compared with the reference: the tip as it is measured, or as the model has it at
    these axes. The latter is the paper's; the tracker then only teaches the model."""

    adaptation: bool = True
    """Whether the model is corrected by what the tracker shows."""

    memory_samples: Annotated[float, Field(ge=2.0)] = 8.0
    """How many samples a field of the model remembers. A field forgets by how much a sample weighs
    in it: what is far from the path stays."""

    sample_tip_mm: Positive = 0.1
    """A sample is taken when the tip has moved so far ..."""

    sample_travel_share: Share = 0.002
    """... or the axes together so far, as a share of their travel: standing still teaches nothing.
    """


class Broyden(TipFollowing):
    """Knows nothing of the robot: measures its Jacobian, then keeps it up to date."""

    kind: Literal["broyden"]

    explore_share: Annotated[float, Field(gt=0.0, le=0.25)] = 0.06
    """Amplitude of the first motions, axis by axis, as a share of the axis' range (its travel; a
    radian of what turns)."""

    explore_speed_share: Share = 0.5
    """Their speed as a share of the axis' highest."""

    explore_together: bool | None = None
    """Whether all axes go out together once as well. None: they do, unless they are tendons, which
    pull against each other."""

    settle_s: Positive = 0.6
    """Waiting for the body after each of them. The second half of it is measured."""

    sample_tip_mm: Positive = 0.5
    """A sample for the Jacobian ends when the tip has moved so far ..."""

    sample_travel_share: Share = 0.005
    """... and the axes so far, as a share of their range."""

    sample_noise_mm: Positive = 0.3
    """What one coordinate of the tip's motion in a sample is uncertain by."""

    drift_mm: Positive = 25.0
    """How far an element of the Jacobian, in mm per whole range, may wander while the axes move
    through their whole range. More follows a changing body faster, less resists noise."""


class VolumetricChambers(ConfigModel):
    """A chamber's length follows its piston in proportion: liquid, or a simple calibration."""

    kind: Literal["volumetric"]
    elongation_mm_per_ml: Positive = 1.0


class GasChambers(ConfigModel):
    """Enclosed gas against the body's stiffness. As the paper's arm is by design (Ho 2018, 2.1)."""

    kind: Literal["gas"]
    pre_pressure_mpa: NotNegative = 0.04
    """Gauge pressure with the cylinder at zero."""
    supply_volume_ml: Positive = 27.5
    """Gas in cylinder and tube with the cylinder at zero."""
    chamber_area_mm2: Positive = 95.0
    bending_stiffness_n_mm2: Positive = 8.0e3
    """EI of a segment."""
    axial_stiffness_n: Positive = 130.0
    """EA of a segment."""


class ArcBody(ConfigModel):
    """Segments in series of three chambers each, all bent to circular arcs. Axes: chambers 1 to 3
    of each, from the base on. The base frame's z axis points along the straight arm."""

    segment_length_mm: Annotated[
        tuple[Positive, ...], Field(strict=False, min_length=1, max_length=6)
    ] = (77.5, 77.5)
    """Of each segment, from the base on, without pressure."""
    chamber_radius_mm: Positive = 7.5
    """Distance of the chambers from the axis."""
    first_chamber_rad: PerAxis = (0.0, 1.0471975511965976)
    """Direction of chamber 1 of each segment from the x axis; the others follow at 120°."""
    base_offset_mm: Vector3 = (0.0, 0.0, 0.0)
    """Where the first segment begins, in the base sensor's frame."""
    chambers: Annotated[VolumetricChambers | GasChambers, Field(discriminator="kind")] = (
        GasChambers(kind="gas")
    )
    """What the pistons do to the chambers."""
    bending_gain: Positive = 1.0
    """Correction of the model's bending, from calibration."""
    elongation_gain: Positive = 1.0
    """Correction of the model's elongation, from calibration."""
    tolerance_mm: Positive = 10.0
    """A trajectory is refused where the model, within the axes' travel, misses it by more."""

    @model_validator(mode="after")
    def _both_of_each_segment(self) -> Self:
        lengths, turns = len(self.segment_length_mm), len(self.first_chamber_rad)
        if lengths != turns:
            raise ValueError(f"{lengths} segment_length_mm and {turns} first_chamber_rad: one each")
        return self


class PositionOnly(KindOptions):
    """Of a kind that leads the tip by its position, and cannot lead where it points."""


class ConstantCurvature(TipFollowing, ArcBody, PositionOnly):
    """A body of circular arcs, whose Jacobian is known from its dimensions."""

    kind: Literal["constant_curvature"]


class FromMotions(KindOptions):
    """What controllers have in common that know the robot from motions it has made."""

    model: str | None = None
    """File that pre-training made, or that such a controller saved: `builtin:` and the name of one
    that is shipped, or a file relative to where the experiment is started, not to its file. None:
    the first motions are motor babbling, and everything is learnt from them and from what
    follows."""

    sample_tip_mm: Positive = 2.0
    """A motion is a sample when the tip has moved so far ..."""

    sample_travel_share: Share = 0.1
    """... or the axes together so far, as a share of their travel. Shorter samples are more, and
    more of them is noise."""

    sample_longest_s: Positive = 4.0
    """A motion that takes longer is none, but standing still and creeping."""

    lag_s: NotNegative | None = None
    """How much later than its axes the body moves. None: as pre-training or the first motions show
    it."""

    sample_noise_mm: Positive = 0.3
    """What one coordinate of the tip's motion in a sample is uncertain by."""

    babbling: MotorBabbling = MotorBabbling()
    """The first motions where there is no model, or one of another body."""


class LearningFollower(TipFollowing, FromMotions):
    """Of a controller that follows through what it learns from motions."""

    lead: bool = True
    """Whether the body's lag, its play, and how much of what it is told it does, are found while it
    is followed, and led: the reference's motion is asked for so much earlier, and what was told and
    has not arrived counts as made. On, unlike for who has no exploration to read a lag against. It
    allows twice the gain on a prompt body. Only with `feed_forward`."""

    learning: bool = True
    """Whether it goes on learning while it controls. Not: the model stays as it is."""


class Learner(LearningFollower):
    """What controllers have in common that learn a model of the robot from its motions."""

    correction_drift_mm: NotNegative = 50.0
    """The learnt Jacobian is corrected by every sample, as `broyden` does it. How far an element,
    in mm per whole travel, may wander while the axes move through their whole travel."""

    correction_reach: Positive = 0.5
    """... and after how much motion, in travels, a correction has faded to a third."""


class ForwardJacobian(Learner):
    """The learnt forward model, inverted: damped least squares, drawn to a posture."""

    kind: Literal["forward_jacobian"]

    memory_samples: Annotated[float, Field(ge=10.0)] | None = None
    """How many samples a field of the model remembers while it goes on learning: then the fields
    tell the Jacobian, and no cubic of the axes. None: the model stays as pre-training left it, and
    only the correction adapts."""


class RewardWeighted(Learner):
    """Local inverse controllers, learnt by reward-weighted regression (Ho 2018)."""

    kind: Literal["reward_weighted"]

    window: Annotated[int, Field(ge=1, le=100_000)] = 425
    """How many samples the controllers are learnt from; the oldest leaves first."""

    engine: Literal["bank", "batch", "oracle"] = "bank"
    """How they are computed. All say the same: bank is the fastest, oracle the plainest."""

    paper: bool = False
    """The paper's law alone, its misprints corrected: no feed-forward, no forward model but for
    the fields, pre-training's samples as what an unvisited field knows, and no fallback."""

    motion_s: Positive = 1.0
    """The controllers are asked for the motion of this time, and a step is its part. Should be
    about what a sample takes."""

    unvisited: Literal["forward_model", "samples", "nothing"] = "forward_model"
    """What the controller of a field is before samples come: the inverse of the forward model, the
    regression over pre-training's samples, or none."""

    prior_mass: NotNegative = 5.0
    """... and as how many samples that counts when they come."""

    sigma_rule: Literal["inverse_mean", "ess", "printed"] = "inverse_mean"
    """How sharp the reward is: see `daemon/learning/inverse/local_controller_settings.py`."""

    kappa: Positive | None = None
    """Sharpness under the first two rules. None: the number of axes."""

    ridge: Positive = 1e-4
    """Of the regression, relative to its weights."""

    attractor_steps: Positive | None = 2.0
    """The posture draws with no more than so many typical steps per motion. None: without limit."""

    fallback: bool = True
    """Whether the learnt Jacobian makes the tip's step, with axes near to what local controllers
    answer, and alone where fields or samples are missing. Not: their answer is the step."""


# Each with what makes it: (options, robot, seed) → a Controller of daemon/control/controller.py.

BROYDEN: Final = Kind(Broyden, "daemon.controllers.broyden:make")
CONSTANT_CURVATURE: Final = Kind(ConstantCurvature, "daemon.controllers.constant_curvature:make")
DESIGNED_EXPLORATION: Final = Kind(
    DesignedExploration,
    "daemon.controllers.exploration.designed_exploration:DesignedExplorationController",
)
FORWARD_JACOBIAN: Final = Kind(
    ForwardJacobian, "daemon.controllers.forward_jacobian:ForwardJacobianController"
)
LEARNED_KINEMATICS: Final = Kind(LearnedKinematics, "daemon.controllers.learned_kinematics:make")
REWARD_WEIGHTED: Final = Kind(
    RewardWeighted, "daemon.controllers.reward_weighted:RewardWeightedController"
)
WAYPOINT_EXPLORATION: Final = Kind(
    WaypointExploration,
    "daemon.controllers.exploration.waypoint_exploration:WaypointExplorationController",
)

ControllerOptions = Annotated[KindOptions, Named(CONTROLLERS)]


def controller_type(kind: str) -> type[KindOptions] | None:
    """The class of options of a kind; None: there is no such kind, or it cannot be used."""
    try:
        return kind_of(CONTROLLERS, kind).options
    except KindError:
        return None


class _Asked(ConfigModel):
    controller: ControllerOptions


def position_only(options: KindOptions) -> str:
    """Its kind, if it leads the tip by its position alone; empty: it points, too."""
    return options.kind if isinstance(options, PositionOnly) else ""


def load_controller_options(mapping: dict[str, Any]) -> ControllerOptions:
    """The options in a message. Raises OptionsError with all problems."""
    return checked_options(_Asked, "controller", mapping).controller
