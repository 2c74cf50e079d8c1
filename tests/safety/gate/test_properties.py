"""Whatever is proposed, measured and answered, and whenever: what the gate never lets happen."""

from dataclasses import dataclass
from itertools import cycle
from math import inf, isfinite, nan

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from safety.gate import RISK, Decision, Gate, Measured
from safety.limits import CountLimits
from safety.permit import PermittedStep
from tests.safety.examples import examples
from tests.safety.gate.gate_rig import (
    LATEST_S,
    LIMITS,
    STEP_NS,
    THRESHOLD,
    Rig,
    ToldRisk,
    change,
    risky_beyond,
)

AXES = 2
MS = 1_000_000


@dataclass(frozen=True)
class Moment:
    """One call of the gate."""

    after_ns: int
    """Since the call before."""
    duration_ns: int
    targets: list[float]
    holds: bool
    lags: list[int]
    """How far each axis is measured behind its target."""
    risk: float


awkward = st.sampled_from([nan, inf, -inf, 1e300, -1e300, 1e18, 0.0, -0.0, 100_000.0, 1e-300])
targets = st.one_of(st.floats(-20_000.0, 120_000.0), awkward, st.floats())
moments = st.builds(
    Moment,
    after_ns=st.one_of(st.just(STEP_NS), st.integers(0, 100 * MS)),
    duration_ns=st.one_of(st.just(STEP_NS), st.integers(2 * MS, 60 * MS)),
    targets=st.lists(targets, min_size=AXES, max_size=AXES),
    holds=st.booleans(),
    lags=st.lists(st.integers(-300, 300), min_size=AXES, max_size=AXES),
    risk=st.one_of(st.just(0.0), st.floats(0.0, 1.0), st.sampled_from([nan, inf, -1.0])),
)
limits_of_an_axis = st.one_of(
    st.just(LIMITS),
    st.builds(
        CountLimits,
        lowest=st.integers(-100_000, 0),
        highest=st.integers(1, 100_000),
        max_velocity=st.integers(1_000, 1_000_000),
        max_acceleration=st.integers(10_000, 10_000_000),
        max_lag=st.just(1_000_000),
    ),
)


class Watched:
    """A gate in use, beside everything that its steps are held against."""

    def __init__(self, limits: list[CountLimits], starts: list[int]) -> None:
        self.limits = limits
        self.risk = ToldRisk()
        self.gate = Gate(limits, [1.0] * AXES, [None] * AXES, self.risk, THRESHOLD, LATEST_S)
        self.gate.settle(starts)
        self.starts = starts
        self.last: PermittedStep | None = None
        self.t_ns = 0

    def call(self, moment: Moment) -> Decision:
        self.t_ns += moment.after_ns
        self.risk.risk = moment.risk
        here = [self.target(axis) - moment.lags[axis] for axis in range(AXES)]
        measured = Measured(here, [None] * AXES)
        if moment.holds:
            decision = self.gate.hold(measured, self.t_ns, moment.duration_ns)
        else:
            decision = self.gate.decide(moment.targets, measured, self.t_ns, moment.duration_ns)
        self.check(decision, moment)
        self.last = decision.step or self.last
        return decision

    def target(self, axis: int) -> int:
        return self.starts[axis] if self.last is None else self.last.target(axis, self.t_ns)

    def velocity(self, axis: int) -> float:
        """That of the last step, which after its end is that of braking."""
        last = self.last
        return 0.0 if last is None else last.velocity(axis, max(self.t_ns, last.begins_ns))

    def check(self, decision: Decision, moment: Moment) -> None:
        assert 0.0 <= decision.scale <= 1.0
        step = decision.step
        assert step is not None, f"the gate has led itself into a corner: {decision.refused}"
        assert "beyond" not in decision.refused, "the last check had to correct the gate"
        assert (step.begins_ns, step.ends_ns) == (self.t_ns, self.t_ns + moment.duration_ns)
        for axis, limits in enumerate(self.limits):
            start, end = step.from_counts[axis], step.to_counts[axis]
            assert start == self.target(axis), "a target jumps"
            assert min(start, limits.lowest) <= end <= max(start, limits.highest)
            duration_s = moment.duration_ns * 1e-9
            assert abs(end - start) <= limits.max_velocity * duration_s + 1
            before, after = self.velocity(axis), (end - start) / duration_s
            most = limits.max_acceleration * duration_s
            assert abs(after - before) <= most + 2 / duration_s
            if abs(after) > abs(before) or after * before < 0:
                unchanged_ns: float = moment.duration_ns
                if self.last is not None:
                    unchanged_ns = self.last.unchanged_ns(axis, self.t_ns)
                gained_s = min(duration_s, unchanged_ns * 1e-9)
                slowed = after * before > 0
                gained = abs(after) - abs(before) if slowed else abs(after)
                assert gained <= limits.max_acceleration * gained_s + 2 / duration_s


