"""contact_risk: any part of the body, anywhere on its way; and that body_point_risk is not that."""

from dataclasses import replace
from functools import cache
from math import erf, sqrt

import numpy as np
import pytest
from scipy.stats import binom

from daemon.workbench.body_model.evaluation.shapes import CHEST_PORT, ball, box, chest, slot, turned
from safety.risk.body_point import BodyPointRisk
from safety.risk.contact import ContactModel
from safety.risk.contact_figures import most_touching, upper_limit
from safety.risk.model.mixture import FloatArray, Mixture
from safety.risk.model.shape_basis import ShapeBasis
from safety.risk.surroundings.distance_grid import DistanceGrid, distance_grid
from safety.risk.surroundings.environment import Environment, InsertionPort, Mesh, environment
from tests.safety.risk.arms import ARC_MM, Pose, points_mixture, shape_mixture, shapes

LENGTH_MM, RADIUS_MM = 100.0, 5.0


def phi(x: float) -> float:
    return 0.5 * (1.0 + erf(x / sqrt(2.0)))


def rod(nodes: int = 21) -> ShapeBasis:
    """Straight along z; its coefficients shift it in x and in y."""
    along = np.linspace(0.0, LENGTH_MM, nodes)
    base = np.column_stack([np.zeros((nodes, 2)), along])
    modes = np.zeros((2, nodes, 3))
    modes[0, :, 0] = modes[1, :, 1] = 1.0
    return ShapeBasis.checked(base, modes, np.full(nodes, RADIUS_MM), np.zeros(nodes), along)


def at(x: float, y: float = 0.0, sigma_mm: float = 1e-3) -> Mixture:
    """The rod shifted there, about."""
    return Mixture.checked([1.0], [[x, y]], [np.eye(2) / sigma_mm])


@cache
def wall() -> DistanceGrid:
    """From x = 40 mm on."""
    return distance_grid(environment(*box((40.0, 200.0, 200.0), (60.0, 0.0, 50.0))), 2.0)


def grid_of(mesh: Mesh, spacing_mm: float = 2.0) -> DistanceGrid:
    return distance_grid(environment(*mesh), spacing_mm)


@pytest.mark.parametrize("distance_mm", [2.0, 5.0, 8.0, 12.0])
def test_the_risk_of_a_flat_wall_is_the_tail_beyond_the_bodys_skin(distance_mm: float) -> None:
    sigma = 4.0
    model = ContactModel(rod(), wall(), None, samples=4000)
    risk = model.risk(at(40.0 - RADIUS_MM - distance_mm, sigma_mm=sigma))
    truth = phi(-distance_mm / sigma)
    assert binom.sf(risk.touching - 1, risk.samples, truth) > 1e-4
    assert binom.cdf(risk.touching, risk.samples, truth) > 1e-4
    assert risk.probability == risk.touching / risk.samples
    assert risk.upper_limit > truth
    assert risk.median_mm == pytest.approx(distance_mm, abs=0.3)
    assert risk.lowest_5_percent_mm == pytest.approx(distance_mm - 1.645 * sigma, abs=0.5)
    assert risk.lowest_1_percent_mm == pytest.approx(distance_mm - 2.326 * sigma, abs=0.8)
    assert risk.mean_of_worst_mm == pytest.approx(distance_mm - 2.063 * sigma, abs=0.6)


def test_a_limit_is_one_that_a_larger_probability_would_almost_always_break() -> None:
    assert upper_limit(0, 1000) == pytest.approx(0.00299, abs=1e-5)
    assert upper_limit(1000, 1000) == 1.0
    for count, samples in ((0, 50), (3, 200), (40, 1000), (999, 1000)):
        assert binom.cdf(count, samples, upper_limit(count, samples)) == pytest.approx(0.05)


@pytest.mark.parametrize("risk", [0.0, 0.001, 0.003, 0.05, 0.5, 0.999])
def test_of_so_many_shapes_may_touch_and_of_no_more(risk: float) -> None:
    count = most_touching(risk, 1000)
    assert count < 0 or upper_limit(count, 1000) <= risk
    assert upper_limit(count + 1, 1000) > risk


