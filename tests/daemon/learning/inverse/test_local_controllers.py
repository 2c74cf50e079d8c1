"""The local controllers: three engines, one meaning."""

from collections.abc import Callable

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher
from scipy.stats import norm, qmc

from daemon.learning.inverse import bank_kernels, local_controller_kernels
from daemon.learning.inverse.engines import EngineName, make_local_controllers, warm_up
from daemon.learning.inverse.local_controller_settings import LocalControllerSettings
from daemon.learning.inverse.local_controllers import InverseAnswer, LocalControllers
from daemon.learning.inverse.prior import Prior
from daemon.learning.samples.motion import MotionSample
from daemon.learning.samples.receptive_fields import ReceptiveFields
from drivers.pose import Vector
from tests.daemon.learning.exploring_arm import (
    SCALE,
    exploration,
    fields_over,
    settings_for,
    tip_mm,
)

ENGINES: tuple[EngineName, ...] = ("oracle", "batch", "bank")
POSTURE = np.full(6, 10.0)
EXPLORED = exploration(700)
FIELDS = fields_over(EXPLORED, 8.0)
SETTINGS = settings_for(EXPLORED)
RUN = exploration(160, seed=1)
CAPACITY = 60

every_engine = pytest.mark.parametrize("engine", ENGINES)


def leaning(fields: ReceptiveFields) -> ReceptiveFields:
    """The same centres with metrics that are not diagonal."""
    random = np.random.default_rng(3)
    turn = 0.3 * random.normal(size=fields.metrics.shape)
    return ReceptiveFields(
        fields.centres, fields.metrics + turn @ turn.transpose(0, 2, 1), fields.scale
    )


def made(
    engine: EngineName,
    fields: ReceptiveFields = FIELDS,
    settings: LocalControllerSettings = SETTINGS,
    prior: Prior | None = None,
    samples: tuple[MotionSample, ...] = RUN,
) -> LocalControllers:
    controllers = make_local_controllers(engine, fields, settings, CAPACITY, POSTURE, prior)
    for sample in samples:
        controllers.add(sample)
        controllers.solve()
    return controllers


def asked(controllers: LocalControllers, samples: tuple[MotionSample, ...]) -> list[InverseAnswer]:
    return [controllers.command(s.delta_tip_mm, s.tip_mm, s.u) for s in samples]


def assert_same(ours: list[InverseAnswer], theirs: list[InverseAnswer], within: float) -> None:
    longest = max(float(np.linalg.norm(command.delta_u)) for command in theirs)
    for a, b in zip(ours, theirs, strict=True):
        assert a.delta_u == pytest.approx(b.delta_u, abs=within * longest)
        assert a.activation == pytest.approx(b.activation, rel=1e-9)
        assert a.support == pytest.approx(b.support, rel=10.0 * within)


def algorithm_1(
    samples: tuple[MotionSample, ...],
    fields: ReceptiveFields,
    weighting: Vector,
    gain: float,
    query: MotionSample,
) -> Vector:
    """Ho 2018, Algorithm 1 and equation 5, line by line in mm, with only misprints corrected."""
    x = np.array([np.r_[s.delta_tip_mm, s.tip_mm, s.u, 1.0] for s in samples])
    y = np.array([s.delta_u for s in samples])
    attractor = np.array([gain * (POSTURE - s.u) for s in samples])
    cost = np.array([a @ weighting @ a for a in y - attractor])
    weights = np.array([fields.weights(s.tip_mm, s.u) for s in samples]).T
    here = fields.weights(query.tip_mm, query.u)
    answer = np.zeros(y.shape[1])
    for i, w in enumerate(weights):
        sigma_squared = np.sum(w * cost) / np.sum(w)
        reward = np.exp(-0.5 * sigma_squared * cost)
        root = np.sqrt(np.diag(reward * w))
        beta = np.linalg.lstsq(root @ x, root @ y, rcond=None)[0]
        asks = np.r_[query.delta_tip_mm, query.tip_mm, query.u, 1.0]
        answer += here[i] * (asks @ beta)
    result: Vector = answer / here.sum()
    return result


