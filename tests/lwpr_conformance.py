"""`python -m tests.lwpr_conformance NPZ JSON`: our regression beside the reference library's.

JSON: for each configuration the parameters that are not the library's defaults, in its own words.
NPZ: the streams `STREAM/X`, `Y`, `Xt`, and under each configuration's name what the library made of
them: `upd_pred` (the prediction that each update returned), `nrf_every250`, `n_pruned`, on `Xt`
`pred`, `conf`, `J_colmajor`, and of output k `rf_ck`, `rf_Dk`, `rf_nRegk`. A configuration learns
the stream that it names with "stream", or else the one that its own name begins with.

Prints the largest relative difference of each configuration. Exits with 1 where one is above 1e-10
or a count differs, with 2 where the files cannot be understood.
"""

import argparse
import json
import re
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from daemon.learning.lwpr.model import FloatArray, Lwpr
from daemon.learning.lwpr.settings import LwprSettings

LARGEST_DIFFERENCE = 1e-10
_COUNTED_EVERY = 250
_NOTHING_KNOWN = 1e19
"""The library's confidence is a number above this where no field is near."""
_ROOT_OF_ROUNDING = 3e-7

Arrays = Mapping[str, FloatArray]
Parameters = dict[str, Any]

_NAMES = {
    "nIn": "inputs",
    "nOut": "outputs",
    "init_D": "init_metric",
    "init_D_diag": "init_metric",
    "norm_in": "norm_in",
    "norm_out": "norm_out",
    "kernel": "kernel",
    "w_gen": "generate_below",
    "w_prune": "prune_above",
    "init_alpha": "init_learning_rate",
    "penalty": "penalty",
    "meta": "meta",
    "meta_rate": "meta_rate",
    "diag_only": "diagonal_only",
    "update_D": "adapt_metric",
    "init_lambda": "forgetting_initial",
    "final_lambda": "forgetting_final",
    "tau_lambda": "forgetting_tau",
    "lambda_init": "forgetting_initial",
    "lambda_final": "forgetting_final",
    "lambda_tau": "forgetting_tau",
    "init_S2": "init_s2",
    "add_threshold": "add_threshold",
    "cutoff": "cutoff",
}
"""The library's words and ours."""

_LIBRARY_DEFAULTS: Parameters = {
    "generate_below": 0.1,
    "prune_above": 1.0,
    "init_learning_rate": 50.0,
    "penalty": 1e-6,
    "meta": False,
    "meta_rate": 250.0,
    "diagonal_only": True,
    "adapt_metric": True,
    "forgetting_initial": 0.999,
    "forgetting_final": 0.99999,
    "forgetting_tau": 0.9999,
    "init_s2": 1e-10,
    "add_threshold": 0.5,
    "kernel": "gaussian",
    "cutoff": 0.001,
}
_DEFAULT_METRIC = 25.0
_SWITCHES = ("meta", "diagonal_only", "adapt_metric")
_KERNELS = {"0": "gaussian", "1": "bisquare", "gaussian": "gaussian", "bisquare": "bisquare"}


class UnreadableError(ValueError):
    """The files do not say what to do. The text says where."""


def settings_of(name: str, parameters: Parameters, inputs: int, outputs: int) -> LwprSettings:
    """A configuration in the library's words, for a stream of so many inputs and outputs."""
    unknown = set(parameters) - set(_NAMES) - {"stream"}
    if unknown:
        raise UnreadableError(
            f"{name}: unknown {', '.join(sorted(unknown))}; known are {', '.join(sorted(_NAMES))}"
        )
    ours = _LIBRARY_DEFAULTS | {"inputs": inputs, "outputs": outputs}
    for theirs, value in parameters.items():
        if theirs == "stream":
            continue
        key = _NAMES[theirs]
        if key in _SWITCHES:
            value = _switch(name, theirs, value)
        elif key == "kernel":
            value = _KERNELS.get(str(value).lower())
        elif key == "init_metric":
            value = np.asarray(value, dtype=np.float64) * np.ones(() if np.ndim(value) else inputs)
        ours[key] = value
    if (ours["inputs"], ours["outputs"]) != (inputs, outputs):
        raise UnreadableError(f"{name}: its stream has {inputs} inputs and {outputs} outputs")
    ours.setdefault("init_metric", [_DEFAULT_METRIC] * inputs)
    try:
        return LwprSettings(**ours, compat=True)
    except (ValueError, TypeError) as error:
        raise UnreadableError(f"{name}: {error}") from error


