"""Tubes remember which shape they have, and snap when and only when it ceases to be one."""

import numpy as np
import pytest

from sim_backends.plants.concentric.concentric_tubes import statics_of
from sim_backends.plants.concentric.statics import Setting, TubeEquilibrium, TubeStatics
from tests.sim_backends.plants.concentric.tube_sets import NO_FORCE, plant_config, settled

SWEEP = np.linspace(0.0, 2.0 * np.pi, 121)


def setting(out_mm: float, inner: float, pair: float = 0.0) -> Setting:
    collars_mm = np.array([0.0, -17.0, out_mm - 121.0])
    return Setting(np.array([0.0, pair, inner]), collars_mm, NO_FORCE)


def swept(
    statics: TubeStatics, start: TubeEquilibrium, way: list[Setting]
) -> tuple[list[TubeEquilibrium], list[int]]:
    """The equilibria along a way, and how often the tubes snapped before each."""
    here, found, snaps = start, [], []
    for there in way:
        followed = statics.follow(here, there, statics.no_sliders())
        assert followed is not None
        here, times = followed
        found.append(here)
        snaps.append(times)
    return found, snaps


def to_and_fro(out_mm: float) -> tuple[float, int, float]:
    """The largest distance of the tip between turning the inner tube to and back, mm; how often it
    snapped; and the smallest determinant."""
    statics = statics_of(plant_config(), ideal=True)
    way = [setting(out_mm, float(angle)) for angle in SWEEP]
    there, one = swept(statics, settled(statics, way[0]), way)
    back, other = swept(statics, there[-1], way[::-1])
    tips = [np.array([e.march.position_mm[-1] for e in part]) for part in (there, back[::-1])]
    apart = float(np.linalg.norm(tips[0] - tips[1], axis=1).max())
    return apart, sum(one) + sum(other), min(e.determinant for e in there + back)


def test_a_drawn_in_tube_snaps_at_different_places_to_and_fro() -> None:
    apart, snaps, determinant = to_and_fro(0.5)
    assert apart == pytest.approx(13.6, abs=0.2)
    assert snaps == 2
    assert determinant > 0.0


@pytest.mark.parametrize("out_mm", [20.0, 30.0, 60.0])
def test_a_tube_that_stands_out_never_snaps(out_mm: float) -> None:
    apart, snaps, determinant = to_and_fro(out_mm)
    assert apart < 1e-6
    assert snaps == 0
    assert determinant > 0.05


def test_tubes_do_not_snap_while_they_are_pushed_to_and_fro_where_two_shapes_are() -> None:
    """Within the range of two shapes the one that was taken stays, to the last bit of the tip."""
    statics = statics_of(plant_config(), ideal=True)
    up = [setting(0.5, float(a)) for a in np.linspace(0.0, 3.14, 60)]
    found, snaps = swept(statics, settled(statics, up[0]), up)
    assert sum(snaps) == 0
    around = [setting(out, 3.14) for out in (0.5, 2.0, 5.0, 2.0, 0.5)]
    there, snaps = swept(statics, found[-1], around)
    assert sum(snaps) == 0
    gone = there[-1].march.position_mm[-1] - found[-1].march.position_mm[-1]
    assert np.abs(gone).max() < 1e-5


@pytest.mark.parametrize("steps", [1, 7, 400])
def test_where_tubes_snap_does_not_depend_on_how_a_motion_is_cut(steps: int) -> None:
    statics = statics_of(plant_config(), ideal=True)
    start = settled(statics, setting(0.5, 0.0))
    angles = np.linspace(0.0, 3.19, steps + 1)[1:]  # the branch ends at 3.217
    found, snaps = swept(statics, start, [setting(0.5, float(a)) for a in angles])
    assert sum(snaps) == 0
    beyond, more = swept(statics, found[-1], [setting(0.5, 3.26)])
    assert sum(more) == 1
    moved = beyond[-1].march.position_mm[-1] - found[-1].march.position_mm[-1]
    assert np.linalg.norm(moved) > 10.0


def test_the_determinant_falls_to_zero_where_the_branch_ends() -> None:
    statics = statics_of(plant_config(), ideal=True)
    here, determinants = settled(statics, setting(0.5, 0.0)), []
    for angle in np.linspace(0.0, 3.24, 400):
        followed = statics.follow(here, setting(0.5, float(angle)), statics.no_sliders())
        assert followed is not None
        here, snapped = followed
        if snapped:
            break
        determinants.append(here.determinant)
    assert snapped
    assert np.all(np.diff(determinants[200:]) < 0.0)
    # It falls like the root of the way that is left: the square has a zero there.
    squares = np.square(determinants[-6:])
    ahead = squares[-1] + (squares[-1] - squares[-2])
    assert ahead < 0.02


def test_tubes_on_a_ridge_fall_to_one_side_and_always_the_same() -> None:
    """Held in perfect balance between two shapes, they take one when let go."""
    statics = statics_of(plant_config(), ideal=True)
    tips = [settled(statics, setting(0.5, np.pi)).march.position_mm[-1] for _ in range(2)]
    np.testing.assert_array_equal(*tips)
    assert np.abs(tips[0][0]) > 5.0


def test_a_load_that_grows_makes_tubes_snap_too() -> None:
    """Drawn in and turned nearly to the end of its branch, the inner tube is pushed over it."""
    statics = statics_of(plant_config(), ideal=True)
    way = [setting(0.5, float(a)) for a in np.linspace(0.0, 3.2, 100)]
    found, snaps = swept(statics, settled(statics, way[0]), way)
    assert sum(snaps) == 0
    times = []
    for sign in (1.0, -1.0):
        pushed = way[-1]._replace(tip_n=np.array([0.3 * sign, 0.0, 0.0]))
        followed = statics.follow(found[-1], pushed, statics.no_sliders())
        assert followed is not None
        assert followed[0].determinant > 0.0
        times.append(followed[1])
    assert sorted(times) == [0, 1]
