"""A rod in balance as the lab sees it."""

from drivers.pose import Pose
from sim_backends.plants.plant import BodyState, FloatArray
from sim_backends.plants.rod_kernels import March


def body_state(march: March, radius_mm: float, actuator_forces: FloatArray) -> BodyState:
    """Copies of what the march says. actuator_forces: (m,) N."""
    tip = Pose(march.position_mm[-1].copy(), march.quaternion[-1].copy())
    return BodyState(march.position_mm.copy(), tip, actuator_forces, radius_mm)
