"""Why there is no path: which of several reasons, the place that blocks, and what helps."""

from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np

from daemon.workbench.planning.body_in_place import BodyInPlace, Standing
from daemon.workbench.planning.clearance_slopes import distance_at
from safety.risk.contact_figures import WorstPlace
from safety.risk.model.mixture import FloatArray

Why = Literal[
    "start_not_allowed",
    "start_touches",
    "entrance_sealed",
    "goal_in_solid",
    "goal_too_near",
    "goal_outside_workspace",
    "goal_out_of_reach",
    "goal_touches",
    "too_narrow",
    "no_way",
    "too_risky",
]

_ENTRANCE: Final = 0.25
"""Of the body's length, from its base: what touches there is where it comes in."""
_UPHILL_MM: Final = 40.0
"""How far the middle of a gap is looked for."""
_STEP_MM: Final = 0.5


@dataclass(frozen=True, eq=False)
class Blocked:
    """There is none, and why."""

    why: Why
    text: str
    """In words, with what helps."""
    place_mm: tuple[float, float, float] | None = None
    """Of what blocks, on the surface; or where it was asked to go."""
    arc_mm: float | None = None
    """Along the body, where it would touch."""
    gap_mm: float | None = None
    """How wide the place is that is too narrow."""

    def summary(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "none": self.why,
            "text": self.text,
            "place_mm": None if self.place_mm is None else list(self.place_mm),
            "arc_mm": self.arc_mm,
            "gap_mm": self.gap_mm,
        }


def start_blocked(body: BodyInPlace, risk: float, worst: WorstPlace) -> Blocked:
    """The body touches before it has moved."""
    length_mm = float(body.thick.arc_mm[-1])
    place, where = _place(worst.nearest_mm), _words(worst)
    if worst.arc_mm <= _ENTRANCE * length_mm:
        return Blocked(
            "entrance_sealed",
            f"there is none: the body cannot come in, it touches where it begins, {where} "
            f"(risk {risk:.0%}); declare the opening as risk.surface.port, or correct the mesh",
            place,
            worst.arc_mm,
        )
    return Blocked(
        "start_touches",
        f"there is none: where it starts the body touches already, {where} (risk {risk:.0%}); "
        "lead it away from there first, plan from somewhere else, or correct the surroundings",
        place,
        worst.arc_mm,
        gap_at(body, worst),
    )


def goal_in_the_way(body: BodyInPlace, goal_mm: FloatArray) -> Blocked | None:
    """What can be said of a (3,) goal by itself; None: nothing speaks against it."""
    place = _place(goal_mm)
    if not body.in_workspace(goal_mm):
        text = f"there is none: {_point(goal_mm)} is outside the workspace of the robot file"
        return Blocked("goal_outside_workspace", text, place)
    distance_mm = float(distance_at(body.grid, goal_mm[None])[0][0])
    room_mm = abs(distance_mm)
    # Regions are on the grid alone.
    if distance_mm < 0.0 or bool(body.environment.solid(goal_mm[None])[0]):
        return Blocked(
            "goal_in_solid",
            f"there is none: the goal {_point(goal_mm)} is {room_mm:.1f} mm within something "
            "solid; choose one in free space",
            place,
        )
    radius_mm = float(body.model.basis.radius_mm[-1])
    if room_mm < radius_mm and not _in_port(body, goal_mm):
        return Blocked(
            "goal_too_near",
            f"there is none: the goal {_point(goal_mm)} is {room_mm:.1f} mm from something solid, "
            f"and the body has a radius of {radius_mm:.1f} mm there; choose one further away",
            place,
        )
    return None


def goal_out_of_reach(goal_mm: FloatArray, nearest_mm: FloatArray, miss_mm: float) -> Blocked:
    """No configuration that is known brings the tip there. nearest_mm: (3,) the tip, at best."""
    return Blocked(
        "goal_out_of_reach",
        f"there is none: no posture that the model knows brings the tip to {_point(goal_mm)}; "
        f"the nearest is {_point(nearest_mm)}, {miss_mm:.1f} mm off. Choose a nearer goal, or "
        "another direction",
        _place(nearest_mm),
    )


