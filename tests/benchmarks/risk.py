"""What the risk of one step costs.

The mixture network forward, beside torch; the bounds of body_point_risk over mesh size;
contact_risk of a thousand shapes; the whole gate, with the tendon arm in a chest, and what is
looked for after a step: the room that is left, and body_point_risk; how long surroundings take to
be made ready, once; and what a body costs that is not seen where its model has it.
"""

import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import yaml

from config.loader import load_robot
from daemon.control.avoidance import Avoidance
from daemon.host.clock import MonotonicClock
from daemon.risk.body_risk_source import BodyRiskSource, make_risk_source
from daemon.risk.mesh_file import write_mesh
from daemon.risk.model_file import read_model
from daemon.robot.axes import AxisRanges
from daemon.workbench.body_model.evaluation.shapes import CHEST_PORT, ball, chest
from drivers.axis_scale import axis_scale, count_limits
from safety.gate import Gate, Measured
from safety.risk.body_point import BodyPointRisk
from safety.risk.contact import ContactModel
from safety.risk.model.mixture import FloatArray, Mixture
from safety.risk.model.mixture_network import MixtureNetwork
from safety.risk.model.risk_model import RiskModel
from safety.risk.seen_tip import LEFT_OUT_SHARE, TipConditioning
from safety.risk.surroundings.distance_grid import DistanceGrid, distance_grid
from safety.risk.surroundings.environment import environment
from safety.risk.way_contact import WayContact
from tests import SOFT_ARM
from tests.benchmarks.timing import Figures, percentiles, pieces
from tests.safety.risk.arms import Pose, points_mixture, shape_mixture
from tests.safety.risk.networks import random_arrays

T = TypeVar("T")

TRIANGLES = (5_000, 50_000, 200_000)
"""Those of the targets."""
_SPACING_MM = 1.5
_STEP_NS = 25_000_000
_BENT_MM = np.array([2.5, 2.5, 2.5, 0.0])
_SOFT_BENT_MM = np.array([10.0, 25.0, 25.0, 25.0, 15.0, 15.0])
_AROUND_RAD = np.radians([0.0, 120.0, 240.0, 0.0])
"""Three straight tendons and a helical one, which is left alone."""
TENDON_ARM = SOFT_ARM.with_name("tendon_arm.yaml")
_POSES = [
    Pose(curvature, turn, spread=4e-4)
    for curvature in (0.002, 0.004, 0.006)
    for turn in np.radians((0.0, 72.0, 144.0, 216.0, 288.0))
]


_KNOWN_SPREAD = 5e-5
"""Of the curvature, per mm: the tip is known to some millimetres, as by a model given its tip."""


def measure(tiny: bool = False) -> Figures:
    """Microseconds for the network, milliseconds for the rest, by what is asked. Code is warm."""
    repeats, triangles = (1, (1000, 2000)) if tiny else (400, TRIANGLES)
    named: dict[str, Callable[[], Figures]] = {"network_us": partial(_network, 10 * repeats)}
    for count in triangles:
        named[f"body_point_ms_{count}_triangles"] = partial(_body_point, count, repeats)
    named["contact_ms"] = partial(_contact, triangles[1], 3.0 if tiny else _SPACING_MM, repeats)
    for count in triangles[:2]:
        named[f"gate_ms_{count}_triangles"] = partial(_gate, count, 5 * repeats)
    named["tip_seen_aside_ms"] = partial(_seen_aside, 5 * repeats)
    named["turned_aside_us"] = partial(_turned_aside, repeats)
    return pieces(named)


def _network(repeats: int) -> Figures:
    """Four inputs, three layers of 128, five components over three dimensions; and over eight."""
    figures: Figures = {}
    inputs = list(np.random.default_rng(0).uniform(-8.0, 8.0, (64, 4)))
    for activation in ("relu", "tanh", "silu"):
        network = MixtureNetwork(random_arrays(), activation)
        figures[f"forward_{activation}"] = _timed(network.mixture, inputs, repeats, 1e6)
    wide = MixtureNetwork(random_arrays(dimensions=8), "relu")
    figures["forward_relu_8_dimensions"] = _timed(wide.mixture, inputs, repeats, 1e6)
    slopes = np.ones(5), np.ones((5, 3)), np.ones((5, 3, 3))
    network = MixtureNetwork(random_arrays(), "relu")
    figures["gradient_relu"] = _timed(lambda u: network.gradient(u, *slopes), inputs, repeats, 1e6)
    figures["torch_eager_silu"] = _torch_eager(inputs, repeats)
    return figures


