"""Input devices: which of their axes mean what for a hand, and which of their keys.

A hand has six motions: along and about x (to the right), y (away from who steers) and z (up). A
device tells of each either how far it is pushed (`rate`: a puck or a stick that comes back to its
middle) or how far it was moved (`way`: a mouse, a ball, a pen).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final, Literal

from daemon.steering.input_events import EV_ABS, EV_KEY, EV_REL, Report

MOTIONS: Final = ("x", "y", "z", "about_x", "about_y", "about_z")

AxisKey = tuple[int, int]
"""EV_REL or EV_ABS, and the code."""


@dataclass(frozen=True)
class DeviceAxis:
    """What one axis of a device means.

    means: `rate`: its value against `full` says how far it is pushed. `way`: a relative one counts
    by how much it was moved, an absolute one where it is; a hand's `full` are one millimetre.
    """

    motion: int
    """Which of MOTIONS."""
    full: float
    """Counts; negative where counting up moves the hand down."""
    middle: float = 0.0
    """Counts where a `rate` is zero."""
    means: Literal["rate", "way"] = "rate"


@dataclass(frozen=True)
class Profile:
    """A kind of device."""

    name: str
    axes: Mapping[AxisKey, DeviceAxis]
    dead_man: frozenset[int]
    """Codes of keys: it is steered while one of them is held."""
    clutch: frozenset[int]
    """... but for while one of these is: then the hand may move, and the tip stays."""
    fades_s: float | None
    """A relative rate is told again and again while it lasts: silent for so long, it is zero. None:
    every change is told, and silence means no change."""
    dead_band: float = 0.06
    """Share of the full rate that counts as none."""

    def ranged(self, ranges: Mapping[int, tuple[float, float]]) -> "Profile":
        """With the ranges of absolute axes that a device states itself, lowest and highest."""
        axes = dict(self.axes)
        for code, (low, high) in ranges.items():
            axis = axes.get((EV_ABS, code))
            if axis is None or axis.means != "rate" or not low < high:
                continue
            # One that rests at an end, such as a trigger, has that as its middle.
            one_sided = axis.middle != 0.0
            middle, full = (low, high - low) if one_sided else (0.5 * (low + high), high - low)
            full = full if one_sided else 0.5 * full
            axes[EV_ABS, code] = replace(
                axis, middle=middle, full=full if axis.full > 0.0 else -full
            )
        return replace(self, axes=axes)


# Codes of <linux/input-event-codes.h>.
_X, _Y, _Z, _RX, _RY, _RZ, _WHEEL = 0, 1, 2, 3, 4, 5, 8
_BTN_0, _BTN_1, _BTN_LEFT, _BTN_RIGHT, _BTN_TL, _BTN_TR = 0x100, 0x101, 0x110, 0x111, 0x136, 0x137
_PUCK_FULL: Final = 350.0
"""Counts of a 3D mouse, pushed all the way."""
_STICK_FULL, _TRIGGER_FULL = 32767.0, 255.0
_MOUSE_COUNTS_MM: Final = 400.0 / 25.4
"""Of the usual mouse, which counts 400 to the inch and more."""


def _puck(kind: int) -> dict[AxisKey, DeviceAxis]:
    """A 3D mouse has x to the right, y towards the hand and z down."""
    signs = (1.0, -1.0, -1.0, 1.0, -1.0, -1.0)
    return {(kind, code): DeviceAxis(code, sign * _PUCK_FULL) for code, sign in enumerate(signs)}


PROFILES: Final[Mapping[str, Profile]] = {
    profile.name: profile
    for profile in (
        Profile(
            "3d_mouse",
            _puck(EV_REL) | _puck(EV_ABS),
            frozenset({_BTN_0}),
            frozenset({_BTN_1}),
            fades_s=0.15,
        ),
        Profile(
            "gamepad",
            {
                (EV_ABS, _X): DeviceAxis(0, _STICK_FULL),
                (EV_ABS, _Y): DeviceAxis(1, -_STICK_FULL),
                (EV_ABS, _RZ): DeviceAxis(2, _TRIGGER_FULL, middle=1e-9),
                (EV_ABS, _Z): DeviceAxis(2, -_TRIGGER_FULL, middle=1e-9),
                (EV_ABS, _RX): DeviceAxis(4, _STICK_FULL),
                (EV_ABS, _RY): DeviceAxis(3, _STICK_FULL),
            },
            frozenset({_BTN_TR}),
            frozenset({_BTN_TL}),
            fades_s=None,
            dead_band=0.12,
        ),
        Profile(
            "mouse",
            {
                (EV_REL, _X): DeviceAxis(0, _MOUSE_COUNTS_MM, means="way"),
                (EV_REL, _Y): DeviceAxis(1, -_MOUSE_COUNTS_MM, means="way"),
                (EV_REL, _WHEEL): DeviceAxis(2, 0.5, means="way"),
            },
            frozenset({_BTN_LEFT}),
            frozenset({_BTN_RIGHT}),
            fades_s=None,
        ),
    )
}


@dataclass
class DeviceState:
    """What a device has said so far, as a hand's motions."""

    profile: Profile
    _rates: dict[AxisKey, tuple[float, int]] = field(default_factory=dict)
    """Of each axis how far it is pushed, and when that was told."""
    _places: dict[AxisKey, int] = field(default_factory=dict)
    _held: set[int] = field(default_factory=set)

    @property
    def dead_man(self) -> bool:
        return bool(self._held & self.profile.dead_man)

    @property
    def clutch(self) -> bool:
        return bool(self._held & self.profile.clutch)

    def take(self, report: Report, t_ns: int) -> tuple[float, ...]:
        """A report that came at `t_ns`. Returns how far the hand was moved, (6,) mm.

        Where events were lost, everything counts as let go, and what is left of such a report is
        not heard: the kernel does not say which of its keys were let go since.
        """
        moved = [0.0] * len(MOTIONS)
        if report.lost:
            self.let_go()
            return tuple(moved)
        for kind, code, value in report.events:
            if kind == EV_KEY:
                (self._held.add if value else self._held.discard)(code)
                continue
            axis = self.profile.axes.get((kind, code))
            if axis is None:
                continue
            if axis.means == "rate":
                self._rates[kind, code] = ((value - axis.middle) / axis.full, t_ns)
                continue
            way = value
            if kind == EV_ABS:
                way = value - self._places.get((kind, code), value)
                self._places[kind, code] = value
            moved[axis.motion] += way / axis.full
        return tuple(moved)

    def rates(self, t_ns: int) -> tuple[float, ...]:
        """(6,) from -1 to 1: how far it is pushed at `t_ns`."""
        found = [0.0] * len(MOTIONS)
        for key, (rate, told_ns) in self._rates.items():
            fades_s = self.profile.fades_s if key[0] == EV_REL else None
            if fades_s is not None and (t_ns - told_ns) * 1e-9 > fades_s:
                continue
            found[self.profile.axes[key].motion] += self._beyond_band(rate)
        return tuple(min(max(rate, -1.0), 1.0) for rate in found)

    def let_go(self) -> None:
        """No key is held, nothing is pushed, and where a pen is is not known."""
        self._rates.clear()
        self._places.clear()
        self._held.clear()

    def _beyond_band(self, rate: float) -> float:
        band = self.profile.dead_band
        beyond = max(0.0, abs(rate) - band) / (1.0 - band)
        return beyond if rate >= 0.0 else -beyond
