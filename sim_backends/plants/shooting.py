"""Equilibria of a rod: the base moment that leaves the tip free, on the branch that is stable.

Unknown are the moment at the base and the pull of every route; wanted are no moment at the tip and
drives in balance with their routes. Newton's method, with the response of the last equilibrium
kept up to date by Broyden's formula; in smaller steps, or once more from the unloaded rod, where
that does not succeed. Every result has been tested for stability: past a buckling load a straight
rod is still an equilibrium, and no plant may return it.
"""

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from sim_backends.plants.rod import Rod, Section, helix
from sim_backends.plants.rod_kernels import (
    FloatArray,
    LoadedRod,
    March,
    broyden,
    newton_step,
)

_TOLERANCE = 1e-9
"""Of the tip's moment, and of every drive's imbalance times its lever, against EI/L."""

CLOSE = 1e-2
"""Error, in the measure of _TOLERANCE, of a guess that is worth improving."""

_BEARABLE = 10.0
"""Where no step leads nearer for a while: how much the error may rise above its least meanwhile."""

_DIFFERENCE = 1e-6
"""Step of finite differences, in the measure of _TOLERANCE."""

_NEUTRAL = 0.05
"""Of what springs must hold, what passes for held: see `rod.NEUTRAL`."""

ITERATIONS = 40
_SMALLEST_STEP = 1.0 / 512.0
_STEP_OF_LOAD = 1.0 / 16.0
_SIDE_FORCE = 0.05
"""Share of the load that pushes sideways on the way up, so that a column knows where to bend."""


