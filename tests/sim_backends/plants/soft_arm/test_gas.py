"""Enclosed gas: its amount is kept, and it flows with the lag."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_backends.plants.plant import FloatArray
from sim_backends.plants.soft_arm.gas import GasLines

AREA = np.array([95.0, 80.0])
LENGTH = np.array([84.0, 70.0])


def lines(supply_mm3: float, kept: float, in_chamber: FloatArray | None = None) -> GasLines:
    """Two lines, balanced at 0.14 MPa with 27 mL of supply unless told otherwise."""
    amount = 0.14 * (27e3 + AREA * LENGTH)
    before = 0.14 * AREA * LENGTH if in_chamber is None else in_chamber
    return GasLines(amount, before, np.full(2, supply_mm3), AREA, kept)


@given(st.floats(1e3, 5e4), st.floats(0.0, 1.0), st.floats(40.0, 150.0))
def test_no_gas_is_lost_or_made(supply_mm3: float, kept: float, length_mm: float) -> None:
    gas, length = lines(supply_mm3, kept), np.full(2, length_mm)
    in_supply = gas.cylinder_pressure(gas.amount_in_chamber(length)) * supply_mm3
    in_chamber = gas.chamber_pressure(length)[0] * AREA * length
    np.testing.assert_allclose(in_supply + in_chamber, gas.amount, rtol=1e-12)
    np.testing.assert_allclose(gas.amount_in_chamber(length), in_chamber, rtol=1e-12)


@given(st.floats(1e3, 5e4), st.floats(40.0, 150.0))
def test_after_long_the_line_has_one_pressure_by_boyles_law(
    supply_mm3: float, length_mm: float
) -> None:
    gas, length = lines(supply_mm3, kept=0.0), np.full(2, length_mm)
    pressure, _ = gas.chamber_pressure(length)
    np.testing.assert_allclose(pressure * (supply_mm3 + AREA * length), gas.amount, rtol=1e-12)
    np.testing.assert_allclose(
        gas.cylinder_pressure(gas.amount_in_chamber(length)), pressure, rtol=1e-9
    )


def test_in_no_time_no_gas_passes_the_tube() -> None:
    gas = lines(10e3, kept=1.0)
    pressure, _ = gas.chamber_pressure(0.5 * LENGTH)
    np.testing.assert_allclose(pressure, 0.28)
    np.testing.assert_allclose(
        gas.cylinder_pressure(gas.amount_in_chamber(0.5 * LENGTH)), 0.14 * 2.7
    )


def test_a_stiff_chamber_fills_with_the_time_constant_of_the_lag() -> None:
    lag_s, dt_s = 0.1, 0.004
    balanced = lines(15e3, kept=0.0).amount_in_chamber(LENGTH)
    in_chamber = 0.14 * AREA * LENGTH
    start = in_chamber
    for _ in range(50):
        in_chamber = lines(15e3, np.exp(-dt_s / lag_s), in_chamber).amount_in_chamber(LENGTH)
    left = (in_chamber - balanced) / (start - balanced)
    np.testing.assert_allclose(left, np.exp(-50 * dt_s / lag_s), rtol=1e-12)


@given(st.floats(1e3, 5e4), st.floats(0.0, 1.0), st.floats(40.0, 150.0))
def test_the_derivative_is_the_derivative(supply: float, kept: float, length: float) -> None:
    gas, step = lines(supply, kept), 1e-3
    above, below = (gas.chamber_pressure(np.full(2, length + d))[0] for d in (step, -step))
    slope = gas.chamber_pressure(np.full(2, length))[1]
    assert slope == pytest.approx((above - below) / (2 * step), rel=1e-5)
    assert (slope < 0).all(), "longer chambers hold their gas at less pressure"