@examples(150)
@given(
    limits=st.lists(limits_of_an_axis, min_size=AXES, max_size=AXES),
    outside=st.sampled_from([-700, 0, 0, 0, 700]),
    history=st.lists(moments, min_size=1, max_size=25),
)
def test_no_limit_is_ever_broken(
    limits: list[CountLimits], outside: int, history: list[Moment]
) -> None:
    starts = [(one.lowest if outside < 0 else one.highest) + outside for one in limits]
    watched = Watched(limits, starts)
    for moment in history:
        decision = watched.call(moment)
        if not moment.holds and not all(isfinite(target) for target in moment.targets):
            assert decision.refused


@examples(60)
@given(
    history=st.lists(moments, max_size=10),
    last=moments,
    bad=st.sampled_from([nan, inf, -inf]),
)
def test_what_is_not_finite_never_becomes_motion(
    history: list[Moment], last: Moment, bad: float
) -> None:
    watched = Watched([LIMITS] * AXES, [50_000] * AXES)
    for moment in history:
        watched.call(moment)
    for number in range(40):
        before = [abs(watched.velocity(axis)) for axis in range(AXES)]
        targets = [bad, last.targets[1]] if number % 2 else [last.targets[0], bad]
        decision = watched.call(Moment(STEP_NS, STEP_NS, targets, False, [0] * AXES, 0.0))
        for axis in range(AXES):
            assert abs(change(decision, axis)) <= before[axis] * STEP_NS * 1e-9 + 1
    assert [change(decision, axis) for axis in range(AXES)] == [0, 0]


@examples(60)
@given(
    history=st.lists(moments, max_size=10),
    targets=st.lists(st.floats(-2e5, 2e5), min_size=AXES, max_size=AXES),
)
def test_at_full_risk_nothing_moves_after_braking(
    history: list[Moment], targets: list[float]
) -> None:
    watched = Watched([LIMITS] * AXES, [50_000] * AXES)
    for moment in history:
        watched.call(moment)
    for _ in range(40):
        decision = watched.call(Moment(STEP_NS, STEP_NS, targets, False, [0] * AXES, 1.0))
        assert decision.refused == RISK
    assert [change(decision, axis) for axis in range(AXES)] == [0, 0]


@examples(40)
@given(
    start=st.integers(0, 100_000),
    target=st.integers(0, 100_000),
    jitter=st.lists(st.integers(-8 * MS, 8 * MS), min_size=1, max_size=10),
)
def test_every_place_within_reach_is_arrived_at(start: int, target: int, jitter: list[int]) -> None:
    rig = Rig(at=start)
    steps = 30 + abs(target - start) // 300
    for early_ns, _ in zip(cycle(jitter), range(steps), strict=False):
        rig.t_ns += early_ns
        rig.decide(target)
    # A step that is always cut short may end one count before its target.
    assert abs(rig.at[0] - target) <= 1


