"""Depth cameras see what faces them, as well as such cameras do."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from config.emulation.plants import SoftArmPlant, TendonArmPlant
from sim_backends.devices.body_surface import BodySurface, PlacedSurface
from sim_backends.devices.depth_cameras import DepthCameras, DepthCameraSettings

FloatArray = NDArray[np.float64]

PERFECT = DepthCameraSettings(
    disparity_step_px=0.0,
    disparity_noise_px=0.0,
    flying_share=0.0,
    mismatched_share=0.0,
    misplaced_mm=0.0,
    misturned_rad=0.0,
)
TUBE = BodySurface(10.0)
LENGTH_MM = 200.0
STRAIGHT = np.column_stack([np.zeros((11, 2)), np.linspace(0.0, LENGTH_MM, 11)])


def arc(turn_rad: float) -> FloatArray:
    """(21, 3) of the same length, bent in the xz plane."""
    angle = np.linspace(0.0, turn_rad, 21)
    radius = LENGTH_MM / turn_rad
    return np.column_stack([radius * (1 - np.cos(angle)), 0 * angle, radius * np.sin(angle)])


def seen(
    line: FloatArray,
    settings: DepthCameraSettings = PERFECT,
    surface: BodySurface = TUBE,
    rig: int = 1,
    noise: int = 2,
) -> FloatArray:
    cameras = DepthCameras(surface, LENGTH_MM, rig, settings)
    return cameras.cloud(line, np.random.default_rng(noise))


def from_centreline(points: FloatArray, line: FloatArray) -> FloatArray:
    """(n,) mm to the nearest of many places of the line."""
    places = np.linspace(0.0, 1.0, 2001)
    nodes = np.linspace(0.0, 1.0, len(line))
    fine = np.column_stack([np.interp(places, nodes, line[:, k]) for k in range(3)])
    distances: FloatArray = np.linalg.norm(points[:, None, ::1] - fine[None, ::4], axis=2).min(1)
    return distances


def test_perfect_cameras_see_the_skin() -> None:
    line = arc(1.0)
    away = from_centreline(seen(line), line)
    assert np.abs(away - TUBE.tube_radius_mm).max() < 0.4


def test_both_sides_are_seen_and_what_no_camera_faces_is_not() -> None:
    cloud = seen(STRAIGHT)
    on_the_side = cloud[(cloud[:, 2] > 5.0) & (cloud[:, 2] < 195.0)]
    towards = np.abs(on_the_side[:, 0]) / TUBE.tube_radius_mm
    assert (on_the_side[:, 0] > 0).mean() == pytest.approx(0.5, abs=0.02)
    # A camera at a finite distance sees a little less than half of the tube.
    least = TUBE.tube_radius_mm / PERFECT.distance_mm
    assert least < towards.min() < 0.5


def test_one_part_of_the_body_hides_another() -> None:
    hairpin = np.concatenate([STRAIGHT, STRAIGHT[::-1] + np.array([40.0, 0.0, 0.0])])
    cloud = seen(hairpin)
    middle = cloud[np.abs(cloud[:, 2] - 100.0) < 60.0]
    between = middle[(middle[:, 0] > 2.0) & (middle[:, 0] < 38.0)]
    assert len(middle) > 200
    assert not len(between)


def test_disks_are_seen_from_the_edge_and_when_they_turn_from_their_face() -> None:
    surface = BodySurface(3.0, disks=9, disk_radius_mm=15.0)
    straight, bent = (
        from_centreline(seen(one, surface=surface), one) for one in (STRAIGHT, arc(1.2))
    )
    for away in (straight, bent):
        assert 14.9 < away.max() < 15.3
        assert 2.7 < away.min() < 3.2
    on_faces = [((away > 4.0) & (away < 12.0)).mean() for away in (straight, bent)]
    assert on_faces[1] > on_faces[0]


def test_depths_come_in_steps_of_the_disparity() -> None:
    settings = replace(PERFECT, disparity_step_px=1.0 / 8.0)
    cloud = seen(STRAIGHT, settings)
    one_side = cloud[cloud[:, 0] > 0]
    depth = PERFECT.distance_mm - one_side[:, 0]
    steps = PERFECT.focal_px * PERFECT.baseline_mm / depth * 8.0
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    assert len(np.unique(np.round(steps))) < 10


def test_noise_grows_with_the_square_of_the_depth() -> None:
    spreads = []
    for distance in (200.0, 400.0):
        settings = replace(PERFECT, disparity_noise_px=0.02, distance_mm=distance)
        cloud, true = (
            seen(STRAIGHT, settings),
            seen(STRAIGHT, replace(PERFECT, distance_mm=distance)),
        )
        spreads.append(float(np.std(cloud[:, 0] - true[:, 0])))
    assert spreads[1] / spreads[0] == pytest.approx(4.0, rel=0.25)


def test_some_pixels_at_silhouettes_fly_backwards_and_few_are_mismatched() -> None:
    flying = replace(PERFECT, flying_share=0.5)
    away = from_centreline(seen(STRAIGHT, flying), STRAIGHT)
    off = away > TUBE.tube_radius_mm + 1.0
    assert 0.003 < off.mean() < 0.05
    assert seen(STRAIGHT, flying).shape == seen(STRAIGHT).shape
    mismatched = replace(PERFECT, mismatched_share=0.05)
    wrong = np.abs(from_centreline(seen(STRAIGHT, mismatched), STRAIGHT) - 10.0) > 0.5
    assert wrong.mean() == pytest.approx(0.05, abs=0.02)


def test_a_rig_is_misplaced_once_and_stays_so() -> None:
    settings = replace(PERFECT, misplaced_mm=2.0)
    true = seen(STRAIGHT)
    first, again, other = (
        seen(STRAIGHT, settings, rig=rig, noise=n) for rig, n in ((1, 1), (1, 2), (2, 1))
    )
    np.testing.assert_array_equal(first, again)
    shift = np.abs(first.mean(axis=0) - true.mean(axis=0)).max()
    assert 0.05 < shift < 8.0
    assert first.shape != other.shape or np.abs(first - other).max() > 0.01


def test_the_same_noise_gives_the_same_cloud() -> None:
    usual = DepthCameraSettings()
    one, same, other = (seen(arc(0.8), usual, noise=noise) for noise in (3, 3, 4))
    np.testing.assert_array_equal(one, same)
    assert not np.array_equal(one[:100], other[:100])
    assert np.isfinite(one).all()


def test_the_usual_cameras_see_the_body_to_about_a_millimetre() -> None:
    line = arc(0.8)
    off = from_centreline(seen(line, DepthCameraSettings()), line) - TUBE.tube_radius_mm
    assert np.quantile(np.abs(off), 0.5) < 0.8
    assert np.quantile(np.abs(off), 0.95) < 3.0


def test_surfaces_are_as_thick_as_their_plants() -> None:
    tendon, soft = TendonArmPlant(kind="tendon_arm"), SoftArmPlant(kind="soft_arm")
    arm = BodySurface.of(tendon)
    assert arm.tube_radius_mm == pytest.approx(3.0, abs=0.01)
    assert arm.disks == tendon.disks
    assert tendon.tendon_radius_mm < arm.disk_radius_mm < tendon.body_radius_mm
    assert BodySurface.of(soft) == BodySurface(soft.body_radius_mm)


def test_disks_stand_across_the_body_the_last_one_at_its_tip() -> None:
    line = arc(1.0)
    placed = PlacedSurface.along(BodySurface(3.0, disks=4, disk_radius_mm=10.0), line)
    np.testing.assert_allclose(placed.disks_mm[-1], line[-1], atol=0.05)
    tip = np.array([np.sin(1.0), 0.0, np.cos(1.0)])
    np.testing.assert_allclose(placed.disk_axes[-1], tip, atol=1e-3)


@pytest.mark.parametrize("bad", [{"focal_px": 0.0}, {"flying_mm": -1.0}, {"distance_mm": np.nan}])
def test_cameras_that_cannot_be_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="camera"):
        replace(PERFECT, **bad)  # type: ignore[arg-type]
