"""How good a forward model an exploration makes: `python -m tests.experiments.forward_models`.

The arm's physics, the tracker's noise and the pose filter, frame by frame, without devices. What is
measured: the error of Δp on lines that were kept back, and the error of one step of the tip when
the model's slopes are inverted (damped least squares) and the arm is asked what such a step does.
Medians over arms at rest all over the workspace; means over seeds.
"""

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from config.tasks.exploration import WaypointExploration
from daemon.control.redundancy import damped_solution
from daemon.controllers.exploration.waypoint_exploration import WaypointExplorationController
from daemon.learning.forward.forward_model import slopes_by_step
from daemon.learning.forward.pretraining import Pretraining, PretrainingSettings, pretrain
from daemon.learning.lwpr.model import Lwpr
from daemon.learning.samples.dataset import Dataset, Frames
from daemon.learning.samples.motion_samples import SamplingSettings
from drivers.pose import Vector
from sim_backends.plants.plant import TipLoad
from tests.daemon.control.closed_loop import DT_S, ROBOT, ClosedLoop, soft_arm

_SEEDS = (1, 2, 3)
_STEP_MM = 1.0
_DAMPING_MM = 8.0
_RAMP_FRAMES, _SETTLING_FRAMES = 12, 8
_PLACES = 100
_LONGEST_SHARE = 0.1
_INNER_MM = 60.0
_TRAVEL = np.full(6, 50.0)

_BASE = PretrainingSettings()


@dataclass(frozen=True)
class Variant:
    """One row of the table."""

    name: str
    waypoints: int = 80
    exploration: tuple[tuple[str, Any], ...] = ()
    settings: PretrainingSettings = _BASE


def _sampled(tip_mm: float, **more: float) -> PretrainingSettings:
    return replace(_BASE, sampling=SamplingSettings(tip_mm=tip_mm, travel_share=0.1, **more))


VARIANTS = (
    Variant("80 waypoints"),
    Variant("  all of it learnt", settings=replace(_BASE, test_share=0.0)),
    Variant("  no dither", exploration=(("dither_share", 0.0),)),
    Variant("  dither 0.01", exploration=(("dither_share", 0.01),)),
    Variant("  dither 0.05", exploration=(("dither_share", 0.05),)),
    Variant("  dither of 4 s", exploration=(("dither_period_s", 4.0),)),
    Variant("  motions of 0.63 mm", settings=_sampled(0.63)),
    Variant("  motions of 2 mm", settings=_sampled(2.0)),
    Variant("  motions of 4 mm", settings=_sampled(4.0)),
    Variant("  single frames", settings=_sampled(1.0, averaged_share=0.0)),
    Variant("  lag not minded", settings=replace(_BASE, lag_s=0.0)),
    Variant("  25 fields", settings=replace(_BASE, fields=25)),
    Variant("  139 fields", settings=replace(_BASE, fields=139)),
    Variant("320 waypoints", waypoints=320),
    Variant("  352 fields", waypoints=320, settings=replace(_BASE, fields=352)),
)


