"""Creep of a single place of the body, against the standard linear solid's closed form."""

import numpy as np
import pytest

from sim_backends.plants.plant import FloatArray
from sim_backends.plants.soft_arm.creep import Creep

STIFFNESS = np.full((1, 6), 100.0)
UNLOADED = np.zeros((1, 3, 6))
SHARE, TIME_S = 0.2, 20.0
FINAL = 0.01


def rested() -> Creep:
    return Creep.rested(STIFFNESS, UNLOADED, UNLOADED, SHARE, TIME_S)


def loaded(creep: Creep, dt_s: float, load: float = 1.0) -> tuple[Creep, float]:
    """What a constant wrench makes of the strain after `dt_s`."""
    stiffness, rest = creep.over(dt_s)
    strain: FloatArray = rest + load / stiffness[:, None]
    return creep.after(dt_s, strain), float(strain[0, 0, 0])


def test_at_once_it_takes_all_but_the_share_and_for_good_all() -> None:
    assert loaded(rested(), 0.0)[1] == pytest.approx((1.0 - SHARE) * FINAL)
    assert loaded(rested(), 1e6)[1] == pytest.approx(FINAL)


def test_the_rest_comes_with_the_creep_time() -> None:
    creep, dt_s = rested(), 0.025
    for _ in range(int(TIME_S / dt_s)):
        creep, strain = loaded(creep, dt_s)
    assert (FINAL - strain) / (SHARE * FINAL) == pytest.approx(np.exp(-1.0), rel=2e-3)


def test_it_comes_back_when_the_load_goes() -> None:
    creep, _ = loaded(rested(), 1e6)
    creep, strain = loaded(creep, 0.0, load=0.0)
    assert strain == pytest.approx(SHARE * FINAL)
    _, strain = loaded(creep, 1e6, load=0.0)
    assert strain == pytest.approx(0.0, abs=1e-12)


def test_a_body_that_has_rested_does_not_move() -> None:
    strain = np.full((1, 3, 6), FINAL)
    creep = Creep.rested(STIFFNESS, UNLOADED, strain, SHARE, TIME_S)
    for dt_s in (0.0, 0.025, 3.0, 1e6):
        assert loaded(creep, dt_s)[1] == pytest.approx(FINAL)
