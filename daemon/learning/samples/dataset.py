"""What an exploration has seen: one npz with its frames, and a JSON text that says whose they are.

The frames are kept and not the samples, so that samples can be made of them in other ways.
"""

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from config.robot import Robot
from daemon.array_files import ArrayFile, ModelError, misfit_of, read_as, whose
from daemon.learning.samples.motion import MotionTable
from daemon.learning.samples.motion_samples import MotionSampler, SamplingSettings
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector

_KIND = "tentacled exploration/1"
_PROVENANCE = "provenance"
_APART_NS = 3_600_000_000_000
_FASTEST_TRAVEL_PER_S = 10.0
_FRAMES = ("t_ns", "tip_mm", "u", "line")


class DatasetError(ValueError):
    """A file that is no exploration, or not one of this robot; the text says which and why."""


@dataclass(frozen=True)
class Frames:
    """n frames of a moving robot, as its controller saw them, in the order of time."""

    t_ns: NDArray[np.int64]
    tip_mm: Vector
    """(n, 3) filtered; only where the tracker's measurement was believed."""
    u: Vector
    """(n, m) where the axes were at that time."""
    line: NDArray[np.int64]
    """(n,) number of the straight line, or of another stretch that belongs together."""

    def __post_init__(self) -> None:
        count = len(self.t_ns)
        shapes = (self.t_ns.shape, self.tip_mm.shape, self.u.shape[:1], self.line.shape)
        if shapes != ((count,), (count, 3), (count,), (count,)) or self.u.ndim != 2:
            raise ValueError("these arrays are not frames of one robot")

    def __len__(self) -> int:
        return len(self.t_ns)

    @property
    def duration_s(self) -> float:
        """From the first to the last."""
        return float(self.t_ns[-1] - self.t_ns[0]) * 1e-9 if len(self) else 0.0

    def motions(self, settings: SamplingSettings, travel: Vector) -> MotionTable:
        """The samples in these frames, by the same rules as while a robot is controlled."""
        sampler = MotionSampler(settings, travel)
        samples, lines = [], []
        for t_ns, tip_mm, u in zip(self.t_ns.tolist(), self.tip_mm, self.u, strict=True):
            sample = sampler.add(t_ns, tip_mm, u)
            if sample is not None:
                samples.append(sample)
                lines.append(int(self.line[np.searchsorted(self.t_ns, sampler.began_ns)]))
        return MotionTable.of(samples, lines, self.u.shape[1])


def finite_frames(frames: Frames) -> Frames:
    """Those with nothing but numbers in them."""
    values = np.hstack([frames.tip_mm, frames.u])
    return _rows(frames, np.asarray(np.isfinite(values).all(axis=1)))


def sound_frames(frames: Frames, travel: Vector) -> Frames:
    """Those that are finite, in order, and where tip and axes can have gone from those around.

    A median of five is right with two of them wrong. travel: (m,) of the axes; no axis goes through
    all of it in a tenth of a second.
    """
    finite = finite_frames(frames)
    later = np.diff(finite.t_ns, prepend=finite.t_ns[:1] - 1) > 0
    ordered = _rows(finite, later & (finite.t_ns == np.maximum.accumulate(finite.t_ns)))
    span_s = np.ptp(_neighbours(ordered.t_ns), axis=1) * 1e-9
    aside_mm = np.abs(ordered.tip_mm - np.median(_neighbours(ordered.tip_mm), axis=1)).max(axis=1)
    share = (np.abs(ordered.u - np.median(_neighbours(ordered.u), axis=1)) / travel).max(axis=1)
    possible = aside_mm <= SamplingSettings().fastest_mm_s * span_s
    return _rows(ordered, possible & (share <= _FASTEST_TRAVEL_PER_S * span_s))


def _neighbours(values: NDArray[Any]) -> NDArray[Any]:
    """(n, 5, ...) each value among those around it, at the ends among the first or last five."""
    count = len(values)
    first = np.clip(np.arange(count) - 2, 0, max(count - 5, 0))
    return np.asarray(values[np.minimum(first[:, None] + np.arange(5), max(count - 1, 0))])


def _rows(frames: Frames, keep: NDArray[np.bool_]) -> Frames:
    return Frames(**{name: getattr(frames, name)[keep] for name in _FRAMES})


@dataclass(frozen=True)
class Dataset:
    """One exploration of one robot, or several of it."""

    frames: Frames
    travel: Vector
    """(m,) of the axes."""
    provenance: dict[str, Any]
    """Whose it is, and how it was made. For JSON."""

    @classmethod
    def of(cls, frames: Frames, robot: Robot, more: dict[str, Any]) -> Self:
        """more: how it was made."""
        return cls(frames, AxisRanges.of(robot).travel, {**whose(robot), **more})

    @property
    def sha256(self) -> str:
        """Of the frames."""
        hashed = hashlib.sha256()
        for name in _FRAMES:
            hashed.update(np.ascontiguousarray(getattr(self.frames, name)).tobytes())
        return hashed.hexdigest()

    def motions(self, settings: SamplingSettings) -> MotionTable:
        """The samples in its frames."""
        return self.frames.motions(settings, self.travel)

    def save(self, path: Path) -> None:
        """A reader sees the old file or the whole new one. Raises OSError."""
        arrays = {name: getattr(self.frames, name) for name in _FRAMES}
        ArrayFile({"kind": _KIND, **self.provenance}, arrays).save(path, _PROVENANCE)

    @classmethod
    def load(cls, path: Path, robot: Robot) -> Self:
        """Raises DatasetError for a file that is none or another robot's, OSError."""
        try:
            with read_as(path, "an exploration"):
                file = ArrayFile.load(path, _KIND, _PROVENANCE)
                frames = Frames(
                    file.arrays["t_ns"].astype(np.int64),
                    file.arrays["tip_mm"].astype(np.float64),
                    file.arrays["u"].astype(np.float64),
                    file.arrays["line"].astype(np.int64),
                )
        except ModelError as error:
            raise DatasetError(str(error)) from None
        provenance = file.about
        misfit = misfit_of(provenance, robot)
        if misfit or frames.u.shape[1] != len(robot.axes):
            raise DatasetError(f"{path} does not fit this robot: {misfit or 'other axes'}")
        return cls(frames, AxisRanges.of(robot).travel, provenance)


def joined(datasets: list[Dataset]) -> Dataset:
    """Several explorations of one robot as one, with no motion from one to the next."""
    if len(datasets) == 1:
        return datasets[0]
    parts, t_ns, line = [], 0, 0
    for dataset in datasets:
        part = dataset.frames
        shifted = part.t_ns - part.t_ns[:1].sum() + t_ns
        parts.append(replace(part, t_ns=shifted, line=part.line - part.line.min(initial=0) + line))
        if len(part):
            t_ns = int(shifted[-1]) + _APART_NS
            line = int(parts[-1].line.max()) + 1
    whole = Frames(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in _FRAMES}
    )
    told = {**datasets[0].provenance, "parts": [dataset.provenance for dataset in datasets]}
    return Dataset(whole, datasets[0].travel, told)
