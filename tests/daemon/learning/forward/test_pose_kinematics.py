"""A pose model in a robot's axes: rigid motion as it is, Jacobians, and learning that forgets near
the path only."""

import numpy as np
import pytest

from config.emulation.plants import ConcentricTubesPlant
from config.loader import load_robot
from daemon.control.task import angle_between
from daemon.learning.forward.pose_kinematics import (
    BodyCoordinates,
    PoseAdaptation,
    PoseKinematics,
)
from daemon.learning.forward.pose_model import PoseModel
from daemon.learning.lwpr.model import Lwpr, with_corrections, with_memory
from daemon.learning.lwpr.settings import LwprSettings
from daemon.robot.axes import AxisRanges
from daemon.robot.coordinates import Coordinates
from drivers.pose import Vector
from sim_backends.plants.concentric.concentric_tubes import ConcentricTubes
from sim_backends.plants.concentric.relative import RelativeTubes
from sim_backends.plants.plant import TipLoad
from tests import SHIPPED_ROBOTS

ROBOT = load_robot(SHIPPED_ROBOTS / "concentric_tubes.yaml").robot
MODEL = PoseModel.load(SHIPPED_ROBOTS.parent / "models" / "concentric_tubes_pose.npz")
COORDINATES = BodyCoordinates.from_dict(MODEL.metadata["coordinates"])
AXES = AxisRanges.of(ROBOT)
PATH = [np.array([0.5 * s, 1.0 + s, 0.5 - s, 0.0, 3.0 * s]) for s in np.linspace(0.0, 0.6, 250)]


def plant() -> ConcentricTubesPlant:
    assert ROBOT.emulation is not None
    assert isinstance(ROBOT.emulation.plant, ConcentricTubesPlant)
    return ROBOT.emulation.plant


def kinematics() -> PoseKinematics:
    return PoseKinematics(
        Lwpr.from_arrays(MODEL.lwpr.settings, MODEL.lwpr.to_arrays()), COORDINATES
    )


def places(count: int, seed: int) -> list[Vector]:
    random = np.random.default_rng(seed)
    lowest, highest = (
        np.array([-6.0, -6.0, -6.0, -5.0, -15.0]),
        np.array([6.0, 6.0, 6.0, 5.0, 10.0]),
    )
    return list(random.uniform(lowest, highest, size=(count, 5)))


def test_the_shipped_model_knows_the_shipped_robot_by_its_axes() -> None:
    """All five of them, several turns round: against the plant itself, without its friction."""
    body = ConcentricTubes(plant().model_copy(update={"friction_nmm": 0.0}))
    learnt = kinematics()
    off_mm, off_rad = [], []
    for u in places(60, 1):
        tip, said = body.step(u, TipLoad(), 0.025).tip, learnt.pose(u)
        off_mm.append(np.linalg.norm(said.position_mm - tip.position_mm))
        x, y, z, w = *tip.quaternion[1:], tip.quaternion[0]
        axis = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
        off_rad.append(angle_between(said.direction, axis))
    assert np.sqrt(np.mean(np.square(off_mm))) < 1.0
    assert np.sqrt(np.mean(np.square(off_rad))) < np.radians(2.0)


def test_the_model_s_numbers_are_the_robot_s_coordinates() -> None:
    said = Coordinates.of(ROBOT)
    for u in places(20, 2):
        q = dict(zip(said.names, said.of_axes(u).tolist(), strict=True))
        expected = [q["alpha_21"], q["alpha_31"], q["d_31"]]
        np.testing.assert_allclose(kinematics().configuration(u), expected, atol=1e-12)
        assert COORDINATES.roll @ u == pytest.approx(q["roll"])
        assert COORDINATES.insertion @ u == pytest.approx(q["insertion"])


def test_coordinates_go_through_another_map_and_a_file() -> None:
    random = np.random.default_rng(5)
    matrix, offset = random.normal(size=(5, 5)), random.normal(size=5)
    other = BodyCoordinates.from_dict(COORDINATES.through(matrix, offset).to_dict())
    v = random.normal(size=5)
    u = matrix @ v + offset
    expected = COORDINATES.shaping @ u + COORDINATES.offset
    np.testing.assert_allclose(other.shaping @ v + other.offset, expected)
    with pytest.raises(ValueError, match="do not fit"):
        BodyCoordinates(np.zeros((3, 5)), np.zeros(2), np.zeros(5), np.zeros(5))
    with pytest.raises(KeyError):
        BodyCoordinates.from_dict({})


def test_the_jacobian_is_how_the_tip_answers() -> None:
    """Of the plant's own poses, by differences; roll and insertion exactly."""
    body = ConcentricTubes(plant().model_copy(update={"friction_nmm": 0.0}))
    learnt, worst = kinematics(), []
    for u in places(15, 3):
        answer = learnt.answer(u)
        assert np.abs(answer.direction @ answer.jacobian[3:]).max() < 1e-12
        true = np.empty((3, 5))
        for axis, step in enumerate((0.01, 0.01, 0.01, 0.1, 0.1)):
            ends = [u + sign * step * np.eye(5)[axis] for sign in (-1.0, 1.0)]
            before, after = (body.step(end, TipLoad(), 0.0).tip.position_mm for end in ends)
            true[:, axis] = (after - before) / (2.0 * step)
        worst.append(np.linalg.norm(answer.jacobian[:3] - true) / np.linalg.norm(true))
        rolled = answer.jacobian @ np.array([1.0, 1.0, 1.0, 0.0, 0.0])
        x, y, _ = answer.position_mm
        np.testing.assert_allclose(rolled[:3], [-y, x, 0.0], atol=1e-9)
        pushed = answer.jacobian @ np.array([0.0, 0.0, 0.0, 1.0, 1.0])
        np.testing.assert_allclose(pushed, [0.0, 0.0, 1.0, 0.0, 0.0, 0.0], atol=1e-9)
    assert np.median(worst) < 0.1


