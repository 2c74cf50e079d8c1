"""The arm's compiled step against the general solver: the same bits, and the same refusals."""

from typing import Any

import numpy as np
import pytest

from config.emulation.plants import SoftArmPlant
from sim_backends.plants.plant import FloatArray, PlantError, TipLoad, variation
from sim_backends.plants.rod_kernels import Settled, settle_chambers
from sim_backends.plants.shooting import Solver
from sim_backends.plants.soft_arm.chambers import ChamberSolver
from sim_backends.plants.soft_arm.soft_arm import TOLERANCE, SoftArm

PAPER = SoftArmPlant(kind="soft_arm")
STEPS = 120


def arms(plant: SoftArmPlant) -> tuple[SoftArm, SoftArm]:
    """Twice the same arm; the second one has the general solver."""
    quick, general = SoftArm(plant, [490.87] * 6), SoftArm(plant, [490.87] * 6)
    assert isinstance(quick._solver, ChamberSolver)
    general._solver = Solver(general._rod, TOLERANCE)
    return quick, general


def motion(seed: int, leap_mm: float) -> list[tuple[FloatArray, TipLoad]]:
    """Places of the pistons and loads; now and then both leap."""
    generator = np.random.default_rng(seed)
    place, load, way = np.zeros(6), TipLoad(), np.zeros(6)
    steps = []
    for number in range(STEPS):
        if number % 15 == 0:
            way = generator.normal(scale=0.2, size=6)
        leap = generator.normal(scale=leap_mm, size=6) if number % 40 == 39 else 0.0
        if number % 40 == 20:
            load = TipLoad(float(generator.uniform(0.0, 60.0)))
        place = np.clip(place + way + leap, -5.0, 45.0)
        steps.append((place, load))
    return steps


def outcome(arm: SoftArm, place: FloatArray, load: TipLoad) -> tuple[bytes, ...] | str:
    try:
        state = arm.step(place, load, 0.025)
    except PlantError as error:
        return str(error)
    told = (state.centreline_mm, state.tip.quaternion, state.actuator_forces)
    return (*(array.tobytes() for array in told), arm.chamber_pressure_mpa.tobytes())


@pytest.mark.parametrize("leap_mm", [0.0, 3.0, 20.0])
@pytest.mark.parametrize("seed", range(3))
def test_every_step_comes_out_as_with_the_general_solver(seed: int, leap_mm: float) -> None:
    quick, general = arms(PAPER if seed == 0 else variation(PAPER, seed))
    for place, load in motion(seed, leap_mm):
        assert outcome(quick, place, load) == outcome(general, place, load)


def test_an_ordinary_motion_needs_no_more_than_the_compiled_step(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    quick, _ = arms(PAPER)

    def unwanted(*_: object) -> None:
        raise AssertionError("the general solver was asked")

    monkeypatch.setattr(Solver, "_guess", unwanted)
    for number in range(STEPS):
        quick.step(
            5.0 * np.sin(0.02 * number + np.arange(6)) - 5.0 * np.sin(np.arange(6)),
            TipLoad(20.0 if number > 60 else 19.0),
            0.025,
        )


def test_what_the_compiled_step_cannot_do_the_general_solver_does(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    quick, general = arms(PAPER)
    converged = []

    def counted(*arguments: Any) -> Settled:
        settled: Settled = settle_chambers(*arguments)
        converged.append(settled.converged)
        return settled

    monkeypatch.setattr("sim_backends.plants.soft_arm.chambers.settle_chambers", counted)
    far = np.array([40.0, -10.0, -10.0, -10.0, 40.0, 0.0])
    assert outcome(quick, far, TipLoad(50.0)) == outcome(general, far, TipLoad(50.0))
    assert converged[0] is False


def test_no_number_of_iterations_hides_a_load_that_no_arm_bears(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Both give up sooner: how small the last steps are makes no load bearable that is none.
    monkeypatch.setattr("sim_backends.plants.shooting._SMALLEST_STEP", 1.0 / 32.0)
    quick, general = arms(PAPER)
    heavy = TipLoad(5000.0)
    told = outcome(quick, np.zeros(6), heavy)
    assert isinstance(told, str)
    assert told == outcome(general, np.zeros(6), heavy)
    assert outcome(quick, np.zeros(6), TipLoad()) == outcome(general, np.zeros(6), TipLoad())
