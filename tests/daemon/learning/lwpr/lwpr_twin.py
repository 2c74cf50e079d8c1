"""Locally weighted projection regression written for reading, one equation a line: the oracle.

Slow, in plain numpy, with the letters of Vijayakumar, D'Souza and Schaal (2005). It shares nothing
with the compiled one but its settings: fields are objects, distances are d'Dd, and a prediction
goes through the projections and not through a slope.
"""
# ruff: noqa: N806 - the paper's letters

import numpy as np

from daemon.learning.lwpr.model import FloatArray
from daemon.learning.lwpr.settings import LwprSettings
from drivers.pose import Vector


class Direction:
    """One projection u of the inputs, and what is regressed on it."""

    def __init__(self, settings: LwprSettings, size: int, number: int, nothing: float) -> None:
        self.u = self.p = np.eye(size)[number]
        self.sum_u, self.sum_p = np.zeros(size), np.zeros(size)
        self.S, self.W, self.n = settings.init_s2, 1e-10, nothing
        self.lam = settings.forgetting_initial
        self.sum_beta = self.beta = self.E = self.H = self.K = 0.0


class Model:
    """The linear model of one output in one field."""

    def __init__(self, settings: LwprSettings, size: int, mean: float, rank: int) -> None:
        self.settings, self.size, self.mean = settings, size, mean
        self.directions = [Direction(settings, size, r, 1e-10) for r in range(rank)]
        self.V = self.E0 = 0.0
        self.s: list[float] = []
        self.e = self.e_cv = 0.0

    @property
    def mature(self) -> list[Direction]:
        last = self.directions[-1]
        return self.directions if last.n > 2 * self.size else self.directions[:-1]

    def learn(self, w: float, x: Vector, y: float, settled: bool) -> None:
        """x from the mean input, y from the mean output. Leaves s, e and e_cv."""
        x_r, y_r = [x], [y]
        for d in self.directions:
            s = d.u @ x_r[-1]
            y_r.append(y_r[-1] - d.beta * s)
            x_r.append(x_r[-1] - d.p * s)
        taken = 0.0
        for r, d in enumerate(self.directions):
            s = d.u @ x_r[r]
            d.W = d.lam * d.W + w
            d.sum_u = (0.9 + 0.1 * d.lam) * d.sum_u + w * y_r[r] * x_r[r]
            if d.sum_u @ d.sum_u > 1e-24:
                d.u = d.sum_u / np.linalg.norm(d.sum_u)
            d.S = d.lam * d.S + w * s**2
            d.sum_beta = d.lam * d.sum_beta + w * s * y_r[r]
            d.beta = d.sum_beta / d.S
            d.sum_p = d.lam * d.sum_p + w * s * x_r[r]
            d.p = d.sum_p / d.S
            taken += (w * s) ** 2 / d.S
        self.V = self.directions[-1].lam * self.V + taken
        self.s = self.project(x, len(self.directions))
        count = len(self.mature)
        self.e, self.e_cv = y - self.value(x), y_r[count]
        if settled:
            self.E0 = self.directions[-1].lam * self.E0 + w * self.e**2
            for r, d in enumerate(self.directions):
                d.E = d.lam * d.E + w * y_r[r + 1] ** 2

    def project(self, x: Vector, count: int) -> list[float]:
        s = []
        for d in self.directions[:count]:
            s.append(float(d.u @ x))
            x = x - d.p * s[-1]
        return s

    def value(self, x: Vector) -> float:
        used = self.mature
        return sum(d.beta * s for d, s in zip(used, self.project(x, len(used)), strict=True))

    def slope(self) -> Vector:
        """How `value` grows, by the images of the unit vectors."""
        return np.array([self.value(axis) for axis in np.eye(self.size)])

    def close(self) -> None:
        rank, last = len(self.directions), self.directions[-1]
        if rank < self.size:
            before, settings = self.directions[-2], self.settings
            pays = settings.add_threshold * (before.E / before.W + 1e-10) > last.E / last.W + 1e-10
            seen = last.n > 0.99 * self.directions[0].n and last.n * (1 - last.lam) > 0.5
            if pays and seen:
                self.directions.append(Direction(settings, self.size, rank, 0.0))
                self.V = 0.0
        final, tau = self.settings.forgetting_final, self.settings.forgetting_tau
        for d in self.directions:
            d.n = d.lam * d.n + 1
            d.lam = final + tau * (d.lam - final)


