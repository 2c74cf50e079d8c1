"""`python -m tests.ctr_conformance NPZ JSON`: our statics of concentric tubes beside solutions that
were found otherwise.

The files are in SI units. JSON: the tubes of each robot, as `sections` (length, curvature), EI, GJ
and mass per length. NPZ: groups of cases with angles `alpha`, places `beta` where the tubes begin,
twisting lengths, `force` at the tip, `gravity`, and the solution: base twists `uz0` and moment
`m0`, `p_tip`, frames, `psi_end`; in some the Jacobian `J_tip` and the `compliance`; and closed
forms under `closed`. Cases begin with the given `uz0` and `m0`, which name one of several branches.

Prints the worst of each group. Exits with 1 where one is above its limit, with 2 where the files
cannot be understood.
"""

import argparse
import json
import sys
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from sim_backends.plants.concentric.statics import Setting, TubeEquilibrium, TubeStatics
from sim_backends.plants.concentric.statics_kernels import FloatArray, TubeSet

_MM: Final = 1e3
_NMM2: Final = 1e6
_TURN_RAD: Final = 1e-4
_PUSH_MM: Final = 0.05
_PUSH_N: Final = 5e-4
_NO_FORCE: Final = np.zeros(3)

LIMITS: Final = {
    "tip_um": 1.0,
    "tip_loaded_um": 20.0,
    "angle_rad": 1e-6,
    "frame": 1e-5,
    "jacobian": 1e-4,
    "compliance": 1e-4,
    "asymmetry": 1e-6,
    "branch": 0.0,
}
"""The largest difference of each kind; relative for the last four. Of a branch: cases in which a
stable one was not found, or an unstable one was."""

Arrays = Mapping[str, FloatArray]
Worst = dict[str, float]


class UnreadableError(ValueError):
    """The files do not say what to compare. The text says where."""


def tubes_of(robot: list[dict[str, Any]], shank_mm: FloatArray, gravity_m_s2: float) -> TubeSet:
    """Tubes in mm and N, with straight pieces before them that reach back to their collars."""
    most = 1 + max(len(tube["sections"]) for tube in robot)
    end_mm, curvature = np.zeros((len(robot), most)), np.zeros((len(robot), most))
    for i, tube in enumerate(robot):
        lengths = [shank_mm[i], *(_MM * length for length, _ in tube["sections"])]
        end_mm[i] = np.cumsum(lengths + [0.0] * (most - len(lengths)))
        curvature[i, 1 : len(lengths)] = [bent / _MM for _, bent in tube["sections"]]
    return TubeSet(
        end_mm,
        curvature,
        np.array([_NMM2 * tube["EI"] for tube in robot]),
        np.array([_NMM2 * tube["GJ"] for tube in robot]),
        np.array([gravity_m_s2 * tube["mass_per_length"] / _MM for tube in robot]),
    )


class Case:
    """One case of a group, set up for our statics."""

    def __init__(self, robot: list[dict[str, Any]], arrays: Arrays, group: str, row: int) -> None:
        self.given = {
            key.removeprefix(f"{group}/"): np.asarray(arrays[key][row])
            for key in arrays
            if key.startswith(f"{group}/")
        }
        begin_mm = _MM * self.given["beta"]
        twist_mm = _MM * self.given["twist_len"]
        self.twisting = bool(twist_mm.any())
        shank_mm = twist_mm + begin_mm if self.twisting else np.zeros(len(robot))
        g = float(np.linalg.norm(self.given["gravity"]))
        down = self.given["gravity"] / g if g else np.array([0.0, 0.0, -1.0])
        tubes = tubes_of(robot, shank_mm, g)
        self.statics = TubeStatics(tubes, down, twisting=self.twisting)
        self.setting = Setting(self.given["alpha"], begin_mm - shank_mm, self.given["force"])
        self.loaded = bool(g or self.given["force"].any())

    def near(self, setting: Setting, base: FloatArray) -> TubeEquilibrium | None:
        return self.statics.near(setting, base, self.statics.no_sliders())

    @property
    def base(self) -> FloatArray:
        """(n+2,) as the reference has it."""
        return np.concatenate([self.given["uz0"] / _MM, _MM * self.given["m0"][:2]])

    def slope(self, found: TubeEquilibrium, ahead: Setting, back: Setting) -> FloatArray:
        """(3,) half the difference of the tip, mm, between two settings."""
        tips = []
        for setting in (ahead, back):
            there = self.near(setting, found.base)
            if there is None:
                return np.full(3, np.nan)
            tips.append(there.march.position_mm[-1])
        return np.asarray(0.5 * (tips[0] - tips[1]))