def _torch_eager(inputs: Sequence[FloatArray], repeats: int) -> Figures:
    """The same network as it is trained, one input at a time, on one thread."""
    import torch

    from daemon.workbench.body_model.training.network import (
        Beginning,
        MixtureDensityNetwork,
        NetworkShape,
        Scaling,
    )

    torch.set_num_threads(1)
    scaling = Scaling(np.zeros(4), np.ones(4), np.zeros(3), 40.0, (-2.0, 4.0), np.zeros(4))
    beginning = Beginning(np.zeros((5, 3)), np.tile(100.0 * np.eye(3), (5, 1, 1)))
    network = MixtureDensityNetwork(NetworkShape(5), scaling, beginning)
    with torch.inference_mode():
        return _timed(lambda u: network(scaling.inputs(u[None])), inputs, repeats, 1e6)


def _body_point(triangles: int, repeats: int) -> Figures:
    """Five components each, in a chest of so many triangles."""
    mesh = chest(triangles, seed=0)
    environment(*mesh)
    started = time.perf_counter()
    risk = BodyPointRisk(environment(*mesh))
    ready_s = time.perf_counter() - started
    mixtures = [points_mixture(pose) for pose in _POSES]
    values = [risk.near_exact(mixture).value for mixture in mixtures]
    bounds = [risk.bounds(mixture) for mixture in mixtures]
    ratio = [one.printed / value for one, value in zip(bounds, values, strict=True)]
    tighter = [(one.certified or 1.0) / value for one, value in zip(bounds, values, strict=True)]
    return {
        "printed_bound": _timed(risk.printed, mixtures, repeats, 1e3),
        "both_bounds": _timed(risk.bounds, mixtures, repeats, 1e3),
        "near_exact_with_derivatives": _timed(risk.near_exact, mixtures, repeats, 1e3),
        "made_ready_s": round(ready_s, 3),
        "median_value": round(float(np.median(values)), 5),
        "printed_over_value": round(float(np.median(ratio)), 2),
        "certified_over_value": round(float(np.median(tighter)), 2),
    }


def _contact(triangles: int, spacing_mm: float, repeats: int) -> Figures:
    """A thousand shapes of 41 nodes and 8 coefficients, in the chest of the middle size."""
    mesh = environment(*chest(triangles, seed=0), port=CHEST_PORT)
    started = time.perf_counter()
    grid = distance_grid(mesh, spacing_mm)
    ready_s = time.perf_counter() - started
    poses = [shape_mixture(pose) for pose in _POSES]
    model = ContactModel(poses[0][0], grid, CHEST_PORT)
    mixtures = [mixture for _, mixture in poses]
    steps = [step for mixture in mixtures for step in _walk(mixture)]
    risks = [model.risk(mixture).probability for mixture in mixtures]
    return {
        "at_rest": _timed(model.risk, mixtures, repeats, 1e3),
        "along_one_step": _timed(model.along, steps, repeats, 1e3),
        **_far(grid, repeats),
        "grid_made_s": round(ready_s, 3),
        "grid_places": int(grid.values_mm.size),
        "lowest_and_highest_risk": [min(risks), max(risks)],
    }


def _far(grid: DistanceGrid, repeats: int) -> Figures:
    """The same where it is known better how much the body bends, so that it is far from all."""
    poses = [shape_mixture(replace(pose, spread=_KNOWN_SPREAD)) for pose in _POSES]
    contact = WayContact(poses[0][0], grid, CHEST_PORT, 1000, 0)
    steps = [step for _, mixture in poses for step in _walk(mixture)]
    far = [step for step in steps if contact.all_draws.is_far(step)]
    return {
        "far_along_one_step": _timed(contact.along, far, repeats, 1e3),
        "far_along_one_step_by_all_draws": _timed(contact.all_draws.along, far, repeats, 1e3),
        "far_steps": [len(far), len(steps)],
    }


