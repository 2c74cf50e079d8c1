"""The pose filter: what it believes, and how good its estimate is."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from config.control import PoseFilterSettings
from daemon.estimation.constant_velocity import from_rotation_vector, rotation_vector
from daemon.estimation.pose_filter import FRAMES_FOR_QUALITY, PoseFilter, TipEstimate
from drivers.pose import Pose, Vector, conjugate, multiply

SETTINGS = PoseFilterSettings()
PERIOD_NS = 25_000_000
START = SETTINGS.outliers_in_a_row
"""Frames that it takes until there is an estimate."""

Motion = Callable[[float], Pose]


def resting(_t_s: float = 0.0) -> Pose:
    return Pose(np.array([5.0, -3.0, 180.0]), np.array([1.0, 0.0, 0.0, 0.0]))


def sweeping(t_s: float) -> Pose:
    """A smooth motion, up to 16 mm/s and 0.5 rad/s."""
    phase = 0.8 * t_s
    return Pose(
        np.array([20.0 * np.sin(phase), 15.0 * np.cos(0.7 * phase), 180.0 + 5.0 * np.sin(phase)]),
        turn(np.array([0.6 * np.sin(phase), 0.4 * np.cos(phase), 0.2])),
    )


def noisy(pose: Pose, generator: np.random.Generator) -> Pose:
    shake = turn(SETTINGS.orientation_noise_rad * generator.normal(size=3))
    return Pose(
        pose.position_mm + SETTINGS.position_noise_mm * generator.normal(size=3),
        multiply(pose.quaternion, shake),
    )


def angle(one: Vector, other: Vector) -> float:
    return float(np.linalg.norm(rotation_vector(multiply(conjugate(one), other).tolist())))


def turn(vector: Vector) -> Vector:
    """The quaternion of a rotation vector."""
    return np.array(from_rotation_vector(vector.tolist()))


def moved(pose: Pose, by_mm: float) -> Pose:
    return Pose(pose.position_mm + np.array([by_mm, 0.0, 0.0]), pose.quaternion)


def following(motion: Motion, frames: int, seed: int = 1) -> tuple[PoseFilter, int]:
    """A filter that has seen so many noisy frames, and the time of the last."""
    pose_filter, generator = PoseFilter(SETTINGS), np.random.default_rng(seed)
    for k in range(1, frames + 1):
        pose_filter.update(k * PERIOD_NS, noisy(motion(k * PERIOD_NS * 1e-9), generator))
    return pose_filter, frames * PERIOD_NS


def there(pose_filter: PoseFilter, t_ns: int) -> TipEstimate:
    estimate = pose_filter.estimate(t_ns)
    assert estimate is not None
    return estimate


def test_there_is_no_estimate_before_several_measurements_agree() -> None:
    pose_filter = PoseFilter(SETTINGS)
    believed = [pose_filter.update(k * PERIOD_NS, resting()) for k in range(1, START + 1)]
    assert believed == [False] * (START - 1) + [True]
    np.testing.assert_allclose(
        there(pose_filter, START * PERIOD_NS).position_mm, resting().position_mm, atol=1e-9
    )


def test_an_outlier_as_the_first_measurement_is_not_taken_for_the_start() -> None:
    pose_filter = PoseFilter(SETTINGS)
    pose_filter.update(PERIOD_NS, moved(resting(), 30.0))
    assert pose_filter.estimate(PERIOD_NS) is None
    for k in range(2, START + 2):
        pose_filter.update(k * PERIOD_NS, resting())
    estimate = there(pose_filter, (START + 1) * PERIOD_NS)
    np.testing.assert_allclose(estimate.position_mm, resting().position_mm, atol=1e-9)


@pytest.mark.parametrize("motion", [resting, sweeping])
def test_the_estimate_is_nearer_to_the_truth_than_the_measurements(motion: Motion) -> None:
    pose_filter, generator = PoseFilter(SETTINGS), np.random.default_rng(7)
    errors: list[tuple[float, float, float, float]] = []
    for k in range(1, 1200):
        t_ns = k * PERIOD_NS
        truth = motion(t_ns * 1e-9)
        measured = noisy(truth, generator)
        pose_filter.update(t_ns, measured)
        if k > 40:
            estimate = there(pose_filter, t_ns)
            errors.append(
                (
                    float(np.linalg.norm(estimate.position_mm - truth.position_mm)),
                    float(np.linalg.norm(measured.position_mm - truth.position_mm)),
                    angle(estimate.quaternion, truth.quaternion),
                    angle(measured.quaternion, truth.quaternion),
                )
            )
    ours_mm, theirs_mm, ours_rad, theirs_rad = np.sqrt(np.mean(np.square(errors), axis=0))
    assert ours_mm < 0.8 * theirs_mm
    assert ours_rad < 0.9 * theirs_rad


def test_the_standard_deviation_tells_how_good_the_estimate_is() -> None:
    errors = []
    for seed in range(60):
        pose_filter, now_ns = following(resting, 60, seed)
        estimate = there(pose_filter, now_ns)
        errors += list(estimate.position_mm - resting().position_mm)
    assert np.std(errors) < 1.1 * estimate.position_std_mm
    assert estimate.position_std_mm < SETTINGS.position_noise_mm


def test_velocity_follows_a_steady_motion() -> None:
    velocity = np.array([12.0, -5.0, 3.0])

    def steady(t_s: float) -> Pose:
        return Pose(velocity * t_s, resting().quaternion)

    pose_filter = PoseFilter(SETTINGS)
    for k in range(1, 80):
        pose_filter.update(k * PERIOD_NS, steady(k * PERIOD_NS * 1e-9))
    np.testing.assert_allclose(there(pose_filter, 79 * PERIOD_NS).velocity_mm_s, velocity, atol=0.1)


def test_an_estimate_for_later_makes_up_for_latency() -> None:
    late_ns = 40_000_000
    pose_filter, generator = PoseFilter(SETTINGS), np.random.default_rng(3)
    plain, ahead = [], []
    for k in range(1, 800):
        t_ns = k * PERIOD_NS
        pose_filter.update(t_ns, noisy(sweeping(t_ns * 1e-9), generator))
        if k > 40:
            truth = sweeping((t_ns + late_ns) * 1e-9).position_mm
            plain.append(np.linalg.norm(there(pose_filter, t_ns).position_mm - truth))
            ahead.append(np.linalg.norm(there(pose_filter, t_ns + late_ns).position_mm - truth))
    assert np.mean(ahead) < 0.75 * np.mean(plain)


@pytest.mark.parametrize("by_mm", [5.0, 50.0, -20.0])
def test_a_single_outlier_is_not_believed_and_moves_nothing(by_mm: float) -> None:
    pose_filter, now_ns = following(sweeping, 100)
    truth = sweeping((now_ns + PERIOD_NS) * 1e-9)
    before = there(pose_filter, now_ns + PERIOD_NS).position_mm
    assert not pose_filter.update(now_ns + PERIOD_NS, moved(truth, by_mm))
    after = there(pose_filter, now_ns + PERIOD_NS)
    np.testing.assert_array_equal(after.position_mm, before)
    assert after.age_s == pytest.approx(0.025)
    now_ns += 2 * PERIOD_NS
    assert pose_filter.update(now_ns, sweeping(now_ns * 1e-9))


def test_a_wild_orientation_makes_an_outlier_of_a_good_position() -> None:
    pose_filter, now_ns = following(resting, 60)
    turned = Pose(resting().position_mm, turn(np.array([0.0, 1.0, 0.0])))
    assert not pose_filter.update(now_ns + PERIOD_NS, turned)


def test_outliers_that_do_not_agree_are_never_believed() -> None:
    pose_filter, now_ns = following(resting, 60)
    for k in range(1, 5 * START):
        far = moved(resting(), 20.0 if k % 2 else -20.0)
        assert not pose_filter.update(now_ns + k * PERIOD_NS, far)


def test_the_tip_has_moved_when_enough_in_a_row_say_so() -> None:
    pose_filter, now_ns = following(resting, 60)
    believed = []
    for _ in range(START):
        now_ns += PERIOD_NS
        believed.append(pose_filter.update(now_ns, moved(resting(), 20.0)))
    assert believed == [False] * (START - 1) + [True]
    estimate = there(pose_filter, now_ns)
    np.testing.assert_allclose(estimate.position_mm, moved(resting(), 20.0).position_mm, atol=1e-6)
    assert pose_filter.update(now_ns + PERIOD_NS, moved(resting(), 20.0))


def led_back(t_s: float) -> Pose:
    """From 20 mm aside, at 80 mm/s within a tenth of a second, and as suddenly at rest."""
    times = np.arange(0.0, t_s, 1e-3)
    speed_mm_s = 80.0 * np.clip(np.minimum(times / 0.1, (0.4 - times) / 0.1), 0.0, 1.0)
    return moved(resting(), 20.0 - float(speed_mm_s.sum()) * 1e-3)


def test_a_tip_that_was_pushed_is_not_lost_while_it_is_led_back() -> None:
    pose_filter, now_ns = following(resting, 60)
    for _ in range(START):
        now_ns += PERIOD_NS
        pose_filter.update(now_ns, moved(resting(), 20.0))
    begun_ns = now_ns
    while now_ns - begun_ns < 600_000_000:
        now_ns += PERIOD_NS
        pose = led_back((now_ns - begun_ns) * 1e-9)
        assert pose_filter.update(now_ns, pose)
        assert np.linalg.norm(there(pose_filter, now_ns).position_mm - pose.position_mm) < 1.0


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("by_mm", np.arange(1.0, 9.0, 0.5).tolist())
def test_no_jump_is_taken_for_speed(by_mm: float, seed: int) -> None:
    """However far: one that may be believed after some frames, for by then the tip may be anywhere,
    lets no estimate fly past it."""
    pose_filter, now_ns = following(resting, 60, seed)
    generator, last = np.random.default_rng(seed + 100), 0.0
    for _ in range(2 * START):
        now_ns += PERIOD_NS
        believed = pose_filter.update(now_ns, noisy(moved(resting(), by_mm), generator))
        last = float((there(pose_filter, now_ns).position_mm - resting().position_mm)[0])
        assert last < by_mm + 0.8
        assert believed or last < 0.8
    assert last > by_mm - 0.8


@pytest.mark.parametrize("after_mm", [0.8, 1.2])
def test_an_outlier_and_a_little_more_noise_are_no_jump(after_mm: float) -> None:
    """What would have been believed in the outlier's place is nothing that began elsewhere."""

    def passing(t_s: float) -> Pose:
        return moved(resting(), 8.0 * t_s)

    pose_filter, now_ns = following(passing, 60)
    for off_mm in (2.5, after_mm):
        now_ns += PERIOD_NS
        believed = pose_filter.update(now_ns, moved(passing(now_ns * 1e-9), off_mm))
        assert believed == (off_mm == after_mm)
        assert pose_filter.jumped_mm == 0.0
    assert there(pose_filter, now_ns).velocity_mm_s[0] > 0.0


