"""What can be set on the controllers of other schools: they are there to be compared with."""

from typing import Annotated, Final, Literal

from pydantic import Field

from config.documents.kinds import Kind
from config.documents.model import NotNegative, Positive
from config.tasks.controllers import (
    ArcBody,
    AxisUse,
    FromMotions,
    LearningFollower,
    PositionOnly,
    ProportionalLaw,
)


class GaussianProcess(LearningFollower):
    """Sparse online Gaussian processes of what motions of the axes do to the tip, inverted at every
    step: damped least squares over their Jacobian, which go on learning."""

    kind: Literal["gaussian_process"]

    budget: Annotated[int, Field(ge=10, le=250)] = 120
    """How many inducing motions each of its two processes keeps, the exploration's and that of what
    is learnt since: the time that a step takes grows with its square."""

    memory_samples: Annotated[float, Field(ge=5.0)] = 60.0
    """After how many motions what was learnt since the exploration has faded to 60 % of itself."""

    difference_mm: Positive = 15.0
    """How much an element of the Jacobian, in mm per whole range, is expected to differ from the
    exploration's: standard deviation."""


class IterativeLearning(ProportionalLaw, FromMotions, PositionOnly):
    """Iterative learning control on top of a feedback law, whose Jacobian is identified from the
    exploration by least squares. On a path that does not repeat it is the law alone."""

    kind: Literal["iterative_learning"]

    gain_by_lag: Positive = 0.4
    """The gain is no more than this by the body's lag, in s: half is the most with which a loop
    with a dead time does not overshoot."""

    probe: bool = True
    """Whether some seconds of small motions, before anything is followed for the first time, show
    how late the body is. Not: it is as the exploration shows it."""

    caution: NotNegative = 0.3
    """Weight of a change of the correction against the error that it takes away, both squared. 0:
    all of the error is taken for what the next cycle shall correct."""

    cutoff_hz: Positive = 1.0
    """Of the filter of the correction: half of what is as fast is kept out."""

    set_out_s: NotNegative = 0.5
    """So long, and two lags, after motion begins nothing is learnt: the tip still sets out."""


class ModelPredictive(AxisUse, FromMotions, PositionOnly):
    """Offset-free model-predictive control on a linear model, which is identified from the
    exploration by least squares, with a lag and a dead time, and a disturbance that is observed."""

    kind: Literal["model_predictive"]

    horizon_s: Annotated[float, Field(ge=0.1, le=5.0)] = 1.5
    """So far ahead it looks: some three lags and the dead time."""

    intervals: Annotated[int, Field(ge=2, le=20)] = 15
    """... and in so many intervals, each with speeds of its own."""

    observer_s: Positive = 0.2
    """Time constant with which the disturbance is found: shorter is quicker, and shows more of the
    tracker's noise."""

    smoothness_mm: Positive = 15.0
    """As what error of the tip a change of the axes' speed by one range per interval counts."""

    effort_mm: Positive = 1.0
    """... and a speed of one range per interval, where it moves the tip."""

    probe: bool = True
    """Whether some seconds of small motions, before anything is followed for the first time, show
    how late the body is. Not: it is as the exploration shows it."""


class PidConstantCurvature(ProportionalLaw, ArcBody, PositionOnly):
    """PID on the tip's error; the Jacobian of a body of circular arcs makes axes of it. With
    `feed_forward` the loop has two degrees of freedom: the reference's velocity is asked for, and
    the derivative is the error's. Without, it is the textbook's: the derivative is that of the
    measured tip, and a reference that moves is caught by the integral alone."""

    kind: Literal["pid_constant_curvature"]

    integral_per_s2: NotNegative = 1.0
    """Of the tip's velocity, per mm of error and second that it lasts. A quarter of `gain_per_s`
    squared is critically damped on a body without a lag. It stands still while limits keep the tip
    from what is asked."""

    derivative: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.05
    """Of the tip's velocity, per mm/s by which the error changes."""

    derivative_filter_s: Positive = 0.1
    """Time constant of the filter that the derivative passes first."""


# Each with what makes it: (options, robot, seed) → a Controller of daemon/control/controller.py.

GAUSSIAN_PROCESS: Final = Kind(
    GaussianProcess, "daemon.controllers.peers.gaussian_process:GaussianProcessController"
)
ITERATIVE_LEARNING: Final = Kind(
    IterativeLearning, "daemon.controllers.peers.iterative_learning:IterativeLearningController"
)
MODEL_PREDICTIVE: Final = Kind(
    ModelPredictive, "daemon.controllers.peers.model_predictive:ModelPredictiveController"
)
PID_CONSTANT_CURVATURE: Final = Kind(
    PidConstantCurvature, "daemon.controllers.peers.pid_constant_curvature:make"
)
