"""The shapes that are shipped: what makes a cycle of each kind from its options."""

from bisect import bisect_right
from collections.abc import Callable
from dataclasses import replace
from math import cos, pi, sin, tau
from pathlib import Path
from typing import Final

import numpy as np

from config.documents.model import Vector3
from config.tasks.trajectory import (
    Circle,
    Helix,
    Hold,
    Lissajous,
    Plane,
    Planned,
    RandomSmooth,
    Rectangle,
    Star,
    Waypoints,
)
from daemon.reference.planned_path import read_path
from daemon.reference.trajectories import Cycle, Motion
from daemon.reference.waypoints import checked_waypoints, read_waypoints
from drivers.pose import Vector

# Each is called with (options, base folder, cycles) and gives a cycle.


_AXES: Final[dict[Plane, tuple[int, int, int]]] = {
    "xy": (0, 1, 2),
    "xz": (0, 2, 1),
    "yz": (1, 2, 0),
}
_SHORTEST: Final = 1e-6
"""Of what is half way between two opposite directions."""
_EXTENT_SAMPLES: Final = 2000
"""Of a random path, from which its size is found."""


def _directions(times: Vector, directions: Vector) -> Callable[[float], Motion]:
    """Between two rows of (n, 3) unit vectors the shorter way along the sphere, nearly evenly."""
    begins_s: list[float] = times[:-1].tolist()

    def at(t_s: float) -> Motion:
        leg = max(bisect_right(begins_s, t_s) - 1, 0)
        lasts_s = times[leg + 1] - times[leg]
        change = directions[leg + 1] - directions[leg]
        between = directions[leg] + (t_s - times[leg]) / lasts_s * change
        length = max(float(np.sqrt(between @ between)), _SHORTEST)
        direction = between / length
        rate = change / lasts_s
        return direction, (rate - (direction @ rate) * direction) / length

    return at


def _stay(place: Vector) -> Cycle:
    return Cycle(lambda _: (place.copy(), np.zeros(3)))


def hold(options: Hold, base: Path, cycles: int) -> Cycle:
    """Staying at a point."""
    del base, cycles
    return replace(_stay(np.array(options.position_mm)), lasts_s=options.duration_s)


def waypoints(options: Waypoints, base: Path, cycles: int) -> Cycle:
    """Straight lines between points. Raises WaypointError."""
    closed = cycles > 1
    if options.file is not None:
        times, rows = read_waypoints(base / options.file, closed=closed)
    else:
        times, rows = checked_waypoints(options.points or (), closed=closed)
    cycle = replace(_polyline(times, rows[:, :3]), lasts_s=float(times[-1]))
    if rows.shape[1] > 3:
        return replace(cycle, pointing=_directions(times, rows[:, 3:]))
    return cycle


def planned(options: Planned, base: Path, cycles: int) -> Cycle:
    """Where a planned path leads the tip. Raises PlannedPathError."""
    if cycles > 1:
        raise ValueError("a planned path is gone once: it does not end where it begins")
    path = read_path(base / (options.file or "")) if options.path is None else options.path
    times = np.array(path.t_s)
    cycle = replace(_polyline(times, np.array(path.tip_mm)), lasts_s=float(times[-1]), path=path)
    if path.direction is None:
        return cycle
    ways = np.array(path.direction)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    return replace(cycle, pointing=_directions(times, ways))


def _polyline(times: Vector, points: Vector) -> Cycle:
    """Straight lines, each gone along evenly. times: (n,) from 0, rising. points: (n, 3)."""
    velocities = np.diff(points, axis=0) / np.diff(times)[:, None]
    begins_s: list[float] = times[:-1].tolist()

    def at(t_s: float) -> Motion:
        leg = max(bisect_right(begins_s, t_s) - 1, 0)
        velocity = velocities[leg]
        return points[leg] + (t_s - begins_s[leg]) * velocity, velocity.copy()

    return Cycle(at, times)


def rectangle(options: Rectangle, base: Path, cycles: int) -> Cycle:
    """Round a rectangle, its corners sharp."""
    del base, cycles
    along, up, _ = _AXES[options.plane]
    sizes = ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))
    corners = np.tile(np.array(options.center_mm), (5, 1))
    for corner, (right, above) in zip(corners, sizes, strict=True):
        corner[along] += 0.5 * right * options.width_mm
        corner[up] += 0.5 * above * options.height_mm
    passed = np.cumsum([0.0, *np.linalg.norm(np.diff(corners, axis=0), axis=1)])
    return _polyline(passed / passed[-1] * options.cycle_s, corners)


