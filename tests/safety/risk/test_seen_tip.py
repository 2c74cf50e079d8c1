"""What a measured tip says of the body: it agrees with it, and says less farther on."""

import numpy as np
import pytest

from safety.risk.model.conditioning_kernels import write_moved_tip
from safety.risk.model.mixture import FloatArray, Mixture
from safety.risk.model.shape_basis import ShapeBasis
from safety.risk.seen_tip import FORGETS, OFF_SHARE, OTHER_BODY, TipConditioning

ARC_MM = np.linspace(0.0, 200.0, 11)
SHARE = ARC_MM / 200.0


def bent_basis() -> ShapeBasis:
    """Straight along z; two coefficients for each way aside, as a cantilever bends and beyond."""
    modes = np.zeros((4, 11, 3))
    for axis in range(2):
        modes[2 * axis, :, axis] = SHARE**2
        modes[2 * axis + 1, :, axis] = SHARE**3
    base = np.column_stack([np.zeros((11, 2)), ARC_MM])
    return ShapeBasis.checked(base, modes, np.full(11, 5.0), np.full(11, 1.0), ARC_MM)


BASIS = bent_basis()


def mixture_at(bend_mm: float = 0.0, std_mm: float = 2.0) -> Mixture:
    means = np.zeros((2, 4))
    means[:, 0] = bend_mm + np.array([-0.5, 0.5])
    return Mixture(np.array([0.5, 0.5]), means, np.tile(np.eye(4) / std_mm, (2, 1, 1)))


def tips(mixture: Mixture, count: int = 40_000) -> FloatArray:
    drawn = mixture.sample(count, np.random.default_rng(0))
    return np.asarray(BASIS.base_mm[-1] + drawn @ BASIS.modes[:, -1].astype(np.float64))


def conditioning(accuracy_mm: float = 0.5, accuracy_rad: float | None = 0.02) -> TipConditioning:
    return TipConditioning(BASIS, accuracy_mm, accuracy_rad)


TIP_MM = np.array([4.0, -3.0, 200.0])


def test_shapes_given_the_tip_end_where_it_is() -> None:
    given, mixture = conditioning(), mixture_at()
    found = given.there(given.seen(mixture, TIP_MM, None), mixture)
    assert found is not None
    ends = tips(found)
    np.testing.assert_allclose(ends[:, :2].mean(axis=0), TIP_MM[:2], atol=0.15)
    assert ends[:, :2].std(axis=0).max() < 0.55
    assert tips(mixture)[:, :2].std(axis=0).min() > 2.0


def test_a_direction_tells_one_bend_from_another() -> None:
    """Two bodies whose tips are in one place, and point along different ways."""
    given, mixture = conditioning(), mixture_at()
    middles = []
    for slope in (0.02, 0.06):
        along = np.array([slope, 0.0, 1.0]) / np.hypot(slope, 1.0)
        seen = given.seen(mixture, np.array([4.0, 0.0, 200.0]), along)
        assert seen.value.size == 6
        found = given.there(seen, mixture)
        assert found is not None
        mean = found.weights @ found.means_mm
        middles.append(float(mean @ BASIS.modes[:, 5, 0]))
    assert middles[0] > middles[1] + 0.3


@pytest.mark.parametrize("longer_mm", [-40.0, 0.0, 50.0])
def test_a_direction_says_nothing_of_how_long_a_body_is(longer_mm: float) -> None:
    """A straight one, longer or shorter than usual, that is seen where it is and points along."""
    modes = np.zeros((3, 11, 3))
    modes[0, :, 2] = SHARE
    modes[1, :, 0] = modes[2, :, 1] = SHARE**2
    basis = ShapeBasis.checked(BASIS.base_mm, modes, BASIS.radius_mm, BASIS.left_out_mm, ARC_MM)
    mean = np.array([longer_mm, 0.0, 0.0])
    mixture = Mixture(np.ones(1), mean[None], np.eye(3)[None] / 2.0)
    given = TipConditioning(basis, 0.5, 0.02)
    seen = given.seen(mixture, np.array([0.0, 0.0, 200.0 + longer_mm]), np.array([0.0, 0.0, 1.0]))
    assert seen.value.size == 6
    found = given.there(seen, mixture)
    assert found is not None
    np.testing.assert_allclose(found.means_mm[0], mean, atol=1e-4)


@pytest.mark.parametrize(
    "along",
    [
        np.array([1.0, 0.0, 0.0]),
        np.array([0.0, 0.0, -1.0]),
        np.array([np.nan, 0.0, 1.0]),
        np.array([np.inf, 0.0, 1.0]),
    ],
    ids=["across", "back", "nan", "inf"],
)
def test_a_direction_that_cannot_be_is_left_out(along: FloatArray) -> None:
    given, mixture = conditioning(), mixture_at()
    assert given.seen(mixture, TIP_MM, along).value.size == 3
    assert given.seen(mixture, TIP_MM, np.array([0.03, -0.03, 1.0])).value.size == 6