@every_engine
def test_the_paper_preset_is_algorithm_1(engine: EngineName) -> None:
    fields = fields_over(EXPLORED, 3.0)
    scales = (SETTINGS.tip_step_mm, SETTINGS.axis_steps)
    settings = LocalControllerSettings.paper(*scales)
    weighting = np.diag(1.0 / (6.0 * SETTINGS.axis_steps**2))
    controllers = made(engine, fields, settings)
    for query in RUN[-5:]:
        expected = algorithm_1(RUN[-CAPACITY:], fields, weighting, 0.1, query)
        command = controllers.command(query.delta_tip_mm, query.tip_mm, query.u)
        assert command.delta_u == pytest.approx(expected, rel=2e-3, abs=2e-3)


@pytest.mark.parametrize("fields", [FIELDS, leaning(FIELDS)], ids=["diagonal", "full"])
@pytest.mark.parametrize("rule", ["inverse_mean", "ess", "printed"])
@pytest.mark.parametrize("pretrained", [True, False])
def test_engines_agree(fields: ReceptiveFields, rule: str, pretrained: bool) -> None:
    settings = settings_for(EXPLORED, sigma_rule=rule)
    prior = Prior.of(EXPLORED, fields, settings, POSTURE) if pretrained else None
    oracle, batch, bank = (made(engine, fields, settings, prior) for engine in ENGINES)
    queries = RUN[-6:] + EXPLORED[::200]
    expected = asked(oracle, queries)
    assert_same(asked(batch, queries), expected, 1e-10)
    assert_same(asked(bank, queries), expected, 1e-5)
    assert batch.parameters == pytest.approx(oracle.parameters, rel=1e-8, abs=1e-8)


@pytest.mark.parametrize("rule", ["inverse_mean", "ess", "printed"])
def test_engines_agree_while_the_window_fills_and_slides(rule: str) -> None:
    settings = settings_for(EXPLORED, sigma_rule=rule, kappa=20.0, effective_samples=12.0)
    prior = Prior.of(EXPLORED, FIELDS, settings, POSTURE)
    oracle, batch, bank = (
        made(engine, settings=settings, prior=prior, samples=()) for engine in ENGINES
    )
    for number, sample in enumerate(RUN):
        for controllers in (oracle, batch, bank):
            controllers.add(sample)
            controllers.solve()
        if number % 13 == 0:
            expected = asked(oracle, RUN[number : number + 1])
            assert_same(asked(batch, RUN[number : number + 1]), expected, 1e-10)
            assert_same(asked(bank, RUN[number : number + 1]), expected, 1e-5)


def test_engines_agree_after_another_posture() -> None:
    prior = Prior.of(EXPLORED, FIELDS, SETTINGS, POSTURE)
    elsewhere = np.array([2.0, 15.0, 8.0, 1.0, 9.0, 18.0])
    commands = {}
    for engine in ENGINES:
        controllers = made(engine, prior=prior)
        before = asked(controllers, RUN[-1:])
        controllers.set_posture(elsewhere)
        assert np.array_equal(controllers.posture, elsewhere)
        for sample in exploration(5, seed=2):
            controllers.add(sample)
        commands[engine] = asked(controllers, RUN[-3:])
        assert not np.allclose(commands[engine][-1].delta_u, before[0].delta_u, rtol=1e-3)
    assert_same(commands["batch"], commands["oracle"], 1e-10)
    assert_same(commands["bank"], commands["oracle"], 1e-5)


