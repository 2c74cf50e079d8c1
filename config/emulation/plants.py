"""The bodies that an emulated lab can hold, each with its figures and where they are from."""

from collections.abc import Mapping, Sequence
from itertools import cycle, islice
from typing import TYPE_CHECKING, Annotated, Final, Literal, NamedTuple

from pydantic import (
    AfterValidator,
    Field,
    ValidationInfo,
    field_validator,
    model_validator,
)

from config.documents.kinds import PLANTS, Kind, KindOptions, Named
from config.documents.model import ConfigModel, NotNegative, Positive, Vector3
from config.emulation.bodies import BodyName, with_body


class BodyExtent(NamedTuple):
    """How much of a body there is before anybody has looked.

    begin_mm: where it begins, along z of the base frame. length_mm: from there to its tip. stretch:
    standard deviation of the logarithm of how much longer it may be.
    """

    begin_mm: float
    length_mm: float
    stretch: float


_SILICONE_STRETCH: Final = 0.25
"""Gas stretches a soft arm by up to a quarter; a printed arm is seldom as long as its drawing."""
_METAL_STRETCH: Final = 0.003
"""Collars are clamped to some tenths of a millimetre, and metal does not stretch."""


class PlantOptions(KindOptions):
    """What every kind of body has, as fields of its class or as properties."""

    if TYPE_CHECKING:

        @property
        def length_mm(self) -> float:
            """The body is not longer, without loads."""

        @property
        def body_radius_mm(self) -> float:
            """Of what it may touch with."""

    def extent(self, actuators: Sequence[float]) -> BodyExtent:
        """As `BodyExtent` says, at (m,) actuators: here they do not change it."""
        del actuators
        return BodyExtent(0.0, self.length_mm, _SILICONE_STRETCH)


def _not_zero(vector: Vector3) -> Vector3:
    if not any(vector):
        raise ValueError("zero has no direction")
    return vector


Direction = Annotated[Vector3, AfterValidator(_not_zero)]


_RATIOS: Final = "chamber_area_ratios"
_MOST_CHAMBERS: Final = 48


def _chambers_said(segments: object) -> int:
    """How many chambers segments have that nobody has checked."""
    if not isinstance(segments, Sequence):
        return 0
    said = [one.get("chambers", 3) for one in segments if isinstance(one, Mapping)]
    said += [one.chambers for one in segments if isinstance(one, SoftSegment)]
    return min(_MOST_CHAMBERS, sum(one for one in said if isinstance(one, int) and one > 0))


class SoftSegment(ConfigModel):
    """A length of a soft arm with chambers of its own, even round its axis."""

    length_mm: Annotated[float, Field(gt=0, le=1000)]
    """As cast. The pre-pressure stretches it."""
    chambers: Annotated[int, Field(ge=3, le=8)] = 3
    rotation_rad: float = 0.0
    """Of the first of its chambers, from the x axis."""


