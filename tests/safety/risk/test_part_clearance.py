"""The clearance of parts of the body, and what it changes with: by the mixture, and by the axes."""

from dataclasses import replace

import numpy as np
import pytest

from daemon.workbench.body_model.evaluation.shapes import box, turned
from safety.risk.body_risk import BodyRisk
from safety.risk.contact import ContactModel
from safety.risk.model.mixture import FloatArray, Mixture
from safety.risk.model.risk_model import RiskModel, risk_model
from safety.risk.model.shape_basis import ShapeBasis
from safety.risk.part_kernels import PartSlopes, part_slopes
from safety.risk.surroundings.distance_grid import DistanceGrid, distance_grid
from safety.risk.surroundings.environment import Environment, InsertionPort, environment
from safety.risk_source import Clearance
from tests.safety.risk.networks import model_arrays
from tests.safety.risk.test_body_risk import arrays as bending_arrays

NODES, RADIUS_MM, LENGTH_MM = 13, 5.0, 120.0
ENDS = np.array([0, 4, 8, NODES])
NEAR_MM = 10.0
SHARE = 0.04


def rod() -> ShapeBasis:
    """Straight along z; its coefficients shift it in x, shift it in y, and tilt it in x."""
    along = np.linspace(0.0, LENGTH_MM, NODES)
    base = np.column_stack([np.zeros((NODES, 2)), along])
    modes = np.zeros((3, NODES, 3))
    modes[0, :, 0] = modes[1, :, 1] = 1.0
    modes[2, :, 0] = along / LENGTH_MM
    radius = np.full(NODES, RADIUS_MM)
    return ShapeBasis.checked(base, modes, radius, np.zeros(NODES), along)


def mixture(means: list[list[float]], seed: int = 1) -> Mixture:
    """Of components that are about as wide as 1 mm, each askew in its own way."""
    random = np.random.default_rng(seed)
    factors = [np.triu(random.uniform(-0.3, 0.3, (3, 3))) for _ in means]
    for factor in factors:
        np.fill_diagonal(factor, random.uniform(0.8, 1.4, 3))
    return Mixture.checked(np.full(len(means), 1.0 / len(means)), means, factors)


@pytest.fixture(scope="module")
def wall() -> DistanceGrid:
    """From x = 20 mm on, and askew, so that no slope is along an axis."""
    made = box((40.0, 300.0, 300.0), (0.0, 0.0, 0.0), 6)
    turn = np.linalg.qr(np.array([[1.0, 0.2, 0.1], [-0.2, 1.0, 0.0], [-0.1, 0.0, 1.0]]))[0]
    turn *= np.sign(np.diag(turn))
    shifted = made.vertices_mm @ turn.T + np.array([40.0, 0.0, 60.0])
    return distance_grid(environment(shifted, made.triangles), 2.0, 30.0)


def measured(grid: DistanceGrid, at: Mixture, port: InsertionPort | None = None) -> PartSlopes:
    model = ContactModel(rod(), grid, port, samples=200)
    return model.part_slopes(at, SHARE, ENDS, NEAR_MM)


HERE = mixture([[5.0, 1.0, 2.0], [4.0, -2.0, 3.0]])


def test_a_part_has_the_clearance_of_the_few_shapes_that_have_least(wall: DistanceGrid) -> None:
    model = ContactModel(rod(), wall, None, samples=200)
    lines = model.centrelines(HERE).astype(np.float64)
    found = measured(wall, HERE)
    for part in range(3):
        nodes = lines[:, ENDS[part] : ENDS[part + 1]]
        room = np.sort(_interpolated(wall, nodes).min(axis=1) - RADIUS_MM)
        assert found.clearance[part] == pytest.approx(room[:17].mean(), abs=1e-3)
        assert ENDS[part] <= found.node[part] < ENDS[part + 1]


def _interpolated(grid: DistanceGrid, places: FloatArray) -> FloatArray:
    from scipy.interpolate import RegularGridInterpolator

    axes = [
        origin + grid.spacing_mm * np.arange(count)
        for origin, count in zip(grid.origin_mm, grid.values_mm.shape, strict=True)
    ]
    return np.asarray(RegularGridInterpolator(axes, grid.values_mm)(places))