def test_a_share_of_the_shapes_has_no_more_clearance_than_is_told() -> None:
    model = ContactModel(rod(), wall(), None, samples=1000)
    mixture = at(25.0, sigma_mm=4.0)
    risk = model.risk(mixture)
    assert model.clearance_mm(mixture, 0.5) == pytest.approx(risk.median_mm)
    assert model.clearance_mm(mixture, 0.049) == pytest.approx(risk.lowest_5_percent_mm)
    shares = [model.clearance_mm(mixture, share) for share in (0.0, 0.01, 0.3, 0.99, 1.0)]
    assert shares == sorted(shares)


def test_the_limit_counts_shapes_that_are_not_proved_to_be_clear() -> None:
    """A coarse grid says less, and what it cannot say is on the safe side."""
    basis, mixture = rod(), at(40.0 - RADIUS_MM - 1.0, sigma_mm=0.4)
    fine, coarse = (
        ContactModel(basis, grid_of(box((40.0, 200.0, 200.0), (60.0, 0.0, 50.0)), h), None)
        for h in (1.0, 5.0)
    )
    fine_risk, coarse_risk = fine.risk(mixture), coarse.risk(mixture)
    assert fine_risk.probability == pytest.approx(coarse_risk.probability, abs=0.01)
    assert fine_risk.touching <= fine_risk.not_surely_clear <= coarse_risk.not_surely_clear
    assert fine_risk.upper_limit < coarse_risk.upper_limit


def test_what_the_centreline_may_be_off_by_is_for_the_limit_and_not_for_the_estimate() -> None:
    """The estimate says what happens; what is not known well goes to the safe side."""
    basis, mixture = rod(), at(40.0 - RADIUS_MM - 4.0, sigma_mm=2.0)
    off = replace(basis, left_out_mm=np.full(basis.nodes, 2.0, np.float32))
    exact, safe = (ContactModel(one, wall(), None).risk(mixture) for one in (basis, off))
    assert safe.touching == exact.touching
    assert safe.median_mm == exact.median_mm
    nearer = ContactModel(basis, wall(), None).risk(at(40.0 - RADIUS_MM - 2.0, sigma_mm=2.0))
    assert nearer.touching <= safe.not_surely_clear <= nearer.not_surely_clear
    assert safe.upper_limit > exact.upper_limit + 0.05


@pytest.mark.parametrize("seed", range(6))
def test_a_shape_that_is_said_to_be_clear_is_clear(seed: int) -> None:
    """Against the triangles themselves: rods of few nodes graze a ball of few triangles."""
    random = np.random.default_rng(seed)
    mesh = ball(12.0, (random.uniform((17.0, -5.0, 45.0), (23.0, 5.0, 55.0))).tolist(), 40)
    model = ContactModel(rod(6), grid_of(mesh, 3.0), None, samples=300, seed=seed)
    mixture = at(4.0, sigma_mm=3.0)
    risk = model.risk(mixture)
    surface = points_on(mesh)
    beyond_ends = np.maximum(np.maximum(surface[:, 2] - LENGTH_MM, -surface[:, 2]), 0.0)
    touching = 0
    for line in model.centrelines(mixture).astype(float):
        aside = np.hypot(surface[:, 0] - line[0, 0], surface[:, 1] - line[0, 1])
        touching += bool((np.hypot(aside, beyond_ends) <= RADIUS_MM).any())
    assert 10 < touching < 290
    assert touching <= risk.not_surely_clear
    assert abs(touching - risk.touching) <= 25


def points_on(mesh: Mesh) -> FloatArray:
    """Many on each triangle."""
    share = np.array([(i, j, 30 - i - j) for i in range(31) for j in range(31 - i)]) / 30.0
    points: FloatArray = np.einsum("pc,tcx->tpx", share, mesh.vertices_mm[mesh.triangles])
    return points.reshape(-1, 3)


def test_a_thin_plate_between_two_nodes_is_touched() -> None:
    """The nodes are 100 mm apart and both far from it."""
    plate = box((60.0, 60.0, 6.0), (0.0, 0.0, 50.0))
    model = ContactModel(rod(2), grid_of(plate), None, samples=50)
    touched = model.risk(at(0.0))
    assert touched.probability == 1.0
    assert model.risk(at(90.0)).probability == 0.0


def test_a_plate_between_two_waypoints_is_touched_on_the_way() -> None:
    plate = box((6.0, 60.0, 60.0), (0.0, 0.0, 50.0))
    model = ContactModel(rod(), grid_of(plate), None, samples=50)
    ends = [at(-40.0), at(40.0)]
    assert [model.risk(mixture).probability for mixture in ends] == [0.0, 0.0]
    path = model.along(ends)
    assert path.at_waypoints == (0.0, 0.0)
    assert path.on_the_way.probability == 1.0
    assert path.on_the_way.upper_limit == 1.0
    beside = model.along([at(-40.0, 80.0), at(40.0, 80.0)])
    assert beside.on_the_way.probability == 0.0
    assert beside.on_the_way.upper_limit < 0.07


