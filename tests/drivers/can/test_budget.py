"""The bus budget against worked figures of a bus with one drive per axis."""

import pytest

from drivers.can.budget import BusTraffic, CyclicPdo, bus_budget


def traffic(axes: int, rate_hz: float, bitrate_bit_s: int = 1_000_000) -> BusTraffic:
    pdos = [CyclicPdo(6), CyclicPdo(8)] * axes
    return BusTraffic(bitrate_bit_s, 1 / rate_hz, pdos, [0.1] * (axes + 1))


@pytest.mark.parametrize(
    ("axes", "rate_hz", "percent"),
    [
        (3, 100, 8.8),
        (6, 200, 32.1),
        (6, 500, 78.7),
        (7, 500, 91.3),
        (12, 100, 31.9),
        (12, 250, 77.8),
    ],
)
def test_load_of_six_bytes_out_and_eight_in_per_axis(
    axes: int, rate_hz: float, percent: float
) -> None:
    assert 100 * bus_budget(traffic(axes, rate_hz)).load == pytest.approx(percent, abs=0.15)


@pytest.mark.parametrize(
    ("rate_hz", "bitrate_bit_s", "most_axes"),
    [
        (100, 1_000_000, 30),
        (200, 1_000_000, 15),
        (400, 1_000_000, 7),
        (500, 1_000_000, 6),
        (100, 500_000, 15),
        (200, 500_000, 7),
    ],
)
def test_the_most_axes_a_bus_can_carry(rate_hz: float, bitrate_bit_s: int, most_axes: int) -> None:
    def refused(axes: int) -> bool:
        return bus_budget(traffic(axes, rate_hz, bitrate_bit_s)).refused

    assert not refused(most_axes)
    assert refused(most_axes + 1)


def test_a_busy_bus_is_warned_of_before_it_is_refused() -> None:
    assert not bus_budget(traffic(6, 200)).warned
    assert bus_budget(traffic(6, 400)).warned
    assert not bus_budget(traffic(6, 400)).refused


def test_slow_pdos_count_whole_in_the_fullest_cycle() -> None:
    slow = BusTraffic(1_000_000, 0.01, [CyclicPdo(8, every_n_syncs=10)] * 70, [])
    budget = bus_budget(slow)
    assert budget.load < 0.2
    assert 0.9 < budget.fullest_cycle < 1.0
    assert budget.warned
    assert not budget.refused


def test_a_cycle_that_cannot_hold_its_frames_is_refused() -> None:
    rare = BusTraffic(1_000_000, 0.002, [CyclicPdo(8, every_n_syncs=100)] * 16, [])
    assert bus_budget(rare).load < 0.1
    assert bus_budget(rare).refused