@pytest.mark.parametrize("component", [0, 1])
@pytest.mark.parametrize("coefficient", [0, 1, 2])
def test_by_a_mean_the_clearance_changes_as_it_says(
    wall: DistanceGrid, component: int, coefficient: int
) -> None:
    found, step = measured(wall, HERE), 0.02
    ends = []
    for way in (step, -step):
        means = HERE.means_mm.copy()
        means[component, coefficient] += way
        ends.append(measured(wall, replace(HERE, means_mm=means)).clearance)
    differences = (ends[0] - ends[1]) / (2.0 * step)
    slopes = found.by_means[:, component, coefficient]
    np.testing.assert_allclose(slopes, differences, atol=0.05)


@pytest.mark.parametrize("row, column", [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)])
def test_by_a_factor_the_clearance_changes_as_it_says(
    wall: DistanceGrid, row: int, column: int
) -> None:
    found, step = measured(wall, HERE), 0.01
    ends = []
    for way in (step, -step):
        factors = HERE.factors_per_mm.copy()
        factors[0, row, column] += way
        ends.append(measured(wall, replace(HERE, factors_per_mm=factors)).clearance)
    differences = (ends[0] - ends[1]) / (2.0 * step)
    slopes = found.by_factors[:, 0, row, column]
    assert np.abs(slopes).max() > 0.01
    np.testing.assert_allclose(slopes, differences, atol=0.06)


def test_of_a_part_that_nothing_is_near_to_no_slope_is_told(wall: DistanceGrid) -> None:
    found = measured(wall, mixture([[-20.0, 0.0, 0.0]]))
    assert (found.clearance > NEAR_MM).all()
    assert not found.by_means.any()
    assert not found.by_factors.any()


def test_what_is_in_the_port_is_near_to_nothing(wall: DistanceGrid) -> None:
    port = InsertionPort((5.0, 0.0, -5.0), (0.0, 0.0, 1.0), radius_mm=40.0, depth_mm=38.0)
    found, without = measured(wall, HERE, port), measured(wall, HERE)
    assert found.clearance[0] == np.inf
    assert not found.by_means[0].any()
    assert found.node[0] == ENDS[0]
    np.testing.assert_array_equal(found.clearance[1:], without.clearance[1:])


def test_a_port_is_no_wider_and_no_deeper_than_it_is(wall: DistanceGrid) -> None:
    without = measured(wall, HERE).clearance
    narrow = InsertionPort((-80.0, 0.0, -5.0), (0.0, 0.0, 1.0), radius_mm=40.0, depth_mm=500.0)
    np.testing.assert_array_equal(measured(wall, HERE, narrow).clearance, without)
    shallow = InsertionPort((5.0, 0.0, -50.0), (0.0, 0.0, 1.0), radius_mm=90.0, depth_mm=30.0)
    np.testing.assert_array_equal(measured(wall, HERE, shallow).clearance, without)


def test_of_shapes_partly_in_the_port_the_others_count(wall: DistanceGrid) -> None:
    """The middle part is in the port with one component and not with the other."""
    apart = mixture([[5.0, 0.0, 0.0], [5.0, 25.0, 0.0]])
    port = InsertionPort((5.0, 25.0, -5.0), (0.0, 0.0, 1.0), radius_mm=12.0, depth_mm=500.0)
    found = measured(wall, apart, port)
    assert np.isfinite(found.clearance).all()
    assert found.by_means[:, 0].any()
    assert not found.by_means[:, 1].any()


@pytest.mark.parametrize("shift", [(-400.0, 0.0), (400.0, 0.0), (0.0, 400.0), (0.0, -400.0)])
def test_outside_of_the_grid_the_body_is_as_far_as_its_end(
    wall: DistanceGrid, shift: tuple[float, float]
) -> None:
    found = measured(wall, mixture([[*shift, 0.0]]))
    np.testing.assert_allclose(found.clearance, wall.margin_mm - RADIUS_MM, rtol=1e-5)
    assert not found.by_means.any()


def test_outside_of_a_cavity_it_is_in_the_solid() -> None:
    cavity = environment(*turned(box((60.0, 60.0, 200.0), (0.0, 0.0, 60.0), 4)), free="inside")
    grid = distance_grid(cavity, 2.0, 20.0)
    found = measured(grid, mixture([[400.0, 0.0, 0.0]]))
    np.testing.assert_allclose(found.clearance, -grid.margin_mm - RADIUS_MM, rtol=1e-5)


# Of a whole model, by its axes. Its body is 200 mm long; the first input leads its end along x.


@pytest.fixture(scope="module")
def bending() -> RiskModel:
    return risk_model(bending_arrays(), "silu", "relu")