def test_a_direction_that_is_not_asked_for_says_nothing() -> None:
    given, mixture = conditioning(accuracy_rad=None), mixture_at()
    seen = given.seen(mixture, TIP_MM, np.array([0.03, -0.03, 1.0]))
    assert seen.value.size == 3


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_a_tip_that_is_no_number_gives_nothing(wrong: float) -> None:
    given, mixture = conditioning(), mixture_at()
    seen = given.seen(mixture, np.array([wrong, 0.0, 200.0]), np.array([0.0, 0.0, 1.0]))
    assert given.there(seen, mixture) is None


def test_the_body_goes_with_its_model_and_is_known_less_the_farther_it_goes() -> None:
    given = conditioning(accuracy_mm=0.5)
    seen = given.seen(mixture_at(), TIP_MM, None)
    spreads, last_mm = [], 0.0
    for bend_mm in (0.0, 2.0, 10.0, 400.0):
        found = given.there(seen, mixture_at(bend_mm))
        assert found is not None
        ends = tips(found)
        spreads.append(float(ends[:, 1].std()))
        last_mm = float(ends[:, 0].mean()) - bend_mm
        if bend_mm <= 10.0:
            assert last_mm > 1.0, "what it was off by, it still is"
    assert spreads == sorted(spreads)
    assert spreads[1] < 1.0 < 1.5 < spreads[-1]
    assert abs(last_mm) < 0.2, "so far away nothing is known of it"


def test_how_far_it_has_gone_is_how_much_less_is_known() -> None:
    """Of one direction across the way there: variances add up as the constants say."""
    accuracy_mm, went_mm = 0.5, 10.0
    given = conditioning(accuracy_mm)
    centred = Mixture(np.ones(1), np.zeros((1, 4)), np.eye(4)[None] / 2.0)
    seen = given.seen(centred, BASIS.base_mm[-1].astype(np.float64), None)
    found = given.there(seen, Mixture(np.ones(1), np.eye(4)[:1] * went_mm, np.eye(4)[None] / 2.0))
    assert found is not None
    told = accuracy_mm**2 + (FORGETS * went_mm) ** 2
    own = 8.0 * (1.0 + OTHER_BODY * (2.0 / 3.0) * 1.5)
    # Tip along y: two coefficients of variance 4, and bends of the size of two thirds of that, as
    # the tip does not go along z.
    expected = 1.0 / (1.0 / own + 1.0 / told)
    variance = tips(found)[:, 1].var()
    assert variance == pytest.approx(expected, rel=0.05)


def test_what_the_tip_is_off_by_leaves_the_middle_less_known() -> None:
    """A load bends the body as no body did that the model has learnt."""
    given, mixture = conditioning(accuracy_rad=None), mixture_at()
    spreads = []
    for off_mm in (0.0, 10.0, 30.0):
        found = given.there(given.seen(mixture, np.array([off_mm, 0.0, 200.0]), None), mixture)
        assert found is not None
        middle = found.sample(40_000, np.random.default_rng(1)) @ BASIS.modes[:, 5, 0]
        spreads.append(float(middle.std()))
    assert spreads[0] < spreads[1] < spreads[2]
    assert spreads[2] > 0.1 * OFF_SHARE * 30.0


@pytest.mark.parametrize("rows", [3, 6])
def test_a_tip_goes_as_the_mean_goes_and_is_less_sure_by_a_share_of_its_way(rows: int) -> None:
    random = np.random.default_rng(rows)
    weights, means = np.array([0.2, 0.5, 0.3]), random.normal(size=(3, 4))
    before, matrix, offset = (
        random.normal(size=4),
        random.normal(size=(6, 4)),
        random.normal(size=6),
    )
    seen, unsure = random.normal(size=rows), np.array([0.3, 0.01])
    value, variance = np.empty(rows), np.empty(rows)
    write_moved_tip(
        *(weights, means, before, matrix, offset, seen, unsure, 200.0, 0.3, value, variance)
    )
    went = matrix[:rows] @ (weights @ means - before)
    np.testing.assert_allclose(value + offset[:rows], seen + went, rtol=1e-12)
    way = float(np.linalg.norm(went[:3]))
    np.testing.assert_allclose(variance[:3], 0.3 + (0.3 * way) ** 2, rtol=1e-12)
    if rows == 6:
        turned = max(float(np.linalg.norm(went[3:])), way / 200.0)
        np.testing.assert_allclose(variance[3:], 0.01 + (0.3 * turned) ** 2, rtol=1e-12)