def rotation(quaternion: FloatArray) -> FloatArray:
    """(3, 3) of a unit quaternion, scalar first."""
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _raise(worst: Worst, kind: str, value: float) -> None:
    worst[kind] = max(worst.get(kind, 0.0), value if np.isfinite(value) else np.inf)


def compare_case(case: Case, worst: Worst) -> None:
    """Raise the worst differences to those of this case."""
    found = case.near(case.setting, case.base)
    _raise(worst, "branch", float(found is None))
    if found is None:
        return
    given, march = case.given, found.march
    off_um = 1e3 * np.abs(march.position_mm[-1] - _MM * given["p_tip"]).max()
    _raise(worst, "tip_loaded_um" if case.loaded else "tip_um", float(off_um))
    _raise(worst, "angle_rad", float(np.abs(march.angle_rad[-1] - given["psi_end"]).max()))
    frame = rotation(march.quaternion[-1])
    _raise(worst, "frame", float(np.abs(frame - given["R_bishop_tip"]).max()))
    _compare_slopes(case, found, worst)


def _compare_slopes(case: Case, found: TubeEquilibrium, worst: Worst) -> None:
    """Jacobian by (alpha2, alpha3, d31), and compliance, by central differences."""
    rotation_rad, collar_mm, tip_n = case.setting
    if "J_tip" in case.given and np.isfinite(case.given["J_tip"]).all():
        columns = []
        for i in (1, 2):
            turn = np.zeros(3)
            turn[i] = _TURN_RAD
            ahead = Setting(rotation_rad + turn, collar_mm, tip_n)
            back = Setting(rotation_rad - turn, collar_mm, tip_n)
            columns.append(case.slope(found, ahead, back) / _TURN_RAD / _MM)
        push = np.array([0.0, 0.0, _PUSH_MM])
        ahead = Setting(rotation_rad, collar_mm + push, tip_n)
        back = Setting(rotation_rad, collar_mm - push, tip_n)
        columns.append(case.slope(found, ahead, back) / _PUSH_MM)
        theirs = case.given["J_tip"]
        off = np.abs(np.array(columns).T - theirs) / np.abs(theirs).max(axis=0)
        _raise(worst, "jacobian", float(off.max()))
    if "compliance" in case.given:
        columns = []
        for push in _PUSH_N * np.eye(3):
            ahead = Setting(rotation_rad, collar_mm, tip_n + push)
            back = Setting(rotation_rad, collar_mm, tip_n - push)
            columns.append(case.slope(found, ahead, back) / _PUSH_N / _MM)
        ours, theirs = np.array(columns).T, case.given["compliance"]
        size = float(np.abs(theirs).max())
        _raise(worst, "compliance", float(np.abs(ours - theirs).max()) / size)
        _raise(worst, "asymmetry", float(np.abs(ours - ours.T).max()) / size)


def _one_tube(arrays: Arrays, worst: Worst) -> None:
    for (bent, length, angle), tip in zip(
        arrays["closed/arc/in"], arrays["closed/arc/p_tip"], strict=True
    ):
        tube = [{"sections": [(length, bent)], "EI": 0.05, "GJ": 0.04, "mass_per_length": 0.0}]
        statics = TubeStatics(tubes_of(tube, np.zeros(1), 0.0), np.array([0.0, 0.0, -1.0]))
        setting = Setting(np.array([angle]), np.zeros(1), _NO_FORCE)
        found = statics.near(setting, np.zeros(3), statics.no_sliders())
        _raise(worst, "branch", float(found is None))
        if found is not None:
            off_um = 1e3 * np.abs(found.march.position_mm[-1] - _MM * tip).max()
            _raise(worst, "tip_um", float(off_um))


