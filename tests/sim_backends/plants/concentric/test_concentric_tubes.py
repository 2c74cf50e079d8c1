"""The plant of concentric tubes: what axes do to it, and what it remembers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from config.emulation.plants import ConcentricTubesPlant
from drivers.pose import conjugate, multiply, rotate
from sim_backends.plants.concentric.concentric_tubes import ConcentricTubes, variation
from sim_backends.plants.concentric.statics_kernels import FloatArray
from sim_backends.plants.plant import BodyState, PlantError, TipLoad
from tests.sim_backends.plants.concentric.tube_sets import plant_config, tube

DT_S = 0.025
FREE = TipLoad()


def u(*values: float) -> FloatArray:
    """Three rotations in rad, the pair's carriage and the inner one's in mm."""
    return np.array(values, dtype=np.float64)


def go(plant: ConcentricTubes, to: FloatArray, load: TipLoad = FREE, steps: int = 40) -> BodyState:
    """From where it was last sent to, in even steps."""
    start = getattr(plant, "sent", np.zeros(plant.actuator_count))
    for share in np.linspace(0.0, 1.0, steps + 1)[1:]:
        state = plant.step(start + share * (to - start), load, DT_S)
    plant.sent = to  # type: ignore[attr-defined]
    return state


def weightless(**options: object) -> ConcentricTubesPlant:
    config = plant_config(**options)
    tubes = tuple(one.model_copy(update={"mass_mg_mm": 0.0}) for one in config.tubes)
    return config.model_copy(update={"tubes": tubes})


def test_at_zero_all_tubes_bend_towards_x() -> None:
    state = ConcentricTubes(weightless()).step(u(0, 0, 0, 0, 40), FREE, DT_S)
    x, y, z = state.tip.position_mm
    assert x > 50.0
    assert abs(y) < 1e-9
    assert 100.0 < z < 190.0
    tangent = rotate(state.tip.quaternion, np.array([0.0, 0.0, 1.0]))
    assert tangent[0] > 0.8
    np.testing.assert_allclose(
        rotate(state.tip.quaternion, np.array([0.0, 1.0, 0.0])), [0.0, 1.0, 0.0], atol=1e-9
    )
    np.testing.assert_allclose(state.centreline_mm[-1], state.tip.position_mm)
    np.testing.assert_allclose(state.centreline_mm[0], 0.0)
    assert state.radius_mm == 1.4


def test_the_pairs_carriage_carries_the_body_forward() -> None:
    plant = ConcentricTubes(weightless(friction_nmm=0.0))
    before = go(plant, u(0.3, 1.0, -0.5, 0.0, 40.0))
    after = go(plant, u(0.3, 1.0, -0.5, 12.0, 52.0))
    np.testing.assert_allclose(
        after.centreline_mm - before.centreline_mm, np.tile([0.0, 0.0, 12.0], (len(after[0]), 1))
    )


def test_in_front_of_a_plate_every_tube_is_pushed_out_of_it() -> None:
    config = ConcentricTubesPlant(
        kind="concentric_tubes",
        mouth="plate",
        tubes=(tube(120.0, 2e-3, collar_mm=-60.0, carriage=0, outer_radius_mm=2.0),),
    )
    plant = ConcentricTubes(config)
    assert plant.actuator_count == 2
    for pushed in (0.0, 40.0):
        state = plant.step(np.array([0.0, pushed]), FREE, DT_S)
        length = np.linalg.norm(np.diff(state.centreline_mm, axis=0), axis=1).sum()
        assert length == pytest.approx(60.0 + pushed, abs=0.01)


@settings(max_examples=20, deadline=None)
@given(
    start=st.tuples(*[st.floats(-3, 3)] * 3, st.floats(0, 20), st.floats(45, 80)),
    turns=st.tuples(*[st.integers(-1, 1)] * 3),
)
def test_a_whole_turn_of_any_tube_changes_nothing_but_its_count(
    start: tuple[float, ...], turns: tuple[int, ...]
) -> None:
    """Positions are not wrapped anywhere; only where tubes are is the same again. Far enough out
    that no tube snaps."""
    plant = ConcentricTubes(plant_config(friction_nmm=0.0))
    before = go(plant, u(*start), steps=20)
    whole = np.array([*turns, 0.0, 0.0]) * 2.0 * np.pi
    after = go(plant, u(*start) + whole, steps=60)
    np.testing.assert_allclose(after.tip.position_mm, before.tip.position_mm, atol=1e-5)
    np.testing.assert_allclose(after.actuator_forces, before.actuator_forces, atol=1e-4)
    assert after.snaps == 0


def test_the_tip_turns_with_the_innermost_tube() -> None:
    """A tube that is straight within straight tubes turns its sensor and nothing else."""
    config = ConcentricTubesPlant(
        kind="concentric_tubes",
        friction_nmm=0.0,
        tubes=(
            tube(100.0, 0.0, outer_radius_mm=2.0),
            tube(150.0, 0.0, collar_mm=-10.0, carriage=1, outer_radius_mm=1.0),
        ),
    )
    plant = ConcentricTubes(config)
    before = plant.step(np.array([0.0, 0.0, 0.0, 0.0]), FREE, DT_S)
    after = plant.step(np.array([0.0, 0.8, 0.0, 0.0]), FREE, DT_S)
    between = multiply(conjugate(before.tip.quaternion), after.tip.quaternion)
    np.testing.assert_allclose(between, [np.cos(0.4), 0.0, 0.0, np.sin(0.4)], atol=1e-9)
    np.testing.assert_allclose(after.tip.position_mm, before.tip.position_mm, atol=1e-9)


def test_weight_and_loads_move_the_tip_as_much_as_in_the_lab() -> None:
    """0.08 to 0.2 mm by its own weight, some 2 mm by a touch of 0.1 N."""
    here = u(0.4, 1.2, -0.6, 0.0, 45.0)
    light = go(ConcentricTubes(weightless(friction_nmm=0.0)), here).tip.position_mm
    plant = ConcentricTubes(plant_config(friction_nmm=0.0))
    heavy = go(plant, here).tip.position_mm
    assert 0.05 < np.linalg.norm(heavy - light) < 0.3
    touched = plant.step(here, TipLoad(force_n=(0.0, 0.1, 0.0)), DT_S).tip.position_mm
    assert 0.5 < touched[1] - heavy[1] < 5.0
    hung = plant.step(here, TipLoad(mass_g=5.0), DT_S).tip.position_mm
    assert hung[1] < heavy[1], "gravity pulls towards -y"


def test_friction_holds_the_twist_until_it_slips() -> None:
    """To the same place from both sides: the tip stays behind, by a loop as wide as the friction,
    and without any friction by nothing."""
    apart = []
    for friction_nmm in (0.0, 1.0, 4.0):
        plant = ConcentricTubes(plant_config(friction_nmm=friction_nmm))
        go(plant, u(0, 0, 0, 0, 45))
        tips = []
        for side in (-1.0, 1.0):
            go(plant, u(0.0, 1.0 + side, 0.5, 0.0, 45.0))
            tips.append(go(plant, u(0.0, 1.0, 0.5, 0.0, 45.0)).tip.position_mm)
        apart.append(float(np.linalg.norm(tips[1] - tips[0])))
    assert apart[0] < 1e-6
    assert 0.05 < apart[1] < 1.0
    assert 2.0 < apart[2] / apart[1] < 5.0


def test_a_small_turn_back_does_not_slip() -> None:
    """Within the presliding range a little loop leaves nothing behind."""
    plant = ConcentricTubes(plant_config(friction_nmm=2.0))
    here = u(0.0, 1.0, 0.5, 0.0, 45.0)
    go(plant, here)
    before = go(plant, here - u(0.0, 0.004, 0.0, 0.0, 0.0)).tip.position_mm
    go(plant, here - u(0.0, 0.002, 0.0, 0.0, 0.0))
    after = go(plant, here - u(0.0, 0.004, 0.0, 0.0, 0.0)).tip.position_mm
    np.testing.assert_allclose(after, before, atol=1e-6)


def test_a_tube_that_is_pushed_to_and_fro_lets_its_twist_go() -> None:
    """What holds the tip away from where it would be without friction fades with the push."""
    left = []
    for shake in (False, True):
        rubbing = ConcentricTubes(plant_config(friction_nmm=4.0))
        free = ConcentricTubes(plant_config(friction_nmm=0.0))
        for plant in (rubbing, free):
            go(plant, u(0.0, 2.0, -1.0, 0.0, 45.0))
            go(plant, u(0.0, 1.0, 0.5, 0.0, 45.0))
            if shake:
                go(plant, u(0.0, 1.0, 0.5, 0.0, 55.0))
                go(plant, u(0.0, 1.0, 0.5, 0.0, 45.0))
        here = u(0.0, 1.0, 0.5, 0.0, 45.0)
        tips = [p.step(here, FREE, DT_S).tip.position_mm for p in (rubbing, free)]
        left.append(float(np.linalg.norm(tips[0] - tips[1])))
    assert left[0] > 0.2
    assert left[1] < 0.6 * left[0]


def test_a_snap_is_told_and_counted_and_the_drives_feel_it() -> None:
    plant = ConcentricTubes(plant_config())
    state = go(plant, u(0.0, 0.0, 3.0, 0.0, 0.5))
    assert (state.snaps, state.stability > 0.1) == (0, True)
    torque, tip = state.actuator_forces[2], state.tip.position_mm
    stability = []
    for angle in np.arange(3.0, 3.6, 0.005):
        state = plant.step(u(0.0, 0.0, angle, 0.0, 0.5), FREE, DT_S)
        if state.snaps:
            break
        stability.append(state.stability)
        torque, tip = state.actuator_forces[2], state.tip.position_mm
    assert state.snaps == 1
    assert min(stability) == stability[-1]
    assert np.linalg.norm(state.tip.position_mm - tip) > 5.0
    assert state.actuator_forces[2] * torque < 0.0, "it pulled back, now it pulls on"
    plant.reset()
    assert plant.step(u(0, 0, 0, 0, 0), FREE, DT_S).snaps == 0


def test_the_same_steps_give_the_same_states_to_the_last_bit() -> None:
    way = np.random.default_rng(3).uniform([-1, -1, -1, 0, 45], [1, 1, 1, 10, 60], (12, 5))
    plant = ConcentricTubes(plant_config())
    runs = []
    for _ in range(2):
        plant.reset()
        runs.append([plant.step(at, TipLoad(2.0), DT_S) for at in way])
    for one, other in zip(*runs, strict=True):
        np.testing.assert_array_equal(one.centreline_mm, other.centreline_mm)
        np.testing.assert_array_equal(one.actuator_forces, other.actuator_forces)


@pytest.mark.parametrize(
    ("to", "load", "text"),
    [
        ((0, 0, 0, 0), FREE, "5 actuators"),
        ((0, np.nan, 0, 0, 40), FREE, "actuator 1 cannot be at nan rad"),
        ((0, 0, 0, np.inf, 40), FREE, "actuator 3 cannot be at inf mm"),
        ((0, 0, 0, 0, 105), FREE, "pass each other"),
        ((0, 0, 0, 0, 40), TipLoad(mass_g=-1.0), "no load"),
        ((0, 0, 0, 0, 40), TipLoad(force_n=(1e3, 0, 0)), "more than the arm can bear"),
    ],
)
def test_what_makes_no_sense_is_refused_and_nothing_moves(
    to: tuple[float, ...], load: TipLoad, text: str
) -> None:
    plant = ConcentricTubes(plant_config())
    before = plant.step(u(0.1, 0.2, 0.3, 0.0, 40.0), FREE, DT_S)
    with pytest.raises(PlantError, match=text):
        plant.step(u(*to), load, DT_S)
    after = plant.step(u(0.1, 0.2, 0.3, 0.0, 40.0), FREE, DT_S)
    np.testing.assert_array_equal(after.centreline_mm, before.centreline_mm)


@pytest.mark.parametrize("dt_s", [-1.0, np.nan, np.inf])
def test_a_step_takes_some_time(dt_s: float) -> None:
    with pytest.raises(PlantError, match="0 s or longer"):
        ConcentricTubes(plant_config()).step(u(0, 0, 0, 0, 0), FREE, dt_s)


@pytest.mark.parametrize("seed", range(1, 6))
def test_a_variation_is_off_by_what_made_sets_are_off(seed: int) -> None:
    nominal = plant_config()
    other = variation(nominal, seed)
    assert other == variation(nominal, seed) != variation(nominal, seed + 1)
    for one, its in zip(nominal.tubes, other.tubes, strict=True):
        stiffer = its.bending_stiffness_n_mm2 / one.bending_stiffness_n_mm2
        assert 0.95 <= stiffer <= 1.05
        torsion = its.torsion_stiffness_n_mm2 / one.torsion_stiffness_n_mm2
        assert torsion == pytest.approx(stiffer)
        bent = its.sections[-1].curvature_per_mm / one.sections[-1].curvature_per_mm
        assert 0.94 <= bent <= 1.06
        assert its.sections[:-1] == one.sections[:-1]
    here = u(0.4, 1.2, -0.6, 0.0, 45.0)
    tips = [go(ConcentricTubes(config), here).tip.position_mm for config in (nominal, other)]
    assert 0.1 < np.linalg.norm(tips[1] - tips[0]) < 12.0
