"""How long concentric tubes take: their statics, the learnt model in a control step, their gate."""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from config.loader import load_robot
from config.tasks.controllers import LearnedKinematics, load_controller_options
from daemon.control import tip_following
from daemon.control.controller import Observation
from daemon.controllers.learned_kinematics import LearnedKinematicsController
from daemon.learning.forward.pose_model import PoseModel
from daemon.learning.lwpr.model import Lwpr, warm_up
from daemon.robot.coupled_axes import count_coupling
from drivers.axis_scale import axis_scale, count_limits
from safety.gate import Gate, Measured
from safety.risk_source import NoModel
from sim_backends.plants.concentric.concentric_tubes import statics_of
from sim_backends.plants.concentric.relative import RelativeTubes
from sim_backends.plants.concentric.statics import Setting, TubeStatics
from tests import SHIPPED_ROBOTS
from tests.benchmarks.timing import Figures, percentiles, pieces

CALLS = 4000
GRID = 80
"""Points along each of three numbers: what the shipped model is learnt from."""
FINE_MM = 0.5
"""Between nodes, of the solution that the others are held against."""
BATCH = 200
"""Places of one call, the first of them from a cold start: less than the call itself would cost."""
EPOCH = 435_200
"""Samples of the shipped model: 85 % of 80³."""
MODEL = SHIPPED_ROBOTS.parent / "models" / "concentric_tubes_pose.npz"