def test_what_would_be_lost_is_an_outlier_again_when_the_tip_is_back() -> None:
    pose_filter, now_ns = following(resting, 60)
    pushed = moved(resting(), 20.0)
    for _ in range(START + 60):
        now_ns += PERIOD_NS
        pose_filter.update(now_ns, pushed)
    calm, ns = following(lambda _: pushed, 60 + START)
    assert not calm.update(ns + PERIOD_NS, moved(pushed, 2.0))
    assert not pose_filter.update(now_ns + PERIOD_NS, moved(pushed, 2.0))


def jumps(poses: list[Pose]) -> list[float]:
    """How far the tip is told to have jumped at each of these measurements, after a steady motion
    at 40 mm/s along y."""
    pose_filter = PoseFilter(SETTINGS)
    told = []
    for frame in range(60 + len(poses)):
        pose = poses[frame - 60] if frame >= 60 else gone(frame)
        pose_filter.update(frame * PERIOD_NS, pose)
        told.append(pose_filter.jumped_mm)
    assert told[:60] == [0.0] * 60
    return told[60:]


def gone(frames: int, aside_mm: float = 0.0) -> Pose:
    return Pose(np.array([aside_mm, frames * 1.0, 180.0]), np.array([1.0, 0.0, 0.0, 0.0]))