def test_more_waypoints_on_the_same_way_are_no_more_risk() -> None:
    """Each draw is one body all the way: nothing multiplies, as it does in equation 10."""
    model = ContactModel(rod(), wall(), None)
    coarse, fine = (
        [at(28.0, y, sigma_mm=3.0) for y in np.linspace(-30.0, 30.0, n)] for n in (3, 33)
    )
    few, many = model.along(coarse), model.along(fine)
    assert few.on_the_way.touching == many.on_the_way.touching > 0
    assert few.on_the_way.touching == max(few.at_waypoints) * few.on_the_way.samples


def test_a_path_is_at_least_as_risky_as_each_of_its_waypoints() -> None:
    model = ContactModel(rod(), wall(), None)
    path = [at(x, sigma_mm=4.0) for x in (10.0, 25.0, 31.0, 12.0)]
    result = model.along(path)
    alone = tuple(model.risk(mixture).probability for mixture in path)
    assert result.at_waypoints == alone
    assert result.on_the_way.probability >= max(alone) > 0.0
    assert result.on_the_way.worst.clearance_mm == min(
        model.risk(mixture).worst.clearance_mm for mixture in path
    )
    assert model.along(path[:1]).on_the_way.probability == alone[0]


def test_a_draw_that_changes_its_component_does_not_sweep_from_one_to_the_other() -> None:
    """Between the two components there is a plate, through which no body goes."""
    plate = box((6.0, 60.0, 60.0), (0.0, 0.0, 50.0))
    model = ContactModel(rod(), grid_of(plate), None, samples=400)
    means, factors = [[-40.0, 0.0], [40.0, 0.0]], [np.eye(2)] * 2
    path = [Mixture.checked([w, 1.0 - w], means, factors) for w in (0.5, 0.3, 0.6)]
    assert model.along(path).on_the_way.probability == 0.0
    through = [
        Mixture.checked([0.5, 0.5], means, factors),
        Mixture.checked([0.3, 0.7], [[40.0, 0.0], [40.0, 0.0]], factors),
    ]
    swept = model.along(through)
    uniform = np.random.default_rng(0).random(400)
    assert swept.on_the_way.touching == np.count_nonzero(uniform < 0.5)


def test_a_way_on_from_the_last_question_is_the_same_as_one_from_anew() -> None:
    model, path = (
        ContactModel(rod(), wall(), None),
        [at(x, sigma_mm=4.0) for x in (10.0, 25.0, 30.0)],
    )
    model.risk(path[0])
    went = [model.along(pair).on_the_way for pair in (path[:2], path[1:], path[:2])]
    for risk, pair in zip(went, (path[:2], path[1:], path[:2]), strict=True):
        anew = ContactModel(rod(), wall(), None).along(pair).on_the_way
        assert (risk.touching, risk.not_surely_clear) == (anew.touching, anew.not_surely_clear)
        assert risk.mean_of_worst_mm == anew.mean_of_worst_mm
        assert risk.worst.clearance_mm == anew.worst.clearance_mm


@pytest.mark.parametrize("seed", range(8))
def test_a_port_that_is_far_away_proves_no_more_and_hardly_less(seed: int) -> None:
    """Of a way that may lead out of a port less is known, and so it is looked at in more places."""
    random = np.random.default_rng(seed)
    port = InsertionPort((0.0, 0.0, -900.0), (0.0, 0.0, 1.0), radius_mm=8.0, depth_mm=2.0)
    without, beside = (ContactModel(rod(), wall(), one, samples=400) for one in (None, port))
    x, y = random.uniform(25.0, 33.0), 0.0
    for _ in range(6):
        to_x, to_y = x + random.normal(scale=0.4), y + random.normal(scale=0.4)
        path = [at(x, y, sigma_mm=1.5), at(to_x, to_y, sigma_mm=random.uniform(1.4, 1.6))]
        one, other = without.along(path), beside.along(path)
        assert not (one.touching & ~other.touching).any()
        assert np.count_nonzero(one.touching != other.touching) <= 4
        assert one.on_the_way.touching == other.on_the_way.touching
        assert one.at_waypoints == other.at_waypoints
        centres = without.centrelines(path[1])[:, :, 0].max(axis=1)
        assert one.touching[centres + RADIUS_MM >= 40.0].all()
        x, y = to_x, to_y


