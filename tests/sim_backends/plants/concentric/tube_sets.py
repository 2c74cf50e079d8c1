"""Sets of tubes for the tests: the shipped robot's, and simpler ones."""

import numpy as np

from config.emulation.plants import ConcentricTubesPlant, Tube, TubeSection
from sim_backends.plants.concentric.statics import Setting, TubeEquilibrium, TubeStatics
from sim_backends.plants.concentric.statics_kernels import FloatArray, TubeSet

BENT = 3.7736e-3
PAIR_MM = 150.0
EI, GJ = 50_000.0, 50_000.0 / 1.3
DOWN = np.array([0.0, -1.0, 0.0])
NO_FORCE = np.zeros(3)


def plant_config(**options: object) -> ConcentricTubesPlant:
    """The paper's tubes; with all at zero the inner tube's end is flush with those of the pair."""
    return ConcentricTubesPlant.model_validate({"kind": "concentric_tubes", **options})


IDEAL: dict[str, object] = {"friction_nmm": 0.0, "gravity_direction": (0.0, 0.0, 1.0)}


def tube(length_mm: float, curvature_per_mm: float, **options: object) -> Tube:
    """One of nitinol that begins at the mouth."""
    return Tube.model_validate(
        {
            "sections": (TubeSection(length_mm=length_mm, curvature_per_mm=curvature_per_mm),),
            "bending_stiffness_n_mm2": EI,
            "torsion_stiffness_n_mm2": GJ,
            "outer_radius_mm": 1.0,
            "carriage": 0,
            "collar_mm": 0.0,
            **options,
        }
    )


def equal_tubes(
    count: int,
    curvature_per_mm: float = BENT,
    transmission_mm: float = 0.0,
    weight_n_mm: float = 0.0,
) -> TubeStatics:
    """Tubes of the pair's kind that end together, with straight shanks behind the mouth."""
    shank = max(transmission_mm, 1.0)
    one = TubeSet(
        np.tile([shank, shank + PAIR_MM], (count, 1)),
        np.tile([0.0, curvature_per_mm], (count, 1)),
        np.full(count, EI),
        np.full(count, GJ),
        np.full(count, weight_n_mm),
    )
    return TubeStatics(one, DOWN, twisting=transmission_mm > 0.0)


def equal_setting(statics: TubeStatics, angles: list[float], tip_n: FloatArray) -> Setting:
    shank = statics.tubes.end_mm[0, 0]
    return Setting(np.array(angles), np.full(len(angles), -shank), tip_n)


def settled(statics: TubeStatics, setting: Setting) -> TubeEquilibrium:
    found = statics.at_rest(setting, statics.no_sliders())
    assert found is not None
    return found


def energy(statics: TubeStatics, found: TubeEquilibrium) -> float:
    """N·mm that tubes store, minus what weight and load have done; by Simpson's rule on the nodes.

    Written from the definition: every tube by itself, bent away from its own curvature.
    """
    layout, march, tubes = found.layout, found.march, statics.tubes
    total = 0.5 * float((tubes.torsion_n_mm2 * found.base[:-2] ** 2) @ layout.twist_length_mm)
    for k, step in enumerate(np.diff(layout.node_mm)):
        there = layout.torsion_n_mm2[k] > 0.0
        ends = []
        for node in (k, k + 1):
            angle, curved = march.angle_rad[node], layout.curved_nmm[k]
            own = np.stack([curved * np.cos(angle), curved * np.sin(angle)]) / tubes.bending_n_mm2
            moment = march.moment_nmm[node] + (tubes.bending_n_mm2 * own).sum(axis=1)
            u = moment / layout.bending_n_mm2[k]
            bent = ((u[:, None] - own) ** 2).sum(axis=0)
            twist = march.twist_rad_mm[node]
            dense = 0.5 * tubes.bending_n_mm2 * bent + 0.5 * tubes.torsion_n_mm2 * twist**2
            height = march.position_mm[node] @ statics.down
            ends.append(float((dense - tubes.weight_n_mm * height)[there].sum()))
        total += 0.5 * float(step) * sum(ends)
    return total - float(found.setting.tip_n @ march.position_mm[layout.tip_node])