def differences(name: str, parameters: Parameters, arrays: Arrays) -> dict[str, float]:
    """Largest relative difference by what is compared; infinite where counts differ."""
    stream = _stream(name, parameters, arrays)
    x, y, queries = (arrays[f"{stream}/{part}"] for part in ("X", "Y", "Xt"))
    given = {key.removeprefix(f"{name}/"): arrays[key] for key in arrays if _belongs(key, name)}
    if "upd_pred" not in given:
        raise UnreadableError(f"{name}: {name}/upd_pred is missing")
    model = Lwpr(settings_of(name, parameters, x.shape[1], y.shape[1]))
    ours = _learn(model, x, y, len(given["upd_pred"])) | _ask(model, queries)
    found = {}
    for key, theirs in sorted(given.items()):
        kind = key.rstrip("0123456789") if key.startswith("rf_") else key
        compare = _COMPARISONS.get(kind)
        if compare is None or key not in ours:
            raise UnreadableError(f"{name}: do not know how to compare {key}")
        found[key] = compare(ours[key], np.asarray(theirs, dtype=np.float64))
    return found


def _switch(name: str, key: str, value: object) -> bool:
    if value not in (0, 1):
        raise UnreadableError(f"{name}: {key} is 0 or 1")
    return bool(value)


def _stream(name: str, parameters: Parameters, arrays: Arrays) -> str:
    streams = {key.removesuffix("/X") for key in arrays if key.endswith("/X")}
    named = parameters.get("stream")
    fitting = [s for s in streams if s == named] if named else _beginnings(name, streams)
    if not fitting:
        raise UnreadableError(
            f"{name}: of the streams {', '.join(sorted(streams))} none is its own"
        )
    return max(fitting, key=len)


def _beginnings(name: str, streams: set[str]) -> list[str]:
    return [stream for stream in streams if re.match(rf"{re.escape(stream)}(_|$)", name)]


def _belongs(key: str, name: str) -> bool:
    return key.startswith(f"{name}/") and not key.endswith(("/X", "/Y", "/Xt"))


def _learn(model: Lwpr, x: FloatArray, y: FloatArray, count: int) -> dict[str, FloatArray]:
    """As many samples of the stream as there are predictions; from its start again at its end."""
    predicted, counts = np.empty((count, y.shape[1])), []
    for i in range(count):
        predicted[i] = model.update(x[i % len(x)], y[i % len(x)])
        if (i + 1) % _COUNTED_EVERY == 0:
            counts.append(model.counts)
    return {
        "upd_pred": predicted,
        "nrf_every250": np.array(counts, dtype=np.float64).reshape(-1, y.shape[1]),
        "n_pruned": np.array(model.pruned, dtype=np.float64),
    }


def _ask(model: Lwpr, queries: FloatArray) -> dict[str, FloatArray]:
    jacobians = np.array([model.jacobian(query) for query in queries])
    answers = {
        "pred": np.array([model.predict(query) for query in queries]),
        "conf": np.array([model.confidence(query) for query in queries]),
        "J_colmajor": jacobians.transpose(0, 2, 1).reshape(len(queries), -1),
    }
    for k, (centres, metrics, ranks) in enumerate(model.fields_by_output()):
        answers |= {f"rf_c{k}": centres, f"rf_D{k}": metrics, f"rf_nReg{k}": ranks}
    return answers


