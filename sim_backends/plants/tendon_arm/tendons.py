"""Tendons that rub at every plate: what drives the rod of the tendon-driven arm.

Each span of tendon between two plates is a route of its own with its own tension, so tension may
fall or rise at every hole, by Euler and Eytelwein's e^(±friction × angle) at most. Which of the two
depends on where the tendon has slipped: a hole remembers its share of the friction, and how much
unstretched tendon there is beyond it. What leaves there towards the motor has slipped. As long as
nothing slips, a span's tension follows its own stretch alone.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from config.emulation.plants import TendonArmPlant
from sim_backends.plants.plant import FloatArray
from sim_backends.plants.rod import Rod, Route, Section, helix
from sim_backends.plants.rod_kernels import March
from sim_backends.plants.tendon_arm import statics_kernels as tendon_arm_kernels
from sim_backends.plants.tendon_arm.statics_kernels import Strung

_CORNER_N = 0.16
"""A tendon goes slack round a corner: where a straight law would have none, it has half of this."""


@dataclass(frozen=True)
class Holes:
    """What all holes remember.

    grip: (n, m) share of the friction that holds against the motor, -1 to 1. beyond_mm: (n, m)
    unstretched tendon between hole and tip.
    """

    grip: FloatArray
    beyond_mm: FloatArray


@dataclass(frozen=True)
class TendonDrive:
    """All tendons with their motors at `wound_mm` (m,), after a past. A `Drive`."""

    rod: Rod
    strung: Strung
    holes: Holes
    wound_mm: FloatArray

    def spread(self, pull_n: FloatArray) -> tuple[FloatArray, FloatArray]:
        return self.rod.presence * pull_n, self.rod.presence

    def imbalance(
        self, march: March, pull_n: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        shape = self.holes.grip.shape
        return tendon_arm_kernels.imbalance(
            self.strung,
            march.position_mm,
            march.quaternion,
            march.length_mm.reshape(shape),
            pull_n.reshape(shape),
            self.holes.grip,
            self.holes.beyond_mm,
            self.wound_mm,
        )

    def holding(self, march: March) -> FloatArray:
        """A tendon that is taut resists by the stiffness of all of it and of its motor's side."""
        spans, tendons = self.holes.grip.shape
        stretch = self.wound_mm + march.length_mm.reshape(spans, tendons).sum(axis=0)
        taut = stretch > self.strung.rest_mm
        give = 1.0 / self.strung.stiffness_n_mm + spans * self.strung.give_mm_n
        return np.tile(np.diag(np.sqrt(taut / give)), (spans, 1))

    def after(self, march: March, pull_n: FloatArray) -> tuple[Holes, FloatArray]:
        """What the holes will remember of this, and the tension (m,) N that the motors hold."""
        shape = self.holes.grip.shape
        grip, beyond_mm, at_motor_n = tendon_arm_kernels.memory(
            self.strung,
            march.length_mm.reshape(shape),
            pull_n.reshape(shape),
            self.holes.grip,
            self.holes.beyond_mm,
            self.wound_mm,
        )
        return Holes(grip, beyond_mm), at_motor_n


def rod_of(config: TendonArmPlant, intervals_per_span: int) -> Rod:
    """The backbone. Its routes are the spans: all tendons' first ones, then the second ones, ..."""
    section = Section(
        bending_n_mm2=config.bending_stiffness_n_mm2,
        torsion_n_mm2=config.torsion_stiffness_n_mm2,
        shear_n=config.shear_stiffness_n,
        axial_n=config.axial_stiffness_n,
    )
    plates = _plates_mm(config)
    spans = [
        _span(config, tendon, start, end)
        for start, end in pairwise(plates)
        for tendon in range(len(config.tendons))
    ]
    return Rod(config.length_mm, section, spans, intervals_per_span * config.disks)


def strung(config: TendonArmPlant, rod: Rod, march: March) -> tuple[Strung, Holes]:
    """The tendons that all have the pretension at `march`, and what their holes know of that."""
    plates = _plates_mm(config)
    angle = np.array([tendon.angle_rad for tendon in config.tendons])
    turn = 2 * np.pi / config.length_mm * np.array([tendon.turns for tendon in config.tendons])
    around = angle + plates[:, None] * turn
    hole_mm = config.tendon_radius_mm * np.stack([np.cos(around), np.sin(around)], axis=-1)
    span_mm = config.length_mm / config.disks * np.hypot(1.0, config.tendon_radius_mm * turn)
    give = span_mm / config.tendon_stiffness_n
    length_mm = march.length_mm.reshape(config.disks, -1)
    unstretched_mm = length_mm - config.pretension_n * give
    beyond_mm = np.ascontiguousarray(np.cumsum(unstretched_mm[::-1], axis=0)[::-1])
    stiffness, tension = config.drive_stiffness_n_mm, config.pretension_n
    stretch_mm = (tension - _CORNER_N**2 / (4.0 * tension)) / stiffness
    tendons = Strung(
        plate=np.array([int(np.argmin(np.abs(rod.nodes_mm - at))) for at in plates]),
        hole_mm=np.ascontiguousarray(hole_mm),
        rest_mm=beyond_mm[0] - stretch_mm,
        give_mm_n=give,
        friction=config.friction,
        presliding_mm=config.presliding_mm,
        stiffness_n_mm=stiffness,
        corner_mm=_CORNER_N / stiffness,
    )
    return tendons, Holes(np.zeros_like(beyond_mm), beyond_mm)


def _plates_mm(config: TendonArmPlant) -> FloatArray:
    """(n+1,) places of base plate and disks along the straight arm."""
    return np.linspace(0.0, config.length_mm, config.disks + 1)


def _span(config: TendonArmPlant, tendon: int, start_mm: float, end_mm: float) -> Route:
    route = config.tendons[tendon]
    return helix(
        config.tendon_radius_mm,
        route.angle_rad,
        float(start_mm),
        float(end_mm),
        turn_rad_per_mm=2 * np.pi * route.turns / config.length_mm,
    )
