"""A sensor that does not sit at the very frame of what it is attached to."""

import numpy as np
import pytest

from drivers.pose import conjugate, multiply, rotate
from tests.sim_backends.aurora.bench import BASE, TIP, Bench

QUARTER = (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0)
"""About x: z comes to lie where -y was."""


def seen(bench: Bench, handle: str) -> tuple[np.ndarray, np.ndarray]:
    """Quaternion and position, mm, in the field generator's frame."""
    bench.set_up()
    assert bench.ask("TSTART:") == "OKAY"
    bench.wait(0.1)
    reply = bench.ask("TX:0001")
    line = next(line for line in reply[2:].split("\n") if line.startswith(handle))
    numbers = line[2:]
    turn = [float(numbers[6 * i : 6 * i + 6]) / 1e4 for i in range(4)]
    place = [float(numbers[24 + 7 * i : 31 + 7 * i]) / 1e2 for i in range(3)]
    return np.array(turn), np.array(place)


def test_a_sensor_is_seen_where_it_sits_on_the_tip() -> None:
    mounted = TIP.model_copy(update={"position_mm": (1.0, 2.0, -1.5), "quaternion": QUARTER})
    turn, place = seen(Bench(mounted, BASE), "0A")
    at_tip, tip = seen(Bench(TIP, BASE), "0A")
    np.testing.assert_allclose(place - tip, [1.0, 2.0, -1.5], atol=0.011)
    np.testing.assert_allclose(multiply(conjugate(at_tip), turn), QUARTER, atol=2e-4)


def test_two_sensors_on_one_tip_are_seen_at_their_own_places() -> None:
    """The offset is one in the frame of the tip, and turns with the robot's base."""
    other = TIP.model_copy(
        update={"port": 2, "serial": "3C112805", "position_mm": (0.0, 0.0, -10.0)}
    )
    bench = Bench(TIP, other, base_quaternion=QUARTER)
    _, first = seen(bench, "0A")
    _, second = seen(Bench(TIP, other, base_quaternion=QUARTER), "0B")
    expected = rotate(np.array(QUARTER), np.array([0.0, 0.0, -10.0]))
    np.testing.assert_allclose(second - first, expected, atol=0.011)


def test_a_rotation_need_not_be_of_unit_length_but_is_never_zero() -> None:
    with pytest.raises(ValueError, match="zero is no rotation"):
        type(TIP).model_validate({**TIP.model_dump(), "quaternion": (0.0, 0.0, 0.0, 0.0)})
