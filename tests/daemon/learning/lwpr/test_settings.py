"""The settings of a regression: one place where what is impossible is refused."""

import json
from typing import Any

import numpy as np
import pytest

from daemon.learning.lwpr.settings import LwprSettings


def test_arrays_and_lists_become_tuples_so_that_settings_compare() -> None:
    one = LwprSettings(2, 1, np.array([1.0, 2.0]), norm_in=[1, 2], localisation=range(2))  # type: ignore[arg-type]
    other = LwprSettings(2, 1, (1.0, 2.0), norm_in=(1.0, 2.0), localisation=(0, 1))
    assert one == other
    assert hash(one) == hash(other)


def test_settings_survive_json() -> None:
    settings = LwprSettings(
        3,
        2,
        ((2.0, 0.5), (0.5, 1.0)),
        localisation=(2, 0),
        regression=(1,),
        periods=(None, 6.28, None),
        diagonal_only=False,
    )
    assert LwprSettings.from_dict(json.loads(json.dumps(settings.to_dict()))) == settings


def test_a_setting_that_nobody_knows_is_named() -> None:
    with pytest.raises(ValueError, match="w_gen"):
        LwprSettings.from_dict({"inputs": 1, "outputs": 1, "init_metric": [1.0], "w_gen": 0.1})


@pytest.mark.parametrize(
    ("wrong", "place"),
    [
        ({"inputs": 0}, "input"),
        ({"init_metric": (1.0,)}, "init_metric"),
        ({"init_metric": (1.0, -1.0)}, "init_metric"),
        ({"init_metric": (1.0, float("nan"))}, "init_metric"),
        ({"init_metric": ((1.0, 0.5), (0.5, 1.0))}, "diagonal_only"),
        ({"init_metric": ((1.0, 0.5), (0.4, 1.0)), "diagonal_only": False}, "init_metric"),
        ({"init_metric": ((1.0, 2.0), (2.0, 1.0)), "diagonal_only": False}, "init_metric"),
        ({"norm_in": (1.0, 0.0)}, "norm_in"),
        ({"norm_in": (1.0,)}, "norm_in"),
        ({"norm_out": (float("inf"),)}, "norm_out"),
        ({"localisation": ()}, "localisation"),
        ({"localisation": (0, 0)}, "localisation"),
        ({"regression": (2,)}, "regression"),
        ({"periods": (1.0,)}, "periods"),
        ({"periods": (1.0, -1.0)}, "periods"),
        ({"kernel": "box"}, "kernel"),
        ({"forgetting_final": 1.01}, "forgetting_final"),
        ({"forgetting_initial": 0.0}, "forgetting_initial"),
        ({"init_s2": 0.0}, "init_s2"),
        ({"init_learning_rate": float("nan")}, "init_learning_rate"),
        ({"generate_below": -0.1}, "generate_below"),
    ],
)
def test_what_cannot_be_is_refused_by_name(wrong: dict[str, Any], place: str) -> None:
    right: dict[str, Any] = {"inputs": 2, "outputs": 1, "init_metric": (1.0, 1.0)}
    with pytest.raises(ValueError, match=place):
        LwprSettings(**(right | wrong))