class Drive(Protocol):
    """What pulls at the routes: constant pulls, springs, gas."""

    def spread(self, pull_n: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Tension in every interval for pulls (m,), and its derivative; both (N, m)."""
        ...

    def imbalance(
        self, march: March, pull_n: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """(m,) pulls minus what the drive pulls with at such a rod, N, and the derivatives (m, m)
        of this by the routes' lengths and by their pulls."""
        ...

    def holding(self, march: March) -> FloatArray:
        """(m, n) G: the drives resist a small change of the lengths from rest with G G', N/mm.
        Friction holds."""
        ...


class Problem(NamedTuple):
    """What holds and loads the rod: internal force (N+1, 3), stiffness (N, 6), rest (N, 3, 6)."""

    force: FloatArray
    drive: Drive
    stiffness: FloatArray
    rest: FloatArray


class Equilibrium(NamedTuple):
    """A rod in balance. unknowns (3+m,): base moment N·mm and the pulls N of the routes.

    response (3+m, 3+m) as in `Rod.tangent`.
    """

    march: March
    unknowns: FloatArray
    response: FloatArray

    @property
    def pull_n(self) -> FloatArray:
        return self.unknowns[3:]


Path = Callable[[float], Problem]
"""Problems from the last one solved, at 0, to the one wanted, at 1."""


class ConstantPull:
    """Pulls that do not depend on what the rod does, the same all along their routes."""

    def __init__(self, rod: Rod, pull_n: FloatArray) -> None:
        self._presence = rod.presence
        self._pull = np.asarray(pull_n, dtype=np.float64)

    def spread(self, pull_n: FloatArray) -> tuple[FloatArray, FloatArray]:
        return self._presence * pull_n, self._presence

    def imbalance(
        self, march: March, pull_n: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        count = len(march.length_mm)
        return pull_n - self._pull, np.zeros((count, count)), np.eye(count)

    def holding(self, march: March) -> FloatArray:
        return np.zeros((len(march.length_mm), 0))


class _Trial(NamedTuple):
    """A march with some unknowns (base moment, pulls), and how far it is from balance.

    outcome (3+m,): tip moment and route lengths. residual (3+m,): tip moment and imbalance.
    """

    unknowns: FloatArray
    outcome: FloatArray
    loaded: LoadedRod
    march: March
    spread: FloatArray
    residual: FloatArray
    by_length: FloatArray
    by_pull: FloatArray
    error: float


class Solver:
    """Finds equilibria of one rod. Keeps nothing between calls."""

    def __init__(self, rod: Rod, tolerance: float = _TOLERANCE, patience: int = 0) -> None:
        """tolerance: of the tip's moment, and of every drive's imbalance times its lever, against
        EI/L. patience: steps that come no nearer to be borne, as there are some where drives have
        dry friction: what slips in the end is first found out by trying."""
        self._rod = rod
        self._tolerance = tolerance
        self._patience = patience
        unit = rod.section.bending_n_mm2 / rod.length_mm
        arm_mm = float(np.abs(rod.offset[..., :2]).max(initial=1.0))
        self._scale = np.concatenate([np.full(3, 1.0 / unit), np.full(rod.routes, arm_mm / unit)])

    def find(self, path: Path, start: Equilibrium, ahead: FloatArray) -> Equilibrium | None:
        """The stable equilibrium of path(1) that `start`, the one of path(0), leads to.

        ahead: (3+m,) how far the unknowns probably go. None: neither the guess nor the path nor
        raising the load from nothing arrives at one.
        """
        found = self._guess(path(1.0), start, ahead)
        if found is None:
            found = self.follow(path, start)
        if found is None:
            found = self.raise_load(path(1.0), start.pull_n, start.march.position_mm[-1])
        return found

    def follow(
        self, path: Path, start: Equilibrium, largest_step: float = 1.0
    ) -> Equilibrium | None:
        """Along `path` in as few steps as it takes. None: it ends on the way."""
        done, step, here = 0.0, largest_step, start
        while done < 1.0:
            there = self.settle(path(done + step), here)
            if there is None:
                step *= 0.5
                if step < _SMALLEST_STEP:
                    return None
            else:
                here, done = there, done + step
                step = min(2.0 * step, largest_step, 1.0 - done)
        return here

    def raise_load(
        self, problem: Problem, pull_n: FloatArray, lean_mm: FloatArray
    ) -> Equilibrium | None:
        """From the unloaded rod up to the whole load, pushed to the side that it leans to, and a
        straight one to the side of `lean_mm` (3,). Where that ends on a ridge: to other sides."""
        unloaded = self.unloaded(problem, pull_n)
        if unloaded is None:
            return None
        lean = unloaded.march.position_mm[-1] + 0.01 * lean_mm
        for side in _sideways(_SIDE_FORCE * problem.force[0], lean):

            def path(t: float, side: FloatArray = side) -> Problem:
                return problem._replace(force=t * (problem.force + (1.0 - t) * side))

            found = self.follow(path, unloaded, _STEP_OF_LOAD)
            if found is not None:
                return found
        return None

    def unloaded(self, problem: Problem, pull_n: FloatArray) -> Equilibrium | None:
        """The equilibrium without any force, from a guess of the pulls."""
        problem = problem._replace(force=np.zeros_like(problem.force))
        unknowns = np.concatenate([np.zeros(3), pull_n])
        trial = self._try(problem, unknowns, problem.rest)
        response = None if trial is None else self._tangent(trial)
        return None if response is None else self._improve(problem, trial, response)

    def settle(self, problem: Problem, start: Equilibrium) -> Equilibrium | None:
        """Newton's method from `start`. None: it does not converge, or to what is not stable."""
        trial = self._try(problem, start.unknowns, start.march.strain)
        return self._improve(problem, trial, start.response)

    def _guess(self, problem: Problem, start: Equilibrium, ahead: FloatArray) -> Equilibrium | None:
        """Newton's method from where the last motion leads to, if that is close. None: not so."""
        trial = self._try(problem, start.unknowns + ahead, start.march.strain)
        if trial is None or trial.error > CLOSE:
            if not self._patience:
                return None
            stopped = self._try(problem, start.unknowns, start.march.strain)
            if trial is None or (stopped is not None and stopped.error < trial.error):
                trial = stopped
        return self._improve(problem, trial, start.response)

    def _improve(
        self, problem: Problem, trial: _Trial | None, response: FloatArray
    ) -> Equilibrium | None:
        """Newton's method: with the old response while it serves, then with better and better
        ones, then in shorter steps. A kink is not passed by a better response, so with patience
        there is only one before the shorter steps."""
        tried, patience, highest = 0, self._patience, np.inf
        for _ in range(ITERATIONS):
            if trial is None:
                return None
            if trial.error <= self._tolerance:
                return self._if_stable(problem, trial)
            highest = min(highest, _BEARABLE * trial.error)
            step = newton_step(response, trial.by_length, trial.by_pull, trial.residual)
            better = self._try(problem, trial.unknowns + step, trial.march.strain)
            nearer = better is not None and better.error <= 0.3 * trial.error
            if better is not None and (nearer or (patience and better.error < highest)):
                change = better.outcome - trial.outcome
                response = broyden(response, better.unknowns - trial.unknowns, change, self._scale)
                trial, tried = better, 0
                if not nearer:
                    patience -= 1
            elif tried and self._patience:
                trial, tried = self._shorten(problem, trial, step), 0
            elif tried < 2:
                fresh = self._differences(problem, trial) if tried else self._tangent(trial)
                if fresh is None:
                    return None
                response, tried = fresh, tried + 1
            else:
                trial, tried = self._shorten(problem, trial, step), 0
        return None

    def _shorten(self, problem: Problem, trial: _Trial, step: FloatArray) -> _Trial | None:
        """A part of a Newton step that goes the right way."""
        for _ in range(8):
            better = self._try(problem, trial.unknowns + step, trial.march.strain)
            if better is not None and better.error < trial.error:
                return better
            step = 0.5 * step
        return None

    def _try(self, problem: Problem, unknowns: FloatArray, guess: FloatArray) -> _Trial | None:
        pull = unknowns[3:]
        tension, spread = problem.drive.spread(pull)
        loaded = self._rod.loaded(tension, problem.force, problem.stiffness, problem.rest)
        march = self._rod.march(loaded, unknowns[:3], guess)
        if march is None:
            return None
        imbalance, by_length, by_pull = problem.drive.imbalance(march, pull)
        tip_moment = march.moment_nmm[-1]
        outcome = np.concatenate((tip_moment, march.length_mm))
        residual = np.concatenate((tip_moment, imbalance))
        error = float(np.abs(residual * self._scale).max())
        if not error < np.inf:
            return None
        return _Trial(unknowns, outcome, loaded, march, spread, residual, by_length, by_pull, error)

    def _differences(self, problem: Problem, trial: _Trial) -> FloatArray | None:
        """The response by finite differences: near a buckling load the tangent's own small error
        is larger than what is left of the rod's stiffness."""
        columns = []
        for step in np.diag(_DIFFERENCE / self._scale):
            moved = self._try(problem, trial.unknowns + step, trial.march.strain)
            if moved is None:
                return None
            columns.append((moved.outcome - trial.outcome) / step.sum())
        return np.ascontiguousarray(np.array(columns).T)

    def _tangent(self, trial: _Trial) -> FloatArray | None:
        answer = self._rod.tangent(trial.loaded, trial.march, trial.spread)
        return None if answer is None else answer[0]

    def _if_stable(self, problem: Problem, trial: _Trial) -> Equilibrium | None:
        answer = self._rod.tangent(trial.loaded, trial.march, trial.spread)
        if answer is None:
            return None
        response, unstable = answer
        if not stable(problem.drive, trial.march, response, unstable):
            return None
        return Equilibrium(trial.march, trial.unknowns, response)


def stable(drive: Drive, march: March, response: FloatArray, unstable: int) -> bool:
    """Whether the drives hold a rod that alone would turn away in `unstable` directions."""
    if not np.isfinite(response).all():
        return False
    return unstable == 0 or unstable == _held_by_drives(response, drive.holding(march))


def _held_by_drives(response: FloatArray, springs: FloatArray) -> int:
    """In how many directions the drives' own stiffness holds a rod that alone would turn away.

    With the rod's energy K and springs G G' on its routes' lengths ℓ, with g = dℓ, count the
    negative eigenvalues of [[K, g' G], [G' g, −1]] both ways: those of K + g' G G' g are as many
    fewer than those of K as −1 − G' g K⁻¹ g' G has positive ones.
    """
    by_moment, by_pull = response[3:, :3], response[3:, 3:]
    lengthening = by_pull - by_moment @ np.linalg.pinv(response[:3, :3]) @ response[:3, 3:]
    whole = springs.T @ lengthening @ springs - np.eye(springs.shape[1])
    eigenvalues = np.linalg.eigvalsh(0.5 * (whole + whole.T))
    return int(np.count_nonzero(eigenvalues > -_NEUTRAL))


def _sideways(force: FloatArray, lean: FloatArray) -> list[FloatArray]:
    """Forces as large as `force` and across it: towards `lean`, where that says anything, then a
    quarter turn on, then opposite."""
    size = float(np.linalg.norm(force))
    if size == 0.0:
        return [np.zeros(3)]
    along = force / size
    for direction in (lean, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])):
        across = direction - (direction @ along) * along
        length = float(np.linalg.norm(across))
        if length > 1e-6:
            break
    first = size / length * across
    return [first, np.cross(along, first), -first]


def warm_up() -> None:
    """Compile all kernels, or load them from numba's cache: seconds once, then tenths of one."""
    section = Section(bending_n_mm2=1e4, torsion_n_mm2=1e4, shear_n=100.0, axial_n=100.0)
    routes = [helix(5.0, 0.0, 0.0, 100.0), helix(5.0, 1.0, 0.0, 100.0, chamber=True)]
    rod = Rod(100.0, section, routes, intervals=4)
    force = rod.internal_force(np.array([0.3, 0.0, 0.0]), np.zeros(3))
    pull = np.array([1.0, -1.0])
    problem = Problem(force, ConstantPull(rod, pull), rod.stiffness, rod.rest)
    if Solver(rod).raise_load(problem, pull, np.zeros(3)) is None:
        raise RuntimeError("the rod's kernels do not work on this machine")
