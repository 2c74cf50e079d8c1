"""Trains a mixture density network: equations 2 to 6 of Thompson et al., by descent on the NLL.

Samples come in groups, one for each actuation vector. Some groups are kept back to tell when to
stop: what is judged, and taken where it was best, is a running mean of the weights that the network
passes through, which says the same of new groups with less noise (Polyak and Juditsky 1992). With
the same seed and number of threads a training gives the same weights to the last bit, on a CPU.

What a body's shape is at an actuation vector depends on it smoothly; how it misses that, friction
decides, and much the same way everywhere. So a network over many dimensions can first learn the one
normal distribution of each vector. Its misses, all of them whitened, are one cloud: the mixture
that fits it says how the one is to be split. Components that begin at random take longer, and some
of them find nothing. Few groups are learnt by heart, and say nothing of how to split: where no
check after the split is as good as the best one before, the one distribution stays.
"""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any, Final

import numpy as np
import torch
from numpy.random import Generator
from numpy.typing import NDArray
from torch import Tensor, nn

from daemon.workbench.body_model.training.network import (
    Beginning,
    MixtureDensityNetwork,
    NetworkShape,
    Scaling,
)
from daemon.workbench.body_model.training.reference_mixture import reference_mixture
from safety.risk.model.mixture import FloatArray, IndexArray

_MISSES: Final = 4000
"""By chance, that tell how to split."""
_BEGINNINGS: Final = 4
_THINNEST: Final = 0.1
"""Of a standard deviation of the whole."""
_ALIKE: Final = 0.1
"""Of how much the components' weights would depend on the inputs if they began at random."""


def split_component(
    one: MixtureDensityNetwork, components: int, inputs: Tensor, places: Tensor, seed: int
) -> MixtureDensityNetwork:
    """A network of K components that begins as one of one component, split like its misses.

    inputs (n, m), places (n, s, d): scaled, what it has learnt from. Weights of the new heads are
    those of the old ones; torch's generator is used.
    """
    with torch.inference_mode():
        _, means, upper, _ = one(inputs)
        misses = ((places - means) @ upper[:, 0].transpose(1, 2)).flatten(0, 1)
        usual = upper[:, 0].double().mean(dim=0).cpu().numpy()
    random = np.random.default_rng(seed)
    some = random.permutation(len(misses))[:_MISSES]
    split = reference_mixture(
        misses[some].double().cpu().numpy(), components, seed, _BEGINNINGS, _THINNEST
    )
    shape = replace(one.shape, components=components)
    made = MixtureDensityNetwork(shape, one.scaling, None).to(inputs.device)
    moved = np.linalg.solve(usual, split.means_mm.T).T
    d = usual.shape[0]
    thinner = np.zeros((components, d, d))
    thinner[:, np.arange(d), np.arange(d)] = np.log(
        np.diagonal(split.factors_per_mm, axis1=1, axis2=2)
    )
    rows, columns = np.triu_indices(d)
    for name, added in (("means", moved), ("factors", thinner[:, rows, columns])):
        _repeat(getattr(one, name), getattr(made, name), components, added)
    made.trunk.load_state_dict(one.trunk.state_dict())
    last = made.weights[-1]
    assert isinstance(last, nn.Linear)
    with torch.no_grad():
        last.weight *= _ALIKE
        last.bias.copy_(torch.from_numpy(np.log(split.weights).astype(np.float32)))
    return made


def _repeat(one: nn.ModuleList, several: nn.ModuleList, components: int, added: FloatArray) -> None:
    """A head's layers, the last one K times; added (K, outputs): to its biases."""
    for old, new in zip(one[:-1], several[:-1], strict=True):
        new.load_state_dict(old.state_dict())
    last, made = one[-1], several[-1]
    assert isinstance(last, nn.Linear)
    assert isinstance(made, nn.Linear)
    with torch.no_grad():
        made.weight.copy_(last.weight.repeat(components, 1))
        more = torch.from_numpy(np.ravel(added).astype(np.float32)).to(made.bias.device)
        made.bias.copy_(last.bias.repeat(components) + more)


_LARGEST_GRADIENT: Final = 5.0
_WEIGHT_DECAY: Final = 1e-2
_RISING: Final = 0.1
"""Of the steps, in which the learning rate rises. Then it falls, like a cosine."""
_FEWEST_STEPS: Final = 20
"""In which a learning rate can rise and fall."""
_REMEMBERED: Final = 0.998
"""Of the mean of the weights, from step to step. Less at first: what it began with is no part."""
_SPLIT_RATE: Final = 0.6
"""Of the learning rate, after the split: it is near to where it will be."""
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
    """Of each group, by chance; all, where there are no more."""
    learning_rate: float = 3e-3
    validation_share: float = 0.1
    """Of the groups that are kept back to tell when to stop."""
    check_every: int = 200
    patience: int = 12
    """Stops after so many checks without anything better."""
    seed: int = 1
    alone: float = 0.0
    """Share of the steps in which one component learns by itself, before it is split."""

    def __post_init__(self) -> None:
        if min(self.steps, self.groups, self.samples, self.check_every, self.patience) < 1:
            raise ValueError("steps, groups, samples, checks and patience must be 1 or more")
        if not 0.0 < self.learning_rate < 1.0 or not 0.0 < self.validation_share < 1.0:
            raise ValueError("the learning rate and the share kept back are between 0 and 1")
        if not 0.0 <= self.alone < 1.0:
            raise ValueError("the share of one component alone is 0 or more, and less than 1")


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
    kept_back: IndexArray
    """The groups that told when to stop."""