class Field:
    """A receptive field: where it is, how wide, and a linear model of each output."""

    def __init__(self, settings: LwprSettings, z: Vector, x: Vector, y: Vector) -> None:
        self.settings, self.c, self.anchor = settings, z, x
        self.x_mean, self.trusted = np.zeros(len(x)), False
        rank = min(2, len(x))
        self.D = settings.init_metric_matrix
        self.M = np.linalg.cholesky(self.D).T
        self.alpha = np.full(self.D.shape, settings.init_learning_rate)
        self.models = [Model(settings, len(x), mean, rank) for mean in y]
        self.slope_at_birth: FloatArray | None = None
        self.start_rates()

    def start_rates(self) -> None:
        self.b, self.trace = np.log(self.alpha + 1e-10), np.zeros(self.D.shape)

    def inherit(self, parent: "Field") -> None:
        self.M, self.D, self.alpha = parent.M.copy(), parent.D.copy(), parent.alpha.copy()
        size = len(self.x_mean)
        self.models = [
            Model(self.settings, size, model.mean, len(model.directions)) for model in parent.models
        ]
        self.start_rates()

    def go_on_from(self, slopes: FloatArray, y: Vector) -> None:
        self.slope_at_birth, self.trusted, self.x_mean = slopes, True, self.anchor
        for model, y_k in zip(self.models, y, strict=True):
            model.mean = y_k

    def given(self, x: Vector) -> Vector:
        """What the slope at birth makes of x."""
        if self.slope_at_birth is None:
            return np.zeros(len(self.models))
        return self.slope_at_birth @ (x - self.anchor)

    def slopes(self) -> FloatArray:
        born = 0.0 if self.slope_at_birth is None else self.slope_at_birth
        return np.array([model.slope() for model in self.models]) + born

    def difference(self, z: Vector, periods: Vector) -> Vector:
        return _shortest(z - self.c, periods)

    def weight(self, d: Vector) -> tuple[float, float, float]:
        """w, and its first and second derivative by the squared distance."""
        q = float(d @ self.D @ d)
        if self.settings.kernel == "gaussian":
            w = float(np.exp(-q / 2))
            return w, -w / 2, w / 4
        if q >= 4:
            return 0.0, 0.0, 0.0
        return (1 - q / 4) ** 2, -(1 - q / 4) / 2, 1 / 8

    def learn(self, w: float, x: Vector, y: Vector) -> None:
        first = self.models[0].directions[0]
        a = first.W * first.lam
        self.x_mean = (a * self.x_mean + w * x) / (a + w)
        self.trusted = self.slope_at_birth is not None or first.n > 2 * len(x)
        settled = first.n * (1 - first.lam) > 0.1
        for model, y_k in zip(self.models, y - self.given(x), strict=True):
            model.mean = (a * model.mean + w * y_k) / (a + w)
            model.learn(w, x - self.x_mean, y_k - model.mean, settled)

    def values(self, x: Vector) -> Vector:
        near = x - self.x_mean
        return self.given(x) + [model.mean + model.value(near) for model in self.models]

    def adapt(self, w: float, w1: float, w2: float, d: Vector) -> None:
        """One step down the gradient of the cost by M."""
        first = self.models[0].directions[0]
        if not first.n * (1 - first.lam) > 0.1:
            return
        settings, size = self.settings, len(d)
        terms = [self._cost_by_weight(model, w) for model in self.models]
        belief, once, twice = np.mean(terms, axis=0)
        pull = belief * 4 * settings.penalty / size * w / first.W
        M, D = self.M.copy(), self.D
        for a in range(size):
            for b in range(a, a + 1 if settings.diagonal_only else size):
                dq = 2 * d[b] * (M @ d)[a]
                g = pull * (M @ D)[a, b] + w1 * dq * once
                if settings.meta:
                    g2 = pull * (D[b, b] + M[a] @ M[a] + M[a, b] ** 2)
                    g2 += (w2 * dq**2 + 2 * w1 * d[b] ** 2) * once + (w1 * dq) ** 2 * twice
                    self._learn_rate(a, b, g, g2)
                step = self.alpha[a, b] * g
                if (step if settings.compat else abs(step)) > 0.1 * np.abs(M).max():
                    self.alpha[a, b] /= 2
                    if not settings.compat:
                        self.b[a, b] = np.log(self.alpha[a, b])
                else:
                    self.M[a, b] = M[a, b] - step
        self.D = self.M.T @ self.M

    def _learn_rate(self, a: int, b: int, g: float, g2: float) -> None:
        change = np.clip(self.settings.meta_rate * g * self.trace[a, b], -0.1, 0.1)
        self.b[a, b] = np.clip(self.b[a, b] - change, -10, 10)
        alpha = self.alpha[a, b] = np.exp(self.b[a, b])
        self.trace[a, b] = self.trace[a, b] * max(0.0, 1 - alpha * g2) - alpha * g

    def _cost_by_weight(self, model: Model, w: float) -> tuple[float, ...]:
        """Belief, and with it the cost's first and second derivative by w; then the traces."""
        first = model.directions[0]
        used = []
        for d, s in zip(model.directions, model.s, strict=True):
            if not d.n * (1 - first.lam) > 0.1:
                break
            used.append((d, s))
        W, e, e_cv = first.W, model.e, model.e_cv
        E = model.directions[max(len(model.mature) - 1, 0)].E
        h = sum(w * s**2 / d.S for d, s in used)
        T = min(1.0, (model.E0 / (E + 1e-10)) ** 4)
        J1 = e_cv**2 - E / W
        J1 -= 2 * sum(s * e / d.S * d.H + (s / d.S) ** 2 * d.K for d, s in used)
        spread = sum(s**2 * e / d.S for d, s in used)
        J2 = 2 * (e**2 * h / w - e_cv**2 / W) + E / W**2
        J2 += 4 * sum((s * e / (d.S * W) + s / d.S * spread) * d.H for d, s in used)
        if not self.settings.compat:
            h = min(h, 0.99)
        for d, s in used:
            d.H = d.lam * d.H + T * w * s * e_cv / (1 - h)
            d.K = d.lam * d.K + T * w**2 * s**2 * e_cv**2 / (1 - h)
        return T, T * J1 / W, T * J2 / W

    def unseen_error(self) -> float:
        lasts = [(model.mature or model.directions)[-1] for model in self.models]
        return sum(last.E / last.W if last.E > 0 else np.inf for last in lasts)


