"""The local controllers' speed and precision, beside Algorithm 1 as it is printed.

All on one core: numpy's products get one thread.

An update takes one sample into the window, lets the oldest go and asks for a command at the new
place. The window slides along an exploration: coverage changes fast, which is the worst case.
"""

import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from daemon.learning.inverse.bank import BankControllers, BankPrecision
from daemon.learning.inverse.exact import BatchControllers, OracleControllers
from daemon.learning.inverse.local_controllers import InverseAnswer, LocalControllers
from daemon.learning.inverse.prior import Prior
from daemon.learning.samples.motion import MotionSample
from daemon.learning.samples.receptive_fields import ReceptiveFields
from drivers.pose import Vector
from tests.benchmarks.timing import Figures, percentiles, pieces
from tests.daemon.learning.exploring_arm import SCALE, exploration, fields_over, settings_for

PAPER = {"table_1": (139, 425, 16.8, 23.0), "table_2": (352, 550, 33.0, 7.0)}
"""Fields, samples, what sharpness of the fields gives so many here, and the paper's updates/s."""
LARGE = {"2000": (2000, 2000, 60.0), "10000": (10_000, 10_000, 100.0)}
PRECISIONS = {"fine": BankPrecision.fine(), "fast": BankPrecision.fast()}
SAMPLES = (100, 200, 425, 550, 1000, 2000)
FIELDS = (50, 139, 352, 1000, 2000)
STEPS = 1_000_000
POSTURE = np.full(6, 10.0)
_PRETRAINED = exploration(4000)
_SETTINGS = settings_for(_PRETRAINED)
_LITERAL_FIELDS = 6
_ACTIVE = 1e-10
"""Share of the largest weight below which a field is not asked for the exact answer."""


class Walk(NamedTuple):
    """The motions that slide through the window."""

    samples: tuple[MotionSample, ...]
    updates: int = 300
    """Timed, after the window was filled."""
    compared: int = 150
    """Answers after these, beside exact ones."""


def measure(tiny: bool = False) -> Figures:
    """All figures, from a process whose products have one thread."""
    threads = dict.fromkeys(("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS"), "1")
    command = [sys.executable, "-m", "tests.benchmarks.local_controllers", *(["tiny"] * tiny)]
    done = subprocess.run(command, env=os.environ | threads, stdout=subprocess.PIPE, check=True)
    figures: Figures = json.loads(done.stdout)
    return figures


def _measure(tiny: bool) -> Figures:
    if tiny:
        walk = Walk(exploration(600, seed=1), updates=10, compared=5)
        return pieces(
            {
                "small": partial(_paper_size, walk, 5, 20, 16.8, 0.0),
                "large": partial(_large, walk, 10, 20, 60.0),
                "cost": partial(_cost, walk, (20,), (5,)),
                "after_many_steps": partial(_many_steps, walk, 400),
            }
        )
    walk = Walk(exploration(40_000, seed=1))
    return pieces(
        {
            **{name: partial(_paper_size, walk, *size) for name, size in PAPER.items()},
            **{f"large_{name}": partial(_large, walk, *size) for name, size in LARGE.items()},
            "cost": partial(_cost, walk, SAMPLES, FIELDS),
            "after_many_steps": partial(_many_steps, walk, STEPS),
        }
    )


def _paper_size(walk: Walk, count: int, samples: int, sharpness: float, paper_hz: float) -> Figures:
    fields = fields_over(_PRETRAINED, sharpness, count)
    prior = Prior.of(_PRETRAINED, fields, _SETTINGS, POSTURE)
    batch = BatchControllers(fields, _SETTINGS, samples, POSTURE, prior)
    row: Figures = {"fields": fields.count, "samples": samples, "paper_hz": paper_hz}
    row["literal_hz"] = round(_literal_hz(walk, fields, samples), 2)
    row["exact"] = _update(walk, batch, samples)
    for name, precision in PRECISIONS.items():
        for kind, known in (("bank", prior), ("bank_without_pretraining", None)):
            bank = BankControllers(fields, _SETTINGS, samples, POSTURE, known, precision)
            exact = BatchControllers(fields, _SETTINGS, samples, POSTURE, known)
            figures = _update(walk, bank, samples) | {"error": _error(walk, bank, exact, samples)}
            row[f"{kind}_{name}"] = figures
    row["command_ms"] = _command(walk, bank)
    row["times_literal"] = round(row["exact"]["hz"] / row["literal_hz"], 1)
    return row