class Arms:
    """The arm at rest at many places, each ready to be asked what a step does there."""

    def __init__(self) -> None:
        random = np.random.default_rng(777)
        self._places: list[tuple[Vector, Vector, Vector]] = []
        while len(self._places) < _PLACES:
            u = random.uniform(0.0, 50.0, 6)
            tip = self._after(u, np.zeros(6))
            if np.abs(tip[:2]).max() < _INNER_MM and tip[2] > 155.0:
                way = random.normal(size=3)
                self._places.append((u, tip, _STEP_MM * way / np.linalg.norm(way)))

    def errors(self, model: Lwpr) -> Vector:
        """(n,) of a step, as a share of it."""
        return np.array([self._error(model, *place) for place in self._places])

    def _error(self, model: Lwpr, u: Vector, tip: Vector, wanted: Vector) -> float:
        by_travel = slopes_by_step(model, tip, u) * _TRAVEL
        step = damped_solution(by_travel, wanted, _DAMPING_MM)
        step *= min(1.0, _LONGEST_SHARE / max(float(np.abs(step).max()), 1e-12)) * _TRAVEL
        got = self._after(u, step) - self._after(u, np.zeros(6))
        return float(np.linalg.norm(got - wanted)) / _STEP_MM

    @staticmethod
    def _after(u: Vector, step: Vector) -> Vector:
        """(3,) tip: brought to u, at rest there, and then moved by a step."""
        arm, load = soft_arm(), TipLoad()
        for share in np.linspace(0.1, 1.0, 10):
            arm.step(share * u, load, 0.2)
        arm.step(u, load, 2.0)
        for frame in range(_RAMP_FRAMES + _SETTLING_FRAMES):
            moved = u + min(1.0, (frame + 1) / _RAMP_FRAMES) * step
            body = arm.step(np.clip(moved, 0.0, 50.0), load, DT_S)
        return body.tip.position_mm


def explored(waypoints: int, seed: int, exploration: dict[str, Any]) -> Dataset:
    """What the controller sees of one exploration."""
    options = WaypointExploration(kind="waypoint_exploration", waypoints=waypoints, **exploration)
    control = WaypointExplorationController(options, ROBOT, seed)
    loop = ClosedLoop(control, seed=seed)
    loop.start()
    rows, lines, numbers = [], [], dict[str, int]()
    while not control.ready:
        lines.append(numbers.setdefault(control.note, len(numbers)))
        loop.step(loop.tip_mm, np.zeros(3))
        rows.append(np.concatenate([[loop.t_ns], loop.tip_mm, loop.u]))
    table = np.array(rows)
    frames = Frames(
        table[:, 0].astype(np.int64), table[:, 1:4], table[:, 4:], np.array(lines, np.int64)
    )
    return Dataset.of(frames, ROBOT, {"seed": seed})


def _row(variant: Variant, learnt: list[tuple[Dataset, Pretraining, Vector]]) -> str:
    def mean(values: Iterator[float]) -> float:
        return float(np.mean(list(values)))

    best = [one.errors[one.best_epoch - 1] for _, one, _ in learnt]
    return (
        f"{variant.name:24}"
        f"{mean(data.frames.duration_s for data, _, _ in learnt):7.0f}"
        f"{mean(float(len(one.motions)) for _, one, _ in learnt):9.0f}"
        f"{mean(float(one.model.count) for _, one, _ in learnt):8.0f}"
        f"{mean(float(one.motions.delta_tip_mm.std()) for _, one, _ in learnt):8.2f}"
        f"{mean(one.train_mm for one in best):9.3f}"
        f"{mean(one.test_mm for one in best):8.3f}"
        f"{mean(float(np.median(errors)) for _, _, errors in learnt):8.2f}"
        f"{mean(float(errors.mean()) for _, _, errors in learnt):8.2f}"
    )


def main() -> None:
    """Print the table, row by row."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", metavar="TEXT", help="variants whose name has this in it")
    only = parser.parse_args().only or ""
    arms, seen = Arms(), dict[object, Dataset]()
    print(f"{'':24}{'s':>7}{'motions':>9}{'fields':>8}{'sd Δp':>8}", end="")
    print(f"{'learnt':>9}{'kept':>8}{'step':>8}{'mean':>8}")
    for variant in VARIANTS:
        if only not in variant.name:
            continue
        learnt = []
        for seed in _SEEDS:
            key = (variant.waypoints, variant.exploration, seed)
            if key not in seen:
                seen[key] = explored(variant.waypoints, seed, dict(variant.exploration))
            one = pretrain(seen[key], variant.settings)
            learnt.append((seen[key], one, arms.errors(one.model)))
        print(_row(variant, learnt), flush=True)


if __name__ == "__main__":
    main()
