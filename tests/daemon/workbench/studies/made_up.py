"""Studies and outcomes that were never run."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from daemon.learning.forward.forward_fit import ForwardFit
from daemon.recording.result import ComputingTime, CycleError, Result, TrackerLimits
from daemon.workbench.experiments.carry_out import STEPS_FILE
from daemon.workbench.experiments.step_statistics import StepSeries
from daemon.workbench.studies.run import Outcome, run_folder

EXPERIMENT = """
experiment: {name}
robot: builtin:soft_arm
trajectory: {{kind: rectangle, center_mm: [0, 0, 185], width_mm: 20, height_mm: 12,
  cycle_s: {cycle_s}, cycles: {cycles}}}
controller: {{kind: broyden, gain_per_s: 2.5}}
tip_load_g: {load_g}
"""

STUDY = """
study: small
description: Small rectangles
source: Somebody 2018
seeds: 2
plants: 1
tables:
  - title: Table 1
    rows:
      - experiment: calm.yaml
        label: no load
      - experiment: loaded.yaml
        label: a load
        published: {mean_mm: [4.56, 5.5], std_mm: [1.99, 1.12], max_mm: [9.02, null]}
        aim_mm: [null, 1.0]
        first_no_worse_than: calm
figures:
  - {figure: figure7, title: Both, experiments: [calm, loaded]}
variants:
  - {variant: broyden, label: measured Jacobian}
  - {variant: arcs, label: arcs, controller: {kind: constant_curvature}}
"""


def write_study(folder: Path, text: str = STUDY, cycle_s: float = 10.0) -> Path:
    """A study file with its experiments beside it."""
    folder.mkdir(exist_ok=True)
    for name, load_g in (("calm", 0.0), ("loaded", 14.2)):
        experiment = EXPERIMENT.format(name=name, cycle_s=cycle_s, cycles=2, load_g=load_g)
        (folder / f"{name}.yaml").write_text(experiment)
    (folder / "study.yaml").write_text(text)
    return folder / "study.yaml"


def cycle_error(cycle: int, mean_mm: float) -> CycleError:
    return CycleError(
        cycle=cycle, samples=400, mean_mm=mean_mm, std_mm=mean_mm / 2, max_mm=3 * mean_mm
    )


def outcome(
    means_mm: Sequence[float],
    seed: int = 1,
    experiment: str = "loaded",
    variant: str = "broyden",
    failure: str = "",
    holds: int = 0,
    settled_s: float | None = None,
) -> Outcome:
    """A run with these mean errors; the truth is 0.1 mm worse, and readings 0.2 mm."""
    rows = [cycle_error(number, mean_mm) for number, mean_mm in enumerate(means_mm)]
    result = Result(
        robot="soft_arm",
        simulated=True,
        trajectory="rectangle",
        controller=variant,
        seed=seed,
        duration_s=20.0,
        cycles=rows,
        steps=800,
        holds=holds,
        refusals=seed,
        faults=["tracker_late"] if holds else [],
        reading_cycles=[cycle_error(row.cycle, row.mean_mm + 0.2) for row in rows],
        true_cycles=[cycle_error(row.cycle, row.mean_mm + 0.1) for row in rows],
        drifts=[0.01 * (row.cycle + 1) for row in rows],
        converged_s=settled_s,
        limits=TrackerLimits(noise_mm=0.12, reading_noise_mm=0.34, distortion_mm=0.56),
        computing=ComputingTime(steps=800, median_ms=0.2, p99_ms=0.4, max_ms=2, idle_mean_ms=0.1),
    )
    return Outcome(
        experiment=experiment,
        variant=variant,
        plant=1,
        seed=seed,
        fingerprint="",
        failure=failure,
        result=result,
        fit=ForwardFit(
            motions=600,
            kept_back=True,
            rmse_mm=0.84,
            spread_mm=1.19,
            r2=0.1 * seed,
            field_r2=[0.0, 0.3, 0.6],
        )
        if variant == "broyden"
        else None,
        commit="abc",
    )


def leave_steps(root: Path, of: Outcome, error_mm: float = 1.0) -> None:
    """What the run would have left for pictures: two rounds of a rectangle of 20 mm x 12 mm."""
    steps = np.arange(0.0, 20.0, 0.05)
    corners = np.array([[-10, -6], [10, -6], [10, 6], [-10, 6], [-10, -6]])
    passed = np.array([0.0, 20.0, 32.0, 52.0, 64.0]) / 64.0 * 10.0
    at = np.stack([np.interp(steps % 10.0, passed, side) for side in corners.T], axis=1)
    reference = np.column_stack([at, np.full(len(steps), 185.0)])
    random = np.random.default_rng(of.seed)
    tip = reference + error_mm * random.normal(size=reference.shape)
    folder = run_folder(root, of.experiment, of.variant, of.plant, of.seed)
    folder.mkdir(parents=True)
    StepSeries(
        t_s=steps,
        clock_s=steps,
        cycle=np.floor(steps / 10.0),
        reference_mm=reference,
        tip_mm=tip,
        reading_mm=tip,
        true_mm=reference,
        u=np.zeros((len(steps), 6)),
    ).save(folder / STEPS_FILE)
