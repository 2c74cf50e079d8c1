"""With `compat` the regression does what the authors' library does, to the last bits but a few."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.lwpr_conformance import differences, load, main

DATA = Path(__file__).parent / "data"
NPZ, JSON = DATA / "lwpr_conformance.npz", DATA / "lwpr_conformance.json"


@pytest.mark.parametrize("name", json.loads(JSON.read_text()))
def test_every_figure_of_the_library_is_met(name: str) -> None:
    arrays, configurations = load(NPZ, JSON)
    found = differences(name, configurations[name], arrays)
    assert {"upd_pred", "nrf_every250", "n_pruned", "pred", "conf", "J_colmajor"} <= set(found)
    assert max(found.values()) <= 1e-10, found


def _few(folder: Path, changed: dict[str, Any], **parameters: object) -> list[str]:
    """The files of one configuration of two hundred samples, with other figures or parameters."""
    arrays, configurations = load(NPZ, JSON)
    name = "cross_diag"
    some = {f"cross/{key}": arrays[f"cross/{key}"] for key in ("X", "Y", "Xt")}
    some |= {f"{name}/upd_pred": arrays[f"{name}/upd_pred"][:200]}
    some |= {f"{name}/nrf_every250": np.zeros((0, 1)), f"{name}/n_pruned": np.zeros(1)}
    np.savez(folder / "some.npz", **(some | changed))
    (folder / "some.json").write_text(json.dumps({name: configurations[name] | parameters}))
    return [str(folder / "some.npz"), str(folder / "some.json")]


def test_the_command_says_how_far_apart_they_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(_few(tmp_path, {})) == 0
    assert "cross_diag: " in capsys.readouterr().out


def test_one_prediction_that_is_off_fails_the_command(tmp_path: Path) -> None:
    arrays, _ = load(NPZ, JSON)
    predictions = arrays["cross_diag/upd_pred"][:200].copy()
    predictions[150] += 1e-9
    assert main(_few(tmp_path, {"cross_diag/upd_pred": predictions})) == 1


def test_one_field_too_many_fails_the_command(tmp_path: Path) -> None:
    assert main(_few(tmp_path, {"cross_diag/n_pruned": np.ones(1)})) == 1


@pytest.mark.parametrize(
    "other",
    [
        {"kernel": 1},
        {"kernel": "BiSquare"},
        {"w_gen": 0.3},
        {"w_prune": 0.5},
        {"init_lambda": 0.99},
        {"init_D": [[30.0, 5.0], [5.0, 30.0]], "diag_only": 0},
        {"init_S2": 1e-3},
    ],
)
def test_parameters_have_their_effect(tmp_path: Path, other: dict[str, object]) -> None:
    assert main(_few(tmp_path, {}, **other)) == 1


@pytest.mark.parametrize(
    "same",
    [
        {"init_lambda": 0.999, "final_lambda": 0.99999, "tau_lambda": 0.9999},
        {"init_S2": 1e-10, "add_threshold": 0.5, "penalty": 1e-6, "kernel": "Gaussian"},
        {"meta": 0, "meta_rate": 100.0, "w_prune": 1.0, "diag_only": 1, "update_D": 1},
        {"stream": "cross"},
    ],
)
def test_the_librarys_defaults_are_what_is_not_given(
    tmp_path: Path, same: dict[str, object]
) -> None:
    assert main(_few(tmp_path, {}, **same)) == 0


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"w_generate": 0.1}, "w_generate"),
        ({"kernel": "box"}, "kernel"),
        ({"update_D": 2}, "update_D"),
        ({"nIn": 3}, "2 inputs"),
        ({"stream": "kin12"}, "stream"),
        ({"norm_in": [0.0, 1.0]}, "norm_in"),
    ],
)
def test_what_it_does_not_understand_is_said_and_not_guessed(
    tmp_path: Path, wrong: dict[str, object], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(_few(tmp_path, {}, **wrong)) == 2
    assert said in capsys.readouterr().err


def test_figures_that_cannot_be_compared_are_not_passed_over(tmp_path: Path) -> None:
    assert main(_few(tmp_path, {"cross_diag/entropy": np.zeros(3)})) == 2


def test_a_missing_file_is_said(tmp_path: Path) -> None:
    assert main([str(tmp_path / "none.npz"), str(JSON)]) == 2
