"""Random designs of soft arms whose bodies are as hard as real ones: all are followed.

`python -m tests.experiments.led_hard_designs`. Every case is an arm, a path and a controller of
`led_designs`; but the body is late by as much as a second, dead for as much as a quarter of one,
rubs, creeps and has uneven chambers. It carries a load from the beginning, and another one is hung
on, or taken off, on the way. Verdicts are those of `led_bodies`.
"""

import sys
from typing import Any, Final

import numpy as np

from tests.experiments import led_designs
from tests.experiments.led_bodies import carry_out_all

_LOAD_G: Final = 30.0
_MOST_TIMES: Final = 1.5
"""So much of that load an arm carries at most, however stiff and short it is."""


def case_of(number: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """A robot file's content, and what the experiment's file is changed by. The same number gives
    the same case."""
    robot, case = led_designs.case_of(100 + number)
    random = np.random.default_rng([number, 777])
    uniform = random.uniform
    plant = robot["emulation"]["plant"]
    hard = {
        "pneumatic_lag_s": float(np.exp(uniform(*np.log([0.15, 1.0])))),
        "dead_time_s": float(uniform(0.0, 0.25)),
        "hysteresis": float(uniform(0.1, 0.5)),
        "creep": float(uniform(0.05, 0.3)),
        "chamber_area_ratios": uniform(0.8, 1.2, len(robot["axes"])).tolist(),
        "backlash_mm": float(uniform(0.0, 0.15)),
    }
    length_mm = sum(one["length_mm"] for one in plant["segments"])
    stiffer = plant["bending_stiffness_n_mm2"] / led_designs.BENDING_N_MM2
    most_g = _LOAD_G * min(_MOST_TIMES, stiffer * (led_designs.SHIPPED_MM / length_mm) ** 2)
    before_g, after_g = (most_g * random.choice([0.0, 0.5, 1.0], 2)).tolist()
    return robot, case | {
        "plant": hard,
        "tip_load_g": before_g,
        "happenings": [{"at_s": float(uniform(6.0, 10.0)), "tip_load_g": after_g}],
    }


def carried_out(number: int) -> dict[str, Any]:
    """One line for the file."""
    robot, case = case_of(number)
    how_late = {
        "lag_s": round(case["plant"]["pneumatic_lag_s"], 2),
        "dead_s": round(case["plant"]["dead_time_s"], 2),
        "loads_g": [round(case["tip_load_g"], 1), round(case["happenings"][0]["tip_load_g"], 1)],
    }
    return led_designs.line_of(number, robot, case, how_late)


def main() -> int:
    """Prints one JSON."""
    return carry_out_all(carried_out, __doc__ or "", 60)


if __name__ == "__main__":
    sys.exit(main())