def _gate(triangles: int, repeats: int) -> Figures:
    """The tendon arm, bent, turns round in a chest."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_mesh(folder / "chest.stl", chest(triangles, seed=0))
        robot = yaml.safe_load(TENDON_ARM.read_text())
        robot["risk"] = {
            "model": "builtin:tendon_arm.npz",
            "surface": {"mesh": "chest.stl", "free": "inside", "port": _port()},
        }
        (folder / "robot.yaml").write_text(yaml.safe_dump(robot))
        file = load_robot(folder / "robot.yaml")
        source = make_risk_source(file, MonotonicClock())
    axes, risk = file.robot.axes, file.robot.risk
    scales = [axis_scale(axis).counts_per_unit for axis in axes]
    tensions = [axis.tension_range_n for axis in axes]
    limits = [count_limits(axis) for axis in axes]
    gate = Gate(limits, scales, tensions, source, risk.threshold, risk.latest_after_s)
    at, t_ns, durations, refused = [0] * len(axes), 0, [], 0
    looking = []
    gate.settle(at)
    for number in range(repeats):
        t_ns += _STEP_NS
        u = _BENT_MM * np.cos(number / 150.0 - _AROUND_RAD)
        targets = [wanted * scale for wanted, scale in zip(u, scales, strict=True)]
        measured = Measured(at, [2.0] * len(axes))
        started = time.perf_counter()
        decision = gate.decide(targets, measured, t_ns, _STEP_NS)
        durations.append(time.perf_counter() - started)
        refused += bool(decision.refused)
        if decision.step is not None:
            at = list(decision.step.to_counts)
        started = time.perf_counter()
        source.clearance([count / scale for count, scale in zip(at, scales, strict=True)], 0.05)
        looking.append(time.perf_counter() - started)
    return {
        **percentiles(durations, 1e3),
        "refused": refused,
        "looking_round_after_it": percentiles(looking, 1e3),
    }


def _seen_aside(repeats: int) -> Figures:
    """The soft arm beside a ball, its tip seen 4 mm from the mean: of a load that is not declared.

    The gate then sweeps the shapes given that tip as well.
    """
    source, tips, outwards = _beside_a_ball()
    looking: list[float] = []
    decided: Counter[str] = Counter()
    asking: dict[bool, list[float]] = {True: [], False: []}
    risks: dict[bool, list[float]] = {True: [], False: []}
    places = [_SOFT_BENT_MM + np.cos(number / 40.0) for number in range(repeats)]
    for seen in (False, True):
        for number, (before, u) in enumerate(pairwise(places)):
            if seen:
                lately = [u, *[places[max(0, number - lag)] for lag in (4, 8, 12)]]
                started = time.perf_counter()
                source.compare(lately, (tips(u) + 4.0 * outwards).tolist(), number * _STEP_NS)
                looking.append(time.perf_counter() - started)
            started = time.perf_counter()
            reading = source.assess(before.tolist(), u.tolist(), number * _STEP_NS)
            asking[seen].append(time.perf_counter() - started)
            risks[seen].append(1.0 if reading is None else reading.contact_risk)
            if seen and reading is not None and reading.answers is not None:
                decided[reading.answers.decided_by] += 1
    return {
        "given_the_tip_alone": _given_the_tip(source, places, tips, outwards),
        "decided_by": dict(decided),
        "comparison_of_a_frame": percentiles(looking, 1e3),
        "risk_of_a_step_nothing_seen": percentiles(asking[False], 1e3),
        "risk_of_a_step_as_seen_too": percentiles(asking[True], 1e3),
        "highest_risk": [max(risks[False]), max(risks[True])],
    }


def _given_the_tip(
    source: BodyRiskSource,
    places: Sequence[FloatArray],
    tips: Callable[[FloatArray], FloatArray],
    outwards: FloatArray,
) -> Figures:
    """A thousand shapes that agree with the tip, at rest: made from the model's, and measured."""
    model, grid = source.body_risk.model, source.body_risk.grid
    given = TipConditioning(model.basis, 1.0, 0.05)
    contact = ContactModel(model.basis.leaving_out(LEFT_OUT_SHARE), grid, None, 1000)
    conditioning, all_of_it = [], []
    for before, u in pairwise(places):
        mixture, there = model.shapes.mixture(before), model.shapes.mixture(u)
        assert mixture is not None
        assert there is not None
        seen = given.seen(mixture, tips(before) + 4.0 * outwards, None)
        started = time.perf_counter()
        found = given.there(seen, there)
        conditioning.append(time.perf_counter() - started)
        assert found is not None
        contact.risk(found)
        all_of_it.append(time.perf_counter() - started)
    return {
        "conditioning": percentiles(conditioning, 1e3),
        "with_1000_shapes": percentiles(all_of_it, 1e3),
    }