def test_where_nothing_was_learnt_nothing_is_known() -> None:
    learnt, far = kinematics(), np.array([0.0, 1.0, 1.0, 0.0, 4000.0])
    assert not learnt.known(far)
    assert np.isnan(learnt.pose(far).position_mm).all()
    assert np.isnan(learnt.answer(far).jacobian).all()
    assert learnt.known(PATH[0])


def far_points(nearest: float = 0.6) -> list[Vector]:
    """Where the body has other shapes than anywhere near the path. nearest: in half turns, or the
    whole extension."""
    configuration, found = kinematics().configuration, []
    shapes = np.array([configuration(u) for u in PATH])
    for u in places(400, 4):
        off = configuration(u) - shapes
        off[:, :2] -= 2.0 * np.pi * np.round(off[:, :2] / (2.0 * np.pi))
        if (np.linalg.norm(off / np.array([np.pi, np.pi, 67.0]), axis=1) > nearest).all():
            found.append(u)
    assert len(found) > 30
    return found


@pytest.mark.parametrize(("memory", "most_mm"), [(8.0, 0.3), (30.0, 0.8)])
def test_a_model_of_half_a_million_samples_still_learns_and_forgets_nothing_far_away(
    memory: float, most_mm: float
) -> None:
    """A body that is off by 4 mm and 3°: along the path the model follows it, the sooner the less
    it remembers; elsewhere it stays what it was."""
    shift = np.array([3.0, -2.0, 1.5])
    learnt, still, far = kinematics(), kinematics(), far_points()
    adaptation = PoseAdaptation(learnt, AXES.scale, memory, 0.1, 0.002)
    off_mm, off_rad = [], []
    for u in [*PATH, *reversed(PATH)]:
        pose = still.pose(u)
        turned = pose.direction + 0.05 * np.cross(pose.direction, [0.0, 0.0, 1.0])
        turned /= np.linalg.norm(turned)
        said = learnt.pose(u)
        off_mm.append(np.linalg.norm(said.position_mm - pose.position_mm - shift))
        off_rad.append(angle_between(said.direction, turned))
        adaptation.see(u, pose.position_mm + shift, turned)
    assert adaptation.samples > 300
    assert off_mm[0] > 3.5
    assert np.mean(off_mm[200:]) < most_mm
    assert np.mean(off_rad[200:]) < np.radians(0.5)
    moved = [np.linalg.norm(learnt.pose(u).position_mm - still.pose(u).position_mm) for u in far]
    assert np.mean(moved) < 0.02
    assert max(moved) < 0.5


def test_what_is_beside_the_path_is_not_spoilt_by_what_the_path_does_not_show() -> None:
    """What forgetting by weight, and slopes that are kept, are for: fields that forget by every
    sample that reaches them are hundreds of millimetres off there."""

    def off_mm(adapting: Lwpr) -> float:
        learnt, still = PoseKinematics(adapting, COORDINATES), kinematics()
        random = np.random.default_rng(6)
        for u in [*PATH, *reversed(PATH)]:
            pose = still.pose(u)
            seen = pose.position_mm + np.array([3.0, -2.0, 1.5]) + 0.2 * random.normal(size=3)
            learnt.learn(u, seen, pose.direction)
        said = [learnt.lwpr.predict(learnt.configuration(u))[:3] for u in far_points(nearest=0.25)]
        nominal = [still.lwpr.predict(still.configuration(u))[:3] for u in far_points(nearest=0.25)]
        return float(np.linalg.norm(np.subtract(said, nominal), axis=1).max())

    model = kinematics().lwpr
    assert off_mm(with_corrections(model, 8.0, 1e-3)) < 5.0
    assert off_mm(with_memory(model, 8.0)) > 20.0


def test_a_model_that_is_made_to_learn_corrections_says_what_it_said() -> None:
    learnt, still = kinematics(), kinematics()
    learnt.lwpr = with_corrections(still.lwpr, 8.0, 1e-3)
    for u in places(50, 8):
        here, there = learnt.answer(u), still.answer(u)
        np.testing.assert_allclose(here.position_mm, there.position_mm, atol=1e-9)
        np.testing.assert_allclose(here.jacobian, there.jacobian, atol=1e-9)


def test_standing_still_teaches_nothing() -> None:
    learnt = kinematics()
    adaptation = PoseAdaptation(learnt, AXES.scale, 12.0, 0.1, 0.002)
    random = np.random.default_rng(7)
    before = learnt.answer(PATH[0])
    for _ in range(2000):
        pose = before.position_mm + 0.2 * random.normal(size=3)
        adaptation.see(PATH[0], pose, before.direction)
    assert adaptation.samples == 1
    np.testing.assert_allclose(learnt.answer(PATH[0]).jacobian, before.jacobian, atol=2.0)
    adaptation.see(np.full(5, np.nan), before.position_mm, before.direction)
    assert adaptation.samples == 1


def test_fields_that_forget_by_weight_keep_their_shape() -> None:
    with pytest.raises(ValueError, match="forget_by_weight"):
        LwprSettings(1, 1, (1.0,), forget_by_weight=True, adapt_metric=True)
    with pytest.raises(ValueError, match="forget_by_weight"):
        LwprSettings(1, 1, (1.0,), forget_by_weight=True, compat=True)


def test_the_plant_of_the_model_makes_its_map() -> None:
    made = BodyCoordinates(*RelativeTubes(plant(), ROBOT.axes).axes_map())
    assert made.to_dict() == COORDINATES.to_dict()