@pytest.fixture(scope="module")
def block() -> Environment:
    return environment(*box((40.0, 60.0, 160.0), (60.0, 0.0, 180.0), 4))


def told(model: RiskModel, block: Environment, first: float, shift: float = 0.0) -> Clearance:
    risk = BodyRisk(model, block, distance_grid(block, 2.0, 20.0), samples=1000)
    if shift:
        risk.take_as_shifted(np.array([shift, 0.0]))
    found = risk.clearance((first, 0.0, 0.0, 0.0), 0.05)
    assert found is not None
    return found


def test_parts_that_something_is_near_to_are_told_and_no_others(
    bending: RiskModel, block: Environment
) -> None:
    parts = told(bending, block, 2.0).parts
    arcs = [part.arc_mm for part in parts]
    assert arcs == sorted(arcs)
    assert arcs[-1] == 200.0
    assert 1 < len(parts) < 6
    assert all(part.arc_mm >= 100.0 for part in parts)


def test_the_nearest_part_has_the_clearance_of_the_whole(
    bending: RiskModel, block: Environment
) -> None:
    for shift in (0.0, 4.0):
        found = told(bending, block, 1.6, shift)
        least = min(part.clearance_mm for part in found.parts)
        assert least == pytest.approx(found.clearance_mm)
        assert found.parts[-1].clearance_mm == least
    assert (
        told(bending, block, 1.6, 4.0).clearance_mm < told(bending, block, 1.6).clearance_mm - 3.0
    )


def test_a_part_comes_nearer_as_fast_as_it_is_led(bending: RiskModel, block: Environment) -> None:
    found = told(bending, block, 2.0)
    for part in found.parts:
        expected = -10.0 * part.arc_mm / 200.0
        assert part.slope[0] == pytest.approx(expected, rel=0.1)
        assert part.slope[1:] == pytest.approx((0.0, 0.0, 0.0), abs=0.1)
    assert found.parts[-1].slope[0] == pytest.approx(found.slope[0], rel=0.1)


def test_place_and_direction_of_the_tip_change_as_the_body_does(
    bending: RiskModel, block: Environment
) -> None:
    slope = np.array(told(bending, block, 2.0).tip_slope)
    assert slope.shape == (6, 4)
    lean = np.hypot(20.0, 200.0)
    assert slope[:3, 0] == pytest.approx([10.0, 0.0, 0.0], abs=0.05)
    assert slope[3:, 0] == pytest.approx(
        [10.0 * 200.0**2 / lean**3, 0.0, -20.0 * 10.0 * 200.0 / lean**3], abs=1e-3
    )
    assert slope[:, 1:] == pytest.approx(np.zeros((6, 3)), abs=1e-6)


def test_by_axes_slopes_are_those_of_the_clearance(block: Environment) -> None:
    """Of a network that has not been put together by hand: all outputs change with all inputs."""
    made = model_arrays(coefficients=2)
    hand = bending_arrays()
    for name in hand:
        if name.startswith(("basis/", "training/")) or "scale" in name or "offset" in name:
            made[name] = hand[name]
    made["shapes/log_diagonal_limits"][:] = (0.0, 0.6)
    model = risk_model(made, "silu", "relu")
    near = BodyRisk(model, block, distance_grid(block, 2.0, 20.0), samples=1000)
    for first in np.linspace(-1.0, 1.0, 9):
        found = near.clearance((float(first), 0.1, -0.2, 0.3), 0.05)
        if found is None or not found.parts:
            continue
        nearest = min(found.parts, key=lambda part: part.clearance_mm)
        np.testing.assert_allclose(nearest.slope, found.slope, atol=0.3 * np.abs(found.slope).max())


def test_what_is_compiled_beforehand_is_all_that_the_parts_need(
    bending: RiskModel, block: Environment
) -> None:
    near = BodyRisk(bending, block, distance_grid(block, 2.0, 20.0), samples=1000)
    near.warm_up()
    known = len(part_slopes.signatures)
    assert known > 0
    assert near.clearance((2.0, 0.0, 0.0, 0.0), 0.05) is not None
    assert len(part_slopes.signatures) == known


def test_a_network_that_gives_nothing_needs_nothing(block: Environment) -> None:
    broken = bending_arrays()
    broken["shapes/means.0.weight"][0, 0] = 1e38
    broken["shapes/output_scale_mm"] = np.array(1e300)
    model = risk_model(broken, "silu", "relu")
    BodyRisk(model, block, distance_grid(block, 2.0, 20.0), samples=100).warm_up()
