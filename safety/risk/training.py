"""Trains a mixture density network: equations 2 to 6 of Thompson et al., by descent on the NLL.

Samples come in groups, one for each actuation vector. Some groups are kept back to tell when to
stop: of the weights that the network passes through, those are taken that were best there. With the
same seed and number of threads a training gives the same weights to the last bit, on a CPU.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from typing import Any, Final

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from safety.risk.mixture import FloatArray
from safety.risk.network import Beginning, MixtureDensityNetwork, NetworkShape, Scaling

_LARGEST_GRADIENT: Final = 5.0
_WEIGHT_DECAY: Final = 1e-4
_RISING: Final = 0.1
"""Of the steps, in which the learning rate rises. Then it falls, like a cosine."""
_CHECKED_GROUPS: Final = 256
"""At once."""
_CHECKED_SAMPLES: Final = 512
"""Of a group, when looking whether it got better."""


class TrainingError(RuntimeError):
    """There is nothing to learn from, or nothing was learnt. Says why."""


@dataclass(frozen=True)
class TrainingSettings:
    """How it is trained."""

    steps: int = 4000
    groups: int = 64
    """In a step."""
    samples: int = 64
    """Of each group, by chance."""
    learning_rate: float = 3e-3
    validation_share: float = 0.1
    """Of the groups that are kept back to tell when to stop."""
    check_every: int = 200
    patience: int = 12
    """Stops after so many checks without anything better."""
    seed: int = 1

    def __post_init__(self) -> None:
        if min(self.steps, self.groups, self.samples, self.check_every, self.patience) < 1:
            raise ValueError("steps, groups, samples, checks and patience must be 1 or more")
        if not 0.0 < self.learning_rate < 1.0 or not 0.0 < self.validation_share < 1.0:
            raise ValueError("the learning rate and the share kept back are between 0 and 1")


@dataclass(frozen=True)
class Check:
    """How good it was at a step. NLL in nats per sample, of a density per mm^d."""

    step: int
    learnt_from: float
    kept_back: float


@dataclass(frozen=True, eq=False)
class Trained:
    """What `mixture_network` runs, and how it came about."""

    arrays: dict[str, NDArray[Any]]
    activation: str
    checks: tuple[Check, ...]
    best: Check


def train(
    u: FloatArray,
    samples_mm: NDArray[Any],
    shape: NetworkShape,
    scaling: Scaling,
    beginning: Beginning,
    settings: TrainingSettings,
    heard: Callable[[Check, dict[str, NDArray[Any]] | None], None] = lambda *_: None,
) -> Trained:
    """Learn what (n, s, d) samples are like at (n, m) u. Raises TrainingError.

    heard: is told of every check, with the weights where they are the best so far.
    """
    learning, kept_back = _split(len(u), settings)
    torch.manual_seed(settings.seed)
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    network = MixtureDensityNetwork(shape, scaling, beginning).to(device)
    inputs, places = scaling.inputs(u).to(device), scaling.places(samples_mm).to(device)
    descent = _Descent(network, settings)
    random = np.random.default_rng(settings.seed)
    checks: list[Check] = []
    best: tuple[Check, dict[str, NDArray[Any]]] | None = None
    since = 0
    for step in range(1, settings.steps + 1):
        chosen = random.choice(learning, min(settings.groups, len(learning)), replace=False)
        which = torch.from_numpy(
            random.integers(places.shape[1], size=(len(chosen), settings.samples))
        )
        rows = torch.from_numpy(chosen)[:, None]
        descent.step(inputs[chosen], places[rows, which])
        if step % settings.check_every and step != settings.steps:
            continue
        few = learning[:: -(-len(learning) // len(kept_back))]  # as many as are kept back
        seen = [_mean(network, inputs, places, part) for part in (few, kept_back)]
        check = Check(step, *seen)
        checks.append(check)
        better = isfinite(check.kept_back) and (best is None or check.kept_back < best[0].kept_back)
        since = 0 if better else since + 1
        if better:
            best = check, network.arrays()
        heard(check, best[1] if better and best else None)
        if since >= settings.patience:
            break
    if best is None:
        raise TrainingError("it diverged: its likelihood was never finite. Lower the learning rate")
    return Trained(best[1], shape.activation, tuple(checks), best[0])


def _split(n: int, settings: TrainingSettings) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Groups to learn from, and such as are kept back."""
    if n < 2:
        raise TrainingError(f"{n} groups of samples: there must be two, one to learn from")
    order = np.random.default_rng(settings.seed).permutation(n)
    kept = min(n - 1, max(1, round(settings.validation_share * n)))
    return np.sort(order[kept:]), np.sort(order[:kept])


class _Descent:
    def __init__(self, network: MixtureDensityNetwork, settings: TrainingSettings) -> None:
        self._network = network
        self._optimizer = torch.optim.AdamW(
            network.parameters(), settings.learning_rate, weight_decay=_WEIGHT_DECAY
        )
        self._schedule = torch.optim.lr_scheduler.OneCycleLR(
            self._optimizer,
            settings.learning_rate,
            total_steps=settings.steps + 1,
            pct_start=_RISING,
        )

    def step(self, inputs: Tensor, places: Tensor) -> None:
        """One step down. One whose slope is not finite is left out."""
        self._optimizer.zero_grad()
        loss = self._network.negative_log_likelihood(inputs, places).mean()
        torch.autograd.backward(loss)
        norm = torch.nn.utils.clip_grad_norm_(self._network.parameters(), _LARGEST_GRADIENT)
        if torch.isfinite(norm):
            self._optimizer.step()
        self._schedule.step()


def _mean(
    network: MixtureDensityNetwork, inputs: Tensor, places: Tensor, groups: NDArray[np.int64]
) -> float:
    """NLL of groups, in nats per sample, of a density per mm^d."""
    total, count = 0.0, 0
    stride = max(1, places.shape[1] // _CHECKED_SAMPLES)
    with torch.inference_mode():
        for begin in range(0, len(groups), _CHECKED_GROUPS):
            part = groups[begin : begin + _CHECKED_GROUPS]
            some = network.negative_log_likelihood(inputs[part], places[part][:, ::stride])
            total += float(some.double().sum())
            count += some.numel()
    return total / count + network.in_mm
