"""The mixture density network while it learns, in torch. `mixture_network` runs what it has learnt.

A trunk, and three heads for the means, the factors of the precisions and the weights, after
Thompson et al. Nothing that a head gives is out of bounds (Kruse 2020): of Ū the logarithms of its
diagonal are learnt, so that Σ⁻¹ = ŪᵀŪ is always positive definite, and ln|Σ⁻¹|^½ is their sum.

It learns in its own units: inputs are (u − offset) / scale, or where an axis comes round the cosine
and sine of where it is in its period; places are (x − offset) / scale with
one scale for all directions. Only programs that train import this file: torch is large and slow.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import log, pi
from typing import Any, Final

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from safety.risk.model.mixture import MOST_COMPONENTS, FloatArray
from safety.risk.model.mixture_network_kernels import feature_count, write_features

_ACTIVATIONS: Final = {"relu": nn.ReLU, "tanh": nn.Tanh, "silu": nn.SiLU}
_SMALL: Final = 0.1
"""Of the usual weights in a head's last layer: it begins near its biases, whatever the input."""


@dataclass(frozen=True)
class NetworkShape:
    """How large it is. trunk, heads: sizes of the hidden layers; each head has its own."""

    components: int
    trunk: tuple[int, ...] = (128, 128, 128)
    heads: tuple[int, ...] = ()
    activation: str = "silu"

    def __post_init__(self) -> None:
        if not 1 <= self.components <= MOST_COMPONENTS:
            raise ValueError(f"a mixture has 1 to {MOST_COMPONENTS} components")
        if not self.trunk or min((*self.trunk, *self.heads)) < 1:
            raise ValueError("a trunk has one layer or more, and each layer something in it")
        if self.activation not in _ACTIVATIONS:
            raise ValueError(f"there is no activation {self.activation!r}")


@dataclass(frozen=True, eq=False)
class Scaling:
    """Between the world's units and the network's. See `mixture_network`."""

    input_offset: FloatArray
    """(m,)."""
    input_scale: FloatArray
    """(m,)."""
    output_offset_mm: FloatArray
    """(d,)."""
    output_scale_mm: float
    log_diagonal_limits: tuple[float, float]
    """Of Ū over the scale: a cloud thinner than its noise would make it explode."""
    input_period: FloatArray
    """(m,) after how much the body is where it was; 0: never."""

    @property
    def features(self) -> int:
        """How many numbers the network sees."""
        return int(feature_count(self.input_period))

    def inputs(self, u: NDArray[Any]) -> Tensor:
        """(n, features) of (n, m) actuation vectors."""
        there = np.empty((len(u), self.features))
        scaling = self.input_offset, self.input_scale, self.input_period
        for place, row in zip(np.asarray(u, np.float64), there, strict=True):
            write_features(place, *scaling, row)
        return torch.from_numpy(there.astype(np.float32))

    def places(self, samples_mm: NDArray[Any]) -> Tensor:
        """(…, d) of places or coefficients."""
        scaled = (samples_mm - self.output_offset_mm) / self.output_scale_mm
        return torch.from_numpy(scaled.astype(np.float32))


@dataclass(frozen=True, eq=False)
class Beginning:
    """The mixture that the network gives before it has learnt, whatever the input."""

    means_mm: FloatArray
    """(K, d)."""
    covariances_mm2: FloatArray
    """(K, d, d)."""

    @property
    def together(self) -> "Beginning":
        """One component that is as wide as all of them."""
        middle = self.means_mm.mean(axis=0)
        away = self.means_mm - middle
        spread = self.covariances_mm2.mean(axis=0) + away.T @ away / len(away)
        return Beginning(middle[None], spread[None])