@pytest.mark.parametrize("axes", [2, 3, 8])
def test_any_number_of_axes_will_do(axes: int) -> None:
    random = np.random.default_rng(axes)
    scale = np.full(3 + axes, 10.0)
    jacobian = random.normal(size=(3, axes))
    metrics = np.tile(np.eye(3 + axes), (5, 1, 1))
    fields = ReceptiveFields(0.1 * random.normal(size=(5, 3 + axes)), metrics, scale)
    settings = LocalControllerSettings(1.0, np.ones(axes))
    controllers = [
        make_local_controllers(engine, fields, settings, 40, np.zeros(axes)) for engine in ENGINES
    ]
    for _ in range(50):
        u, delta_u = random.normal(size=axes), random.normal(size=axes)
        sample = MotionSample(jacobian @ u, u, delta_u, jacobian @ delta_u)
        for engine in controllers:
            engine.add(sample)
    expected, *others = ([e.command(np.ones(3), np.zeros(3), np.zeros(axes))] for e in controllers)
    for commands in others:
        assert_same(commands, expected, 1e-5)


@every_engine
def test_an_answer_is_the_weighted_mean_of_what_the_parameters_say(engine: EngineName) -> None:
    controllers, query = made(engine), RUN[-1]
    weights = FIELDS.weights(query.tip_mm, query.u)
    away = FIELDS.place(query.tip_mm, query.u) - FIELDS.centres
    step = np.tile(query.delta_tip_mm / SETTINGS.tip_step_mm, (FIELDS.count, 1))
    rows = np.hstack([step, away, np.ones((FIELDS.count, 1))])
    answers = np.einsum("fp,fpm->fm", rows, controllers.parameters) * SETTINGS.axis_steps
    knowing = np.any(controllers.parameters != 0.0, axis=(1, 2))
    expected = (weights * knowing) @ answers / (weights @ knowing)
    command = controllers.command(query.delta_tip_mm, query.tip_mm, query.u)
    assert command.delta_u == pytest.approx(expected, rel=1e-6)
    assert command.activation == pytest.approx(weights.max())


def _inverse(matrix: Vector) -> Vector:
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)


class LinearArm:
    """Δp = J Δu, explored with Δu ~ N(μ, Σ) at one place: what the regression must converge to.

    Samples are evenly spread, not random, so that few of them are close to the limit.
    """

    def __init__(self, axes: int, samples: int) -> None:
        random = np.random.default_rng(1)
        self.axes = axes
        self.jacobian = np.linalg.qr(random.normal(size=(axes, 3)))[0].T
        self.weighting = self._positive(random, 0.5)
        self.covariance = self._positive(random, 0.3)
        self.mean = 0.3 * random.normal(size=axes)
        self.u = random.normal(size=axes)
        self.posture = self.u + random.normal(size=axes)
        self.cheapest = 0.3 * (self.posture - self.u)
        spread = norm.ppf(qmc.Sobol(axes, seed=3).random(samples))
        self.steps = self.mean + spread @ np.linalg.cholesky(self.covariance).T
        self.wanted_mm = np.array([0.5, -1.0, 0.7])

    def _positive(self, random: np.random.Generator, least: float) -> Vector:
        root = random.normal(size=(self.axes, self.axes))
        return root @ root.T / self.axes + least * np.eye(self.axes)

    def learnt(self, scale: float) -> Vector:
        """The answer to wanted_mm with σ² fixed to `scale`."""
        d = 3 + self.axes
        fields = ReceptiveFields(np.zeros((1, d)), np.eye(d)[None], np.full(d, 100.0))
        away = self.steps - self.cheapest
        mean_cost = np.mean(np.sum((away @ self.weighting) * away, axis=1))
        settings = LocalControllerSettings(
            1.0,
            np.ones(self.axes),
            self.weighting,
            attractor_gain=0.3,
            attractor_steps=None,
            kappa=float(scale * mean_cost),
            ridge=1e-9,
        )
        controllers = make_local_controllers(
            "batch", fields, settings, len(self.steps), self.posture
        )
        place = np.zeros(3)
        moved = self.steps @ self.jacobian.T
        controllers.refill(
            MotionSample(place, self.u, step, tip)
            for step, tip in zip(self.steps, moved, strict=True)
        )
        return controllers.command(self.wanted_mm, place, self.u).delta_u

    def closed_form(self, scale: float) -> Vector:
        """μ' + Σ'Jᵀ(JΣ'Jᵀ)⁻¹(Δp − Jμ'), Σ' = (Σ⁻¹ + σ²N)⁻¹, μ' = Σ'(Σ⁻¹μ + σ²NΔu₀)."""
        precision = _inverse(self.covariance)
        covariance = _inverse(precision + scale * self.weighting)
        mean = covariance @ (precision @ self.mean + scale * self.weighting @ self.cheapest)
        return self._nearest(mean, covariance)

    def pseudo_inverse(self) -> Vector:
        """The N-weighted pseudo-inverse with the attractor in its null space."""
        return self._nearest(self.cheapest, _inverse(self.weighting))

    def _nearest(self, start: Vector, spread: Vector) -> Vector:
        j = self.jacobian
        across = np.linalg.solve(j @ spread @ j.T, self.wanted_mm - j @ start)
        result: Vector = start + spread @ j.T @ across
        return result


