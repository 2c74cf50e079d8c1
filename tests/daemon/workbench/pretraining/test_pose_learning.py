"""A pose model of concentric tubes: learnt, asked across the seam, kept; and how good it is."""

import json
from pathlib import Path

import numpy as np
import pytest

from config.emulation.plants import ConcentricTubesPlant
from config.loader import load_robot
from daemon.array_files import ModelError, save_npz
from daemon.commands.outcome.exit_codes import EXIT_CONFIGURATION, EXIT_FAILED, EXIT_USAGE
from daemon.commands.terminal.command_line import main
from daemon.learning.forward.pose_model import PoseModel, sized_metric
from daemon.workbench.pretraining.pose_learning import (
    LearntPose,
    PoseErrors,
    PoseLearningError,
    PoseLearningSettings,
    curvature_metric,
    errors_of,
    learn_pose,
)
from sim_backends.plants.concentric.relative import Poses, RelativeTubes
from tests import SHIPPED_ROBOTS

pytestmark = pytest.mark.xdist_group("pose_learning")  # whose model is learnt once for all tests

FILE = SHIPPED_ROBOTS / "concentric_tubes.yaml"
SHIPPED = SHIPPED_ROBOTS.parent / "models" / "concentric_tubes_pose.npz"
SMALL = PoseLearningSettings(points=16, fields=100)
PAPER_MM = np.array([0.97, 0.87, 0.41])
PAPER_RAD = np.radians(1.89)


def tubes(extension_mm: tuple[float, float] | None = None) -> RelativeTubes:
    robot = load_robot(FILE).robot
    assert robot.emulation is not None
    assert isinstance(robot.emulation.plant, ConcentricTubesPlant)
    return RelativeTubes(robot.emulation.plant, robot.axes, extension_mm)


@pytest.fixture(scope="module")
def learnt() -> LearntPose:
    return learn_pose(tubes(), SMALL, {"robot": "made up"})


def test_a_small_model_knows_the_tip_to_a_few_millimetres(learnt: LearntPose) -> None:
    assert 70 < learnt.model.lwpr.count <= 100
    assert learnt.learnt + learnt.kept_back == 16**3
    assert learnt.kept_back == round(0.15 * 16**3)
    assert (learnt.errors.position_mm < 5.0).all()
    assert learnt.errors.angle_rad < 0.1


def test_more_fields_know_more(learnt: LearntPose) -> None:
    more = learn_pose(tubes(), PoseLearningSettings(points=16, fields=250), {})
    assert (more.errors.position_mm < 0.95 * learnt.errors.position_mm).all()
    assert more.errors.angle_rad < 0.85 * learnt.errors.angle_rad


def test_the_model_is_the_same_on_both_sides_of_the_seam(learnt: LearntPose) -> None:
    for out_mm in (25.0, 60.0):
        for other in (-2.0, 0.5):
            for seam in (0, 1):
                here, there = np.array([other, other, out_mm]), np.array([other, other, out_mm])
                here[seam], there[seam] = np.pi - 1e-9, -np.pi + 1e-9
                one, two = learnt.model.predict(here), learnt.model.predict(there)
                np.testing.assert_allclose(one.position_mm, two.position_mm, atol=1e-5)
                np.testing.assert_allclose(one.direction, two.direction, atol=1e-6)


def test_directions_have_unit_length_and_are_not_known_where_nothing_was_learnt(
    learnt: LearntPose,
) -> None:
    said = learnt.model.predict(np.array([0.3, -0.4, 50.0]))
    assert np.linalg.norm(said.direction) == pytest.approx(1.0)
    far = learnt.model.predict(np.array([0.3, -0.4, 5000.0]))
    assert np.isnan(far.position_mm).all()
    assert np.isnan(far.direction).all()


def test_the_same_seed_gives_the_same_model_to_the_last_bit(learnt: LearntPose) -> None:
    again = learn_pose(tubes(), SMALL, {})
    at = np.array([1.0, -2.0, 33.0])
    np.testing.assert_array_equal(
        again.model.predict(at).position_mm, learnt.model.predict(at).position_mm
    )