def test_what_comes_out_of_the_port_beside_its_hole_touches() -> None:
    room = turned(box((120.0, 120.0, 200.0), (0.0, 0.0, 100.0), 4))
    port = InsertionPort((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), radius_mm=8.0, depth_mm=12.0)
    model = ContactModel(rod(), grid_of(room), port, samples=10)
    assert model.along([at(7.6), at(7.9)]).on_the_way.not_surely_clear == 0
    assert model.along([at(7.9), at(8.2)]).on_the_way.not_surely_clear == 10


def test_the_same_question_has_the_same_answer() -> None:
    one, other = (ContactModel(rod(), wall(), None, seed=5) for _ in range(2))
    mixture = at(30.0, sigma_mm=5.0)
    first = one.risk(mixture)
    one.along([at(0.0), at(10.0)])
    assert one.risk(mixture).probability == first.probability == other.risk(mixture).probability
    assert ContactModel(rod(), wall(), None, seed=6).risk(mixture).median_mm != first.median_mm


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e30])
def test_a_body_that_is_nowhere_touches(bad: float) -> None:
    for grid in (wall(), grid_of(turned(box((300.0, 300.0, 300.0), (0.0, 0.0, 50.0))), 4.0)):
        model = ContactModel(rod(), grid, None, samples=10)
        mixture = Mixture(np.ones(1), np.array([[bad, 0.0]]), np.eye(2)[None])
        if abs(bad) == 1e30 and not grid.solid_around:
            assert model.risk(mixture).probability == 0.0  # it is somewhere, far away
            continue
        assert model.risk(mixture).probability == 1.0
        assert model.risk(mixture).upper_limit == 1.0


def test_outside_a_cavity_everything_touches_and_far_from_a_body_nothing() -> None:
    cavity = grid_of(turned(box((120.0, 120.0, 120.0), (0.0, 0.0, 50.0))), 4.0)
    assert ContactModel(rod(), cavity, None, samples=10).risk(at(0.0)).probability == 0.0
    for far in (80.0, 500.0, 1e5):
        assert ContactModel(rod(), cavity, None, samples=10).risk(at(far)).probability == 1.0
        risk = ContactModel(rod(), wall(), None, samples=10).risk(at(-far))
        assert risk.probability == 0.0
        assert risk.median_mm > 10.0


def test_in_the_port_touching_is_no_contact_and_deeper_it_is() -> None:
    """The rod comes through a wall in whose hole it has no clearance at all."""
    room = turned(box((120.0, 120.0, 200.0), (0.0, 0.0, 100.0), 4))
    port = InsertionPort((0.0, 0.0, 0.0), (0.0, 0.0, 3.0), radius_mm=8.0, depth_mm=12.0)
    assert ContactModel(rod(), grid_of(room), None, samples=10).risk(at(0.0)).probability == 1.0
    inside = ContactModel(rod(), grid_of(room), port, samples=10)
    assert inside.risk(at(0.0)).probability == 0.0
    assert inside.risk(at(20.0)).probability == 1.0  # beside the hole
    shallow = InsertionPort((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), radius_mm=8.0, depth_mm=2.0)
    assert ContactModel(rod(), grid_of(room), shallow, samples=10).risk(at(0.0)).probability == 1.0


def test_the_worst_place_is_named() -> None:
    """A ball beside the rod's middle."""
    model = ContactModel(rod(), grid_of(ball(15.0, (26.0, 0.0, 60.0), 800)), None)
    worst = model.risk(at(0.0, sigma_mm=0.5)).worst
    assert worst.arc_mm == pytest.approx(60.0, abs=5.0)
    np.testing.assert_allclose(worst.place_mm, [0.9, 0.0, 60.0], atol=0.6)
    np.testing.assert_allclose(worst.nearest_mm, [11.0, 0.0, 60.0], atol=1.0)