@pytest.mark.parametrize(("axes", "scale"), [(6, 0.2), (6, 3.0), (4, 1.0), (4, 10.0)])
def test_on_a_linear_arm_the_answer_is_the_closed_form(axes: int, scale: float) -> None:
    arm = LinearArm(axes, 2**15)
    learnt, expected = arm.learnt(scale), arm.closed_form(scale)
    assert np.linalg.norm(learnt - expected) < 0.01 * np.linalg.norm(expected)
    assert arm.jacobian @ learnt == pytest.approx(arm.wanted_mm, abs=1e-5)


def test_the_sharper_the_reward_the_nearer_to_the_pseudo_inverse_with_the_attractor() -> None:
    arm = LinearArm(4, 2**14)
    limit = arm.pseudo_inverse()
    assert arm.closed_form(1e9) == pytest.approx(limit, rel=1e-6)
    missed = [
        np.linalg.norm(arm.learnt(scale) - limit) / np.linalg.norm(limit)
        for scale in (1e-9, 1.0, 10.0)
    ]
    assert missed[0] > 0.5
    assert missed[1] < 0.6 * missed[0]
    assert missed[2] < 0.06


@every_engine
def test_it_learns_the_arm(engine: EngineName) -> None:
    """Where there are samples, the answer moves the tip as it was asked to."""
    controllers = made(engine, prior=Prior.of(EXPLORED, FIELDS, SETTINGS, POSTURE))
    missed = []
    for query in RUN[-20:]:
        step = controllers.command(query.delta_tip_mm, query.tip_mm, query.u).delta_u
        missed.append(tip_mm(query.u + step) - query.tip_mm - query.delta_tip_mm)
    asked_mm = [np.linalg.norm(query.delta_tip_mm) for query in RUN[-20:]]
    assert np.median(np.linalg.norm(missed, axis=1)) < 0.35 * np.median(asked_mm)


@every_engine
def test_a_field_that_was_not_visited_keeps_its_pretrained_controller_exactly(
    engine: EngineName,
) -> None:
    far = FIELDS.centres[0] + 10.0
    fields = ReceptiveFields(
        np.vstack([FIELDS.centres, far]),
        np.concatenate([FIELDS.metrics, FIELDS.metrics[:1]]),
        SCALE,
    )
    moved = far * SCALE - np.r_[EXPLORED[0].tip_mm, EXPLORED[0].u]
    there = tuple(
        sample._replace(tip_mm=sample.tip_mm + moved[:3], u=sample.u + moved[3:])
        for sample in EXPLORED[:50]
    )
    prior = Prior.of(EXPLORED + there, fields, SETTINGS, POSTURE)
    assert prior.mass[-1] > 1.0
    controllers = made(engine, fields, prior=prior, samples=())
    before = controllers.parameters
    for sample in RUN:
        controllers.add(sample)
    after = controllers.parameters
    assert np.array_equal(after[-1], before[-1])
    assert not np.allclose(after[:-1], before[:-1])