class SoftArmPlant(PlantOptions):
    """Pneumatic segments in series, each with its chambers, moved by cylinders.

    As it stands it is the arm of Ho 2018, section 2.1: two segments, three chambers each. The paper
    gives the sizes: 155 mm long, 27 mm across, 41.71 g, Dragon Skin 10, 0.040 MPa before
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
    body: BodyName = "as_made"
    """A named set of figures (`config/emulation/bodies.py`), on top of which come those given
    here."""
    segments: Annotated[
        tuple[SoftSegment, ...], Field(strict=False, min_length=1, max_length=6)
    ] = (SoftSegment(length_mm=77.5), SoftSegment(length_mm=77.5, rotation_rad=1.0471975511965976))
    """From the base on. Their chambers, in this order, are those of the axes. As it stands the
    second one is turned by 60°, which puts its chambers over the first one's gaps."""
    mass_g: Positive = 41.7
    body_radius_mm: Positive = 13.5
    """Of what it may touch with."""
    bending_stiffness_n_mm2: Positive = 8.0e3
    """EI for good, without creep. Below 5e3 the arm buckles under the paper's tip loads."""
    axial_stiffness_n: Positive = 130.0
    """EA for good, without creep."""
    chamber_area_mm2: Positive = 95.0
    chamber_area_ratios: Annotated[tuple[Positive, ...], Field(strict=False)] = (1.0,) * 6
    """Area of each chamber against `chamber_area_mm2`: no two castings are alike. Not given: as
    the named body has it, begun anew where there are more chambers."""
    chamber_radius_mm: Positive = 7.5
    """Distance of the chambers from the axis."""
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
    pneumatic_lag_s: Annotated[float, Field(gt=0, le=1)] = 0.1
    """Time constant of the gas between cylinder and chamber."""
    dead_time_s: Annotated[float, Field(ge=0, le=0.5)] = 0.0
    """How long nothing arrives of what a piston does. Cylinders that are always open to their
    chambers have none; valves and the sampled links before them have 0.1 to 0.25 s."""
    backlash_mm: NotNegative = 0.0
    """Half of the play of nut and piston: a motor that turns back moves its piston only after twice
    as much. A preloaded nut has none, a worn one 0.05 to 0.15 mm."""
    leak_per_hour: NotNegative = 0.0
    """Rate at which the gas that is enclosed beyond the atmosphere's share escapes."""
    ageing: Annotated[float, Field(ge=0, le=0.5)] = 0.0
    """Share of its stiffness that the body loses for good by being used (Mullins' effect)."""
    ageing_time_h: Positive = 2.0
    """Time constant of that loss."""

    @property
    def length_mm(self) -> float:
        """All segments, as cast."""
        return sum(segment.length_mm for segment in self.segments)

    @property
    def chambers(self) -> int:
        """Of all segments."""
        return sum(segment.chambers for segment in self.segments)

    @model_validator(mode="before")
    @classmethod
    def _figures_of_the_body(cls, given: object) -> object:
        figures = with_body(given)
        if not isinstance(figures, Mapping) or not isinstance(given, Mapping):
            return given
        if _RATIOS in given or "segments" not in given:
            return figures
        ratios = cycle(figures.get(_RATIOS, (1.0,)))
        return {**figures, _RATIOS: tuple(islice(ratios, _chambers_said(given["segments"])))}

    @field_validator(_RATIOS)
    @classmethod
    def _one_for_each_chamber(
        cls, ratios: tuple[float, ...], info: ValidationInfo
    ) -> tuple[float, ...]:
        segments = info.data.get("segments")
        chambers = len(ratios) if segments is None else sum(one.chambers for one in segments)
        if len(ratios) != chambers:
            raise ValueError(f"{len(ratios)} ratios are not one for each of {chambers} chambers")
        return ratios


class TendonRoute(ConfigModel):
    """Where a tendon runs: through a hole in every plate."""

    angle_rad: float
    """Of its hole in the base plate, from the x axis."""
    turns: float = 0.0
    """How often it winds round the arm from base to tip; 0: it runs straight."""