def goal_touches(body: BodyInPlace, goal_mm: FloatArray, best: Standing) -> Blocked:
    """Wherever the tip is there, the body touches. best: the least of it."""
    assert best.worst is not None
    if (narrow := _too_narrow(body, best.worst)) is not None:
        return narrow
    return Blocked(
        "goal_touches",
        f"there is none: with the tip at {_point(goal_mm)} the body touches in every posture, "
        f"{_words(best.worst)} (risk {best.risk:.0%} in the best of them)",
        _place(best.worst.nearest_mm),
        best.worst.arc_mm,
    )


def way_blocked(body: BodyInPlace, worst: Standing | None) -> Blocked:
    """Every way leads through something. worst: the place on the least bad one; None: unknown."""
    if worst is None or worst.worst is None:
        return Blocked(
            "no_way",
            "there is none: what the model knows of the body does not lead from the start to the "
            "goal in one piece; see the body at more configurations (`tentacled mdn collect`)",
        )
    place = worst.worst
    if (narrow := _too_narrow(body, place)) is not None:
        return narrow
    return Blocked(
        "no_way",
        f"there is none: every way is blocked; on the least bad one the body touches "
        f"{_words(place)} (risk {worst.risk:.0%})",
        _place(place.nearest_mm),
        place.arc_mm,
    )


def too_risky(risk: float, most: float, worst: WorstPlace) -> Blocked:
    """There is a path, and nobody should go it."""
    return Blocked(
        "too_risky",
        f"there is none with a risk of {most:.1%} or less: the best that was found has up to "
        f"{risk:.1%}, {_words(worst)}; allow more with --most-risk, or choose another goal",
        _place(worst.nearest_mm),
        worst.arc_mm,
    )


def _too_narrow(body: BodyInPlace, worst: WorstPlace) -> Blocked | None:
    """Where the body touches on both sides."""
    gap_mm, thick_mm = gap_at(body, worst), 2.0 * float(body.thick.radius_mm.max())
    if gap_mm is None:
        return None
    return Blocked(
        "too_narrow",
        f"there is none: every way leads through a gap of {gap_mm:.1f} mm at "
        f"{_point(worst.nearest_mm)}, and the body is {thick_mm:.1f} mm thick as its model knows "
        "it",
        _place(worst.nearest_mm),
        worst.arc_mm,
        gap_mm,
    )


def gap_at(body: BodyInPlace, worst: WorstPlace) -> float | None:
    """How wide the free space is where a part of the body touches, mm; None: it is wide.

    From there the distance is climbed to where there is most room, which is in the middle.
    """
    place = worst.place_mm.astype(np.float64)
    if not np.isfinite(place).all():
        return None
    enough = float(body.thick.radius_mm.max())
    best = -np.inf
    for _ in range(int(_UPHILL_MM / _STEP_MM)):
        distance, slope = (part[0] for part in distance_at(body.grid, place[None]))
        best = max(best, float(distance))
        steepness = float(np.linalg.norm(slope))
        if best >= enough:
            return None
        if steepness < 0.2 or float(distance) < best - _STEP_MM:
            break
        place = place + _STEP_MM * slope / steepness
    return 2.0 * best if best > 0.0 else None


def _in_port(body: BodyInPlace, place_mm: FloatArray) -> bool:
    port = body.environment.port
    if port is None:
        return False
    inwards = np.asarray(port.inwards) / np.linalg.norm(port.inwards)
    off = place_mm - np.asarray(port.centre_mm)
    along = float(off @ inwards)
    return along <= port.depth_mm and float(np.linalg.norm(off - along * inwards)) <= port.radius_mm


def _words(worst: WorstPlace) -> str:
    return f"{worst.arc_mm:.0f} mm along the body, at {_point(worst.nearest_mm)}"


def _point(place_mm: FloatArray) -> str:
    return "({:.0f}, {:.0f}, {:.0f}) mm".format(*place_mm)


def _place(place_mm: FloatArray) -> tuple[float, float, float]:
    x, y, z = (float(part) for part in place_mm)
    return x, y, z