def test_a_tip_that_is_suddenly_elsewhere_and_goes_on_there_has_jumped() -> None:
    told = jumps([gone(60 + after, 12.0) for after in range(10)])
    assert told[START - 1] == pytest.approx(12.0, abs=0.5)
    assert [jump for jump in told if jump] == [told[START - 1]]


def test_a_tip_that_is_flung_aside_over_many_frames_has_not_jumped() -> None:
    assert jumps([gone(60 + after, 12.0 * after) for after in range(10)]) == [0.0] * 10


def test_an_outlier_or_a_gap_is_no_jump() -> None:
    one = [gone(60, 30.0), *(gone(61 + after) for after in range(9))]
    assert jumps(one) == [0.0] * 10
    pose_filter, frames = following(resting, 60)
    for later in range(10):
        pose_filter.update((frames + 40 + later) * PERIOD_NS, moved(resting(), 12.0))
        assert pose_filter.jumped_mm == 0.0


def test_a_good_measurement_between_outliers_breaks_their_row() -> None:
    pose_filter, now_ns = following(resting, 60)
    for k in range(1, 4 * START):
        now_ns += PERIOD_NS
        good = k % (START - 1) == 0
        assert pose_filter.update(now_ns, resting() if good else moved(resting(), 20.0)) == good


def test_a_short_gap_is_bridged_and_a_long_one_is_not() -> None:
    pose_filter, now_ns = following(sweeping, 100)
    for k in range(1, 5):
        assert not pose_filter.update(now_ns + k * PERIOD_NS, None)
    later_ns = now_ns + 4 * PERIOD_NS
    estimate = there(pose_filter, later_ns)
    assert estimate.age_s == pytest.approx(0.1)
    truth = sweeping(later_ns * 1e-9).position_mm
    assert np.linalg.norm(estimate.position_mm - truth) < 2.0
    assert estimate.position_std_mm > there(pose_filter, now_ns).position_std_mm
    too_late_ns = now_ns + round(SETTINGS.predict_for_s * 1e9) + 1
    assert pose_filter.estimate(too_late_ns - 1) is not None
    assert pose_filter.estimate(too_late_ns) is None