def test_a_thick_body_just_outside_the_grid_does_not_touch() -> None:
    """There only a bound of the distance is known, and it is enough."""
    along = np.array([0.0, 50.0, 100.0])
    base, modes = np.column_stack([np.zeros((3, 2)), along]), np.zeros((1, 3, 3))
    modes[0, :, 0] = 1.0
    thick = ShapeBasis.checked(base, modes, np.full(3, 13.0), np.zeros(3), along)
    model = ContactModel(thick, wall(), None, samples=5)
    for x, touched in ((23.0, 0.0), (19.5, 0.0), (10.0, 0.0), (28.0, 1.0)):
        risk = model.risk(Mixture.checked([1.0], [[x]], [[[1e6]]]))
        assert risk.probability == touched
        assert risk.upper_limit == 1.0 if touched else risk.not_surely_clear == 0


def test_a_grid_that_is_not_exact_as_far_as_the_body_is_thick_is_refused() -> None:
    shallow = distance_grid(environment(*box((40.0, 40.0, 40.0), (60.0, 0.0, 0.0))), 2.0, 6.0)
    with pytest.raises(ValueError, match=r"exact to 6 mm, and the body needs 11\.3"):
        ContactModel(rod(), shallow, None)


def test_questions_that_make_no_sense_are_refused() -> None:
    model = ContactModel(rod(), wall(), None)
    with pytest.raises(ValueError, match="2 coefficients, and the mixture is over 3"):
        model.risk(Mixture.checked([1.0], [[0.0] * 3], [np.eye(3)]))
    with pytest.raises(ValueError, match="at least one waypoint"):
        model.along([])


def test_a_slot_is_passed_by_what_is_thin_enough() -> None:
    for gap, touched in ((8.0, 1.0), (16.0, 0.0)):
        model = ContactModel(rod(), grid_of(slot(gap, 2), 1.0), None, samples=20)
        assert model.risk(at(0.0)).probability == touched


@cache
def cavity() -> tuple[Environment, DistanceGrid]:
    mesh = environment(*chest(5000, seed=0), port=CHEST_PORT)
    return mesh, distance_grid(mesh, 2.0)


@pytest.mark.parametrize(
    ("pose", "largest_body_point_risk", "least_contact_risk"),
    [
        (Pose(0.005, np.radians(210.0)), 0.04, 0.97),
        (Pose(0.004, np.radians(90.0)), 0.06, 0.99),
        (Pose(0.005, np.radians(300.0)), 0.06, 0.99),
        (Pose(0.004, np.radians(180.0)), 0.02, 0.5),
    ],
)
def test_poses_where_body_point_risk_is_small_and_the_body_touches_all_the_same(
    pose: Pose, largest_body_point_risk: float, least_contact_risk: float
) -> None:
    """A planner's own condition holds, all means are free, and the shapes are in the wall."""
    mesh, grid = cavity()
    body_point = BodyPointRisk(mesh)
    mixture = points_mixture(pose)
    assert not body_point.bounds(mixture).mean_in_solid.any()
    assert body_point.near_exact(mixture).value < largest_body_point_risk
    basis, coefficients = shape_mixture(pose)
    risk = ContactModel(basis, grid, CHEST_PORT).risk(coefficients)
    assert risk.probability > least_contact_risk
    assert risk.worst.arc_mm == ARC_MM[-1]  # the tip, of which there is little in the mixture


def test_the_same_reading_of_body_point_risk_means_anything_between_never_and_always() -> None:
    mesh, grid = cavity()
    body_point = BodyPointRisk(mesh)
    printed, contact = [], []
    for pose in (Pose(0.006, np.radians(30.0)), Pose(0.003, np.radians(120.0))):
        printed.append(body_point.printed(points_mixture(pose)))
        basis, coefficients = shape_mixture(pose)
        contact.append(ContactModel(basis, grid, CHEST_PORT).risk(coefficients).probability)
    assert max(printed) < 0.1
    assert contact[0] < 0.1
    assert contact[1] > 0.99


def test_the_sampled_shapes_are_like_the_bodys_own() -> None:
    """The reading above is not the sampling's fault: the shapes themselves touch as often."""
    _, grid = cavity()
    pose = Pose(0.004, np.radians(180.0))
    basis, coefficients = shape_mixture(pose)
    predicted = ContactModel(basis, grid, CHEST_PORT).risk(coefficients).probability
    own = shapes(pose, 1000, seed=7)
    beyond_port = own[:, ARC_MM > 40.0].reshape(-1, 3)
    index = np.rint((beyond_port - grid.origin_mm) / grid.spacing_mm).astype(int).T
    clearance = grid.values_mm[tuple(index)].reshape(len(own), -1).min(axis=1) - 6.0
    assert predicted == pytest.approx((clearance < 0.0).mean(), abs=0.12)