def _equal_pair(arrays: Arrays, worst: Worst) -> None:
    """Two equal tubes are a pendulum; the second of three solutions of one of them is unstable."""
    rows = arrays["closed/pair/in"]
    for row, (modulus, at_end, slope) in zip(
        rows, arrays["closed/pair/k_alphaL_dalpha0"], strict=True
    ):
        bent, length, poisson, angle = row
        stiffness = {"EI": 0.05, "GJ": 0.05 / (1.0 + poisson), "mass_per_length": 0.0}
        tubes = tubes_of([{"sections": [(length, bent)], **stiffness}] * 2, np.zeros(2), 0.0)
        statics = TubeStatics(tubes, np.array([0.0, 0.0, -1.0]), interval_mm=5.0)
        twist = 0.5 * slope / _MM
        setting = Setting(np.array([0.0, angle]), np.zeros(2), _NO_FORCE)
        base = np.array([-twist, twist, 0.0, 0.0])
        found = statics.near(setting, base, statics.no_sliders())
        several = (rows == row).all(axis=1).sum() > 1
        unstable = several and abs(modulus) < 0.5
        _raise(worst, "branch", float((found is None) != unstable))
        if found is not None and not unstable:
            angles = found.march.angle_rad[-1]
            _raise(worst, "angle_rad", float(abs(angles[1] - angles[0] - at_end)))


def _no_twist(robot: list[dict[str, Any]], arrays: Arrays, worst: Worst) -> None:
    """Tubes that cannot twist are a chain of arcs."""
    stiff = [{**tube, "GJ": 1e12 * tube["GJ"]} for tube in robot]
    tubes = tubes_of(stiff, np.zeros(3), 0.0)
    statics = TubeStatics(tubes, np.array([0.0, 0.0, -1.0]))
    for (pair, inner, out), given in zip(
        arrays["closed/rigid_torsion/q"], arrays["closed/rigid_torsion/p_tip_tangent"], strict=True
    ):
        collar_mm = np.array([0.0, 0.0, _MM * out - 87.0])
        setting = Setting(np.array([0.0, pair, inner]), collar_mm, _NO_FORCE)
        found = statics.near(setting, np.zeros(5), statics.no_sliders())
        _raise(worst, "branch", float(found is None))
        if found is not None:
            tip = found.march.position_mm[-1]
            _raise(worst, "tip_um", float(1e3 * np.abs(tip - _MM * given[:3]).max()))
            tangent = rotation(found.march.quaternion[-1])[:, 2]
            _raise(worst, "frame", float(np.abs(tangent - given[3:]).max()))


def differences(robots: Mapping[str, Any], arrays: Arrays) -> dict[str, Worst]:
    """The worst differences of every group. Raises UnreadableError."""
    found: dict[str, Worst] = {}
    for group in sorted({key.split("/")[0] for key in arrays} - {"closed"}):
        robot = robots.get(group, robots.get("paper"))
        if robot is None or f"{group}/p_tip" not in arrays:
            raise UnreadableError(f"{group}: neither its robot nor that of the paper is there")
        for row in range(len(arrays[f"{group}/p_tip"])):
            compare_case(Case(robot, arrays, group, row), found.setdefault(group, {}))
    if "closed/arc/in" in arrays:
        _one_tube(arrays, found.setdefault("closed arc", {}))
        _equal_pair(arrays, found.setdefault("closed pair", {}))
        _no_twist(robots["paper"], arrays, found.setdefault("closed no twist", {}))
    return found


def load(npz: Path, description: Path) -> tuple[Mapping[str, Any], Arrays]:
    """The robots and the arrays. Raises UnreadableError."""
    try:
        robots = json.loads(description.read_text())["robots"]
        with np.load(npz) as arrays:
            return robots, {key: arrays[key] for key in arrays.files}
    except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile) as error:
        raise UnreadableError(f"{npz}, {description}: {error}") from error


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="tests.ctr_conformance")
    parser.add_argument("npz", type=Path)
    parser.add_argument("json", type=Path)
    parsed = parser.parse_args(arguments)
    try:
        found = differences(*load(parsed.npz, parsed.json))
    except (UnreadableError, KeyError) as error:
        print(error, file=sys.stderr)
        return 2
    above = False
    for group, worst in found.items():
        for kind, value in worst.items():
            sound = value <= LIMITS[kind]
            above = above or not sound
            print(f"{group:18}{kind:16}{value:10.2e}{'' if sound else '  above its limit'}")
    return int(above)


if __name__ == "__main__":
    sys.exit(main())
