"""The bodies that the emulated lab can hold."""

from typing import Annotated, Literal

from pydantic import Field

from config.model import ConfigModel, NotNegative, Positive

PerChamber = Annotated[
    tuple[Positive, Positive, Positive, Positive, Positive, Positive], Field(strict=False)
]


class SoftArmPlant(ConfigModel):
    """Two pneumatic segments, three chambers each, moved by cylinders (Ho 2018, section 2.1).

    The paper gives the sizes: 155 mm long, 27 mm across, 41.71 g, Dragon Skin 10, 0.040 MPa before
    it moves, about 100° of bending per segment. The rest follows from these. At 1.07 g/cm³ the mass
    leaves 252 mm² of silicone in a cross-section of 573 mm²; voids take the other 320: three
    chambers of 95 mm² (11 mm across) at 7.5 mm from the axis, and a lumen for tubes. That leaves
    15.9e3 of the circle's second moment of 26.1e3 mm⁴. Young's modulus is 0.26 MPa by the data
    sheet's 100 % modulus (151 kPa, neo-Hookean) and 0.41 MPa by its hardness (Shore 10A, Gent
    1958); the fibre round the chambers keeps their walls from narrowing, which makes 4/3 of it:
    0.45 MPa in the middle. Rigid printed parts take about 20 of the 155 mm. So EI = 0.45 × 15.9e3
    × 155/135 = 8e3 N·mm² and EA = 0.45 × 252 × 155/135 = 130 N, uncertain by a third either way.
    """

    kind: Literal["soft_arm"]
    length_mm: Positive = 155.0
    """As cast. The pre-pressure stretches it."""
    mass_g: Positive = 41.7
    bending_stiffness_n_mm2: Positive = 8.0e3
    """EI for good, without creep. Below 5e3 the arm buckles under the paper's tip loads."""
    axial_stiffness_n: Positive = 130.0
    """EA for good, without creep."""
    chamber_area_mm2: Positive = 95.0
    chamber_area_ratios: PerChamber = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
    """Area of each chamber against `chamber_area_mm2`: no two castings are alike."""
    chamber_radius_mm: Positive = 7.5
    """Distance of the chambers from the axis."""
    distal_rotation_rad: float = 1.0471975511965976
    """Turn of the distal chambers against the proximal ones: 60° puts each over a gap."""
    pre_pressure_mpa: NotNegative = 0.04
    """Gauge pressure of every chamber with its cylinder at zero."""
    tube_volume_ml: NotNegative = 2.0
    """0.6 m of tube, 2 mm wide."""
    cylinder_volume_ml: Positive = 25.5
    """Gas in front of the piston at zero: 50 mm of stroke in a bore of 25 mm and 1 mL more."""
    hysteresis: Annotated[float, Field(ge=0, le=0.5)] = 0.15
    """How much stiffer against bending the body is after a reversal (Prandtl-Ishlinskii): 0.10 to
    0.25 for fibre-reinforced silicone."""
    hysteresis_reach_mm: Positive = 6.0
    """Change of a chamber's length after which nothing sticks any more: half of a bend of 100°."""
    creep: Annotated[float, Field(ge=0, le=0.3)] = 0.05
    """Share of the deformation that comes late."""
    creep_time_s: Positive = 20.0
    """Time constant of that share under a constant load."""
    pneumatic_lag_s: Positive = 0.1
    """Time constant of the gas between cylinder and chamber."""


Plant = Annotated[SoftArmPlant, Field(discriminator="kind")]
