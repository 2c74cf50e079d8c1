"""How well a forward model foretells motions, over all of them and field by field.

A model of small steps is as poor as its motions are: noise at both ends of a short one, few
directions in a field, hysteresis and creep that neither the tip nor the axes tell. What is left of
the slope of an inverse that is learnt from such motions is about R² of the forward model in the
field (errors in variables), so this says beforehand how far a controller without other knowledge
stays behind (Ho 2018, figures 4 and 5).
"""

import msgspec
import numpy as np

from daemon.learning.forward.forward_model import receptive_fields
from daemon.learning.forward.pretraining import Pretraining
from drivers.pose import Vector

_MOTIONS_AT_LEAST = 5.0
"""Sum of a field's weights; with less, its R² is that of single motions."""


class ForwardFit(msgspec.Struct, frozen=True, kw_only=True):
    """Of Δp, in all three coordinates together."""

    motions: int
    kept_back: bool
    """Whether these motions were kept back; else the model was learnt from them."""
    rmse_mm: float
    """Per coordinate, as in Ho 2018, figure 4."""
    spread_mm: float
    """Root mean square of Δp per coordinate: what a model that says nothing is off by."""
    r2: float
    """1 − rmse² / spread²; negative where it is worse than saying nothing."""
    field_r2: list[float] | None
    """Quartiles over the fields, motions counting by the field's weight. None: no field has
    motions enough."""


def forward_fit(learnt: Pretraining) -> ForwardFit:
    """By the motions that were kept back; where there are none, by those that were learnt."""
    kept_back = bool(learnt.test.any())
    rows = learnt.test if kept_back else ~learnt.test
    motions, said = learnt.motions.of_rows(rows), learnt.predicted_mm[rows]
    wrong = ((motions.delta_tip_mm - said) ** 2).mean(axis=1)
    all_of_it = (motions.delta_tip_mm**2).mean(axis=1)
    fields = receptive_fields(learnt.model)
    weights = np.array(
        [fields.weights(*place) for place in zip(motions.tip_mm, motions.u, strict=True)]
    )
    return ForwardFit(
        motions=len(motions),
        kept_back=kept_back,
        rmse_mm=float(np.sqrt(wrong.mean())),
        spread_mm=float(np.sqrt(all_of_it.mean())),
        r2=float(1.0 - wrong.sum() / all_of_it.sum()),
        field_r2=_quartiles(weights, wrong, all_of_it),
    )


def _quartiles(weights: Vector, wrong: Vector, all_of_it: Vector) -> list[float] | None:
    enough = weights.sum(axis=0) >= _MOTIONS_AT_LEAST
    if not enough.any():
        return None
    by_field = 1.0 - (wrong @ weights)[enough] / (all_of_it @ weights)[enough]
    return [float(one) for one in np.quantile(by_field, (0.25, 0.5, 0.75))]