@dataclass(frozen=True, eq=False)
class _Samples:
    """Scaled, on the device. learning, kept_back: numbers of groups."""

    inputs: Tensor
    places: Tensor
    learning: IndexArray
    kept_back: IndexArray

    @classmethod
    def of(
        cls, u: FloatArray, samples_mm: NDArray[Any], scaling: Scaling, settings: TrainingSettings
    ) -> "_Samples":
        device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        inputs, places = scaling.inputs(u).to(device), scaling.places(samples_mm).to(device)
        return cls(inputs, places, *_split(len(u), settings))

    def some(self, groups: IndexArray, count: int, random: Generator) -> Tensor:
        """(k, count, d) of each of k groups, by chance; all, where there are no more."""
        there = self.places.shape[1]
        if count >= there:
            return self.places[groups]
        which = torch.from_numpy(random.integers(there, size=(len(groups), count)))
        return self.places[torch.from_numpy(groups)[:, None], which]

    def check(self, network: MixtureDensityNetwork, step: int) -> "Check":
        few = self.learning[:: -(-len(self.learning) // len(self.kept_back))]  # as many as kept
        seen = [_mean(network, self.inputs, self.places, part) for part in (few, self.kept_back)]
        return Check(step, *seen)


def train(
    u: FloatArray,
    samples_mm: NDArray[Any],
    shape: NetworkShape,
    scaling: Scaling,
    beginning: Beginning | None,
    settings: TrainingSettings,
    heard: Callable[[Check], None] = lambda _: None,
) -> Trained:
    """Learn what (n, s, d) samples are like at (n, m) u. Raises TrainingError.

    beginning: None: as chance has it. heard: is told of every check.
    """
    samples = _Samples.of(u, samples_mm, scaling, settings)
    alone = round(settings.alone * settings.steps) if shape.components > 1 else 0
    torch.manual_seed(settings.seed)
    device = samples.inputs.device
    if not alone:
        network = MixtureDensityNetwork(shape, scaling, beginning).to(device)
        found = _descent(network, samples, settings, 0, heard)
    else:
        single = replace(shape, components=1)
        one = MixtureDensityNetwork(single, scaling, beginning and beginning.together).to(device)
        first = replace(settings, steps=alone)
        before = _descent(one, samples, first, 0, heard)
        learnt = samples.inputs[samples.learning], samples.places[samples.learning]
        try:
            network = split_component(before.network, shape.components, *learnt, settings.seed)
        except ValueError as error:
            raise TrainingError(str(error)) from None
        rest = replace(
            settings,
            steps=settings.steps - alone,
            learning_rate=_SPLIT_RATE * settings.learning_rate,
        )
        found = _descent(network, samples, rest, alone, heard)
        found.checks[:0] = before.checks
        if before.check.kept_back < found.check.kept_back:
            found = replace(before, checks=found.checks)
    return Trained(
        found.network.arrays(),
        shape.activation,
        tuple(found.checks),
        found.check,
        samples.kept_back,
    )


@dataclass(eq=False)
class _Found:
    """The best network of a descent."""

    network: MixtureDensityNetwork
    check: Check
    checks: list[Check]


def _descent(
    network: MixtureDensityNetwork,
    samples: _Samples,
    settings: TrainingSettings,
    before: int,
    heard: Callable[[Check], None],
) -> _Found:
    """before: steps that were made already. The network is changed."""
    descent = _Descent(network, settings)
    random = np.random.default_rng([settings.seed, before])
    checks: list[Check] = []
    found: _Found | None = None
    since = 0
    for step in range(1, settings.steps + 1):
        learning = samples.learning
        chosen = random.choice(learning, min(settings.groups, len(learning)), replace=False)
        descent.step(samples.inputs[chosen], samples.some(chosen, settings.samples, random))
        if step % settings.check_every and step != settings.steps:
            continue
        check = samples.check(descent.mean, before + step)
        checks.append(check)
        heard(check)
        since += 1
        if isfinite(check.kept_back) and (found is None or check.kept_back < found.check.kept_back):
            found, since = _Found(deepcopy(descent.mean), check, checks), 0
        if since >= settings.patience:
            break
    if found is None:
        raise TrainingError("it diverged: its likelihood was never finite. Lower the learning rate")
    return found


def _split(n: int, settings: TrainingSettings) -> tuple[IndexArray, IndexArray]:
    """Groups to learn from, and such as are kept back."""
    if n < 2:
        raise TrainingError(f"{n} groups of samples: there must be two, one to learn from")
    order = np.random.default_rng(settings.seed).permutation(n)
    kept = min(n - 1, max(1, round(settings.validation_share * n)))
    return np.sort(order[kept:]), np.sort(order[:kept])


class _Descent:
    def __init__(self, network: MixtureDensityNetwork, settings: TrainingSettings) -> None:
        self._network = network
        self.mean = deepcopy(network)
        self._steps = 0
        self._optimizer = torch.optim.AdamW(
            network.parameters(), settings.learning_rate, weight_decay=_WEIGHT_DECAY
        )
        self._schedule = torch.optim.lr_scheduler.OneCycleLR(
            self._optimizer,
            settings.learning_rate,
            total_steps=max(settings.steps + 1, _FEWEST_STEPS),
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
        self._steps += 1
        remembered = min(_REMEMBERED, (1.0 + self._steps) / (10.0 + self._steps))
        with torch.no_grad():
            for mean, now in zip(self.mean.parameters(), self._network.parameters(), strict=True):
                mean.lerp_(now, 1.0 - remembered)


def _mean(
    network: MixtureDensityNetwork, inputs: Tensor, places: Tensor, groups: IndexArray
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
