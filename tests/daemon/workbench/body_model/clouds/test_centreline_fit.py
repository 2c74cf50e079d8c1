"""Centrelines from clouds: those of the emulated bodies are known, and found again."""

import numpy as np
import pytest
from numpy.typing import NDArray

from daemon.workbench.body_model.clouds.centreline_fit import VisibleSurface, fit_centreline
from tests.daemon.workbench.body_model.seen_bodies import seen_bodies

FloatArray = NDArray[np.float64]
TUBE = VisibleSurface(200.0, 8.0)


def off_curve(nodes_mm: FloatArray, curve_mm: FloatArray) -> FloatArray:
    """(n,) distances of nodes from a curve through other nodes."""
    share = np.linspace(0.0, 1.0, 20, endpoint=False)[:, None, None]
    fine = (curve_mm[:-1] + share * np.diff(curve_mm, axis=0)).reshape(-1, 3)
    fine = np.concatenate([fine, curve_mm[-1:]])
    return np.asarray(np.linalg.norm(nodes_mm[:, None] - fine, axis=2).min(axis=1))


@pytest.mark.parametrize("name", ["tendon_arm", "soft_arm"])
def test_where_an_emulated_body_was_is_found_in_what_cameras_saw(name: str) -> None:
    seen = seen_bodies(name)
    off, tips = [], []
    for clouds, lines in zip(
        seen.clouds["clouds_mm"], seen.clouds["true_centrelines_mm"].astype(np.float64), strict=True
    ):
        for cloud, line in zip(clouds, lines, strict=True):
            fit = fit_centreline(cloud, seen.surface, len(line))
            assert fit.near > 0.97
            assert fit.unseen < 0.15
            off.append(off_curve(line, fit.nodes_mm))
            tips.append(np.linalg.norm(fit.nodes_mm[-1] - line[-1]))
    assert np.median(off) < 1.0
    assert np.max(off) < 2.5
    assert np.max(tips) < 2.5


def bent(
    first_rad: float, second_rad: float, pieces: int = 60, length_mm: float = 200.0
) -> FloatArray:
    """(pieces + 1, 3) in the x-z plane: one half turns by so much, the other by so much more."""
    half = pieces // 2
    turns = np.concatenate([np.full(half, first_rad / half), np.full(half, second_rad / half)])
    angle = np.cumsum(turns) - 0.5 * turns
    steps = length_mm / pieces * np.stack([np.sin(angle), 0.0 * angle, np.cos(angle)], axis=1)
    return np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])


def skin(line: FloatArray, count: int, seed: int = 1, noise_mm: float = 0.4) -> FloatArray:
    """(count, 3) points on a tube round a line in the x-z plane, a tenth on its round end."""
    random = np.random.default_rng(seed)
    at = random.uniform(0.0, len(line) - 1.001, count)
    which, share = at.astype(int), (at % 1.0)[:, None]
    way = np.diff(line, axis=0)[which]
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    aside = np.cross(way, [0.0, 1.0, 0.0])
    turn = random.uniform(0.0, 2.0 * np.pi, (count, 1))
    outwards = np.cos(turn) * aside + np.sin(turn) * np.array([0.0, 1.0, 0.0])
    middle = line[which] * (1.0 - share) + line[which + 1] * share
    end = random.permutation(count)[: count // 10]
    up = random.normal(size=(len(end), 3))
    up *= np.sign(up @ way[np.argmax(at)])[:, None]
    outwards[end] = up / np.linalg.norm(up, axis=1, keepdims=True)
    middle[end] = line[-1]
    noise = noise_mm * random.normal(size=(count, 3))
    return np.asarray(middle + TUBE.tube_radius_mm * outwards + noise)


@pytest.mark.parametrize(
    ("first", "second"), [(0.0, 0.0), (1.0, 1.0), (1.2, -1.2), (-0.4, 1.8), (1.6, 1.0)]
)
def test_bends_of_all_kinds_are_found(first: float, second: float) -> None:
    line = bent(first, second)
    fit = fit_centreline(skin(line, 250), TUBE, 21)
    assert np.max(off_curve(fit.nodes_mm, line)) < 2.5
    assert np.linalg.norm(fit.nodes_mm[-1] - line[-1]) < 3.0
    assert fit.miss_mm < 0.6


def test_what_is_not_of_the_body_counts_next_to_nothing() -> None:
    line, random = bent(0.8, 0.3), np.random.default_rng(5)
    strewn = random.uniform([-150.0, -100.0, 0.0], [150.0, 100.0, 220.0], (25, 3))
    alone = fit_centreline(skin(line, 250), TUBE, 21)
    among = fit_centreline(np.concatenate([skin(line, 250), strewn]), TUBE, 21)
    assert np.linalg.norm(among.nodes_mm - alone.nodes_mm, axis=1).max() < 1.0
    assert among.near < alone.near


def test_a_part_that_is_not_seen_is_filled_in_and_told() -> None:
    line = bent(0.7, 0.7)
    points = skin(line, 400)
    along = np.linalg.norm(points, axis=1)
    fit = fit_centreline(points[(along < 70.0) | (along > 120.0)], TUBE, 21)
    assert np.max(off_curve(fit.nodes_mm, line)) < 3.0
    assert 0.15 < fit.unseen < 0.35


@pytest.mark.parametrize("stretch", [0.85, 1.0, 1.2])
def test_a_body_that_stretches_is_as_long_as_it_is_seen(stretch: float) -> None:
    line = bent(0.9, 0.2, length_mm=200.0 * stretch)
    fit = fit_centreline(skin(line, 300), TUBE, 21)
    found = np.linalg.norm(np.diff(fit.nodes_mm, axis=0), axis=1).sum()
    assert found == pytest.approx(200.0 * stretch, abs=2.0)


def test_another_body_is_not_taken_for_this_one() -> None:
    fit = fit_centreline(skin(bent(0.2, 0.2), 250), VisibleSurface(60.0, 2.0), 21)
    assert fit.near < 0.5


@pytest.mark.parametrize("points", [np.zeros((60, 3)), np.ones((60, 3)), np.eye(3).repeat(20, 0)])
def test_points_that_are_no_body_do_no_harm(points: FloatArray) -> None:
    fit = fit_centreline(points, TUBE, 21)
    assert np.isfinite(fit.nodes_mm).all()
    assert fit.unseen > 0.5


@pytest.mark.parametrize(
    "points", [np.zeros((29, 3)), np.full((60, 3), np.nan), np.full((60, 3), np.inf)]
)
def test_too_little_and_what_is_not_finite_is_refused(points: FloatArray) -> None:
    with pytest.raises(ValueError, match="30 points, all of them finite"):
        fit_centreline(points, TUBE, 21)


@pytest.mark.parametrize("sizes", [(0.0, 8.0), (200.0, -1.0), (200.0, 8.0, 3), (float("nan"), 8.0)])
def test_a_body_without_size_is_refused(sizes: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="must be positive"):
        VisibleSurface(*sizes)  # type: ignore[arg-type]
