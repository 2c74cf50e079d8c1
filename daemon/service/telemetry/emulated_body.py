"""The truth of an emulated lab, which a rig never has: asked for beside the loop."""

from collections.abc import Mapping
from math import isfinite
from pathlib import Path
from threading import Event, Thread
from typing import Any, Final

from daemon.messages import Body
from daemon.robot.lab_connections import LabRefusedError, LabUnreachableError, ask
from daemon.service.telemetry.body_teller import spread

_ASKS_EACH_S: Final = 0.1


class LabBody:
    """Asks a lab's control socket ten times a second, in a thread that nobody waits for."""

    def __init__(self, directory: Path) -> None:
        """directory: where the lab has its ports."""
        self._directory = directory
        self._ended = Event()
        self._newest: Body | None = None
        self._failing = ""

    def start(self) -> None:
        Thread(target=self._listen, name="emulated body", daemon=True).start()

    def end(self) -> None:
        self._ended.set()

    def newest(self) -> Body | None:
        """What the lab has told last; None: it tells nothing at the moment."""
        return self._newest

    def failing(self) -> str:
        """What the package that the body comes from does wrong; empty: nothing, or nobody tells."""
        return self._failing

    def _listen(self) -> None:
        while not self._ended.wait(_ASKS_EACH_S):
            try:
                told = ask(self._directory, {"do": "state"})
                self._newest, self._failing = told_body(told), str(told.get("failing", ""))
            except (LabUnreachableError, LabRefusedError, ValueError):
                self._newest, self._failing = None, ""


def told_body(told: Mapping[str, Any]) -> Body | None:
    """The body in what a lab tells of its state; None where there is none, or no numbers."""
    points, radius = told.get("centreline_mm"), told.get("body_radius_mm")
    if not isinstance(points, list) or len(points) < 2 or not isinstance(radius, int | float):
        return None
    kept = [points[place] for place in spread(len(points))]
    if not isfinite(radius) or not all(_is_place(point) for point in kept):
        return None
    return Body(
        t_ns=int(told.get("t_ns", 0)),
        source="emulated truth",
        centreline_mm=kept,
        radius_mm=[float(radius)] * len(kept),
        stability=_number(told.get("stability")),
        snaps=None if (snaps := _number(told.get("snaps"))) is None else int(snaps),
    )


def _number(told: object) -> float | None:
    return float(told) if isinstance(told, int | float) and isfinite(told) else None


def _is_place(point: object) -> bool:
    return (
        isinstance(point, list)
        and len(point) == 3
        and all(isinstance(part, int | float) and isfinite(part) for part in point)
    )