@every_engine
def test_where_nothing_is_known_the_answer_says_so(engine: EngineName) -> None:
    query = RUN[-1]
    nothing = made(engine, samples=()).command(query.delta_tip_mm, query.tip_mm, query.u)
    assert (nothing.delta_u == 0.0).all()
    assert nothing.support == 0.0
    assert nothing.activation > 0.0
    no_fields = ReceptiveFields(np.zeros((0, 9)), np.zeros((0, 9, 9)), SCALE)
    none = made(engine, no_fields).command(query.delta_tip_mm, query.tip_mm, query.u)
    assert (none.delta_u == 0.0).all()
    assert (none.activation, none.support) == (0.0, 0.0)


@every_engine
def test_far_from_all_fields_activation_vanishes(engine: EngineName) -> None:
    far = made(engine).command(np.ones(3), np.full(3, 5e3), np.full(6, 900.0))
    assert far.activation == 0.0
    assert np.isfinite(far.delta_u).all()
    assert 0.0 <= far.support < 0.1


@every_engine
@pytest.mark.parametrize("poison", [np.nan, np.inf, 1e200])
def test_a_query_that_is_no_number_gets_no_answer(engine: EngineName, poison: float) -> None:
    controllers, query = made(engine), RUN[-1]
    for place in range(3):
        parts = [query.delta_tip_mm.copy(), query.tip_mm.copy(), query.u.copy()]
        parts[place][1] = poison
        command = controllers.command(*parts)
        assert (command.delta_u == 0.0).all()
        assert (command.activation, command.support) == (0.0, 0.0)


@every_engine
@pytest.mark.parametrize("poison", [np.nan, np.inf, 1e9])
def test_poison_is_refused_and_changes_nothing(engine: EngineName, poison: float) -> None:
    prior = Prior.of(EXPLORED, FIELDS, SETTINGS, POSTURE)
    controllers = made(engine, prior=prior)
    before, parameters = asked(controllers, RUN[-3:]), controllers.parameters
    for name in MotionSample._fields:
        bad = RUN[5]._replace(**{name: np.full(len(getattr(RUN[5], name)), poison)})
        with pytest.raises(ValueError, match=r"not finite|not a motion of this robot"):
            controllers.add(bad)
        with pytest.raises(ValueError, match=r"not finite|not a motion of this robot"):
            controllers.refill([*RUN[:3], bad])
    with pytest.raises(ValueError, match="a posture is 6 finite numbers"):
        controllers.set_posture(np.full(6, np.nan))
    assert len(controllers.window) == CAPACITY
    for a, b in zip(asked(controllers, RUN[-3:]), before, strict=True):
        assert np.array_equal(a.delta_u, b.delta_u)
    assert np.array_equal(controllers.parameters, parameters)


@every_engine
def test_support_counts_the_samples_that_speak_about_the_query(engine: EngineName) -> None:
    d = len(SCALE)
    fields = ReceptiveFields(np.zeros((1, d)), np.eye(d)[None], SCALE)
    settings = settings_for(EXPLORED, prior_mass=0.0, kappa=1e-6)
    random = np.random.default_rng(0)
    controllers = make_local_controllers(engine, fields, settings, 200, np.zeros(6))
    centre, step = np.zeros(3), SETTINGS.tip_step_mm
    supports = []
    for count in (50, 200):
        while len(controllers.window) < count:
            place = 0.05 * random.normal(size=d) * SCALE
            moved = step * random.normal(size=3) / np.sqrt(3.0)
            delta_u = SETTINGS.axis_steps * random.normal(size=6)
            controllers.add(MotionSample(place[:3], place[3:], delta_u, moved))
        supports.append(controllers.command(np.zeros(3), centre, np.zeros(6)).support)
    assert supports[0] == pytest.approx(50.0, rel=0.25)
    assert supports[1] == pytest.approx(200.0, rel=0.15)
    onward = [
        controllers.command(times * step * np.array([1.0, 0.0, 0.0]), centre, np.zeros(6)).support
        for times in (1.0, 5.0, 25.0)
    ]
    assert supports[1] > onward[0] > 10.0 * onward[1] > 100.0 * onward[2]
    away = controllers.command(np.zeros(3), np.array([60.0, 0.0, 0.0]), np.zeros(6))
    assert away.support < 0.1 * supports[1]