def _large(walk: Walk, count: int, samples: int, sharpness: float) -> Figures:
    """Too large for the exact engine: the answer is compared field by field at some places."""
    fields = _thinned_fields(count, sharpness)
    bank = BankControllers(fields, _SETTINGS, samples, POSTURE, None, PRECISIONS["fast"])
    figures: Figures = {"fields": fields.count, "samples": samples, **_update(walk, bank, samples)}
    oracle = OracleControllers(fields, _SETTINGS, samples, POSTURE)
    oracle.refill(bank.window)
    errors = []
    after = samples + walk.updates
    for query in walk.samples[after : after + min(40, walk.compared) : 2]:
        bank.add(query)
        oracle.add(query)
        expected = _exact_answer(oracle, fields, query)
        errors.append(_missed(_ask(bank, query).delta_u, expected))
    return figures | {"error": _spread(errors)}


def _cost(walk: Walk, samples: Sequence[int], fields: Sequence[int]) -> Figures:
    """ms of an update, the fastest fifth, against the number of samples and of fields."""
    here = fields_over(_PRETRAINED, PAPER["table_2"][2], PAPER["table_2"][0])
    by_samples = [{"samples": n, **_cost_of(walk, here, n)} for n in samples]
    by_fields = [
        {"fields": m, **_cost_of(walk, _thinned_fields(m, 10.0 * m**0.25), 550)} for m in fields
    ]
    return {"by_samples_at_352_fields": by_samples, "by_fields_at_550_samples": by_fields}


def _cost_of(walk: Walk, fields: ReceptiveFields, samples: int) -> Figures:
    made: dict[str, LocalControllers] = {
        "exact": BatchControllers(fields, _SETTINGS, samples, POSTURE)
    }
    for name, precision in PRECISIONS.items():
        made[f"bank_{name}"] = BankControllers(
            fields, _SETTINGS, samples, POSTURE, precision=precision
        )
    short = walk._replace(updates=min(60, walk.updates))
    costs = {
        f"{name}_ms": round(1e3 / _update(short, controllers, samples)["hz_fastest_fifth"], 3)
        for name, controllers in made.items()
    }
    return costs | {"literal_ms": round(1e3 / _literal_hz(walk, fields, samples), 1)}


def _many_steps(walk: Walk, steps: int) -> Figures:
    """The bank after a million samples, beside sums that are made anew; and memory."""
    count, samples, sharpness, _ = PAPER["table_1"]
    fields = fields_over(_PRETRAINED, sharpness, count)
    bank = BankControllers(fields, _SETTINGS, samples, POSTURE)
    before = 0
    for step in range(steps):
        bank.add(walk.samples[step % len(walk.samples)])
        if step % 10 == 0:
            bank.solve()
        if step == steps // 20:
            before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    kept = bank.parameters
    bank.refill(bank.window)
    exact = BatchControllers(fields, _SETTINGS, samples, POSTURE)
    exact.refill(bank.window)
    return {
        "steps": steps,
        "parameters_against_made_anew": _largest(kept, bank.parameters),
        "parameters_against_exact": _largest(kept, exact.parameters),
        "memory_grown_kb": grown,
        "drift_without_refreshing": _drift(walk, fields, samples),
    }