def test_after_a_long_gap_one_measurement_is_not_enough() -> None:
    pose_filter, now_ns = following(resting, 60)
    now_ns += 1_000_000_000
    assert not pose_filter.update(now_ns, moved(resting(), 1.0))
    assert pose_filter.estimate(now_ns) is None
    for k in range(1, START):
        pose_filter.update(now_ns + k * PERIOD_NS, moved(resting(), 1.0))
    assert pose_filter.estimate(now_ns + (START - 1) * PERIOD_NS) is not None


@settings(max_examples=40, deadline=None)
@given(
    what=st.sampled_from(["position", "quaternion"]),
    index=st.integers(0, 2),
    value=st.sampled_from([float("nan"), float("inf"), -float("inf"), 1e300]),
    started=st.booleans(),
)
def test_what_is_not_a_pose_is_never_believed(
    what: str, index: int, value: float, started: bool
) -> None:
    pose_filter, now_ns = following(resting, 60 if started else 0)
    position, quaternion = resting().position_mm.copy(), resting().quaternion.copy()
    (position if what == "position" else quaternion)[index] = value
    for _ in range(2 * START):
        now_ns += PERIOD_NS
        assert not pose_filter.update(now_ns, Pose(position, quaternion))
    for _ in range(START):
        now_ns += PERIOD_NS
        pose_filter.update(now_ns, resting())
    estimate = there(pose_filter, now_ns)
    assert np.isfinite(estimate.position_mm).all()
    assert np.isfinite(estimate.quaternion).all()


def test_a_quaternion_that_is_no_rotation_is_not_believed() -> None:
    pose_filter, now_ns = following(resting, 60)
    for bad in (np.zeros(4), np.array([0.5, 0.0, 0.0, 0.0])):
        now_ns += PERIOD_NS
        assert not pose_filter.update(now_ns, Pose(resting().position_mm, bad))


def test_frames_that_are_not_newer_are_ignored() -> None:
    pose_filter, now_ns = following(resting, 60)
    before = there(pose_filter, now_ns)
    for t_ns in (now_ns, now_ns - PERIOD_NS, 0):
        assert not pose_filter.update(t_ns, moved(resting(), 0.3))
        assert not pose_filter.update(t_ns, None)
    after = there(pose_filter, now_ns)
    np.testing.assert_array_equal(after.position_mm, before.position_mm)
    assert after.quality == before.quality


def test_a_sign_that_flips_in_the_measurements_does_not_flip_in_the_estimate() -> None:
    pose_filter, generator = PoseFilter(SETTINGS), np.random.default_rng(5)
    last: Vector | None = None
    for k in range(1, 1500):
        spun = turn(np.array([0.0, 0.0, 0.3]))
        round_y = turn(np.array([0.0, 0.02 * k, 0.0]))  # twice round and more
        pose = noisy(Pose(resting().position_mm, multiply(round_y, spun)), generator)
        sign = 1.0 if generator.random() < 0.5 else -1.0
        pose_filter.update(k * PERIOD_NS, Pose(pose.position_mm, sign * pose.quaternion))
        estimate = pose_filter.estimate(k * PERIOD_NS + 10_000_000)
        if estimate is not None:
            assert abs(np.linalg.norm(estimate.quaternion) - 1.0) < 1e-9
            assert last is None or last @ estimate.quaternion > 0.9
            last = estimate.quaternion
    assert last is not None


def test_quality_is_the_share_of_recent_frames_that_were_believed() -> None:
    pose_filter, now_ns = following(resting, 3 * FRAMES_FOR_QUALITY)
    assert pose_filter.quality == 1.0
    for k in range(1, FRAMES_FOR_QUALITY + 1):
        missing = k % 4 == 0
        pose_filter.update(now_ns + k * PERIOD_NS, None if missing else resting())
    assert pose_filter.quality == pytest.approx(0.75)


def test_reset_forgets_everything() -> None:
    pose_filter, now_ns = following(resting, 60)
    pose_filter.reset()
    assert pose_filter.estimate(now_ns) is None
    assert pose_filter.quality == 0.0
    assert not pose_filter.update(PERIOD_NS, resting())


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3))
def test_a_rotation_vector_comes_back_from_its_quaternion(values: list[float]) -> None:
    vector = np.array(values)
    vector *= min(1.0, 3.1 / max(float(np.linalg.norm(vector)), 1e-9))
    np.testing.assert_allclose(rotation_vector(turn(vector).tolist()), vector, atol=1e-9)
    np.testing.assert_allclose(rotation_vector((-turn(vector)).tolist()), vector, atol=1e-9)