class TendonArmPlant(PlantOptions):
    """One flexible backbone with disks, bent by tendons through them (Thompson's prototype).

    The paper gives 0.2 m, nine disks, three parallel tendons and a helical one. The robot files
    that its laboratory has published give the rest: tendons 8 mm from the axis, at 0 and ±120°, the
    helical one 1.5 turns beginning in line with the first; a body of printed polyurethane round a
    nitinol tube with E = 91 MPa, ν = 0.3 over a radius of 3 mm, so EI = 5.79e3 N·mm², GJ = 4.45e3
    N·mm² and EA = 2573 N; and 15 mm as its radius for collisions. Their E varies from file to file
    by two decades, as it must where only lengths drive a robot that nothing loads; 91 MPa goes with
    their greatest tensions, 9.7 N straight and 16.8 N helical. Mass, tendons' stiffness, friction
    and play are judged.
    """

    kind: Literal["tendon_arm"]
    body: BodyName = "as_made"
    """A named set of figures (`config/emulation/bodies.py`), on top of which come those given
    here."""
    length_mm: Positive = 200.0
    mass_g: NotNegative = 30.0
    body_radius_mm: Positive = 15.0
    """Of what it may touch with: the disks and what stands out from them."""
    gravity_direction: Direction = (0.0, 0.0, 1.0)
    """In the base frame, whose z axis points along the straight arm: as it stands, the arm hangs
    from its base plate. Level (0, -1, 0), the tendons below it go slack by its own weight."""
    bending_stiffness_n_mm2: Positive = 5.79e3
    torsion_stiffness_n_mm2: Positive = 4.45e3
    shear_stiffness_n: Positive = 990.0
    axial_stiffness_n: Positive = 2573.0
    disks: Annotated[int, Field(ge=2, le=30)] = 9
    """Evenly spaced. Tendons rub on the base plate and on all disks but the last, which holds
    their ends."""
    tendon_radius_mm: Positive = 8.0
    """Distance of the tendons from the axis."""
    tendons: Annotated[
        tuple[TendonRoute, ...], Field(strict=False, min_length=1, max_length=12)
    ] = (
        TendonRoute(angle_rad=0.0),
        TendonRoute(angle_rad=2.0943951023931953),
        TendonRoute(angle_rad=-2.0943951023931953),
        TendonRoute(angle_rad=0.0, turns=-1.5),
    )
    """In the order of the axes that pull them."""
    tendon_stiffness_n: Positive = 3.0e3
    """EA of a tendon."""
    drive_stiffness_n_mm: Positive = 8.0
    """Of everything between a motor and the base plate: spool, gear, the tendon's way there."""
    pretension_n: Positive = 2.0
    """Of every tendon as it is strung, with all axes at zero and nothing at the tip."""
    friction: Annotated[float, Field(ge=0, le=1)] = 0.15
    """Of a tendon on the edge of a hole, by Euler and Eytelwein."""
    presliding_mm: Annotated[float, Field(ge=0.005)] = 0.02
    """What a tendon gives way at a hole before it slips, from rest to full friction."""
    backlash_mm: NotNegative = 0.1
    """Half of the play of gear, spool and sheath: a motor that turns back moves its tendon only
    after twice as much."""
    dead_time_s: Annotated[float, Field(ge=0, le=0.5)] = 0.0
    """How long nothing arrives of what a motor does. Stiff drives have none to speak of."""

    @model_validator(mode="before")
    @classmethod
    def _figures_of_the_body(cls, given: object) -> object:
        return with_body(given)


class TubeSection(ConfigModel):
    """A length of a tube that alone would be an arc."""

    length_mm: Annotated[float, Field(gt=0, le=1000)]
    curvature_per_mm: Annotated[float, Field(ge=-0.2, le=0.2)] = 0.0
    """One over the radius of the arc, towards x with the tube's axis at zero; 0: straight."""


class Tube(ConfigModel):
    """One of several tubes in each other."""

    sections: Annotated[tuple[TubeSection, ...], Field(strict=False, min_length=1, max_length=8)]
    """From its collar, by which its axes hold it, to its end."""
    bending_stiffness_n_mm2: Positive
    """EI."""
    torsion_stiffness_n_mm2: Positive
    """GJ."""
    mass_mg_mm: NotNegative = 0.0
    """Of 1 mm of it; the same in g/m."""
    outer_radius_mm: Positive
    """The first tube's is that of the body, of what it may touch with."""
    carriage: Annotated[int, Field(ge=0, le=7)]
    """Which carriage its collar is on, from 0. Two tubes may share one."""
    collar_mm: float
    """Where its collar is with its carriage at zero, from the mouth; forward is positive."""
    turned_rad: float = 0.0
    """How far it is turned in its collar when its axis says zero: what homing has left."""


_PAIR_CURVATURE = 3.7736e-3
_INNER_CURVATURE = 14.29e-3


