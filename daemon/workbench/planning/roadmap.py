"""A roadmap of places that the body can hold, and the best path through it: a lazy PRM*.

Places are a Sobol sequence over the body's physical manifold. A way between two neighbours is swept
only when it lies on what would be the best path (Bohlin and Kavraki 2000); then its cost is known,
and the search goes on until nothing of the best path is unknown. The cost is how far the body goes,
and how likely it touches something: −ln(1 − risk), so that risks along a path add up.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import log
from typing import Final

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree
from scipy.stats import qmc

from daemon.host.progress import Progress
from daemon.workbench.body_model.clouds.configurations import manifold_of
from daemon.workbench.planning.body_in_place import (
    CLOSE_SHARE,
    BodyInPlace,
    Standing,
)
from safety.risk.model.mixture import FloatArray, IndexArray

_DRAWN: Final = 13
"""Powers of two of the sequence, at most."""
_FEW_KNOWN: Final = 0.01
"""Of the sequence. Where fewer are known, nobody has said what the body's manifold is (a real robot
has no emulated plant): the places of the model's own training are taken instead."""
_KEEP_AWAY_MM: Final = 8.0
"""Nearer than this a way counts as longer, up to _TWICE as much where it touches."""
_TWICE: Final = 1.0
_FORBIDDEN: Final = np.inf
_MOST_ROUNDS: Final = 2000


@dataclass(frozen=True, slots=True)
class Preference:
    """What makes one path better than another."""

    mm_per_nat: float
    """How much longer the body's way may be for a risk that is smaller by a factor of e."""
    most_risk: float
    """A place or a way with more is not gone. 1: any may be."""

    def cost(self, length_mm: float, standing: Standing) -> float:
        """Of a way, mm."""
        if not standing.allowed or standing.risk > self.most_risk:
            return _FORBIDDEN
        near = min(max(1.0 - standing.clearance_mm / _KEEP_AWAY_MM, 0.0), 1.0)
        risk = -log(max(1.0 - standing.risk, 1e-4))
        longer = _TWICE * near if self.mm_per_nat > 0.0 else 0.0
        return length_mm * (1.0 + longer) + self.mm_per_nat * risk


@dataclass(frozen=True, eq=False)
class RoadmapPath:
    """From the start to one of the goals."""

    places: FloatArray
    """(n, m)."""
    cost: float
    worst: Standing | None
    """Of its ways, the one that is likeliest to touch; None: none was looked at."""


Judge = Callable[[FloatArray, FloatArray], Standing]
"""Of the straight way between two (m,) places."""


