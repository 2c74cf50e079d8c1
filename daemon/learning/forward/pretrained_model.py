"""A robot's forward model on disk, with the samples that it was learnt from.

One npz: what the regression has learnt, the samples, and a JSON text with the settings, the errors
by epoch and where the data came from.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import msgspec
import numpy as np

from config.robot import Robot
from daemon.array_files import ArrayFile, ModelError, misfit_of, prefixed, read_as, stripped
from daemon.learning.forward.cubic_shape import CubicShape, unforetold
from daemon.learning.forward.forward_fit import ForwardFit, forward_fit
from daemon.learning.forward.forward_model import receptive_fields, slopes_by_step
from daemon.learning.forward.pretraining import Pretraining
from daemon.learning.lwpr.model import Lwpr
from daemon.learning.lwpr.settings import LwprSettings
from daemon.learning.samples.dataset import Dataset
from daemon.learning.samples.motion import MotionTable
from daemon.learning.samples.motion_samples import SamplingSettings
from daemon.learning.samples.receptive_fields import ReceptiveFields
from drivers.pose import Vector

KIND = "tentacled forward model/1"
FIT = "fit"
"""In the metadata: how well it foretells motions."""
_WHAT = "a forward model"
_LWPR = "lwpr/"
_MOTIONS = "motions/"


@dataclass(frozen=True)
class PretrainedModel:
    """What a learning controller begins with."""

    lwpr: Lwpr
    """[p, u, Δu] → Δp. It learns on where it is updated: `load` gives everybody their own."""
    motions: MotionTable
    """The samples that it was learnt from, those of the test too."""
    sampling: SamplingSettings
    """How they were taken, with the body's lag."""
    metadata: Mapping[str, Any]
    """Whose it is and where it came from. For JSON."""

    @classmethod
    def of(cls, pretraining: Pretraining, dataset: Dataset) -> Self:
        """What pre-training with these data has learnt."""
        metadata = {
            **dataset.provenance,
            "data_sha256": dataset.sha256,
            "samples": len(pretraining.motions),
            "kept_back": int(pretraining.test.sum()),
            "fields": pretraining.model.count,
            "best_epoch": pretraining.best_epoch,
            "errors": [dict(errors._asdict()) for errors in pretraining.errors],
            FIT: msgspec.to_builtins(forward_fit(pretraining)),
        }
        return cls(
            pretraining.model, pretraining.motions, pretraining.sampling, _without_nan(metadata)
        )

    @property
    def fields(self) -> ReceptiveFields:
        """Where local controllers live."""
        return receptive_fields(self.lwpr)

    @cached_property
    def shape(self) -> CubicShape | None:
        """The body over all of its travel, where that foretells lines which it was not learnt from
        better than the fields do those they were learnt from; None: it does not."""
        found = CubicShape.of(self.motions)
        if found is None:
            return None
        said_mm = np.array([self.lwpr.predict(x) for x in self.motions.inputs])
        by_fields = unforetold(self.motions, said_mm)
        return found if found.unforetold < by_fields else None

    def jacobian(self, tip_mm: Vector, u: Vector) -> Vector:
        """(3, m) mm per mm or rad, with the tip at (3,) and axes at (m,)."""
        if self.shape is not None:
            return self.shape.jacobian(u)
        return slopes_by_step(self.lwpr, tip_mm, u)

    @property
    def fit(self) -> ForwardFit | None:
        """How well it foretells motions. None: the file does not say."""
        try:
            return msgspec.convert(self.metadata.get(FIT), ForwardFit | None)
        except msgspec.ValidationError:
            return None

    def save(self, path: Path) -> None:
        """A reader sees the old file or the whole new one. Raises OSError."""
        metadata = {
            "kind": KIND,
            **self.metadata,
            "lwpr": self.lwpr.settings.to_dict(),
            "sampling": self.sampling.to_dict(),
        }
        arrays = {
            **prefixed(_LWPR, self.lwpr.to_arrays()),
            **prefixed(_MOTIONS, self.motions.to_arrays()),
        }
        ArrayFile(metadata, arrays).save(path)

    @classmethod
    def load(cls, path: Path, robot: Robot) -> Self:
        """Raises ModelError for a file that is none, or another robot's; OSError."""
        with read_as(path, _WHAT):
            return cls.of_file(path, ArrayFile.load(path), robot)

    @classmethod
    def of_file(cls, path: Path, file: ArrayFile, robot: Robot) -> Self:
        """As `load`, of what was read from `path` already."""
        with read_as(path, _WHAT):
            metadata = dict(file.about)
            if metadata.pop("kind") != KIND:
                raise ValueError(f"its kind is not {KIND!r}")
            settings = LwprSettings.from_dict(metadata.pop("lwpr"))
            sampling = SamplingSettings.from_dict(metadata.pop("sampling"))
            model = Lwpr.from_arrays(settings, stripped(_LWPR, file.arrays))
            motions = MotionTable.from_arrays(stripped(_MOTIONS, file.arrays))
        axes = len(robot.axes)
        misfit = misfit_of(metadata, robot)
        if misfit:
            raise ModelError(f"{path} does not fit this robot: {misfit}")
        if (settings.inputs, settings.outputs, motions.axes) != (3 + 2 * axes, 3, axes):
            raise ModelError(f"{path} is damaged: it is not for {axes} axes")
        return cls(model, motions, sampling, metadata)


def _without_nan(value: Any) -> Any:
    """JSON has no NaN: what is not known is null."""
    if isinstance(value, dict):
        return {key: _without_nan(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_without_nan(inner) for inner in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
