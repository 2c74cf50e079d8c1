"""What coupled limits must be: to axes and coordinates, to each other, and to the travels."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from config.coupling.coordinates import CoordinateBase
from config.coupling.feasible import has_room, reach
from config.coupling.limits import ConditionBase, CoupledLimitBase
from config.coupling.sums import AxesLimit, AxesSum, FloatArray, axes_limits
from config.documents.problems import did_you_mean
from config.documents.yaml_document import Location

Finding = tuple[Location, str]

ROUNDING_COUNTS: Final = 8.0
"""Of each axis: targets are whole counts, and the gate keeps half so many away from a bound."""
_SAME_SHARE: Final = 1e-6
"""Of a travel: as far as rounding in linear programs goes."""


class AxisFacts(NamedTuple):
    """What is asked of an axis."""

    name: str
    unit: str
    travel: tuple[float, float]
    travel_key: str
    """Of the robot file."""
    counts_per_unit: float
    mode: str
    """Of its drive."""
    goes_on_s: float
    """With its last velocity, when nothing is sent any more."""


def limit_findings(
    limits: Sequence[CoupledLimitBase | None],
    axes: Sequence[AxisFacts] | None,
    coordinates: Sequence[CoordinateBase],
    homing_groups: Sequence[Sequence[str]],
) -> Iterator[Finding]:
    """All that is wrong with coupled limits: where in the file, and a sentence about it.

    None stands for a limit that is unsound by itself, and for axes that are not all sound.
    coordinates: sound ones; what a sum may name beside axes. homing_groups: names of axes that
    look for their zeros at the same time.
    """
    units = None if axes is None else {axis.name: axis.unit for axis in axes}
    if units is not None:
        units |= {one.name: one.unit for one in coordinates}
    seen: set[str] = set()
    wrong = False
    for index, limit in enumerate(limits):
        if limit is None:
            wrong = True
            continue
        at = ("coupled_limits", index)
        found = list(_limit_findings(at, limit, units))
        if limit.name in seen:
            found.append(((*at, "name"), f"there is already a coupled limit '{limit.name}'"))
        seen.add(limit.name)
        wrong = wrong or bool(found)
        yield from found
    if axes is not None and not wrong:
        known = [limit for limit in limits if limit is not None]
        yield from _findings_in_axes(known, axes, coordinates)
        limits_in_axes = axes_limits(known, [axis.name for axis in axes], coordinates)
        yield from _homing_findings(limits_in_axes, axes, homing_groups)


def _limit_findings(
    at: Location, limit: CoupledLimitBase, units: Mapping[str, str] | None
) -> Iterator[Finding]:
    """Of one limit alone. units: of everything that a sum may name; None: not known."""
    unit, lowest, highest = limit.unit, limit.lowest, limit.highest
    if lowest is None and highest is None:
        yield at, f"bounds nothing: give lowest_{unit}, highest_{unit} or both"
    elif lowest is not None and highest is not None and not lowest < highest:
        yield (*at, f"highest_{unit}"), f"must be above lowest_{unit}, {lowest:g} {unit}"
    if units is not None:
        yield from _sum_findings((*at, "sum"), limit.sum, unit, units)
    for index, condition in enumerate(limit.only_while):
        place = (*at, "only_while", index)
        if units is not None:
            yield from _sum_findings((*place, "sum"), condition.sum, condition.unit, units)
        yield from _band_findings(place, condition)


def _sum_findings(
    at: Location, named: Mapping[str, float], unit: str, units: Mapping[str, str]
) -> Iterator[Finding]:
    for name, factor in named.items():
        if name not in units:
            hint = did_you_mean(name, units)
            yield (*at, name), f"there is no axis or coordinate '{name}'{hint}"
        elif units[name] != unit:
            yield (*at, name), f"'{name}' is in {units[name]}, and this sum in {unit}"
        if factor == 0.0:
            yield (*at, name), "0 adds nothing: leave it out"


def _band_findings(at: Location, condition: ConditionBase) -> Iterator[Finding]:
    period = condition.period
    if period is not None and not 2 * condition.within < period:
        yield (
            (*at, f"within_{condition.unit}"),
            f"must be less than half of the period, {period / 2:g} {condition.unit}: as it is, the "
            "condition is always met",
        )


def _findings_in_axes(
    limits: Sequence[CoupledLimitBase],
    axes: Sequence[AxisFacts],
    coordinates: Sequence[CoordinateBase],
) -> Iterator[Finding]:
    """What shows once sums are known in axes."""
    known = axes_limits(limits, [axis.name for axis in axes], coordinates)
    travels = np.array([axis.travel for axis in axes])
    found = [
        finding
        for index, (limit, one) in enumerate(zip(limits, known, strict=True))
        for finding in _count_findings(("coupled_limits", index), limit, one, axes)
    ]
    yield from found
    if found or not (travels[:, 0] < travels[:, 1]).all():
        return
    for index in range(len(known)):
        if not has_room(known[: index + 1], travels):
            yield ("coupled_limits", index), _no_room(known[: index + 1])
            return
    yield from _zero_findings(limits, known, len(axes))
    yield from _travel_findings(known, axes, travels)


def _count_findings(
    at: Location, limit: CoupledLimitBase, known: AxesLimit, axes: Sequence[AxisFacts]
) -> Iterator[Finding]:
    """Sums must be of something, and have room for whole counts; drives must go straight."""
    for place, one in (
        ((*at, "sum"), known.sum),
        *[
            ((*at, "only_while", number, "sum"), condition.sum)
            for number, condition in enumerate(known.only_while)
        ],
    ):
        if not one.factors.any():
            yield place, "no axis is left in this sum: its coordinates cancel each other"
        for factor, axis in zip(one.factors, axes, strict=True):
            if factor and axis.mode == "pp":
                yield (
                    place,
                    (
                        f"the drive of '{axis.name}' is in mode pp and goes its own way to each "
                        "target: for axes that are coupled it must be csp, csv or pv"
                    ),
                )
    yield from _stream_findings(at, known, axes)
    narrow = _rounding(known.sum, axes)
    if not known.highest - known.lowest > narrow:
        text = f"leaves less than the {narrow:.2g} {limit.unit} that whole counts need"
        yield (*at, f"highest_{limit.unit}"), text
    for number, (condition, one_) in enumerate(
        zip(known.only_while, limit.only_while, strict=True)
    ):
        narrow = _rounding(condition.sum, axes)
        gap = np.inf if condition.period is None else condition.period - 2 * condition.within
        if not gap > narrow:
            yield (
                (*at, "only_while", number, f"within_{one_.unit}"),
                f"leaves less than the {narrow:.2g} {one_.unit} beside it that whole counts need",
            )


def _stream_findings(
    at: Location, known: AxesLimit, axes: Sequence[AxisFacts]
) -> Iterator[Finding]:
    """Where nothing is sent any more, axes that are coupled go on together or not at all."""
    sums = [known.sum, *[condition.sum for condition in known.only_while]]
    coupled = np.any([one.factors != 0.0 for one in sums], axis=0)
    together = [axis for axis, one in zip(axes, coupled, strict=True) if one]
    for first, axis in pairwise(together):
        if axis.goes_on_s != first.goes_on_s:
            yield (
                at,
                (
                    f"when nothing is sent any more, '{first.name}' goes on for "
                    f"{first.goes_on_s:g} s and '{axis.name}' for {axis.goes_on_s:g} s: give axes "
                    "that are coupled the same mode and setpoint_timeout_s"
                ),
            )
            return


def _rounding(one: AxesSum, axes: Sequence[AxisFacts]) -> float:
    counts = [ROUNDING_COUNTS / abs(axis.counts_per_unit) for axis in axes]
    return float(np.abs(one.factors) @ counts)


def _no_room(limits: Sequence[AxesLimit]) -> str:
    *before, last = [f"'{limit.name}'" for limit in limits]
    beside = f", beside {', '.join(before)}" if before else ""
    return f"nowhere within the axes' travels can {last} be kept{beside}"


def _zero_findings(
    limits: Sequence[CoupledLimitBase], known: Sequence[AxesLimit], count: int
) -> Iterator[Finding]:
    """Zero is where homing ends: who is not inside there could only come back in."""
    for index, (limit, one) in enumerate(zip(limits, known, strict=True)):
        if bool(one.kept(np.zeros(count))):
            continue
        value = float(one.sum.at(np.zeros(count)))
        side, bound = ("lowest", one.lowest) if value < one.lowest else ("highest", one.highest)
        yield (
            ("coupled_limits", index, f"{side}_{limit.unit}"),
            f"with all axes at their zeros, where homing ends, the sum is {value:g} {limit.unit}, "
            f"and {bound:g} is the {side}: move a zero, or the bound",
        )


def _homing_findings(
    known: Sequence[AxesLimit],
    axes: Sequence[AxisFacts],
    groups: Sequence[Sequence[str]],
) -> Iterator[Finding]:
    """Of axes that home together each moves where the gate knows nothing of the others."""
    for index, group in enumerate(groups):
        for limit in known:
            named = zip(axes, limit.sum.factors, strict=True)
            shared = [axis.name for axis, factor in named if factor and axis.name in group]
            if len(shared) > 1:
                yield (
                    ("homing_order", index),
                    f"{' and '.join(shared)} share the coupled limit '{limit.name}', which counts "
                    "on one of them standing still: home one after the other",
                )
                break


def _travel_findings(
    known: Sequence[AxesLimit], axes: Sequence[AxisFacts], travels: FloatArray
) -> Iterator[Finding]:
    """A drive keeps its axis' travel by itself: it shall not be wider than it can ever be used."""
    for index, (axis, (low, high), (least, most)) in enumerate(
        zip(axes, travels, reach(known, travels), strict=True)
    ):
        slack = _SAME_SHARE * (high - low)
        if least > low + slack or most < high - slack:
            yield (
                ("axes", index, axis.travel_key),
                f"the coupled limits leave only [{least:g}, {most:g}] of it: write that, and the "
                "drive keeps it without anybody's help",
            )