def _of_outputs(ours: FloatArray, theirs: FloatArray) -> float:
    """(rows, outputs): relative to the largest of each output."""
    return _relative(ours, theirs, axis=0)


def _of_jacobian(ours: FloatArray, theirs: FloatArray) -> float:
    return _relative(ours, theirs, axis=None)


def _of_confidence(ours: FloatArray, theirs: FloatArray) -> float:
    """Where nothing is known both must say so; how large the number is then means nothing.

    The library takes the root of a difference of squares. Where a single field without errors
    speaks that is the root of what rounding left, and both must be as small as that.
    """
    if ours.shape != theirs.shape or ((ours > _NOTHING_KNOWN) != (theirs > _NOTHING_KNOWN)).any():
        return np.inf
    said = theirs <= _NOTHING_KNOWN
    largest = np.where(said, theirs, 0.0).max(initial=0.0)
    said &= (ours > _ROOT_OF_ROUNDING * largest) | (theirs > _ROOT_OF_ROUNDING * largest)
    return _relative(np.where(said, ours, 0.0), np.where(said, theirs, 0.0), axis=0)


def _of_fields(ours: FloatArray, theirs: FloatArray) -> float:
    """(fields, …): relative to the largest of each field."""
    return _relative(ours, theirs, axis=tuple(range(1, theirs.ndim)))


def _of_counts(ours: FloatArray, theirs: FloatArray) -> float:
    return 0.0 if np.array_equal(ours, theirs) else np.inf


def _relative(ours: FloatArray, theirs: FloatArray, axis: int | tuple[int, ...] | None) -> float:
    if ours.shape != theirs.shape or not np.isfinite(ours).all():
        return np.inf
    if not theirs.size:
        return 0.0
    scale = np.abs(theirs).max(axis=axis, keepdims=True)
    return float(np.max(np.abs(ours - theirs) / np.where(scale > 0.0, scale, 1.0)))


_COMPARISONS: dict[str, Callable[[FloatArray, FloatArray], float]] = {
    "upd_pred": _of_outputs,
    "nrf_every250": _of_counts,
    "n_pruned": _of_counts,
    "pred": _of_outputs,
    "conf": _of_confidence,
    "J_colmajor": _of_jacobian,
    "rf_c": _of_fields,
    "rf_D": _of_fields,
    "rf_nReg": _of_counts,
}


def load(npz: Path, configurations: Path) -> tuple[dict[str, FloatArray], dict[str, Parameters]]:
    """Both files. Raises UnreadableError."""
    try:
        with np.load(npz) as file:
            arrays: dict[str, NDArray[np.float64]] = dict(file)
        parameters = json.loads(configurations.read_text())
    except (OSError, ValueError) as error:
        raise UnreadableError(str(error)) from error
    if not isinstance(parameters, dict) or not all(
        isinstance(each, dict) for each in parameters.values()
    ):
        raise UnreadableError(f"{configurations}: one object of parameters per configuration")
    return arrays, parameters


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("npz", type=Path, help="streams and the library's figures")
    parser.add_argument("json", type=Path, help="parameters of each configuration")
    options = parser.parse_args(arguments)
    worst = 0.0
    try:
        arrays, configurations = load(options.npz, options.json)
        for name, parameters in configurations.items():
            found = differences(name, parameters, arrays)
            largest = max(found.values())
            parts = ", ".join(f"{key} {value:.1e}" for key, value in found.items())
            print(f"{name}: {largest:.1e} ({parts})", flush=True)
            worst = max(worst, largest)
    except UnreadableError as error:
        print(error, file=sys.stderr)
        return 2
    print(f"largest relative difference: {worst:.1e}")
    return 0 if worst <= LARGEST_DIFFERENCE else 1


if __name__ == "__main__":
    sys.exit(main())
