"""contact_risk: how likely any part of the body, as thick as it is, touches something solid.

Whole shapes are drawn from a mixture over the coefficients of the body's shape, and measured
against a grid of distances. This is the risk that decides. It is not body_point_risk, which is the
share of the body that is in something solid: see `body_point`.

The draws are the same for every question, so that shapes move as the mixture moves: along a path a
body stays the body that it was, and the risk does not flicker.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from safety.risk.contact_figures import (
    ContactRisk,
    PathContactRisk,
    Touching,
    WorstPlace,
    counted,
    few_of,
    share_touching,
    threshold_mm,
)
from safety.risk.contact_kernels import CAP_MM, FINEST_MM, are_far, clearances, sweep
from safety.risk.model.mixture import FloatArray, IndexArray, Mixture
from safety.risk.model.shape_basis import ShapeBasis, SingleArray
from safety.risk.moving_obstacles import NOTHING_MOVES, MovingClearance, Swept, longest_ways
from safety.risk.part_kernels import Draws, PartSlopes, no_slopes, part_slopes
from safety.risk.shape_kernels import (
    Shapes,
    Skin,
    SolidArrays,
    enclose_draws,
    exchange,
    fall_to,
    find_changed,
    find_longest,
    in_lanes,
    lower,
    place_shapes,
    worst_place,
)
from safety.risk.surroundings.distance_grid import DistanceGrid
from safety.risk.surroundings.environment import InsertionPort

_ROUNDED: Final = 1e-3
"""Standard deviations: draws are rounded by less."""


@dataclass(slots=True, eq=False)
class _Measured:
    """All draws in one mixture."""

    shapes: Shapes
    component: IndexArray
    """(S,) which each draw belongs to."""
    mixture: Mixture | None = None
    """None: nothing has been measured yet."""
    moving: SingleArray | None = None
    """(S,) what no part of each is nearer to what moves; None: nothing that moves is near."""
    looked_mm: float = 0.0
    """So far it was looked for."""


class ContactModel:
    """contact_risk of one body in one environment. Not for several threads: they would share its
    room.

    Raises ValueError where the grid is not made for so thick a body.
    """

    def __init__(
        self,
        basis: ShapeBasis,
        grid: DistanceGrid,
        port: InsertionPort | None,
        samples: int = 1000,
        seed: int = 0,
        every: int = 1,
    ) -> None:
        """every: of so many draws one is taken, from those that another one takes all of."""
        # Decided is where interpolated distances are up to so much, from corners one cube away.
        decided_mm = grid.error_mm + FINEST_MM + CAP_MM
        needed_mm = basis.thickest_mm + decided_mm + 2.0 * grid.error_mm
        if needed_mm > grid.exact_to_mm:
            raise ValueError(
                f"the grid is exact to {grid.exact_to_mm:g} mm, and the body needs {needed_mm:.3g}"
            )
        random = np.random.default_rng(seed)
        self._basis = basis
        self._grid = grid
        uniform = random.random(samples)
        # In this order those of one component are neighbours, and so are their shapes.
        order = np.argsort(uniform)
        self._uniform = uniform[order][::every].copy()
        self._normal = random.standard_normal((samples, basis.coefficients))[order][::every].copy()
        self._lengths = (np.linalg.norm(self._normal, axis=1) + _ROUNDED).astype(np.float32)
        samples = self._uniform.size
        self._base = in_lanes(basis.base_mm.ravel())
        self._modes = in_lanes(basis.modes.reshape(basis.coefficients, -1))
        self._surroundings = surroundings_of(grid, port)
        safe = basis.radius_mm + basis.left_out_mm
        self._skin = Skin(basis.radius_mm, safe, basis.left_out_mm.max())
        self._moving_clearance = MovingClearance(self._skin, basis.arc_mm, samples)
        self._swept = NOTHING_MOVES
        self._exact = few_of(samples)
        """Of how many shapes, those with the least, the clearance has to be exact."""
        nowhere = np.zeros(samples, np.int64)
        self._now, self._next = (_Measured(self._buffers(samples), nowhere) for _ in range(2))
        self._arriving, self._changed = self._buffers(samples), np.empty(samples, np.int64)
        """Room for draws that fall to another component on a way: as they arrive; and which."""

    @property
    def basis(self) -> ShapeBasis:
        """The body."""
        return self._basis

    @property
    def surroundings(self) -> SolidArrays:
        """As the compiled code reads them."""
        return self._surroundings

    @property
    def skin(self) -> Skin:
        """Of the body, as the compiled code reads it."""
        return self._skin

    def take_moving(self, swept: Swept) -> None:
        """Count with these from now on."""
        self._swept = swept
        self._now.mixture = self._next.mixture = None

    def look_as_far_as(self, far_mm: float) -> None:
        """At what moves: at least so far."""
        self._moving_clearance.look_as_far_as(far_mm)

    def near_moving(self, mixture: Mixture) -> bool:
        """Whether anything that moves is near to the body at rest."""
        self._measure(mixture)
        return self._now.moving is not None

    def is_far(self, mixtures: Sequence[Mixture]) -> bool:
        """Whether it is proved of all draws at once that nothing is near to any on its way through
        the mixtures: none touches. It takes a small part of what looking at each of them takes.

        A draw is within its component's ellipsoid, and on its way between those of two mixtures.
        """
        if self._swept.capsules.size:
            return False
        components = max(mixture.components for mixture in mixtures)
        longest = np.full(components, -1.0, np.float32)
        for mixture in mixtures:
            self._check(mixture)
            find_longest(mixture.weights, self._uniform, self._lengths, longest)
        balls = np.full((components, 5, self._basis.nodes), -1.0, np.float32)
        for mixture in mixtures:
            means, factors = mixture.means_mm, mixture.factors_per_mm
            enclose_draws(means, factors, longest, self._base, self._modes, balls)
        return bool(are_far(self._surroundings, self._skin, balls))

    def risk(self, mixture: Mixture) -> ContactRisk:
        """Of the body at rest."""
        self._measure(mixture)
        shapes = self._now.shapes
        found = counted(shapes.clearance, shapes.surely)
        return ContactRisk.of(found, self._worst(shapes, found.threshold_mm))

    def clearance_mm(self, mixture: Mixture, share: float) -> float:
        """What this share of the shapes, or one of them, have no more clearance than."""
        self._measure(mixture)
        clearance = self._now.shapes.clearance
        rank = min(max(0, int(share * clearance.size)), clearance.size - 1)
        if rank >= self._exact:
            self._exact = rank + 1
            self._now.mixture = self._next.mixture = None
            self._measure(mixture)
            clearance = self._now.shapes.clearance
        return float(np.partition(clearance, rank)[rank])

    def part_slopes(
        self, mixture: Mixture, share: float, ends: IndexArray, near_mm: float
    ) -> PartSlopes:
        """The same of each part of the body, smoothed over shapes, and by the mixture.

        ends: (P + 1,) nodes; part p has those from ends[p] to before ends[p + 1]. Derivatives are
        those of parts with no more than near_mm.
        """
        self._measure(mixture)
        found = no_slopes(ends.size - 1, mixture.components, mixture.dimensions)
        few = min(1 + 2 * int(share * self._uniform.size), self._uniform.size)
        draws = Draws(
            self._now.shapes.positions, self._now.component, self._normal, mixture.factors_per_mm
        )
        skin = self._skin.radius
        part_slopes(self._surroundings, skin, self._modes, draws, ends, few, near_mm, found)
        return found

    def centrelines(self, mixture: Mixture) -> SingleArray:
        """(samples, n, 3) the shapes themselves, to be drawn."""
        self._measure(mixture)
        return self._now.shapes.positions.reshape(len(self._uniform), -1, 3).copy()

    def along(self, mixtures: Sequence[Mixture]) -> PathContactRisk:
        """Of the body on its way through mixtures that lie close together.

        Each draw is one body: it goes straight from its shape in one mixture to that in the next.
        Where the weights make it another component's, it first arrives as what it was. A way that
        begins where the last question was is quicker, if it is the same object.
        """
        if not mixtures:
            raise ValueError("a path has at least one waypoint")
        self._measure(mixtures[0])
        start = Touching.of(self._now.shapes)
        swept, surely = self._now.shapes.clearance.copy(), self._now.shapes.surely.copy()
        estimates, lowest_mm = [share_touching(swept)], threshold_mm(swept)
        worst: WorstPlace | None = None
        for mixture in mixtures[1:]:
            before = self._now
            self._now, self._next = self._next, self._now
            self._measure_anew(mixture)
            self._sweep(before, self._now, swept, surely)
            estimates.append(share_touching(self._now.shapes.clearance))
            there_mm = threshold_mm(self._now.shapes.clearance)
            if there_mm <= lowest_mm:
                lowest_mm, worst = there_mm, self._worst(self._now.shapes, there_mm)
            elif worst is None:  # where it begins: those shapes are still there
                worst = self._worst(before.shapes, lowest_mm)
        leaving = start.left(self._now.shapes, surely) if start.count else None
        worst = worst or self._worst(self._now.shapes, lowest_mm)
        figures, touching = ContactRisk.of(counted(swept, surely), worst), ~(surely > 0.0)
        return PathContactRisk(figures, tuple(estimates), leaving, touching)

    def warm_up(self) -> None:
        """Compile what only draws need that fall to another component, or load it from numba's
        cache."""
        shapes, none = self._now.shapes, self._changed[:0]
        exchange(shapes, none, shapes)
        lower(shapes.clearance, shapes.surely, shapes, none)

    def _measure(self, mixture: Mixture) -> None:
        """Have the mixture's shapes now, looked at. Those of the last two mixtures are kept."""
        if self._next.mixture is mixture:
            self._now, self._next = self._next, self._now
        if self._now.mixture is not mixture:
            self._measure_anew(mixture)

    def _check(self, mixture: Mixture) -> None:
        if mixture.dimensions != self._basis.coefficients:
            raise ValueError(
                f"the body's shape has {self._basis.coefficients} coefficients, and the mixture is "
                f"over {mixture.dimensions}"
            )

    def _measure_anew(self, mixture: Mixture) -> None:
        self._check(mixture)
        component = np.empty(self._uniform.size, np.int64)
        fall_to(mixture.weights, self._uniform, component)
        self._now.mixture = None
        self._now.looked_mm = self._moving_clearance.far_mm
        shapes = self._now.shapes
        self._place(mixture, component, self._normal, shapes.positions)
        self._now.moving = self._look(shapes)
        self._now.mixture, self._now.component = mixture, component

    def _place(
        self, mixture: Mixture, component: IndexArray, normal: FloatArray, positions: SingleArray
    ) -> None:
        """Write where the shapes of draws are."""
        means, factors, base = mixture.means_mm, mixture.factors_per_mm, self._base
        place_shapes(means, factors, component, normal, base, self._modes, positions)

    def _look(self, shapes: Shapes) -> SingleArray | None:
        """Fill `shapes`, whose positions there are, with their clearances.

        Returns what no part of each is nearer to what moves; None: nothing that moves is near.
        """
        clearances(self._surroundings, self._skin, shapes, self._exact)
        found = self._moving_clearance.look(self._swept, shapes.positions)
        if found is None:
            return None
        near, node, safe = found
        shapes.node[:] = np.where(near < shapes.clearance, node, shapes.node)
        np.minimum(shapes.clearance, near, out=shapes.clearance)
        np.minimum(shapes.surely, safe, out=shapes.surely)
        return safe.copy()

    def _sweep(
        self, start: "_Measured", end: "_Measured", swept: SingleArray, surely: SingleArray
    ) -> None:
        """Lower `swept` and `surely` by the way from the one's shapes to the other's."""
        surroundings, skin = self._surroundings, self._skin
        count = find_changed(start.component, end.component, self._changed)
        if count == 0 or end.mixture is None:
            sweep(surroundings, skin, start.shapes, end.shapes, swept, surely)
            self._pass_moving(start, end.shapes, end.moving, surely)
            return
        changed = self._changed[:count]
        arriving = Shapes._make([one[:count] for one in self._arriving])
        component, normal = start.component[changed], self._normal[changed]
        self._place(end.mixture, component, normal, arriving.positions)
        there = self._look(arriving)
        exchange(end.shapes, changed, arriving)
        sweep(surroundings, skin, start.shapes, end.shapes, swept, surely)
        moving = end.moving
        if moving is not None or there is not None:
            far_mm = self._moving_clearance.far_mm
            moving = np.full(surely.size, far_mm, np.float32) if moving is None else moving.copy()
            moving[changed] = far_mm if there is None else there
        self._pass_moving(start, end.shapes, moving, surely)
        exchange(end.shapes, changed, arriving)
        lower(swept, surely, end.shapes, changed)

    def _pass_moving(
        self, start: _Measured, end: Shapes, after: SingleArray | None, surely: SingleArray
    ) -> None:
        """Lower (S,) `surely` by what no part of each shape comes nearer to what moves: no node
        goes farther than the one that goes farthest, and all go straight. after: (S,) where they
        arrive."""
        if start.moving is None and after is None:
            return
        far = np.float32(self._moving_clearance.far_mm)
        before = np.float32(start.looked_mm) if start.moving is None else start.moving
        longest = longest_ways(start.shapes.positions, end.positions)
        least = np.float32(0.5) * (before + (far if after is None else after) - longest)
        np.minimum(surely, least, out=surely)

    def _worst(self, shapes: Shapes, threshold: float) -> WorstPlace:
        """threshold: mm, that none of the worst has more than."""
        place_mm, nearest_mm = np.empty(3), np.empty(3)
        node = worst_place(self._surroundings, shapes, threshold, place_mm, nearest_mm)
        if self._swept.capsules.size:
            away_mm, moving_mm = self._swept.nearest(place_mm)
            if away_mm < np.linalg.norm(nearest_mm - place_mm):
                nearest_mm = moving_mm
        return WorstPlace(float(self._basis.arc_mm[node]), place_mm, nearest_mm, threshold)

    def _buffers(self, samples: int) -> Shapes:
        return Shapes(
            np.empty((samples, 3 * self._basis.nodes), np.float32),
            np.empty(samples, np.float32),
            np.empty(samples, np.int64),
            np.empty(samples, np.float32),
            np.empty(samples, np.float32),
        )


def surroundings_of(grid: DistanceGrid, port: InsertionPort | None) -> SolidArrays:
    """A grid and a port as the compiled code reads them."""
    outside = -1.0 if grid.solid_around else 1.0
    frame = [*grid.origin_mm, 1.0 / grid.spacing_mm, outside, grid.margin_mm, grid.error_mm]
    # Between corners that are said to be farther away than this, none may be exact.
    frame.append(grid.exact_to_mm - 2.0 * grid.error_mm)
    hole = [0.0] * 6 + [-1.0, 0.0]
    if port is not None:
        inwards = np.asarray(port.inwards) / np.linalg.norm(port.inwards)
        hole = [*port.centre_mm, *inwards, port.radius_mm, port.depth_mm]
    return SolidArrays(
        grid.values_mm.ravel(),
        np.array(grid.values_mm.shape, np.uint64),
        np.array(frame, np.float32),
        np.array(hole, np.float32),
    )