@examples(60)
@given(
    start=st.integers(10_000, 90_000),
    speed=st.integers(-480, 480),
    others=st.integers(-480, 480),
)
def test_a_motion_within_the_limits_goes_through_unchanged(
    start: int, speed: int, others: int
) -> None:
    rig = Rig(2, at=start)
    for number in range(10):
        ramp = min(1.0, (number + 1) / 4)
        steps = [rig.at[0] + round(speed * ramp), rig.at[1] + round(others * ramp)]
        decision = rig.decide(*steps)
        assert rig.at == steps
        assert (decision.scale, decision.limits, decision.refused) == (1.0, (), "")


@examples(60)
@given(
    wall=st.integers(50_000, 60_000),
    run_up=st.integers(0, 12),
    targets=st.lists(st.integers(40_000, 70_000), min_size=1, max_size=40),
)
def test_a_wall_that_is_known_is_never_passed(wall: int, run_up: int, targets: list[int]) -> None:
    rig = Rig(at=45_000, risk=risky_beyond(wall / 2000.0))
    for target in [70_000] * run_up + targets:
        rig.decide(target)
        assert rig.at[0] <= wall
    for _ in range(10):
        rig.hold()
        assert rig.at[0] <= wall


@examples(150)
@given(
    limits=st.one_of(
        st.just(LIMITS),
        st.builds(
            CountLimits,
            lowest=st.integers(-2_000, 0),
            highest=st.integers(1, 20_000),
            max_velocity=st.integers(1_000, 100_000),
            max_acceleration=st.integers(10_000, 1_000_000),
            max_lag=st.just(1_000_000),
        ),
    ),
    after_ms=st.lists(
        st.one_of(st.just(25.0), st.floats(0.0, 60.0), st.sampled_from([0.0, 0.5, 37.4, 200.0])),
        min_size=1,
        max_size=40,
    ),
    wanted=st.lists(st.sampled_from([-1e9, -50.0, 0.0, 50.0, 1e9]), min_size=1, max_size=8),
    cycle_ms=st.sampled_from([2, 5, 10]),
)
def test_limits_hold_on_the_targets_as_they_go_on_the_bus_whenever_frames_come(
    limits: CountLimits, after_ms: list[float], wanted: list[float], cycle_ms: int
) -> None:
    """Velocities within any time differ by what the acceleration allows in it and in one step."""
    gate = Gate([limits], [1.0], [None], ToldRisk(), THRESHOLD, LATEST_S)
    gate.settle([max(0, limits.lowest)])
    steps: list[PermittedStep] = []
    t_ns, at = 0, max(0, limits.lowest)
    for after, want in zip(after_ms, cycle(wanted), strict=False):
        t_ns += round(after * MS)
        at = steps[-1].target(0, t_ns) if steps else at
        decision = gate.decide([at + want], Measured([at], [None]), t_ns, STEP_NS)
        assert decision.step is not None
        steps.append(decision.step)
    times = np.arange(steps[0].begins_ns, t_ns + 2 * STEP_NS, cycle_ms * MS)
    latest = np.searchsorted([step.begins_ns for step in steps], times, side="right") - 1
    on_bus = np.array([steps[k].target(0, int(t)) for k, t in zip(latest, times, strict=True)])
    assert limits.lowest <= on_bus.min() <= on_bus.max() <= limits.highest
    cycle_s, step_s = cycle_ms * 1e-3, STEP_NS * 1e-9
    velocities = np.diff(on_bus) / cycle_s
    assert np.abs(velocities).max(initial=0.0) <= limits.max_velocity + 1 / step_s + 1 / cycle_s
    apart_s = np.abs(times[:-1, None] - times[None, :-1]) * 1e-9
    apart = np.abs(velocities[:, None] - velocities[None, :])
    frames = np.abs(latest[:-1, None] - latest[None, :-1]) + 1
    rounding = (frames + 1) / step_s + 4 / cycle_s
    assert np.all(apart <= limits.max_acceleration * (apart_s + cycle_s + step_s) + rounding)
