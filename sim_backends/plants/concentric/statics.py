"""Equilibria of concentric tubes along a motion: on their branch while it lasts, and where it ends.

Near some configurations tubes have several stable shapes, and which of them they take depends on
where they came from. So an equilibrium is followed: Newton's method from the last one, in steps so
small that it cannot arrive on another branch. Where no step is small enough the branch has ended,
and the tubes snap: they turn away as if something thick were between them, which resists quick
motions alone, until they rest on another branch.
"""

from typing import NamedTuple

import numpy as np

from sim_backends.plants.concentric.statics_kernels import (
    Drag,
    FloatArray,
    Friction,
    Layout,
    March,
    TubeSet,
    lay_out,
    section_pushes,
    settle,
    sweep,
)

INTERVAL_MM = 8.0
"""Between nodes. Then a loaded tip is right to 0.05 µm, an unloaded one to 0.005 µm."""
_UNLOADED_LONGER = 2.0
"""So much longer may intervals be where nothing is asked but unloaded tips: 0.08 µm, in two thirds
of the time."""

_ITERATIONS = 12
_PATIENCE = 4
"""Of Newton's method where it has nothing to follow."""
_SMALLEST_STEP = 2e-5
"""Of a motion, rad or ten times as many mm, or the same share of its load: where this is too much,
a branch has ended."""
_LONGER = 10.0
_DRAG = 2.0
"""Resistance at the start of a snap against the largest torque, per length and angle, that may turn
tubes away from an unstable shape: with more than one, a step has one solution only."""
_LESS_DRAG, _MORE_DRAG = 0.7, 4.0
_RELAXATIONS = 500
_KICK_RAD = 1e-3
"""Tubes on a ridge, in perfect balance, fall to one side: always the same."""

_NO_DRAG = Drag(np.zeros((1, 3, 1)), 0.0)


class Setting(NamedTuple):
    """What holds and loads the tubes. rotation_rad and collar_mm: (n,) of each tube at its collar,
    the latter from the mouth, forward positive. tip_n: (3,) dead force at the tip, base frame."""

    rotation_rad: FloatArray
    collar_mm: FloatArray
    tip_n: FloatArray

    def towards(self, other: "Setting", share: float) -> "Setting":
        """A share of the way to another setting, all moving evenly."""
        if share == 1.0:
            return other
        return Setting(*(a + share * (b - a) for a, b in zip(self, other, strict=True)))


class TubeEquilibrium(NamedTuple):
    """Tubes in balance.

    base: (n+2,) their twist at the mouth, rad/mm, and the moment M_xy there, N·mm. determinant:
    1 for short tubes, positive on a stable branch, 0 where it ends.
    """

    setting: Setting
    layout: Layout
    base: FloatArray
    march: March
    determinant: float

    @property
    def rubbing_rad(self) -> FloatArray:
        """(n, S) angles between the tubes that rub on each other where a section ends; 0: none."""
        contact, partner = self.layout.contact, self.layout.partner
        angle = self.march.angle_rad
        own = angle[contact, np.arange(angle.shape[1])[:, None]]
        return np.where((contact >= 0) & (partner >= 0), own - angle[contact, partner], 0.0)


