"""How cameras stand to a base, and what is stated of fitted centrelines: beside the truth."""

import numpy as np
import pytest

from daemon.workbench.body_model.clouds.camera_alignment import CameraAlignment, alignment_of
from daemon.workbench.body_model.clouds.centreline_fit import VisibleSurface, fit_centreline
from daemon.workbench.body_model.evaluation.evaluation import off_curves
from safety.risk.model.mixture import FloatArray
from tests.daemon.workbench.body_model.clouds.test_centreline_fit import TUBE, bent, skin
from tests.daemon.workbench.body_model.seen_bodies import seen_bodies

pytestmark = pytest.mark.xdist_group("camera_alignment")  # whose clouds are seen once for all tests

NODES = 21
BENDS = np.random.default_rng(8).uniform(-1.2, 1.2, (10, 2))
OFF = np.array([0.7, -0.9, 0.4])


def turned(points: FloatArray, angle: float) -> FloatArray:
    """About z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))


LINES = np.array([turned(bent(*bend), k) for k, bend in enumerate(BENDS)])
CLOUDS = np.array([turned(skin(bent(*bend), 250, k), k) for k, bend in enumerate(BENDS)])


@pytest.fixture(scope="module")
def unmoved() -> CameraAlignment:
    """Of cameras that stand where they should."""
    found = alignment_of(CLOUDS, [TUBE] * len(CLOUDS), NODES)
    assert found is not None
    return found


def rms(off: FloatArray) -> float:
    return float(np.sqrt(np.square(off).mean()))


def test_clouds_are_moved_back_to_where_bodies_begin(unmoved: CameraAlignment) -> None:
    found = alignment_of(CLOUDS + OFF, [TUBE] * len(CLOUDS), NODES)
    assert found is not None
    assert found.doubt == ""
    assert found.clouds == len(CLOUDS)
    np.testing.assert_allclose(found.shift_mm[:2], -OFF[:2], atol=0.1)
    # Along the base's axis a round body that may stretch tells little: not the wrong way, at least.
    assert -2.0 * OFF[2] < found.shift_mm[2] < 0.1
    np.testing.assert_allclose(unmoved.shift_mm, 0.0, atol=0.2)


def test_one_body_that_is_torn_off_does_not_move_the_others(unmoved: CameraAlignment) -> None:
    torn = CLOUDS.copy()
    torn[3] += np.array([4.0, 3.0, 0.0])
    found = alignment_of(torn, [TUBE] * len(torn), NODES)
    assert found is not None
    np.testing.assert_allclose(found.shift_mm, unmoved.shift_mm, atol=0.1)


def test_two_cameras_that_do_not_agree_show_in_the_stated_error(
    unmoved: CameraAlignment,
) -> None:
    """What is seen from one side is 1 mm aside: the fit goes through the middle, half of it off."""
    towards = np.array([1.0, 0.0, 0.0])
    apart = CLOUDS.copy()
    for cloud, line in zip(apart, LINES, strict=True):
        nearest = np.square(cloud[:, None] - line).sum(axis=2).argmin(axis=1)
        cloud[(cloud - line[nearest]) @ towards > 0.0] += np.array([0.0, 1.0, 0.0])
    found = alignment_of(apart, [TUBE] * len(apart), NODES)
    assert found is not None
    assert np.median(unmoved.fit_error_mm[4:]) < 0.25
    assert 0.35 < np.median(found.fit_error_mm[4:]) < 0.75


@pytest.mark.parametrize("name", ["tendon_arm", pytest.param("soft_arm", marks=pytest.mark.long)])
def test_the_stated_error_is_about_the_true_one(name: str) -> None:
    """Of emulated bodies; and it is less than half of what it is with the cameras as they stand."""
    seen = seen_bodies(name, 5)
    lines = seen.clouds["true_centrelines_mm"]
    nodes = lines.shape[2]
    lines = lines.reshape(-1, nodes, 3)
    clouds = seen.clouds["clouds_mm"].reshape(len(lines), -1, 3)
    found = alignment_of(clouds, [seen.surface] * len(clouds), nodes)
    assert found is not None
    off = [
        np.array([fit_centreline(cloud + by, seen.surface, nodes).nodes_mm for cloud in clouds])
        for by in (np.zeros(3), found.shift_mm)
    ]
    before, after = (rms(off_curves(fitted, lines)) for fitted in off)
    assert after < 0.6 * before
    assert 0.7 * after < rms(found.fit_error_mm) < 2.0 * after


def test_a_single_camera_is_aligned_as_well() -> None:
    """It sees one side only: there is the noise to be stated, and nothing else to compare with."""
    seen_from = np.array([0.0, -1.0, 0.0])
    half = []
    for k, bend in enumerate(BENDS):
        cloud, line = skin(bent(*bend), 600, k), bent(*bend)
        nearest = np.square(cloud[:, None] - line).sum(axis=2).argmin(axis=1)
        half.append(cloud[(cloud - line[nearest]) @ seen_from > 0.0][:200])
    found = alignment_of(np.array(half), [TUBE] * len(half), NODES)
    assert found is not None
    np.testing.assert_allclose(found.shift_mm, 0.0, atol=0.4)
    assert 0.02 < np.median(found.fit_error_mm[4:]) < 0.6


def test_cameras_that_stand_elsewhere_are_doubted() -> None:
    found = alignment_of(CLOUDS + np.array([9.0, 0.0, 0.0]), [TUBE] * len(CLOUDS), NODES)
    assert found is not None
    assert "begin at (9" in found.doubt
    assert "calibrate the cameras" in found.doubt


def test_clouds_in_which_nobody_lies_align_nothing() -> None:
    strewn = np.random.default_rng(2).uniform(-90.0, 90.0, (4, 60, 3))
    assert alignment_of(strewn, [VisibleSurface(200.0, 2.0)] * len(strewn), NODES) is None
