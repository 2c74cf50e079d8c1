"""Splits the one component of a trained network into several.

What a body's shape is at an actuation vector depends on it smoothly; how it misses that, friction
decides, and much the same way everywhere. So a network first learns the one normal distribution of
each vector. Its misses, all of them whitened, are one cloud: the mixture that fits it says how the
one is to be split. Components that begin at random take longer, and some of them find nothing.
"""

from dataclasses import replace
from typing import Final

import numpy as np
import torch
from torch import Tensor, nn

from daemon.workbench.body_model.training.network import MixtureDensityNetwork
from daemon.workbench.body_model.training.reference_mixture import reference_mixture
from safety.risk.model.mixture import FloatArray

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