class ConcentricTubesPlant(PlantOptions):
    """Precurved tubes in each other, each turned by an axis and pushed by a carriage.

    The tubes are those of Fagogenis, Bergeles and Dupont (IROS 2016, Table I): a balanced pair of
    150 mm that shares a carriage, and a tube of which 87 mm are strongly curved. Collars that are
    17 mm long keep the tubes apart in the drive unit, as in other robots of that laboratory, so
    tubes 2 and 3 are longer by 17 and 34 mm. The paper gives stiffnesses relative to each other.
    Nitinol of 60 GPa makes them absolute with tubes of 2.80/2.58, 2.40/2.01 and 1.80/1.54 mm:
    EI = 0.05, 0.05 and 0.0143 N·m², and ν = 0.3. Friction is judged: 2 % of what twists the pair.
    """

    kind: Literal["concentric_tubes"]
    tubes: Annotated[tuple[Tube, ...], Field(strict=False, min_length=1, max_length=6)] = (
        Tube(
            sections=(TubeSection(length_mm=150.0, curvature_per_mm=_PAIR_CURVATURE),),
            bending_stiffness_n_mm2=50_000.0,
            torsion_stiffness_n_mm2=38_461.5,
            mass_mg_mm=5.93,
            outer_radius_mm=1.4,
            carriage=0,
            collar_mm=0.0,
        ),
        Tube(
            sections=(
                TubeSection(length_mm=17.0),
                TubeSection(length_mm=150.0, curvature_per_mm=_PAIR_CURVATURE),
            ),
            bending_stiffness_n_mm2=50_000.0,
            torsion_stiffness_n_mm2=38_461.5,
            mass_mg_mm=8.79,
            outer_radius_mm=1.2,
            carriage=0,
            collar_mm=-17.0,
        ),
        Tube(
            sections=(
                TubeSection(length_mm=184.0),
                TubeSection(length_mm=87.0, curvature_per_mm=_INNER_CURVATURE),
            ),
            bending_stiffness_n_mm2=14_285.0,
            torsion_stiffness_n_mm2=10_988.5,
            mass_mg_mm=4.37,
            outer_radius_mm=0.9,
            carriage=1,
            collar_mm=-121.0,
        ),
    )
    """Outermost first. Its axes are one that turns each, in this order, then the carriages."""
    mouth: Literal["first_collar", "plate"] = "first_collar"
    """Where the tubes are free to bend: in front of the first one's collar, which carries the whole
    body with it, or of a plate that stands still."""
    twisting_transmissions: bool = True
    """Whether tubes twist between their collars and the mouth, too."""
    gravity_direction: Direction = (0.0, -1.0, 0.0)
    """In the base frame, whose z axis points out of the mouth: as it stands, the robot lies."""
    friction_nmm: NotNegative = 1.0
    """Torque that turns a tube in its neighbour where a section of one of them ends."""
    presliding_rad: Annotated[float, Field(ge=0.001)] = 0.02
    """What two tubes turn against each other there before they slip."""
    friction_fades_mm: Positive = 1.0
    """How far a tube is pushed until two thirds of a torque that rubbing held are gone."""

    @property
    def carriages(self) -> int:
        """How many there are."""
        return 1 + max(tube.carriage for tube in self.tubes)

    @property
    def body_radius_mm(self) -> float:
        """Of what the body may touch with: the outermost tube's, all along. Where an inner one
        stands out alone the body is thinner, by half a millimetre; it is taken to be as thick,
        since where that begins moves along the body with the carriages. No risk is too low so."""
        return self.tubes[0].outer_radius_mm

    def extent(self, actuators: Sequence[float]) -> BodyExtent:
        """As `BodyExtent` says: tubes come out of the mouth as far as (m,) actuators push them."""
        pushed_mm = actuators[len(self.tubes) :]
        begin_mm = pushed_mm[0] if self.mouth == "first_collar" else 0.0
        ends_mm = [
            tube.collar_mm
            + pushed_mm[tube.carriage]
            + sum(section.length_mm for section in tube.sections)
            for tube in self.tubes
        ]
        return BodyExtent(begin_mm, max(ends_mm) - begin_mm, _METAL_STRETCH)

    @property
    def length_mm(self) -> float:
        """The body is never longer than its longest tube."""
        return max(sum(section.length_mm for section in tube.sections) for tube in self.tubes)


# Each with the functions that make it, (options, robot) → sim_backends.plants.plant.Plant, and
# another of its design.

SOFT_ARM: Final = Kind(
    SoftArmPlant, "sim_backends.lab.bodies:soft_arm", "sim_backends.plants.plant:variation"
)
TENDON_ARM: Final = Kind(
    TendonArmPlant,
    "sim_backends.lab.bodies:tendon_arm",
    "sim_backends.plants.tendon_arm.tendon_arm:variation",
)
CONCENTRIC_TUBES: Final = Kind(
    ConcentricTubesPlant,
    "sim_backends.lab.bodies:concentric_tubes",
    "sim_backends.plants.concentric.concentric_tubes:variation",
)

Plant = Annotated[PlantOptions, Named(PLANTS)]