def _round(center_mm: Vector3, plane: Plane, radius_mm: float) -> Callable[[float, float], Motion]:
    """A point on a circle at an angle and an angular velocity."""
    first, second, _ = _AXES[plane]

    def at(angle: float, rate: float) -> Motion:
        position, velocity = np.array(center_mm), np.zeros(3)
        position[first] += radius_mm * cos(angle)
        position[second] += radius_mm * sin(angle)
        velocity[first] = -radius_mm * rate * sin(angle)
        velocity[second] = radius_mm * rate * cos(angle)
        return position, velocity

    return at


def circle(options: Circle, base: Path, cycles: int) -> Cycle:
    """Round a circle."""
    del base, cycles
    at, rate = _round(options.center_mm, options.plane, options.radius_mm), tau / options.cycle_s
    return Cycle(lambda t_s: at(rate * t_s, rate))


def helix(options: Helix, base: Path, cycles: int) -> Cycle:
    """Round a rising circle, and back."""
    del base, cycles
    turn = _round(options.center_mm, options.plane, options.radius_mm)
    normal = _AXES[options.plane][2]
    half_s = 0.5 * options.cycle_s

    def at(t_s: float) -> Motion:
        back = t_s >= half_s
        share = (options.cycle_s - t_s if back else t_s) / half_s
        direction = (-1.0 if back else 1.0) / half_s
        turned = tau * options.turns
        position, velocity = turn(turned * share, turned * direction)
        position[normal] += options.rise_mm * share
        velocity[normal] = options.rise_mm * direction
        return position, velocity

    return Cycle(at, np.array([half_s]))


def lissajous(options: Lissajous, base: Path, cycles: int) -> Cycle:
    """Sines along all coordinates."""
    del base, cycles
    center, amplitude = np.array(options.center_mm), np.array(options.amplitude_mm)
    rates = 2.0 * pi * np.array(options.frequencies) / options.cycle_s
    phases = np.array(options.phases_rad)

    def at(t_s: float) -> Motion:
        angle = rates * t_s + phases
        return center + amplitude * np.sin(angle), amplitude * rates * np.cos(angle)

    return Cycle(at)


def star(options: Star, base: Path, cycles: int) -> Cycle:
    """Round a star, its corners sharp."""
    del base, cycles
    first, second, _ = _AXES[options.plane]
    count = 2 * options.points
    angles = tau * np.arange(count + 1) / count
    radii = np.where(np.arange(count + 1) % 2, options.inner_radius_mm, options.radius_mm)
    corners = np.tile(np.array(options.center_mm), (count + 1, 1))
    corners[:, first] += radii * np.cos(angles)
    corners[:, second] += radii * np.sin(angles)
    corners[-1] = corners[0]
    return _polyline(options.cycle_s * np.arange(count + 1) / count, corners)


def random_smooth(options: RandomSmooth, base: Path, cycles: int) -> Cycle:
    """A closed random curve: sines whose amplitudes fall with their frequency."""
    del base, cycles
    random = np.random.default_rng(options.seed)
    orders = np.arange(1, options.harmonics + 1)
    weights = random.normal(size=(3, options.harmonics)) / orders
    phases = random.uniform(0.0, tau, (3, options.harmonics))
    turns = np.linspace(0.0, tau, _EXTENT_SAMPLES, endpoint=False)
    courses = (weights[:, :, None] * np.sin(orders[:, None] * turns + phases[:, :, None])).sum(1)
    lowest, highest = courses.min(axis=1), courses.max(axis=1)
    scale = np.array(options.size_mm) / (highest - lowest)
    middle = np.array(options.center_mm) - scale * 0.5 * (lowest + highest)
    weights *= scale[:, None]
    rates = tau * orders / options.cycle_s

    def at(t_s: float) -> Motion:
        angles = rates * t_s + phases
        place = middle + (weights * np.sin(angles)).sum(axis=1)
        return place, (weights * rates * np.cos(angles)).sum(axis=1)

    return Cycle(at)