def _drift(walk: Walk, fields: ReceptiveFields, samples: int) -> Figures:
    """Relative error of sums that only samples in and out have touched, by mass left."""
    bank = BankControllers(fields, _SETTINGS, samples, POSTURE)
    bank.refill(walk.samples[:samples])
    bank._refresh_one = lambda: None  # type: ignore[method-assign]
    for sample in walk.samples[samples:]:
        bank.add(sample)
    kept = bank._moments
    whole = np.flatnonzero(~kept.broken & (kept.samples > 0))
    sums, mass, anchor = kept.terms[whole, 0], kept.mass[whole], kept.anchor[whole]
    errors = []
    for index, i in enumerate(whole):
        anew = _first_term(bank, int(i), float(anchor[index]))
        errors.append(np.abs(sums[index] - anew).max() / np.abs(anew).max())
    by_mass: Figures = {"steps": len(walk.samples) - samples}
    for least, most in ((0.1, np.inf), (1e-3, 0.1), (1e-6, 1e-3)):
        found = [e for e, here in zip(errors, mass, strict=True) if least <= here < most]
        by_mass[f"mass_above_{least:g}"] = float(f"{max(found, default=0.0):.1e}")
    return by_mass


def _first_term(bank: BankControllers, field: int, anchor: float) -> Vector:
    ring, fields = bank._ring, bank.fields
    away = ring.places.T + bank._regressors.middle - fields.centres[field]
    log_weights = -0.5 * np.einsum("ka,ab,kb->k", away, fields.metrics[field], away)
    costs = ring.cost - bank._moments.reference[field]
    weights = np.exp(log_weights - 0.5 * anchor * costs) * (log_weights > bank._rule.log_cut)
    sums: Vector = weights @ ring.products
    return sums


def _update(walk: Walk, controllers: LocalControllers, samples: int) -> Figures:
    """Fill the window, then update it: ms, and updates per second.

    At the median; at the fastest fifth, which other processes disturb less; and of CPU time.
    """
    controllers.refill(walk.samples[:samples])
    _ask(controllers, walk.samples[0])
    took, spent = [], []
    for sample in walk.samples[samples : samples + walk.updates]:
        began, before = time.perf_counter_ns(), time.thread_time_ns()
        controllers.add(sample)
        _ask(controllers, sample)
        spent.append(time.thread_time_ns() - before)
        took.append(time.perf_counter_ns() - began)
    return {
        "ms": percentiles(took, 1e-6),
        "hz": round(1e9 / float(np.median(took))),
        "hz_fastest_fifth": round(1e9 / float(np.percentile(took, 20))),
        "hz_of_cpu_time": round(1e9 / float(np.median(spent))),
    }


def _ask(controllers: LocalControllers, sample: MotionSample) -> InverseAnswer:
    return controllers.command(sample.delta_tip_mm, sample.tip_mm, sample.u)


def _command(walk: Walk, controllers: LocalControllers) -> Figures:
    """With everything solved."""
    controllers.solve()
    took = []
    for sample in walk.samples[:1000]:
        began = time.perf_counter_ns()
        _ask(controllers, sample)
        took.append(time.perf_counter_ns() - began)
    return percentiles(took, 1e-6)


def _error(walk: Walk, bank: BankControllers, exact: BatchControllers, samples: int) -> Figures:
    """Of the answer, relative to its length."""
    exact.refill(bank.window)
    errors = []
    for sample in walk.samples[samples + walk.updates : samples + walk.updates + walk.compared]:
        bank.add(sample)
        exact.add(sample)
        errors.append(_missed(_ask(bank, sample).delta_u, _ask(exact, sample).delta_u))
    return _spread(errors)


