"""Which scenes of `python -m tests.experiments.dodging` are played, and which were before."""

from pathlib import Path

import numpy as np

from tests.experiments.dodging import (
    Passed,
    figures_of,
    is_worse,
    keep,
    kept,
    options,
    scenes_of,
    solids_between,
)
from tests.experiments.dodging_scenes import HOME_MM, KINDS, PARTS, Scene, Stands


def passed(mean_error_mm: float = 0.4, state: str = "armed", refused: int = 0) -> Passed:
    return Passed(state, [], 3.2, mean_error_mm, 1.0, refused, 2, 30, 600)


def test_all_of_it_is_a_hundred_scenes_of_three_robots_each_once() -> None:
    scenes = scenes_of(options(["--full"]))
    assert len(scenes) == len(set(scenes)) >= 100
    for robot in ("soft", "tendon"):
        mine = [scene for scene in scenes if scene.robot == robot]
        assert {(scene.kind, scene.part) for scene in mine} == {
            (kind, part) for kind in KINDS for part in PARTS
        }
    assert any(scene.robot == "tubes" for scene in scenes)


def test_shares_have_all_scenes_between_them_and_none_twice() -> None:
    whole = scenes_of(options(["--full", "--robot", "tendon"]))
    assert {scene.robot for scene in whole} == {"tendon"}
    parts = [
        scenes_of(options(["--full", "--robot", "tendon", "--share", f"{k}/3"])) for k in (1, 2, 3)
    ]
    assert sorted(map(str, whole)) == sorted(str(scene) for part in parts for scene in part)


def test_what_was_played_is_kept_and_a_line_that_was_cut_off_is_played_again(
    tmp_path: Path,
) -> None:
    path = tmp_path / "scenes.jsonl"
    first, second = (Scene("soft", "ball", "tip", seed) for seed in (1, 2))
    assert kept(path) == {} and kept(None) == {}
    keep(path, first, passed(0.9), passed(0.4, refused=1))
    keep(path, second, passed(np.inf, "hold"), passed())
    assert kept(path) == {
        first: (passed(0.9), passed(0.4, refused=1)),
        second: (passed(np.inf, "hold"), passed()),
    }
    path.write_text(path.read_text()[:-40])
    assert list(kept(path)) == [first]


def test_parts_are_worse_where_the_tip_is_further_off_or_does_not_get_round() -> None:
    assert not is_worse(passed(0.5), passed(0.5))
    assert is_worse(passed(0.5), passed(0.7))
    assert not is_worse(passed(3.3), passed(3.4))
    assert is_worse(passed(3.3), passed(3.5))
    assert is_worse(passed(), passed(state="hold"))
    assert not is_worse(passed(state="hold"), passed(9.0))
    scene = Scene("tendon", "slab", "middle", 1)
    figures = figures_of([(scene, passed(refused=3), passed(0.9, refused=1))])
    assert figures["all"]["worse"] == [scene.name]
    assert figures["all"]["whole"]["refused"] == 3 and figures["all"]["parts"]["refused"] == 1


def test_what_stands_there_leaves_the_body_room_to_be_armed() -> None:
    home = np.column_stack([np.zeros((20, 2)), np.linspace(0.0, 190.0, 20)])
    stands = Stands(np.array([9.0, 0.0, 110.0]), np.eye(3), 13.5)
    for kind in KINDS:
        solids = solids_between(stands, kind, 3.0, 20.0, (home, HOME_MM["soft"]))
        room_mm = min(solid.distance_mm(home) for solid in solids) - 13.5
        assert room_mm >= HOME_MM["soft"]
        meshes = [solid.mesh() for solid in solids]
        # Their own surfaces are where they are said to be.
        for solid, mesh in zip(solids, meshes, strict=True):
            off = [abs(solid.distance_mm(place[None])) for place in mesh.vertices_mm[::50]]
            assert max(off) < 1e-6