class MixtureDensityNetwork(nn.Module):
    """m inputs to K components over d coordinates."""

    def __init__(self, shape: NetworkShape, scaling: Scaling, beginning: Beginning | None) -> None:
        """Weights are drawn from torch's generator: seed it before.

        beginning: None: all layers as torch makes them, the last ones too.
        """
        super().__init__()
        self.shape, self.scaling = shape, scaling
        self._dimensions = d = scaling.output_offset_mm.size
        k, wide = shape.components, shape.trunk[-1]
        self._rows, self._columns = torch.triu_indices(d, d)
        self.trunk = _stack((scaling.features, *shape.trunk))
        self.means = _stack((wide, *shape.heads, k * d))
        self.factors = _stack((wide, *shape.heads, k * d * (d + 1) // 2))
        self.weights = _stack((wide, *shape.heads, k))
        self._activation = _ACTIVATIONS[shape.activation]()
        if beginning is not None:
            self._begin(beginning)

    def _begin(self, beginning: Beginning) -> None:
        scaling = self.scaling
        means = (beginning.means_mm - scaling.output_offset_mm) / scaling.output_scale_mm
        # The lower Cholesky factor L of the precision is the wanted Ū, transposed.
        precision = np.linalg.inv(beginning.covariances_mm2) * scaling.output_scale_mm**2
        factors = np.linalg.cholesky(precision).transpose(0, 2, 1)
        diagonal = np.arange(self._dimensions)
        factors[:, diagonal, diagonal] = np.log(factors[:, diagonal, diagonal])
        entries = factors[:, self._rows.numpy(), self._columns.numpy()]
        with torch.no_grad():
            for head, bias in ((self.means, means), (self.factors, entries), (self.weights, 0.0)):
                last = head[-1]
                assert isinstance(last, nn.Linear)
                last.weight *= _SMALL
                values = np.broadcast_to(np.ravel(bias), last.out_features)
                last.bias.copy_(torch.from_numpy(values.astype(np.float32)))

    def forward(self, inputs: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """The mixtures at (b, features) inputs, in scaled units.

        Returns ln w (b, K), means (b, K, d), Ū (b, K, d, d), and the sum of the logarithms of its
        diagonal (b, K).
        """
        k, d = self.shape.components, self._dimensions
        common = inputs
        for layer in self.trunk:
            common = self._activation(layer(common))
        means = self._head(self.means, common).reshape(-1, k, d)
        entries = self._head(self.factors, common).reshape(-1, k, d * (d + 1) // 2)
        logits = self._head(self.weights, common)
        on_diagonal = self._rows == self._columns
        logarithms = entries[:, :, on_diagonal].clamp(*self.scaling.log_diagonal_limits)
        upper = torch.zeros(*entries.shape[:2], d, d, dtype=entries.dtype, device=entries.device)
        off = ~on_diagonal
        upper[:, :, self._rows[off], self._columns[off]] = entries[:, :, off]
        upper = upper + torch.diag_embed(logarithms.exp())
        return torch.log_softmax(logits, dim=1), means, upper, logarithms.sum(dim=2)

    def negative_log_likelihood(self, inputs: Tensor, places: Tensor) -> Tensor:
        """(b, p) of (b, p, d) scaled places at (b, features) inputs, with its constant.

        In nats, of a density per scaled unit^d: `in_mm` makes it one per mm^d.
        """
        log_weights, means, upper, log_determinant = self(inputs)
        away = places[:, None] - means[:, :, None]
        square = (away @ upper.transpose(2, 3)).square().sum(dim=3)
        parts = (log_weights + log_determinant)[:, :, None] - 0.5 * square
        constant = 0.5 * self._dimensions * log(2.0 * pi)
        return constant - torch.logsumexp(parts, dim=1)

    @property
    def in_mm(self) -> float:
        """What to add to a negative log-likelihood of scaled places for one of places in mm."""
        return self._dimensions * log(self.scaling.output_scale_mm)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """What `mixture_network` runs."""
        scaling = self.scaling
        arrays: dict[str, NDArray[Any]] = {
            name: value.detach().cpu().numpy().copy() for name, value in self.state_dict().items()
        }
        if scaling.input_period.any():
            arrays["input_period"] = scaling.input_period
        return arrays | {
            "input_offset": scaling.input_offset,
            "input_scale": scaling.input_scale,
            "output_offset_mm": scaling.output_offset_mm,
            "output_scale_mm": np.array(scaling.output_scale_mm),
            "log_diagonal_limits": np.array(scaling.log_diagonal_limits),
        }

    def _head(self, head: nn.ModuleList, common: Tensor) -> Tensor:
        *hidden, last = head
        for layer in hidden:
            common = self._activation(layer(common))
        result: Tensor = last(common)
        return result


def _stack(sizes: Sequence[int]) -> nn.ModuleList:
    return nn.ModuleList(nn.Linear(before, after) for before, after in pairwise(sizes))
