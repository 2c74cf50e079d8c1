"""`python -m tests.experiments.scripted_reaches OUT.csv`: a tip's path as by teleoperation.

No hand made it. A scripted one reaches from place to place as hands do (least jerk, Flash and
Hogan 1985, bowed aside, with pauses and a tremor) within what the shipped soft arm reaches.
"""

import argparse
from pathlib import Path
from typing import Final

import numpy as np

from drivers.pose import Vector

SEED: Final = 20160
_DT_S: Final = 0.1
_CENTER_MM: Final = (0.0, 0.0, 185.0)
_REACH_MM: Final = (35.0, 35.0, 4.0)
_PEAK_MM_S: Final = 25.0
_PAUSE_S: Final = (0.3, 1.0)
_TREMOR_MM, _TREMOR_HZ = 0.1, 3.0
_BOW: Final = 0.15
"""How far a reach bends aside, as a share of its length."""
_PEAK_OF_LEAST_JERK: Final = 1.875
"""Its highest speed over its mean one."""


def scripted_path(seed: int = SEED, lasts_s: float = 40.0) -> Vector:
    """(n, 4) t, x, y, z."""
    random = np.random.default_rng(seed)
    here = np.array(_CENTER_MM)
    points = [here]
    while len(points) * _DT_S <= lasts_s:
        there = np.array(_CENTER_MM) + random.uniform(-1.0, 1.0, 3) * _REACH_MM
        way = there - here
        length_mm = float(np.linalg.norm(way))
        steps = max(round(_PEAK_OF_LEAST_JERK * length_mm / _PEAK_MM_S / _DT_S), 3)
        share = np.arange(1, steps + 1)[:, None] / steps
        moved = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        aside = np.array([-way[1], way[0], 0.0]) * _BOW * random.choice([-1.0, 1.0])
        points += list(here + moved * way + np.sin(np.pi * moved) * aside)
        points += [there] * round(random.uniform(*_PAUSE_S) / _DT_S)
        here = there
    path = np.array(points[: round(lasts_s / _DT_S) + 1])
    t_s = _DT_S * np.arange(len(path))
    phases = random.uniform(0.0, 2.0 * np.pi, 3)
    tremor = _TREMOR_MM * np.sin(2.0 * np.pi * _TREMOR_HZ * t_s[:, None] + phases)
    return np.column_stack([t_s, path + tremor])


def main() -> None:
    """Writes the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=SEED)
    given = parser.parse_args()
    lines = [
        "# Made by a scripted hand, not recorded from a person:",
        f"# python -m tests.experiments.scripted_reaches {given.out.name} --seed {given.seed}",
        "t, x, y, z",
    ]
    rows = scripted_path(given.seed)
    lines += [f"{t:.1f}, " + ", ".join(f"{value:.3f}" for value in at) for t, *at in rows]
    given.out.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