class Roadmap:
    """Places, what they are like, and what is known of the ways between them."""

    def __init__(
        self,
        body: BodyInPlace,
        places: FloatArray,
        standings: Sequence[Standing],
        neighbours: int,
        centrelines: Sequence[FloatArray] = (),
    ) -> None:
        """places: (n, m). standings: of each. neighbours: of each that ways lead to. centrelines:
        of the first of them, where they are known."""
        self.body = body
        self.places = places
        self.standings = list(standings)
        self._neighbours = neighbours
        self._swept: dict[tuple[int, int], Standing] = {}
        more = [body.centreline(u) for u in places[len(centrelines) :]]
        self._centrelines = np.array([*centrelines, *more])
        self._edges, self._lengths = self._joined()

    def joined_with(self, more: FloatArray, standings: Sequence[Standing]) -> "Roadmap":
        """The same with (k, m) more places, which come last. What was swept stays known."""
        other = Roadmap(
            self.body,
            np.concatenate([self.places, more]),
            [*self.standings, *standings],
            self._neighbours,
            list(self._centrelines),
        )
        other._swept = dict(self._swept)
        return other

    def tips(self) -> FloatArray:
        """(n, 3) mm."""
        return np.asarray(self._centrelines[:, -1])

    @property
    def swept(self) -> int:
        """How many ways have been looked at."""
        return len(self._swept)

    def path(
        self, start: int, goals: Sequence[int], preference: Preference, judge: Judge
    ) -> RoadmapPath | None:
        """The best one; None: there is none in this roadmap."""
        index = {(a, b): row for row, (a, b) in enumerate(self._edges.tolist())}
        costs = np.array([self._cost(edge, row, preference) for edge, row in index.items()])
        for _ in range(_MOST_ROUNDS):
            found = self._cheapest(start, goals, costs)
            if found is None:
                return None
            unknown = [edge for edge in found if edge not in self._swept]
            if not unknown:
                return self._made(start, found, index, costs)
            for edge in unknown:
                a, b = edge
                self._swept[edge] = judge(self.places[a], self.places[b])
                row = index[edge]
                costs[row] = preference.cost(self._lengths[row], self._swept[edge])
                if not np.isfinite(costs[row]):
                    break  # the rest of this path will hardly be gone
        return None

    def _made(
        self,
        start: int,
        edges: list[tuple[int, int]],
        index: dict[tuple[int, int], int],
        costs: FloatArray,
    ) -> RoadmapPath:
        nodes = [start]
        for a, b in edges:
            nodes.append(b if nodes[-1] == a else a)
        ways = [self._swept[edge] for edge in edges]
        worst = min(ways, key=lambda way: (-way.risk, way.clearance_mm), default=None)
        total = float(sum(costs[index[edge]] for edge in edges))
        return RoadmapPath(self.places[nodes], total, worst)

    def _cheapest(
        self, start: int, goals: Sequence[int], costs: FloatArray
    ) -> list[tuple[int, int]] | None:
        """The edges from start to the goal that is reached at the least cost (Dijkstra)."""
        open_ways = np.isfinite(costs)
        ends = self._edges[open_ways]
        count = len(self.places)
        graph = csr_array((costs[open_ways] + 1e-9, (ends[:, 0], ends[:, 1])), (count, count))
        far, before = dijkstra(graph, directed=False, indices=start, return_predecessors=True)
        goal = min(goals, key=lambda one: float(far[one]))
        if not np.isfinite(far[goal]):
            return None
        edges: list[tuple[int, int]] = []
        node = int(goal)
        while node != start:
            last = int(before[node])
            edges.append((min(last, node), max(last, node)))
            node = last
        return edges[::-1]

    def _cost(self, edge: tuple[int, int], row: int, preference: Preference) -> float:
        """Of a way as far as it is known: where nobody has looked at it, what its ends say, which
        it hardly falls short of."""
        length_mm = float(self._lengths[row])
        if (known := self._swept.get(edge)) is not None:
            return preference.cost(length_mm, known)
        first, second = (self.standings[end] for end in edge)
        worse = first if first.clearance_mm < second.clearance_mm else second
        allowed = first.allowed and second.allowed
        both = Standing(allowed, max(first.risk, second.risk), worse.clearance_mm, None)
        return preference.cost(length_mm, both)

    def _joined(self) -> tuple[IndexArray, FloatArray]:
        """(e, 2) neighbours by number, the smaller first, and (e,) how far the body goes, mm."""
        scaled = self.places * self.body.model.scale
        count = min(self._neighbours + 1, len(scaled))
        near = cKDTree(scaled).query(scaled, k=count)[1].reshape(len(scaled), -1)[:, 1:]
        own = np.repeat(np.arange(len(scaled)), near.shape[1])
        edges = np.unique(np.sort(np.stack([own, near.ravel()], axis=1), axis=1), axis=0)
        ends = self._centrelines[edges]
        lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=2).max(axis=1)
        return edges, lengths


def make_roadmap(
    body: BodyInPlace, places: int, neighbours: int, seed: int, progress: Progress
) -> Roadmap:
    """A roadmap of about so many places that the body can hold, touching or not."""
    found = _on_the_manifold(body, places, seed)
    progress.begin("roadmap", len(found), 0)
    standings = []
    for u in found:
        standings.append(body.standing(u))
        progress.advance()
    return Roadmap(body, found, standings, neighbours)


def _on_the_manifold(body: BodyInPlace, places: int, seed: int) -> FloatArray:
    """(n, m) that are known well and within all limits."""
    manifold = manifold_of(body.robot)
    sequence = qmc.Sobol(manifold.parameters, seed=seed)
    found: list[FloatArray] = []
    drawn = 0
    for power in range(9, _DRAWN + 1):
        for parameters in sequence.random(2**power - drawn):
            u = manifold.actuation(parameters)
            if len(found) < places and body.allowed(u):
                found.append(u)
        drawn = 2**power
        if len(found) >= places or len(found) < _FEW_KNOWN * drawn:
            break
    if len(found) < _FEW_KNOWN * drawn:
        found += [u for u in _trained_at(body, places, seed) if body.allowed(u, CLOSE_SHARE)]
    return np.array(found).reshape(-1, body.ranges.count)


def _trained_at(body: BodyInPlace, places: int, seed: int) -> FloatArray:
    known = body.model.known
    chosen = np.random.default_rng(seed).permutation(len(known))[:places]
    return np.asarray(known[np.sort(chosen)])