@every_engine
def test_a_refilled_window_leaves_no_trace_of_what_was_before(engine: EngineName) -> None:
    """So saved samples are a saved state: who goes on and who loads them do the same."""
    prior = Prior.of(EXPLORED, FIELDS, SETTINGS, POSTURE)
    gone_on, loaded = made(engine, prior=prior), made(engine, prior=prior, samples=())
    saved = tuple(gone_on.window)
    gone_on.refill(saved)
    loaded.refill(saved)
    for sample in exploration(CAPACITY + 10, seed=4):
        for controllers in (gone_on, loaded):
            controllers.add(sample)
        a, b = (asked(controllers, (sample,))[0] for controllers in (gone_on, loaded))
        assert np.array_equal(a.delta_u, b.delta_u)
        assert a.support == b.support


@every_engine
def test_a_refill_takes_the_newest_samples_that_fit(engine: EngineName) -> None:
    controllers = made(engine, samples=())
    controllers.refill(RUN)
    expected = made(engine)
    assert_same(asked(controllers, RUN[-3:]), asked(expected, RUN[-3:]), 1e-6)


@every_engine
def test_solving_ahead_changes_no_answer(engine: EngineName) -> None:
    ahead, late = made(engine), made(engine)
    ahead.solve(3)
    ahead.solve()
    for a, b in zip(asked(ahead, RUN[-3:]), asked(late, RUN[-3:]), strict=True):
        assert np.array_equal(a.delta_u, b.delta_u)


def same_place(sample: MotionSample) -> MotionSample:
    return RUN[0]


def still(sample: MotionSample) -> MotionSample:
    return sample._replace(delta_u=np.zeros(6), delta_tip_mm=np.zeros(3))


def parallel(sample: MotionSample) -> MotionSample:
    return sample._replace(delta_u=RUN[0].delta_u, delta_tip_mm=RUN[0].delta_tip_mm)


@every_engine
@pytest.mark.parametrize("degenerate", [same_place, still, parallel])
def test_samples_that_say_little_do_no_harm(
    engine: EngineName, degenerate: Callable[[MotionSample], MotionSample]
) -> None:
    controllers = made(engine, samples=tuple(degenerate(sample) for sample in RUN))
    typical = float(np.linalg.norm(SETTINGS.axis_steps))
    for query in RUN[-3:]:
        command = controllers.command(query.delta_tip_mm, query.tip_mm, query.u)
        assert np.linalg.norm(command.delta_u) < 100.0 * typical
        assert np.isfinite(command.support)


def test_nothing_is_compiled_once_it_is_warm() -> None:
    """A compilation while the robot moves would cost the loop seconds."""
    warm_up()
    kernels = [
        kernel
        for module in (bank_kernels, local_controller_kernels)
        for name, kernel in vars(module).items()
        if isinstance(kernel, Dispatcher) and not name.startswith("_")
    ]
    assert len(kernels) > 6
    prior = Prior.of(EXPLORED, FIELDS, SETTINGS, POSTURE)
    for engine in ENGINES:
        for known in (prior, None):
            controllers = made(engine, prior=known)
            asked(controllers, RUN[-2:])
            controllers.set_posture(np.zeros(6))
            controllers.solve(2)
            controllers.refill(RUN[:30])
            asked(controllers, RUN[-2:])
    assert [kernel.py_func for kernel in kernels if len(kernel.signatures) > 1] == []


def test_settings_for_other_axes_are_refused() -> None:
    with pytest.raises(ValueError, match="for 6 axes, the settings for 2"):
        make_local_controllers(
            "bank", FIELDS, LocalControllerSettings(1.0, np.ones(2)), 10, np.zeros(2)
        )