class TubeStatics:
    """Finds equilibria of one set of tubes. Keeps nothing between calls."""

    def __init__(
        self,
        tubes: TubeSet,
        down: FloatArray,
        *,
        twisting: bool = True,
        friction_nmm: float = 0.0,
        presliding_rad: float = 1.0,
        interval_mm: float = INTERVAL_MM,
    ) -> None:
        """down: (3,) unit vector of the tubes' weight. twisting: they twist behind the mouth, too.
        friction_nmm: what turns a tube in another where a section of one ends, after they have
        given way by presliding_rad."""
        self.tubes = tubes
        self.down = down
        self._twisting = twisting
        self._friction_nmm = friction_nmm
        self._stiffness = friction_nmm / presliding_rad
        self.interval_mm = interval_mm
        self._light = not tubes.weight_n_mm.any() and friction_nmm == 0.0

    def no_sliders(self) -> FloatArray:
        """(n, S) sliders of tubes that have not rubbed on each other yet."""
        return np.zeros(self.tubes.end_mm.shape)

    def at_rest(self, setting: Setting, slider_rad: FloatArray) -> TubeEquilibrium | None:
        """Where tubes arrive that were held straight and untwisted at first. None: nowhere."""
        count = len(setting.rotation_rad)
        found = self._settle(setting, np.zeros(count + 2), slider_rad, _PATIENCE)
        if found is not None:
            return found
        layout = self._lay_out(setting)
        past = np.tile(setting.rotation_rad, (len(layout.node_mm) - 1, 3, 1))
        return self._relax(setting, np.zeros(count + 2), _kicked(past), slider_rad)

    def near(
        self, setting: Setting, base: FloatArray, slider_rad: FloatArray
    ) -> TubeEquilibrium | None:
        """The stable equilibrium that a guess of (n+2,) twists and moment leads to. None: none."""
        return self._settle(setting, base, slider_rad, _PATIENCE)

    def follow(
        self, start: TubeEquilibrium, to: Setting, slider_rad: FloatArray
    ) -> tuple[TubeEquilibrium, int] | None:
        """Where an even motion leads to, and how often the tubes snap on the way. None: nowhere."""
        here, done, step, snaps = start, 0.0, 1.0, 0
        smallest = _SMALLEST_STEP / max(_SMALLEST_STEP, _size(start.setting, to))
        while done < 1.0:
            there = self._settle(start.setting.towards(to, done + step), here.base, slider_rad)
            if there is not None:
                here, done = there, done + step
                step = min(2.0 * step, 1.0 - done)
                continue
            if step > smallest:
                step *= 0.5
                continue
            setting = start.setting.towards(to, done + step)
            past = _kicked(_sampled(here, self._lay_out(setting)))
            there = self._relax(setting, here.base, past, slider_rad)
            if there is None:
                return None
            here, done, snaps = there, done + step, snaps + 1
            step = 1.0 - done
        return here, snaps

    def tips(
        self, rotation_rad: FloatArray, collar_mm: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Tips (k, 3) in mm and their directions (k, 3), without loads and friction.

        rotation_rad, collar_mm: (k, n). Rows follow each other as a motion; not a number where
        none of the tubes' stable shapes was found.
        """
        rotation, collar = np.ascontiguousarray(rotation_rad), np.ascontiguousarray(collar_mm)
        tip_mm, direction = np.empty((len(rotation), 3)), np.empty((len(rotation), 3))
        sweep(
            self.tubes,
            rotation,
            collar,
            self._twisting,
            _UNLOADED_LONGER * self.interval_mm,
            tip_mm,
            direction,
        )
        return tip_mm, direction

    def pushes(self, found: TubeEquilibrium) -> FloatArray:
        """(n,) N with which each tube pushes its collar backwards, all others held."""
        pushes: FloatArray = section_pushes(
            found.layout, self.tubes, found.base, found.march, self.down
        )
        return pushes

    def _lay_out(self, setting: Setting) -> Layout:
        layout: Layout = lay_out(
            self.tubes,
            setting.collar_mm,
            self._twisting,
            setting.tip_n,
            self.down,
            self.interval_mm,
        )
        return layout

    def _settle(
        self, setting: Setting, base: FloatArray, slider_rad: FloatArray, patience: int = 0
    ) -> TubeEquilibrium | None:
        """Newton's method. None: it does not converge, or to what is not stable."""
        layout = self._lay_out(setting)
        settled = settle(
            layout,
            self.tubes,
            setting.rotation_rad,
            base,
            Friction(slider_rad, self._friction_nmm, self._stiffness),
            _NO_DRAG,
            self._light and not setting.tip_n.any(),
            patience,
            _ITERATIONS,
        )
        if not (settled.converged and settled.determinant > 0.0):
            return None
        return TubeEquilibrium(setting, layout, settled.base, settled.march, settled.determinant)

    def _relax(
        self, setting: Setting, base: FloatArray, past_rad: FloatArray, slider_rad: FloatArray
    ) -> TubeEquilibrium | None:
        """Let the tubes go from a shape (N, 3, n) that is none of balance. None: they do not rest.

        Every step is one of the implicit Euler method for tubes that drag on what is between them,
        the longer (with the less drag) the better the last ones went: none of them leads uphill.
        """
        layout = self._lay_out(setting)
        curved = np.abs(layout.curved_nmm)
        others = curved.sum(axis=1, keepdims=True) - curved
        drag = _DRAG * float((curved * others / layout.bending_n_mm2[:, None]).max())
        friction = Friction(slider_rad, self._friction_nmm, self._stiffness)
        for _ in range(_RELAXATIONS):
            settled = settle(
                layout,
                self.tubes,
                setting.rotation_rad,
                base,
                friction,
                Drag(past_rad, drag),
                False,
                0,
                _ITERATIONS,
            )
            if not (settled.converged and settled.determinant > 0.0):
                drag *= _MORE_DRAG
                continue
            drag *= _LESS_DRAG
            base, past_rad = settled.base, _shape(layout, settled.march)
            found = self._settle(setting, base, slider_rad)
            if found is not None:
                return found
        return None


def _size(one: Setting, other: Setting) -> float:
    """How far apart two settings are, in the measure of _SMALLEST_STEP."""
    turned = np.abs(other.rotation_rad - one.rotation_rad).max()
    pushed = np.abs(other.collar_mm - one.collar_mm).max() / _LONGER
    return float(max(turned, pushed, 1.0 if (one.tip_n != other.tip_n).any() else 0.0))


def _shape(layout: Layout, march: March) -> FloatArray:
    """(N, 3, n) angles at the start, the middle and the end of each interval."""
    start, end = march.angle_rad[:-1], march.angle_rad[1:]
    there = layout.torsion_n_mm2 > 0.0
    step = np.diff(layout.node_mm)[:, None]
    bulge = 0.125 * step * (march.twist_rad_mm[:-1] - march.twist_rad_mm[1:])
    middle = 0.5 * (start + end) + np.where(there, bulge, 0.0)
    return np.ascontiguousarray(np.stack([start, middle, end], axis=1))


def _sampled(equilibrium: TubeEquilibrium, layout: Layout) -> FloatArray:
    """Its shape, at the places of another layout."""
    node = layout.node_mm
    places = np.stack([node[:-1], 0.5 * (node[:-1] + node[1:]), node[1:]], axis=1)
    columns = [
        np.interp(places, equilibrium.layout.node_mm, angle)
        for angle in equilibrium.march.angle_rad.T
    ]
    return np.ascontiguousarray(np.stack(columns, axis=2))


def _kicked(shape_rad: FloatArray) -> FloatArray:
    """A shape in which every tube is turned a little more than the one round it."""
    return np.asarray(shape_rad + _KICK_RAD * np.arange(1, shape_rad.shape[2] + 1))
