"""What the gate asks, made from a robot file's model and mesh; and what is wrong with those."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from config.documents.problems import ConfigError
from config.loader import load_robot
from daemon.commands.outcome.exit_codes import EXIT_CONFIGURATION
from daemon.commands.terminal.command_line import main
from daemon.risk.body_risk_source import BodyRiskSource, RiskFilesError, make_risk_source
from daemon.risk.mesh_file import write_mesh
from daemon.risk.model_file import write_model
from daemon.workbench.body_model.evaluation.shapes import box
from safety.risk.moving_obstacles import NOTHING_MOVES
from safety.risk_source import (
    GIVEN_TIP,
    MODEL,
    NoModel,
    TipComparing,
    WayCounting,
    ask,
    count_way,
    minute_risk_of,
)
from tests.safety.risk.test_body_risk import arrays, at

ROBOT = Path(__file__).parents[3] / "config" / "robots" / "tendon_arm.yaml"
ABOUT = {"robot": "tendon_arm", "points_activation": "silu", "shapes_activation": "relu"}


class Clock:
    """Goes on by so much whenever it is looked at."""

    def __init__(self, step_ns: int = 0) -> None:
        self._t_ns, self._step_ns = 0, step_ns
        self.wall_ns = 0

    def now_ns(self) -> int:
        self._t_ns += self._step_ns
        return self._t_ns

    def wall_time_ns(self) -> int:
        return self.wall_ns


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A robot file, a model that fits it, and a block in its way."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    write_model(tmp_path / "arm.npz", arrays(), ABOUT)
    write_mesh(tmp_path / "block.stl", box((40.0, 60.0, 60.0), (60.0, 0.0, 200.0), 4))
    write_robot(tmp_path, {"model": "arm.npz", "surface": {"mesh": "block.stl", "grid_mm": 2.0}})
    return tmp_path


def write_robot(folder: Path, risk: dict[str, object]) -> None:
    robot = yaml.safe_load(ROBOT.read_text())
    robot["risk"] = risk
    (folder / "robot.yaml").write_text(yaml.safe_dump(robot))


def test_it_answers_for_the_robot_s_model_and_mesh(folder: Path) -> None:
    source = make_risk_source(load_robot(folder / "robot.yaml"), Clock())
    assert source.name == "arm.npz, block.stl"
    touching, near, far = (ask(source, at(0.0), at(end), 0, 0.02) for end in (5.0, 2.5, 0.5))
    assert far.risk < 0.05 < 0.9 < touching.risk
    assert near.nearest is not None
    assert near.nearest.obstacle_mm[0] == pytest.approx(40.0, abs=2.5)
    assert "at 200 mm along the body, nearest to (" in near.detail
    assert (touching.doubt, near.doubt, far.doubt) == ("", "", "")


def test_what_it_does_not_know_is_the_maximum_with_its_reason(folder: Path) -> None:
    source = make_risk_source(load_robot(folder / "robot.yaml"), Clock())
    answer = ask(source, at(0.0), at(9.0), 0, 0.02)
    assert answer.risk == 1.0
    assert "outside what the model has learned" in answer.doubt


def test_it_says_how_long_it_took(folder: Path) -> None:
    source = make_risk_source(load_robot(folder / "robot.yaml"), Clock(30_000_000))
    answer = ask(source, at(0.0), at(0.1), 0, 0.02)
    assert answer.risk == 1.0
    assert answer.took_s == pytest.approx(0.03)
    assert "late" in answer.doubt


def test_who_names_no_model_has_none(folder: Path) -> None:
    write_robot(folder, {})
    assert isinstance(make_risk_source(load_robot(folder / "robot.yaml"), Clock()), NoModel)


def damaged(folder: Path) -> None:
    whole = (folder / "arm.npz").read_bytes()
    (folder / "arm.npz").write_bytes(whole[: len(whole) // 2])


def of_another_robot(folder: Path) -> None:
    write_model(folder / "arm.npz", arrays(), {**ABOUT, "robot": "another_arm"})


def of_axes_in_another_order(folder: Path) -> None:
    axes = ["straight_2", "straight_1", "straight_3", "helical"]
    write_model(folder / "arm.npz", arrays(), {**ABOUT, "axes": axes})


def with_wider_pistons(folder: Path) -> None:
    """Of the soft arm, whose file says that its own have a bore of 25 mm."""
    soft = yaml.safe_load(ROBOT.with_name("soft_arm.yaml").read_text())
    surface = {"mesh": "block.stl", "grid_mm": 2.0}
    soft["risk"] = {"model": "builtin:soft_arm.npz", "surface": surface}
    for axis in soft["axes"]:
        axis["bore_mm"] = 20.0
    (folder / "robot.yaml").write_text(yaml.safe_dump(soft))


def with_a_load(folder: Path) -> None:
    write_model(folder / "arm.npz", arrays(), {**ABOUT, "tip_load_g": 14.2})


def open_mesh(folder: Path) -> None:
    mesh = box((40.0, 60.0, 60.0), (60.0, 0.0, 200.0), 4)
    write_mesh(folder / "block.stl", type(mesh)(mesh.vertices_mm, mesh.triangles[:-1]))


def round_the_base(folder: Path) -> None:
    write_mesh(folder / "block.stl", box((40.0, 60.0, 60.0), (0.0, 0.0, 0.0), 4))


def inside_out(folder: Path) -> None:
    mesh = box((40.0, 60.0, 60.0), (60.0, 0.0, 200.0), 4)
    write_mesh(folder / "block.stl", type(mesh)(mesh.vertices_mm, mesh.triangles[:, ::-1]))


def too_thick(folder: Path) -> None:
    made = arrays()
    made["basis/radius_mm"] = np.full(11, 5e4)
    write_model(folder / "arm.npz", made, ABOUT)


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (damaged, "arm.npz"),
        (of_another_robot, "is of the robot 'another_arm'"),
        (of_axes_in_another_order, "was made with the axes"),
        (with_wider_pistons, "with pistons of 490.9 mm², and bore_mm makes .* 314.2: the same"),
        (with_a_load, "was made with 14.2 g at the tip, and not with 0 g"),
        (open_mesh, "block.stl"),
        (round_the_base, "base at .* has no room .* there is no port: declare one"),
        (inside_out, "say that it is free outside, if its normals point the wrong way"),
        (too_thick, "grid"),
    ],
)
def test_files_that_do_not_do_are_named(
    folder: Path, spoil: Callable[[Path], None], told: str
) -> None:
    spoil(folder)
    with pytest.raises(RiskFilesError, match=told):
        make_risk_source(load_robot(folder / "robot.yaml"), Clock())


def test_a_model_is_for_the_load_that_it_was_made_with(folder: Path) -> None:
    with_a_load(folder)
    file = load_robot(folder / "robot.yaml")
    assert make_risk_source(file, Clock(), [14.2, 14.0]).name == "arm.npz, block.stl"
    with pytest.raises(RiskFilesError, match="not with 20 g"):
        make_risk_source(file, Clock(), [14.2, 20.0])


def test_a_model_is_believed_for_so_many_days_and_then_no_more(folder: Path) -> None:
    surface = {"mesh": "block.stl", "grid_mm": 2.0}
    write_robot(folder, {"model": "arm.npz", "surface": surface, "oldest_days": 1.5})
    write_model(folder / "arm.npz", arrays(), {**ABOUT, "seen_on": "1970-01-11"})
    clock = Clock()
    source = make_risk_source(load_robot(folder / "robot.yaml"), clock)
    clock.wall_ns = int(11.4 * 86_400e9)
    assert ask(source, at(0.0), at(0.5), 0, 0.02).risk < 0.05
    clock.wall_ns = int(11.5 * 86_400e9)
    late = ask(source, at(0.0), at(0.5), 0, 0.02)
    assert late.risk == 1.0
    assert "older than risk.oldest_days" in late.doubt


@pytest.mark.parametrize("about", [{}, {"seen_on": "yesterday"}, {"seen_on": 3.5}])
def test_a_model_that_may_not_be_old_says_how_old_it_is(
    folder: Path, about: dict[str, object]
) -> None:
    surface = {"mesh": "block.stl", "grid_mm": 2.0}
    write_robot(folder, {"model": "arm.npz", "surface": surface, "oldest_days": 30})
    write_model(folder / "arm.npz", arrays(), {**ABOUT, **about})
    with pytest.raises(RiskFilesError, match="does not say when its clouds were seen"):
        make_risk_source(load_robot(folder / "robot.yaml"), Clock())


@pytest.mark.parametrize(
    ("risk", "told"),
    [
        ({"model": "none.npz", "surface": {"mesh": "block.stl"}}, "there is no file"),
        ({"model": "arm.npz", "surface": {"mesh": "none.stl"}}, "there is no file"),
        ({"model": "arm.npz"}, "needs both"),
        ({"surface": {"mesh": "block.stl"}}, "needs both"),
    ],
)
def test_files_that_are_not_there_are_a_mistake_of_the_robot_file(
    folder: Path, risk: dict[str, object], told: str
) -> None:
    write_robot(folder, risk)
    with pytest.raises(ConfigError, match=told):
        load_robot(folder / "robot.yaml")


def test_with_a_damaged_model_the_daemon_does_not_start(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    damaged(folder)
    words = ["run", str(folder / "robot.yaml"), "--runs", str(folder / "runs")]
    assert main([*words, "--runtime-dir", str(folder)]) == EXIT_CONFIGURATION
    told = capsys.readouterr().err
    assert str(folder / "arm.npz") in told
    assert "tentacled mdn train" in told


def test_a_tip_that_stays_where_the_body_cannot_be_makes_the_risk_unavailable(folder: Path) -> None:
    source = make_risk_source(load_robot(folder / "robot.yaml"), Clock())
    assert isinstance(source, TipComparing)
    u, tip_mm = at(0.5), [5.0, 0.0, 200.0]
    fits = source.compare([u], tip_mm, 0)
    assert fits is not None
    assert fits.doubt == ""
    assert fits.off_mm < 5.0
    frames, told = 0, fits
    while not told.doubt:
        frames += 1
        answer = source.compare([u], [150.0, 0.0, 200.0], frames * 25_000_000)
        assert answer is not None
        told = answer
        assert frames < 20
    assert frames == 7
    assert told.statistic >= 1.0
    reading = ask(source, u, u, 0, 0.02)
    assert reading.risk == 1.0
    assert "risk.tip_load_g" in reading.doubt
    assert source.compare([at(50.0)], tip_mm, 0) is None, "not known there"
    for _ in range(400):
        frames += 1
        source.compare([u], tip_mm, frames * 25_000_000)
    assert ask(source, u, u, 0, 0.02).doubt == ""


# Given the tip.

PERIOD_NS = 25_000_000
AWAY_MM = [14.0, 0.0, 200.0]
"""Six millimetres farther from the block than where the model has the tip at 2."""


def test_a_tip_that_fits_decides_for_as_long_as_it_is_fresh(folder: Path) -> None:
    source = make_risk_source(load_robot(folder / "robot.yaml"), Clock())
    assert isinstance(source, TipComparing)
    alone = ask(source, at(2.0), at(2.1), 0, 0.02)
    assert alone.answers is not None
    assert (alone.answers.given_tip, alone.answers.decided_by) == (None, MODEL)
    source.compare([at(2.0)], AWAY_MM, 10 * PERIOD_NS)
    fresh = ask(source, at(2.0), at(2.1), 16 * PERIOD_NS, 0.02)
    assert fresh.answers is not None
    assert fresh.answers.decided_by == GIVEN_TIP
    assert fresh.risk == fresh.answers.given_tip
    assert fresh.risk < alone.risk
    late = ask(source, at(2.0), at(2.1), 16 * PERIOD_NS + 1, 0.02)
    assert (late.risk, late.answers) == (alone.risk, alone.answers)
    source.compare([at(2.0)], AWAY_MM, 20 * PERIOD_NS)
    before = ask(source, at(2.0), at(2.1), 13 * PERIOD_NS, 0.02)
    assert before.answers == alone.answers, "of a time to come, too"


def test_paths_are_planned_with_a_tip_that_fits_for_as_long_as_it_is_fresh(folder: Path) -> None:
    source = make_risk_source(load_robot(folder / "robot.yaml"), Clock())
    assert isinstance(source, BodyRiskSource)
    assert source.seen_tip(0) is None
    source.compare([at(2.0)], AWAY_MM, 10 * PERIOD_NS)
    fresh = source.seen_tip(16 * PERIOD_NS)
    assert fresh is not None
    assert fresh.value.tolist() == AWAY_MM
    assert source.seen_tip(16 * PERIOD_NS + 1) is None
    for frame in range(11, 15):
        source.compare([at(2.0)], [-60.0, 0.0, 200.0], frame * PERIOD_NS)
    assert source.seen_tip(15 * PERIOD_NS) is None, "the model has something against it"


def test_a_tip_of_which_nothing_is_known_is_forgotten(folder: Path) -> None:
    source = make_risk_source(load_robot(folder / "robot.yaml"), Clock())
    assert isinstance(source, TipComparing)
    alone = ask(source, at(2.0), at(2.1), 0, 0.02).answers
    for place, tip_mm in ((at(50.0), AWAY_MM), (at(2.0), [np.nan, 0.0, 200.0])):
        source.compare([at(2.0)], AWAY_MM, 0)
        assert ask(source, at(2.0), at(2.1), 0, 0.02).answers != alone
        assert source.compare([place], tip_mm, 1) is None
        after = ask(source, at(2.0), at(2.1), 0, 0.02).answers
        assert after is not None
        assert after.given_tip is None


def test_a_tip_that_the_model_has_something_against_only_adds_to_the_risk(folder: Path) -> None:
    source = make_risk_source(load_robot(folder / "robot.yaml"), Clock())
    assert isinstance(source, TipComparing)
    alone = ask(source, at(2.0), at(2.1), 0, 0.02)
    told = [source.compare([at(2.0)], [-60.0, 0.0, 200.0], frame * PERIOD_NS) for frame in range(4)]
    assert told[-1] is not None
    assert 0.0 < told[-1].statistic < 1.0
    doubted = ask(source, at(2.0), at(2.1), 4 * PERIOD_NS, 0.02)
    assert doubted.answers is not None
    assert doubted.answers.decided_by == MODEL
    assert doubted.risk == alone.risk


def test_a_robot_file_can_leave_the_tip_out_of_it(folder: Path) -> None:
    surface = {"mesh": "block.stl", "grid_mm": 2.0}
    write_robot(folder, {"model": "arm.npz", "surface": surface, "given_tip": False})
    source = make_risk_source(load_robot(folder / "robot.yaml"), Clock())
    assert isinstance(source, TipComparing)
    alone = ask(source, at(2.0), at(2.1), 0, 0.02)
    source.compare([at(2.0)], AWAY_MM, 0)
    seen = ask(source, at(2.0), at(2.1), 0, 0.02)
    assert seen.answers is not None
    assert seen.answers.given_tip is None
    assert seen.risk == alone.risk


def test_a_direction_counts_where_it_is_told_and_asked_for(folder: Path) -> None:
    risks = []
    for accuracy in (0.02, None):
        surface = {"mesh": "block.stl", "grid_mm": 2.0}
        settings = {"surface": surface, "tip_accuracy_rad": accuracy, "tip_accuracy_mm": 3.0}
        write_robot(folder, {"model": "arm.npz", **settings})
        source = make_risk_source(load_robot(folder / "robot.yaml"), Clock())
        assert isinstance(source, TipComparing)
        for slope in (0.12, 0.18):
            along = [slope / np.hypot(slope, 1.0), 0.0, 1.0 / np.hypot(slope, 1.0)]
            source.compare([at(2.0)], [30.0, 0.0, 200.0], 0, along)
            risks.append(ask(source, at(2.0), at(2.1), 0, 0.02).risk)
    assert risks[0] < risks[1]
    assert risks[2] == risks[3]


# The minute behind.


def test_only_ways_that_were_gone_count_for_the_minute(folder: Path) -> None:
    source = make_risk_source(load_robot(folder / "robot.yaml"), Clock())
    assert isinstance(source, WayCounting)
    touching = ask(source, at(0.0), at(2.9), 0, 0.02).risk
    assert touching > 0.05
    assert minute_risk_of(source, 0) < 0.01
    ask(source, at(0.0), at(0.1), 0, 0.02)
    count_way(source, 0)
    assert minute_risk_of(source, 0) < 0.01
    ask(source, at(0.0), at(2.9), 0, 0.02)
    count_way(source, 1)
    assert minute_risk_of(source, 1) == touching
    assert minute_risk_of(source, 60_000_000_001) < 0.01


def test_a_way_of_which_nothing_was_known_is_certain(folder: Path) -> None:
    for nobody_knows in (at(50.0), None):
        source = make_risk_source(load_robot(folder / "robot.yaml"), Clock())
        assert isinstance(source, WayCounting)
        ask(source, at(0.0), at(0.1), 0, 0.02)
        if nobody_knows is not None:
            ask(source, at(0.0), nobody_knows, 0, 0.02)
        else:
            assert isinstance(source, BodyRiskSource)
            source.take_moving(NOTHING_MOVES, 5)
            ask(source, at(0.0), at(0.1), 6, 0.02)
        count_way(source, 0)
        assert minute_risk_of(source, 0) == 1.0