def _exact_answer(
    oracle: OracleControllers, fields: ReceptiveFields, query: MotionSample
) -> Vector:
    """Equation 5 over all fields with any share in it, each solved from all samples."""
    log_weights = fields.log_weights(query.tip_mm, query.u)
    regressors = oracle._regressors
    row = np.zeros(regressors.count)
    regressors.query(query.delta_tip_mm, query.tip_mm, query.u, row)
    answer, total = np.zeros(regressors.axes), 0.0
    for i in np.flatnonzero(log_weights > log_weights.max() + np.log(_ACTIVE)):
        solved = oracle.solve_field(int(i))
        if solved is not None:
            weight = float(np.exp(log_weights[i] - log_weights.max()))
            answer += weight * (row @ solved.beta)
            total += weight
    result: Vector = answer / total * regressors.axis_steps
    return result


def _literal_hz(walk: Walk, fields: ReceptiveFields, samples: int) -> float:
    """Algorithm 1, lines 6–12, with its n × n matrix W; from some fields."""
    window = walk.samples[:samples]
    x = np.array([np.r_[s.delta_tip_mm, s.tip_mm, s.u, 1.0] for s in window])
    y = np.array([s.delta_u for s in window])
    cost = np.sum(y**2, axis=1)
    weights = np.array([fields.weights(s.tip_mm, s.u) for s in window]).T
    took = []
    for w in weights[np.linspace(0, fields.count - 1, _LITERAL_FIELDS).astype(int)]:
        began = time.perf_counter()
        sigma_squared = np.sum(w * cost) / np.sum(w)
        reward = np.exp(-0.5 * sigma_squared * cost)
        weighting = np.diag(reward * w)
        gram = x.T @ weighting @ x
        np.linalg.solve(gram + 1e-9 * np.eye(len(gram)), x.T @ weighting @ y)
        took.append(time.perf_counter() - began)
    return 1.0 / (fields.count * float(np.median(took)))


def _thinned_fields(count: int, sharpness: float) -> ReceptiveFields:
    """Centres at every so manieth sample of an exploration."""
    explored = exploration(2 * count, seed=2)[::2]
    centres = np.array([np.r_[sample.tip_mm, sample.u] for sample in explored]) / SCALE
    metrics = np.tile(sharpness * np.eye(len(SCALE)), (count, 1, 1))
    return ReceptiveFields(centres, metrics, SCALE)


def _missed(answer: Vector, expected: Vector) -> float:
    return float(np.linalg.norm(answer - expected) / np.linalg.norm(expected))


def _largest(ours: Vector, theirs: Vector) -> float:
    return float(f"{np.abs(ours - theirs).max() / np.abs(theirs).max():.1e}")


def _spread(errors: list[float]) -> Figures:
    figures: dict[str, Callable[[list[float]], Any]] = {
        "median": np.median,
        "p99": lambda values: np.percentile(values, 99),
        "max": max,
    }
    return {name: float(f"{compute(errors):.1e}") for name, compute in figures.items()}


def plot(figures: Figures, path: Path) -> None:
    """Cost of an update against samples and fields."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, panels = plt.subplots(1, 2, figsize=(11, 4.5), sharey=True)
    views = (("samples", "by_samples_at_352_fields"), ("fields", "by_fields_at_550_samples"))
    names = {
        "literal_ms": "Algorithm 1 as printed",
        "exact_ms": "exact, all fields and samples",
        "bank_fine_ms": "bank, fine",
        "bank_fast_ms": "bank, fast",
    }
    for panel, (axis, table) in zip(panels, views, strict=True):
        for name, label in names.items():
            rows = figures["cost"][table]
            panel.loglog([r[axis] for r in rows], [r[name] for r in rows], "o-", label=label)
        panel.axhline(25.0, color="grey", linestyle=":", linewidth=1.0)
        panel.set_xlabel(axis)
        panel.set_title(table.replace("_", " "))
        panel.grid(visible=True, which="both", alpha=0.3)
    panels[0].set_ylabel("ms per update (dotted: a tracker's 40 Hz)")
    panels[0].legend()
    figure.tight_layout()
    figure.savefig(path, dpi=130)


if __name__ == "__main__":
    print(json.dumps(_measure(tiny="tiny" in sys.argv[1:])))
