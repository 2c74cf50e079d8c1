"""One package with everything wrong that a controller of somebody else's may have."""

from pathlib import Path
from typing import Final, NamedTuple

from tests.installed_package import write_package

OWNER: Final = "ten_defects 1.2"

_KINDS: Final = """
from typing import Literal

from config.documents.kinds import Kind, KindOptions


class Bad(KindOptions):
    kind: Literal["bad"]
    defect: str = ""
    gain: float = 1.0


BAD = Kind(Bad, "ten_defects.maker:make")
"""
_OLD: Final = """
from typing import Literal

from config.documents.kinds import Kind, KindOptions


class Old(KindOptions):
    kind: Literal["old"]


OLD = Kind(Old, "ten_defects.maker:make", api=9)
"""
_MAKER: Final = '''
import time

import numpy as np

from daemon.control.controller import Proposal


class Controller:
    """Stands still, and after half a second does what it was told to do wrong."""

    name = "bad"
    ready = True

    def __init__(self, axes, defect):
        self.axes, self.defect, self.asked = axes, defect, 0

    def reset(self, observation):
        pass

    def observe(self, observation):
        pass

    def propose(self, observation):
        self.asked += 1
        good = Proposal(np.zeros(self.axes))
        if self.asked < 20:
            return good
        if self.defect == "wrong shape":
            return Proposal(np.zeros(self.axes - 1))
        if self.defect == "not a number":
            return Proposal(np.full(self.axes, np.nan))
        if self.defect == "no pace":
            return good._replace(pace=float("nan"))
        if self.defect == "runs ahead":
            return good._replace(pace=1.5)
        if self.defect == "expects rubbish":
            return good._replace(expected_mm="much")
        if self.defect == "rubbish":
            return "left"
        if self.defect == "raises":
            raise IndexError("five")
        if self.defect == "ends the process":
            raise SystemExit(3)
        if self.defect == "sleeps a second":
            time.sleep(1.0)
        if self.defect == "is too slow":
            time.sleep(0.02)
        return good

    def learn(self):
        pass

    def save(self, path):
        pass

    def load(self, path):
        pass


def make(options, robot, seed):
    if getattr(options, "defect", "") == "cannot be made":
        raise KeyError("proximal")
    return Controller(len(robot.axes), getattr(options, "defect", ""))
'''


def package(folder: Path) -> Path:
    """As if it were installed there."""
    modules = {
        "kinds": _KINDS,
        "old": _OLD,
        "maker": _MAKER,
        "without": "import nowhere\n",
        "leaving": "import sys\n\nsys.exit(3)\n",
    }
    points = {
        "bad": "ten_defects.kinds:BAD",
        "old": "ten_defects.old:OLD",
        "without": "ten_defects.without:KIND",
        "leaving": "ten_defects.leaving:KIND",
        "nothing": "ten_defects.kinds:NOTHING",
    }
    return write_package(folder, "ten_defects", modules, {"tentacled.controllers": points})


class Defect(NamedTuple):
    """What a file or a client names, and what is then told."""

    controller: dict[str, object]
    told: str
    whose: str = f"the controller 'bad' of {OWNER}"


def bad(defect: str, told: str) -> Defect:
    return Defect({"kind": "bad", "defect": defect}, told)


REFUSED: Final = {
    "cannot be imported": Defect(
        {"kind": "without"}, "No module named 'nowhere'", f"the controller 'without' of {OWNER}"
    ),
    "ends the process as it is imported": Defect(
        {"kind": "leaving"}, "SystemExit: 3", f"the controller 'leaving' of {OWNER}"
    ),
    "is not there": Defect(
        {"kind": "nothing"}, "has no attribute 'NOTHING'", f"the controller 'nothing' of {OWNER}"
    ),
    "another API version": Defect(
        {"kind": "old"}, "is written for API version 9", f"the controller 'old' of {OWNER}"
    ),
    "an option that it does not have": Defect(
        {"kind": "bad", "gian": 2.0}, "unknown key (did you mean 'gain'?)", "controller.gian"
    ),
    "an option of the wrong type": Defect(
        {"kind": "bad", "gain": "much"}, "should be a valid number, not 'much'", "controller.gain"
    ),
    "cannot be made": bad("cannot be made", "cannot be made: KeyError: 'proximal'"),
}
"""Before anything moves."""

HELD: Final = {
    "no pace": bad("no pace", "asked for a pace of nan: it is above 0, and 1 at the most"),
    "runs ahead": bad("runs ahead", "asked for a pace of 1.5: it is above 0, and 1 at the most"),
    "expects rubbish": bad("expects rubbish", "expects an error of 'much': it is None, or mm"),
    "wrong shape": bad("wrong shape", "proposed a step of shape (5,), and there are 6 axes"),
    "not a number": bad("not a number", "proposed what is not a number"),
    "rubbish": bad("rubbish", "proposed no Proposal, but 'left'"),
    "raises": bad("raises", "failed in propose: IndexError: five"),
    "ends the process": bad("ends the process", "SystemExit: 3"),
}
"""While it moves: the robot stands still, energised."""

LATE: Final = {
    "sleeps a second": bad("sleeps a second", "gave no answer within 6 ms"),
    "is too slow": bad("is too slow", "gave no answer within 6 ms"),
}
"""The same, where time is real."""