def _beside_a_ball() -> tuple[BodyRiskSource, Callable[[FloatArray], FloatArray], FloatArray]:
    """What is asked, where the tip is, and the direction from it to the ball."""
    bent = _SOFT_BENT_MM
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        model = read_model(SOFT_ARM.parents[1] / "models" / "soft_arm.npz").model
        tips = partial(_tip_of, model)
        outwards = tips(bent) * np.array([1.0, 1.0, 0.0])
        outwards /= np.linalg.norm(outwards)
        write_mesh(folder / "ball.stl", ball(20.0, (tips(bent) + 44.0 * outwards).tolist(), 600))
        robot = yaml.safe_load(SOFT_ARM.read_text())
        robot["risk"] = {
            "model": "builtin:soft_arm.npz",
            "surface": {"mesh": "ball.stl", "free": "outside"},
        }
        (folder / "robot.yaml").write_text(yaml.safe_dump(robot))
        source = make_risk_source(load_robot(folder / "robot.yaml"), MonotonicClock())
    assert isinstance(source, BodyRiskSource)
    return source, tips, outwards


def _turned_aside(repeats: int) -> Figures:
    """The same arm beside the ball: what a control step pays for being led along it."""
    source, _, outwards = _beside_a_ball()
    robot = load_robot(SOFT_ARM).robot
    avoidance = Avoidance(AxisRanges.of(robot))
    avoidance.warm_up()
    looking, stepping, turned = [], [], 0
    for number in range(repeats):
        u = _SOFT_BENT_MM + np.cos(number / 40.0)
        started = time.perf_counter()
        clearance = source.clearance(u.tolist(), 0.001)
        looking.append(time.perf_counter() - started)
        if clearance is None or not clearance.parts:
            continue
        step, *_ = np.linalg.lstsq(np.array(clearance.tip_slope)[:3], outwards)
        avoidance.prepare(clearance)  # in spare time
        started = time.perf_counter()
        aside = avoidance.aside(step, u, clearance, _STEP_NS * 1e-9)
        stepping.append(time.perf_counter() - started)
        turned += aside is not None
    return {
        "a_step": percentiles(stepping, 1e6),
        "clearance_of_six_parts_and_the_whole": percentiles(looking, 1e6),
        "steps": len(stepping),
        "turned": turned,
    }


def _tip_of(model: RiskModel, u: FloatArray) -> FloatArray:
    mixture = model.shapes.mixture(u)
    assert mixture is not None
    mean = mixture.weights @ mixture.means_mm @ model.basis.modes[:, -1]
    return np.asarray(model.basis.base_mm[-1] + mean, np.float64)


def _port() -> dict[str, Any]:
    port = CHEST_PORT
    return {
        "centre_mm": list(port.centre_mm),
        "inwards": list(port.inwards),
        "radius_mm": port.radius_mm,
        "depth_mm": port.depth_mm,
    }


def _walk(mixture: Mixture) -> list[tuple[Mixture, Mixture]]:
    """Ten steps that move the tip by a millimetre each; each begins where the last one ended."""
    means, factors = mixture.means_mm, mixture.factors_per_mm
    ways = [Mixture(mixture.weights, means + 0.2 * step, factors) for step in range(11)]
    return list(pairwise(ways))


def _timed(
    function: Callable[[T], object], arguments: Sequence[T], repeats: int, scale: float
) -> Figures:
    """Over all arguments in turn."""
    for argument in arguments:
        function(argument)
    durations = []
    for number in range(repeats):
        argument = arguments[number % len(arguments)]
        started = time.perf_counter()
        function(argument)
        durations.append(time.perf_counter() - started)
    return percentiles(durations, scale)


def plot(figures: Figures, path: Path) -> None:
    """Cost of the bounds over the size of the mesh."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, panel = plt.subplots(figsize=(6, 4.5))
    names = {
        "printed_bound": "bound as printed",
        "both_bounds": "printed and certified",
        "near_exact_with_derivatives": "near-exact, with derivatives",
    }
    for name, label in names.items():
        costs = [figures[f"body_point_ms_{n}_triangles"][name]["median"] for n in TRIANGLES]
        panel.loglog(TRIANGLES, costs, "o-", label=label)
    panel.set_xlabel("triangles")
    panel.set_ylabel("ms, median")
    panel.grid(visible=True, which="both", alpha=0.3)
    panel.legend()
    figure.tight_layout()
    figure.savefig(path, dpi=130)