def measure(tiny: bool = False) -> Figures:
    """Microseconds per call with the cost of calling from Python, and an epoch's seconds."""
    warm_up()
    tip_following.warm_up()
    calls = 20 if tiny else CALLS
    model = PoseModel.load(MODEL)
    named: dict[str, Callable[[], Figures]] = {
        "statics_unloaded": partial(_unloaded, calls),
        "statics_loaded": partial(_loaded, calls // 4),
        "statics_grid": partial(_grid, 8 if tiny else GRID),
        "gate_decision": partial(_decisions, calls, coupled=True),
        "gate_decision_without_coupled_limits": partial(_decisions, calls, coupled=False),
        "predict": partial(_asked, model.lwpr.predict, calls),
        "slopes": partial(_asked, model.lwpr.slopes, calls),
        "epoch": partial(_epoch, model, 5 * calls),
    }
    for feedback in ("model", "tracker"):
        named[f"control_step_{feedback}"] = partial(_steps, calls, feedback=feedback)
    return pieces(named)


def _tubes() -> RelativeTubes:
    robot = load_robot(SHIPPED_ROBOTS / "concentric_tubes.yaml").robot
    return RelativeTubes(robot.emulation.plant, robot.axes, (0.0, 87.0))  # type: ignore[arg-type, union-attr]


def _statics(interval_mm: float | None = None, *, ideal: bool) -> TubeStatics:
    plant = load_robot(SHIPPED_ROBOTS / "concentric_tubes.yaml").robot.emulation.plant  # type: ignore[union-attr]
    found = statics_of(plant, ideal=ideal)  # type: ignore[arg-type]
    found.interval_mm = interval_mm or found.interval_mm
    return found


def _moving(count: int) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Rotations and collars of a motion: 1.5 mrad and 0.02 mm from one place to the next."""
    t = 1.5e-3 * np.arange(count)[:, None]
    swing = np.array([2.0, 2.0, 30.0]) * np.sin(t * [1.0, 0.7, 0.4])
    return _tubes().held(swing + np.array([0.0, 0.0, 55.0]))


def _unloaded(calls: int) -> Figures:
    """One equilibrium from the one before, unloaded, and what its tip is wrong by."""
    rotation, collar = _moving(BATCH * (calls // 10))
    statics = _statics(ideal=True)

    def batch(number: int) -> None:
        rows = slice(BATCH * number, BATCH * (number + 1))
        statics.tips(rotation[rows], collar[rows])

    times = np.array(_times(batch, calls // 10)) / BATCH
    tips, _ = statics.tips(rotation[::BATCH], collar[::BATCH])
    exact, _ = _statics(FINE_MM, ideal=True).tips(rotation[::BATCH], collar[::BATCH])
    off_um = 1e3 * np.linalg.norm(tips - exact, axis=1)
    return {"us": percentiles(list(times), 1e6), "tip_off_um": round(float(off_um.max()), 4)}


def _loaded(calls: int) -> Figures:
    """The same with weight, friction and 0.1 N at the tip, each followed on its branch."""
    rotation, collar = _moving(calls)
    statics = _statics(ideal=False)
    settings = [
        Setting(turned, pushed, np.array([0.0, -0.1, 0.0]))
        for turned, pushed in zip(rotation, collar, strict=True)
    ]
    none = statics.no_sliders()
    here = statics.at_rest(settings[0], none)

    def follow(number: int) -> None:
        nonlocal here
        assert here is not None
        followed = statics.follow(here, settings[number], none)
        assert followed is not None
        here = followed[0]

    return {"us": percentiles(_times(follow, calls), 1e6)}


def _grid(points: int) -> Figures:
    began, cpu = time.perf_counter(), time.thread_time()
    poses = _tubes().poses(points)
    return {
        "places": len(poses.tip_mm),
        "unsolved": int(np.isnan(poses.tip_mm[:, 0]).sum()),
        "s": round(time.perf_counter() - began, 2),
        "cpu_s": round(time.thread_time() - cpu, 2),
    }


def _decisions(calls: int, *, coupled: bool) -> Figures:
    """Of a gate without a risk model, on its way among its limits."""
    robot = load_robot(SHIPPED_ROBOTS / "concentric_tubes.yaml").robot
    scales = [axis_scale(axis).counts_per_unit for axis in robot.axes]
    limits = [count_limits(axis) for axis in robot.axes]
    coupling = count_coupling(robot) if coupled else ()
    gate = Gate(limits, scales, [None] * len(scales), NoModel(), 0.5, 0.02, coupling)
    t, middle = np.arange(calls)[:, None] / 80.0, np.array([0.0, 0.5, 1.0, 0.0, 0.0])
    u = middle + np.array([0.1, 0.1, 0.1, 1.0, 1.0]) * np.sin(t + np.arange(5))
    targets = (u * scales).tolist()
    at: list[int] = [round(target) for target in targets[0]]
    gate.settle(at)

    def decide(number: int) -> None:
        nonlocal at
        measured = Measured(at, [None] * len(at))
        decision = gate.decide(targets[number], measured, number * 25_000_000, 25_000_000)
        assert decision.step is not None and not decision.refused
        at = list(decision.step.to_counts)

    return {"us": percentiles(_times(decide, calls), 1e6)}


def _places(count: int) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    random = np.random.default_rng(1)
    return random.uniform([-np.pi, -np.pi, 20.0], [np.pi, np.pi, 87.0], (count, 3))


def _asked(ask: Callable[[Any], object], calls: int) -> Figures:
    places = _places(calls)
    return {"us": percentiles(_times(lambda i: ask(places[i]), calls), 1e6)}


def _epoch(model: PoseModel, samples: int) -> Figures:
    """By a part of it: what is learnt is what the model says already."""
    lwpr = Lwpr.from_arrays(model.lwpr.settings, model.lwpr.to_arrays())
    places = _places(samples)
    said = [lwpr.predict(place) for place in places]
    began = time.perf_counter()
    for place, row in zip(places, said, strict=True):
        lwpr.update(place, row)
    each_s = (time.perf_counter() - began) / samples
    return {"fields": lwpr.count, "update_us": 1e6 * each_s, "epoch_s": EPOCH * each_s}


def _steps(calls: int, **options: Any) -> Figures:
    """Observe with adaptation, and propose a step for position and direction."""
    asked = load_controller_options(
        {"kind": "learned_kinematics", "model": f"builtin:{MODEL.name}", **options}
    )
    assert isinstance(asked, LearnedKinematics)
    robot = load_robot(SHIPPED_ROBOTS / "concentric_tubes.yaml").robot
    controller = LearnedKinematicsController(asked, robot)
    start, way = np.array([0.0, 2.0, 1.2, 0.0, 0.0]), np.array([0.3, 0.5, -0.5, 1.0, 5.0])
    seen = []
    for share in np.linspace(0.0, 1.0, calls):
        u = start + share * way
        pose = controller.learnt.pose(u)
        tip, direction = pose.position_mm + 1.0, pose.direction
        seen.append(
            Observation(
                round(share * calls * 25e6), 0.025, u, u, tip, np.zeros(3), tip, np.ones(3),
                True, None, direction, direction, np.zeros(3),
            )
        )  # fmt: skip
    controller.reset(seen[0])

    def step(i: int) -> None:
        controller.observe(seen[i])
        controller.propose(seen[i])

    return {"us": percentiles(_times(step, calls), 1e6), "adapted": controller.adapted}


def _times(call: Callable[[int], object], calls: int) -> list[float]:
    call(0)
    times = []
    for number in range(calls):
        began = time.perf_counter()
        call(number)
        times.append(time.perf_counter() - began)
    return times
