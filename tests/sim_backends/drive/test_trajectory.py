"""Motion profiles."""

from math import inf, isclose

from hypothesis import given
from hypothesis import strategies as st

from sim_backends.devices.drive.axis.trajectory import Piece, change_velocity, move, stop

rates = st.floats(1.0, 1e6)
speeds = st.floats(1.0, 1e5)
velocities = st.floats(-1e5, 1e5)
distances = st.floats(-1e6, 1e6)


def end_velocity(pieces: list[Piece], start: float) -> float:
    if not pieces:
        return start
    last = pieces[-1]
    if last.acceleration == 0.0:
        return last.velocity
    return last.velocity + last.acceleration * last.duration_s


def continuous(pieces: list[Piece], start: float) -> bool:
    velocity = start
    for piece in pieces:
        if not isclose(piece.velocity, velocity, rel_tol=1e-6, abs_tol=1e-3):
            return False
        velocity = end_velocity([piece], velocity)
    return True


@given(distances, velocities, speeds, rates, rates)
def test_a_move_ends_at_its_target_and_stands_still(
    distance: float, velocity: float, max_velocity: float, up: float, down: float
) -> None:
    pieces = move(distance, velocity, max_velocity, up, down)
    went = sum(piece.distance for piece in pieces)
    scale = abs(distance) + velocity * velocity / down
    assert isclose(went, distance, rel_tol=1e-6, abs_tol=1e-6 * (1 + scale))
    assert abs(end_velocity(pieces, 0.0 if not pieces else velocity)) < 1e-3 * max(
        1.0, max_velocity, abs(velocity)
    )


@given(distances, velocities, speeds, rates, rates)
def test_a_move_keeps_its_limits(
    distance: float, velocity: float, max_velocity: float, up: float, down: float
) -> None:
    pieces = move(distance, velocity, max_velocity, up, down)
    assert continuous(pieces, velocity)
    for piece in pieces:
        assert piece.duration_s >= 0
        assert abs(piece.velocity) <= max(max_velocity, abs(velocity)) * (1 + 1e-9)
        faster = piece.acceleration * piece.velocity > 0 or piece.velocity == 0
        limit = up if faster else max(down, up if piece.velocity == 0 else down)
        assert abs(piece.acceleration) <= limit * (1 + 1e-9)


@given(velocities, velocities, rates, rates)
def test_a_change_of_velocity_gets_there_and_stays(
    velocity: float, target: float, up: float, down: float
) -> None:
    pieces = change_velocity(velocity, target, up, down)
    assert continuous(pieces, velocity)
    if target:
        assert pieces[-1] == Piece(inf, target, 0.0)
    else:
        assert abs(end_velocity(pieces, velocity)) < 1e-3 * max(1.0, abs(velocity))


@given(velocities, rates)
def test_braking_takes_as_long_and_as_far_as_it_must(velocity: float, rate: float) -> None:
    pieces = stop(velocity, rate)
    assert isclose(sum(piece.duration_s for piece in pieces), abs(velocity) / rate)
    way = velocity * abs(velocity) / (2 * rate)
    assert isclose(sum(piece.distance for piece in pieces), way, rel_tol=1e-9, abs_tol=1e-300)


def test_a_trapezoid() -> None:
    assert move(300.0, 0.0, 100.0, 100.0, 50.0) == [
        Piece(1.0, 0.0, 100.0),
        Piece(1.5, 100.0, 0.0),
        Piece(2.0, 100.0, -50.0),
    ]


def test_a_triangle() -> None:
    (up, down) = move(-150.0, 0.0, 1000.0, 100.0, 50.0)
    assert isclose(up.acceleration, -100.0)
    assert isclose(down.velocity, -100.0)
    assert isclose(up.duration_s, 1.0)


def test_what_cannot_stop_in_time_comes_back() -> None:
    pieces = move(10.0, 100.0, 100.0, 100.0, 100.0)
    assert pieces[0] == Piece(1.0, 100.0, -100.0)
    assert all(piece.velocity <= 0 for piece in pieces[1:])