class Twin:
    """Fields that share their outputs. In `compat` one of these per output is what is compared."""

    def __init__(self, settings: LwprSettings, outputs: slice = slice(None)) -> None:
        self.settings = settings
        self.norm_in = np.array(settings.norm_in)
        self.norm_out = np.array(settings.norm_out)[outputs]
        self.where_z = list(settings.localised_on)
        self.where_x = list(settings.regressed_on)
        self.periods = settings.period_of_inputs
        self.fields: list[Field] = []
        self.pruned = 0

    def update(self, inputs: Vector, outputs: Vector) -> Vector:
        settings, y = self.settings, outputs / self.norm_out
        z, x = self._split(inputs)
        total, blended = 0.0, np.zeros(len(y))
        weights = []
        for field in self.fields:
            d = field.difference(z, self.periods[self.where_z])
            w, w1, w2 = field.weight(d)
            weights.append(w)
            if w <= 1e-3:
                continue
            near = self._near(field, x)
            field.learn(w, near, y)
            if field.trusted:
                total, blended = total + w, blended + w * field.values(near)
            if settings.adapt_metric:
                field.adapt(w, w1, w2, d)
            for model in field.models:
                model.close()
        self._add_or_prune(np.array(weights), z, x, y)
        return blended / total * self.norm_out if total > 0 else np.zeros(len(y))

    def _add_or_prune(self, weights: Vector, z: Vector, x: Vector, y: Vector) -> None:
        order = np.argsort(-weights, kind="stable")
        largest = weights[order[0]] if len(order) else 0.0
        second = weights[order[1]] if len(order) > 1 else 0.0
        if largest <= self.settings.generate_below > 0:
            new = Field(self.settings, z, x, y)
            if largest > 0.1 * self.settings.generate_below and self.fields[order[0]].trusted:
                new.inherit(self.fields[order[0]])
            near = [(f, w) for f, w in zip(self.fields, weights, strict=True) if w > 1e-3]
            if not self.settings.compat and any(field.trusted for field, _ in near):
                new.go_on_from(self._blended_slopes(near), y)
            self.fields.append(new)
        elif second > self.settings.prune_above:
            self._prune(*order[:2])

    def _prune(self, a: int, b: int) -> None:
        one, other = self.fields[a], self.fields[b]
        if self.settings.compat:
            first_goes = np.trace(one.D) < np.trace(other.D)
        else:
            first_goes = one.unseen_error() > other.unseen_error()
        self.fields[a if first_goes else b] = self.fields[-1]
        self.fields.pop()
        self.pruned += 1

    def predict(self, inputs: Vector) -> Vector:
        parts, x = self._speaking(inputs)
        if not parts:
            return np.zeros(len(self.norm_out))
        total = sum(w for _, w in parts)
        values = np.array([w * field.values(self._near(field, x)) for field, w in parts])
        blended: Vector = values.sum(axis=0) / total * self.norm_out
        return blended

    def slopes(self, inputs: Vector) -> FloatArray:
        parts, _ = self._speaking(inputs)
        slopes = np.zeros((len(self.norm_out), len(self.norm_in)))
        if parts:
            slopes[:, self.where_x] = self._blended_slopes(parts)
        slopes *= self.norm_out[:, None] / self.norm_in
        return slopes

    def _blended_slopes(self, parts: list[tuple[Field, float]]) -> FloatArray:
        trusted = [(field, w) for field, w in parts if field.trusted]
        total = sum(w for _, w in trusted)
        return np.array(sum(w * field.slopes() for field, w in trusted) / total)

    def confidence(self, inputs: Vector) -> Vector:
        parts, x = self._speaking(inputs)
        nothing = 1e20 if self.settings.compat else np.inf
        confidence = np.full(len(self.norm_out), nothing)
        for k in range(len(confidence)):
            rows = []
            for field, w in parts:
                model, near = field.models[k], self._near(field, x)
                used = model.mature
                if not used or not (used[-1].E > 0 or self.settings.compat):
                    continue
                spare = used[-1].W - model.V
                spare = abs(spare) if self.settings.compat else spare
                if spare <= 0:
                    continue
                s = model.project(near - field.x_mean, len(used))
                far = w * sum(s_r**2 / d.S for d, s_r in zip(used, s, strict=True))
                rows.append((w, used[-1].E / spare * (1 + far), field.values(near)[k]))
            if rows:
                w, variance, value = np.array(rows).T
                spread = w @ (variance + (value - w @ value / w.sum()) ** 2)
                confidence[k] = np.sqrt(spread) / w.sum() * self.norm_out[k]
        return confidence

    @property
    def centres(self) -> FloatArray:
        return np.array([field.c for field in self.fields])

    @property
    def metrics(self) -> FloatArray:
        return np.array([field.D for field in self.fields])

    def _speaking(self, inputs: Vector) -> tuple[list[tuple[Field, float]], Vector]:
        z, x = self._split(inputs)
        parts = []
        for field in self.fields:
            w, _, _ = field.weight(field.difference(z, self.periods[self.where_z]))
            if w > self.settings.cutoff and field.trusted:
                parts.append((field, w))
        return parts, x

    def _split(self, inputs: Vector) -> tuple[Vector, Vector]:
        normalised = inputs / self.norm_in
        return normalised[self.where_z], normalised[self.where_x]

    def _near(self, field: Field, x: Vector) -> Vector:
        """x on the turn that is nearest to where the field was born."""
        return field.anchor + _shortest(x - field.anchor, self.periods[self.where_x])


def _shortest(way: Vector, periods: Vector) -> Vector:
    turns = np.round(np.divide(way, periods, out=np.zeros(len(way)), where=periods > 0))
    return way - turns * periods
