"""A clamped elastic rod with tendons or chambers along it, as arrays that the kernels understand.

The rod is described by its total internal force n and moment m, so tendons are internal: no point
loads at their ends and no derivative of their tension. With frame R and strains v, u along s:

    p' = R v,  R' = R û,  m' = n × p',  n(s) known for dead loads, and locally
    K_v (v − v*) + Σ τ t = Rᵀ n,  K_u (u − u*) + Σ τ r × t = Rᵀ m,  t along g = v + u × r + r'

(Rucker and Webster, T-RO 27, 2011, in total-wrench form). Units are mm, N, N·mm and rad.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from sim_backends.plants import rod_kernels
from sim_backends.plants.rod_kernels import ABSENT, CHAMBER, TENDON, FloatArray, LoadedRod, March

NEUTRAL = 0.005
"""Stiffness against turning, in EI/L² plus the load, that passes for zero. A round rod that has
buckled is free to turn about its load, and rounding would decide the sign. So a column may exceed
its buckling load by 0.7 % before it counts as unstable."""

UNLOADED_STRAIN = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
"""Straight, as long as at rest."""


@dataclass(frozen=True)
class Section:
    """Stiffness of the cross-section, about its principal axes x and y and along z."""

    bending_n_mm2: float
    torsion_n_mm2: float
    shear_n: float
    axial_n: float

    def diagonal(self) -> FloatArray:
        """(6,) stiffness against (shear, shear, stretch, bend, bend, twist)."""
        shear, bending = self.shear_n, self.bending_n_mm2
        return np.array([shear, shear, self.axial_n, bending, bending, self.torsion_n_mm2])


@dataclass(frozen=True)
class Route:
    """Where a tendon or a chamber runs, from `start_mm` to `end_mm` of the body at rest.

    offset: s (n,) to its place (n, 2) in the cross-section, mm. slope: the derivative of that.
    A chamber pushes along the normal of the cross-section, a tendon pulls along its own tangent.
    """

    offset: Callable[[FloatArray], FloatArray]
    slope: Callable[[FloatArray], FloatArray]
    start_mm: float
    end_mm: float
    chamber: bool = False


def helix(
    radius_mm: float,
    angle_rad: float,
    start_mm: float,
    end_mm: float,
    *,
    turn_rad_per_mm: float = 0.0,
    chamber: bool = False,
) -> Route:
    """A route at constant distance from the axis, straight or winding, at `angle_rad` for s = 0."""

    def offset(s: FloatArray) -> FloatArray:
        angle = angle_rad + turn_rad_per_mm * s
        return radius_mm * np.stack([np.cos(angle), np.sin(angle)], axis=-1)

    def slope(s: FloatArray) -> FloatArray:
        angle = angle_rad + turn_rad_per_mm * s
        turn = radius_mm * turn_rad_per_mm
        return turn * np.stack([-np.sin(angle), np.cos(angle)], axis=-1)

    return Route(offset, slope, start_mm, end_mm, chamber)


class Rod:
    """The geometry: N intervals whose nodes fall on every place where something begins or ends."""

    def __init__(
        self,
        length_mm: float,
        section: Section,
        routes: Sequence[Route],
        intervals: int,
        breaks_mm: Sequence[float] = (),
    ) -> None:
        self.length_mm = length_mm
        self.section = section
        ends = [end for route in routes for end in (route.start_mm, route.end_mm)]
        self.nodes_mm = _nodes(length_mm, [*ends, *breaks_mm], intervals)
        self.step = np.diff(self.nodes_mm)
        self.stiffness = np.tile(section.diagonal(), (self.intervals, 1))
        start = self.nodes_mm[:-1]
        self.places_mm = np.stack([start, start + 0.5 * self.step, start + self.step], axis=1)
        self.kind = np.zeros((self.intervals, len(routes)), dtype=np.int8)
        self.offset = np.zeros((self.intervals, 3, len(routes), 4))
        for index, route in enumerate(routes):
            middle = self.places_mm[:, 1]
            there = (middle > route.start_mm) & (middle < route.end_mm)
            self.kind[:, index] = np.where(there, CHAMBER if route.chamber else TENDON, ABSENT)
            self.offset[..., index, :2] = route.offset(self.places_mm)
            self.offset[..., index, 2:] = route.slope(self.places_mm)
        self.presence = (self.kind != ABSENT).astype(np.float64)
        self._above = (1.0 - self.nodes_mm / length_mm)[:, None]
        self.rest = np.tile(UNLOADED_STRAIN, (self.intervals, 3, 1))

    @property
    def intervals(self) -> int:
        return len(self.step)

    @property
    def routes(self) -> int:
        return self.kind.shape[1]

    def internal_force(self, tip_n: FloatArray, weight_n: FloatArray) -> FloatArray:
        """(N+1, 3) force at the nodes under a dead force at the tip and an even own weight."""
        return np.asarray(tip_n + self._above * weight_n)

    def loaded(
        self, tension: FloatArray, force: FloatArray, stiffness: FloatArray, rest: FloatArray
    ) -> LoadedRod:
        """The rod under tensions (N, m) and internal forces (N+1, 3), N; stiffness (N, 6) and
        rest (N, 3, 6) strain as they are now."""
        return LoadedRod(self.step, stiffness, rest, self.offset, self.kind, tension, force)

    def march(self, loaded: LoadedRod, base_moment: FloatArray, guess: FloatArray) -> March | None:
        """Integrate from the base. None: no such rod (pressed flat, or strains without balance).

        base_moment (3,) N·mm; guess (N, 3, 6) strains. Accurate to the fourth order of the
        intervals' length.
        """
        nodes = self.intervals + 1
        march = March(
            np.empty((nodes, 3)),
            np.empty((nodes, 4)),
            np.empty((nodes, 3)),
            guess.copy(),
            np.empty(self.routes),
        )
        return march if rod_kernels.march(loaded, base_moment, march) else None

    def tangent(
        self, loaded: LoadedRod, march: March, spread: FloatArray
    ) -> tuple[FloatArray, int] | None:
        """How the march answers to small changes, and in how many ways it would turn away.

        spread (N, m): change of the tensions per newton of each route's pull. Returns the
        response (3+m, 3+m), d(tip moment, route lengths) / d(base moment, pulls), accurate to the
        second order of the intervals' length, and the number of directions in which the rod's
        energy falls with pulls and forces held: zero where the rod is stable.
        """
        size = 3 + self.routes
        response, transfer = np.empty((size, size)), np.empty((self.intervals, 6, 6))
        if not rod_kernels.tangent(loaded, spread, march, response, transfer):
            return None
        foundation = self.foundation(loaded.force)
        return response, rod_kernels.unstable_directions(self.step, transfer, foundation)

    def foundation(self, force: FloatArray) -> float:
        """N·mm/rad per mm: what passes for no stiffness under an internal force (N+1, 3)."""
        unit = self.section.bending_n_mm2 / self.length_mm**2
        strongest: float = max(map(abs, force[0].tolist()))
        return NEUTRAL * (unit + strongest)


def _nodes(length_mm: float, breaks_mm: Sequence[float], intervals: int) -> FloatArray:
    """Nodes on all breaks, the pieces between divided evenly into about `intervals` in all."""
    inside = {float(s) for s in breaks_mm if 0.0 < s < length_mm}
    corners = [0.0, *sorted(inside), length_mm]
    nodes = [np.zeros(1)]
    for start, end in pairwise(corners):
        count = max(1, round(intervals * (end - start) / length_mm))
        nodes.append(np.linspace(start, end, count + 1)[1:])
    return np.concatenate(nodes)