def test_errors_are_root_mean_squares_of_what_is_off() -> None:
    class Off:
        def predict(self, configuration: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            from daemon.learning.forward.pose_model import PoseOfTip

            turned = np.array([np.sin(0.1), 0.0, np.cos(0.1)])
            return PoseOfTip(configuration + np.array([1.0, -2.0, 3.0]), turned)

    places = np.array([[0.0, 0.0, 0.0], [10.0, 20.0, 30.0]])
    rows = np.hstack([places, np.tile([0.0, 0.0, 1.0], (2, 1))])
    found = errors_of(Off(), places, rows)  # type: ignore[arg-type]
    assert isinstance(found, PoseErrors)
    np.testing.assert_allclose(found.position_mm, [1.0, 2.0, 3.0])
    assert found.angle_rad == pytest.approx(0.1)
    np.testing.assert_allclose(found.position_percent, [10.0, 10.0, 10.0])
    assert found.angle_percent == pytest.approx(100.0 * 0.1 / np.pi)


def test_fields_are_narrow_where_the_pose_bends() -> None:
    """x² / 2 along one number, a tenth of it along the other: H is diag(1, 0.1)."""
    steps = np.linspace(-1.0, 1.0, 9)
    x, y = (part.ravel() for part in np.meshgrid(steps, steps, indexing="ij"))
    tip = np.stack([0.5 * x * x + 0.05 * y * y, 0.0 * x, 0.0 * x], axis=1)
    mixed = np.random.default_rng(0).permutation(len(x))
    poses = Poses(np.stack([x, y], axis=1)[mixed], tip[mixed], tip[mixed])
    metric = curvature_metric(poses, 9, np.ones(2))
    np.testing.assert_allclose(metric / metric[0, 0], np.diag([1.0, 0.1]), atol=1e-9)
    assert np.trace(metric) == pytest.approx(2.0)


def test_a_grid_that_is_too_coarse_or_all_holes_is_refused() -> None:
    with pytest.raises(PoseLearningError, match="do not show how it bends"):
        learn_pose(tubes(), PoseLearningSettings(points=4, fields=5), {})
    nothing = np.full((7**2, 3), np.nan)
    steps = np.linspace(0.0, 1.0, 7)
    places = np.stack([part.ravel() for part in np.meshgrid(steps, steps)], axis=1)
    with pytest.raises(PoseLearningError, match="nothing but holes"):
        curvature_metric(Poses(places, nothing, nothing), 7, np.ones(2))


@pytest.mark.parametrize("fields", [1, 20, 150])
def test_samples_make_as_many_fields_as_asked_for_and_no_more(fields: int) -> None:
    places = np.random.default_rng(2).uniform(-1.0, 1.0, (4000, 3))
    metric = sized_metric(np.diag([1.0, 2.0, 0.5]), places, np.array([2.0, 2.0, 0.0]), fields)
    from daemon.learning.forward.pose_model import _fields_made

    made = _fields_made(places, np.array([2.0, 2.0, 0.0]), metric, 1000)
    assert 0.85 * fields <= made <= fields


def test_a_kept_model_is_the_same_and_other_files_are_refused(
    learnt: LearntPose, tmp_path: Path
) -> None:
    path = tmp_path / "pose.npz"
    learnt.model.save(path)
    loaded = PoseModel.load(path)
    at = np.array([1.0, -2.0, 33.0])
    np.testing.assert_array_equal(
        loaded.predict(at).position_mm, learnt.model.predict(at).position_mm
    )
    assert loaded.metadata["robot"] == "made up"
    for damage in (b"", b"PK", path.read_bytes()[:5000]):
        broken = tmp_path / "broken.npz"
        broken.write_bytes(damage)
        with pytest.raises(ModelError, match="is not a pose model"):
            PoseModel.load(broken)
    save_npz(path, {"metadata": np.array(json.dumps({"kind": "another"}))})
    with pytest.raises(ModelError, match="is not a pose model"):
        PoseModel.load(path)


def test_the_command_learns_keeps_and_says_how_well(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "pose.npz"
    how = ["kinematics", str(FILE), "--points", "12", "--fields", "60"]
    assert main([*how, "--out", str(path)]) == 0
    first = capsys.readouterr().out
    assert "receptive fields; 1469 configurations, 259 kept back" in first
    assert main([*how, "--model", str(path), "--json"]) == 0
    again = json.loads(capsys.readouterr().out)["result"]
    assert f"{again['rmse_mm'][0]:.2f} mm" in first
    assert PoseModel.load(path).metadata["commands"] == [
        "tentacled kinematics concentric_tubes.yaml --out pose.npz --points 12 --fields 60 "
        "--epochs 1 --test-share 0.15 --seed 1"
    ]


@pytest.mark.parametrize(
    ("robot", "options", "code", "text"),
    [
        (FILE, ["--points", "2"], EXIT_USAGE, "points are 4 or more"),
        (FILE, ["--extension", "50", "10"], EXIT_FAILED, "from lowest to highest"),
        (SHIPPED_ROBOTS / "soft_arm.yaml", [], EXIT_CONFIGURATION, "these are no concentric tubes"),
    ],
)
def test_the_command_explains_what_it_cannot_do(
    robot: Path,
    options: list[str],
    code: int,
    text: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["kinematics", str(robot), *options, "--out", str(tmp_path / "x.npz")]) == code
    assert text in capsys.readouterr().err


def test_the_shipped_model_knows_more_than_half_as_well_again_as_the_papers() -> None:
    """Its errors on a grid that it was not learnt from, coarser and over the paper's whole range:
    about half of the paper's in every column."""
    model = PoseModel.load(SHIPPED)
    assert model.lwpr.count <= 600
    poses = tubes((0.0, 87.0)).poses(19)
    rows = np.hstack([poses.tip_mm, poses.direction])
    known = np.isfinite(rows).all(axis=1)
    assert known.mean() > 0.99
    found = errors_of(model, poses.configuration[known], rows[known])
    assert (found.position_mm < 0.75 * PAPER_MM).all()
    assert found.angle_rad < 0.75 * PAPER_RAD
