"""The risk of collision as the gate asks for it, from the files that a robot file names."""

import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from config.control import RiskSettings, Surface
from config.loader import RobotFile
from config.paths import BUILTIN, named_model, risk_paths
from daemon.risk.mesh_file import binary_stl
from daemon.risk.model_file import ModelFile, read_model
from daemon.risk.path_ahead import PathAhead
from daemon.risk.surroundings import (
    BodySize,
    RiskSurroundings,
    check_way_in,
    read_surroundings,
)
from drivers.clock import WallClock
from safety.risk.body_risk import Beside, BodyRisk
from safety.risk.contact_figures import MinuteBehind, WorstPlace
from safety.risk.model.mixture import FloatArray
from safety.risk.model.risk_model import RiskModelError
from safety.risk.moving_obstacles import NOTHING_MOVES, Swept
from safety.risk.seen_tip import SeenTip, TipConditioning
from safety.risk.surroundings.distance_grid import DistanceGrid
from safety.risk.surroundings.environment import Environment, EnvironmentFaultError
from safety.risk.tip_consistency import TipConsistency, TipModel
from safety.risk_source import (
    Clearance,
    KnownBody,
    Nearest,
    NoModel,
    RiskReading,
    RiskSource,
    TipComparison,
)

_log = logging.getLogger(__name__)

_GROWS: Final = 1.5
"""While the tip speaks against the model, the body is taken to be off by so much more than it is
seen to be: what makes it so goes on as the body moves on. An arm of silicone that sinks under 14 g
is off by 8 mm a second before the alarm, and by 13 mm when it comes."""
_SAME_LOAD_G: Final = 1.0
"""Silicone sinks by 0.6 mm under it (8 to 13 mm under 14 g): less than models are off."""
_SEEN_FOR_NS: Final = 150_000_000
"""So long the risk is told given a tip: what keeps the robot moving without one, by default."""
_DAY_NS: Final = 86_400_000_000_000
_NOT_AS_MODELLED: Final = (
    "the tip is not where the model of the body has it: look for what the body touches; take off "
    "what hangs at the tip, or train a model with it and declare it as risk.tip_load_g"
)
_MOVED: Final = "where the moving obstacles are is no longer known: their stream has stopped"
_FOR_EVER_NS: Final = 1 << 63
_TOO_OLD: Final = "the model is older than risk.oldest_days: see the body anew, and train another"


class RiskFilesError(Exception):
    """The risk cannot be told with these files: names the file, and what to do."""

    def __init__(self, text: str, *keys: str) -> None:
        """keys: below `risk` in the robot file, to what is wrong."""
        super().__init__(text)
        self.keys = keys


class RiskIdentity(NamedTuple):
    """Which body in which surroundings it is: digests, in hexadecimal digits."""

    model_sha256: str
    surroundings_sha256: str


@dataclass(frozen=True, slots=True, eq=False)
class RiskFiles:
    """What a robot file names for its risk, read."""

    model: ModelFile
    surroundings: RiskSurroundings

    @property
    def environment(self) -> Environment:
        """The meshes."""
        return self.surroundings.environment

    @property
    def grid(self) -> DistanceGrid:
        """Of meshes and regions."""
        return self.surroundings.grid

    @property
    def identity(self) -> RiskIdentity:
        """What a path has to be planned with, to be gone here."""
        return RiskIdentity(self.model.sha256, self.surroundings.sha256)


class BodyRiskSource:
    """A `RiskSource`: says how long it took, which pure mathematics cannot."""

    def __init__(
        self,
        risk: BodyRisk,
        files: RiskFiles,
        model_name: str,
        clock: WallClock,
        until_ns: int | None = None,
        tip: TipModel | None = None,
    ) -> None:
        """files: what `risk` was made from.

        until_ns: date from which on the model is too old to be believed; None: never.

        tip: where measured tips are compared with; None: nothing is compared.
        """
        self.files = files
        self._model_name = model_name
        self._name = f"{model_name}, {files.surroundings.name}"
        self._shift: FloatArray | None = None
        self._swept, self._moving_until_ns = NOTHING_MOVES, _FOR_EVER_NS
        self._tip = tip
        self._consistency = TipConsistency()
        self._risk = risk
        self._clock = clock
        self._until_ns = until_ns
        self._beside: Beside | None = None
        self._minute = MinuteBehind(risk.samples)
        self._touching: NDArray[np.bool_] | None = None
        """On the way that was asked about last; None: it is not known who does."""
        self._seen_ns: int | None = None
        """When the tip was last compared with the model; None: its last word is not to be used."""

    @property
    def name(self) -> str:
        return self._name

    def among(self, around: RiskSurroundings) -> BodyRisk:
        """The same body among other surroundings, for `surround`; whatever answers meanwhile is
        not touched. Raises ValueError where the grid is not made for so thick a body."""
        return self._risk.among(around.environment, around.grid)

    def surround(self, around: RiskSurroundings, risk: BodyRisk) -> None:
        """Ask among other surroundings from now on: between two control steps. risk: what `among`
        has made of them."""
        risk.see_as(self._risk.sight)
        risk.take_moving(self._swept)
        self._risk, self._beside = risk, None  # until the next frame
        self.files = RiskFiles(self.files.model, around)
        self._name = f"{self._model_name}, {around.name}"

    def take_moving(self, swept: Swept, until_ns: int | None) -> None:
        """Count with what moves. until_ns: on the monotonic clock; afterwards nothing is known.
        None: nothing moves."""
        self._swept = swept
        self._moving_until_ns = _FOR_EVER_NS if until_ns is None else until_ns
        self._risk.take_moving(swept)

    @property
    def body_risk(self) -> BodyRisk:
        """Whom it asks."""
        return self._risk

    def assess(
        self, u_from: Sequence[float], u_to: Sequence[float], t_ns: int
    ) -> RiskReading | None:
        self._touching = None
        if t_ns > self._moving_until_ns:
            return RiskReading(1.0, None, 0.0, self.name, doubt=_MOVED)
        began_ns = self._clock.now_ns()
        if self._seen_ns is not None and not abs(t_ns - self._seen_ns) <= _SEEN_FOR_NS:
            self._forget_tip()
        if self._until_ns is not None and self._clock.wall_time_ns() >= self._until_ns:
            return RiskReading(1.0, None, 0.0, self.name, doubt=_TOO_OLD)
        if not self._consistency.consistent:
            return RiskReading(1.0, None, 0.0, self.name, doubt=_NOT_AS_MODELLED)
        try:
            assessed = self._risk.of_way(u_from, u_to)
        except Exception:  # the gate takes it for the maximum, and has only its words
            _log.exception("the model of the risk has failed")
            raise
        took_s = (self._clock.now_ns() - began_ns) * 1e-9
        self._touching = None if isinstance(assessed, str) else assessed.touching
        if isinstance(assessed, str):
            return RiskReading(1.0, None, took_s, self.name, doubt=assessed)
        nearest = _nearest(assessed.contact.worst, self._beside)
        return RiskReading(
            assessed.contact.upper_limit,
            None if self._beside is None else self._beside.body_point_risk,
            took_s,
            self.name,
            _words(nearest),
            nearest,
            leaving=assessed.leaving,
            answers=assessed.answers,
        )

    def compare(
        self,
        lately: Sequence[Sequence[float]],
        tip_mm: Sequence[float],
        t_ns: int,
        direction: Sequence[float] | None = None,
    ) -> TipComparison | None:
        """As `TipComparing` has it."""
        if self._tip is None:
            return None
        tip = np.asarray(tip_mm, np.float64)
        place = self._tip.place([np.asarray(u, np.float64) for u in lately], tip)
        if place is None:
            self._forget_tip()
            return None
        fits = self._consistency.add(place.probability, t_ns)
        statistic = self._consistency.statistic
        self._shift = place.shift if statistic <= 0.0 else _GROWS * place.shift
        self._risk.take_as_shifted(self._shift)
        along = None if direction is None else np.asarray(direction, np.float64)
        self._risk.see(place.mixture, tip, along, agrees=statistic <= 0.0)
        self._seen_ns = t_ns
        doubt = "" if fits else _NOT_AS_MODELLED
        return TipComparison(statistic, place.probability, place.off_mm, doubt)

    def went(self, t_ns: int) -> None:
        """As `WayCounting` has it."""
        touching = np.ones(self._risk.samples, np.bool_)
        self._minute.add(touching if self._touching is None else self._touching, t_ns)

    def minute_risk(self, t_ns: int) -> float:
        """As `WayCounting` has it."""
        return self._minute.risk(t_ns)

    def path_ahead(self, t_s: Sequence[float], u: Sequence[Sequence[float]]) -> PathAhead:
        """Of a path among the present surroundings, and nothing that moves; not looked at yet."""
        around = self.files
        return PathAhead(self._risk.among(around.environment, around.grid), t_s, u)

    def seen_tip(self, t_ns: int) -> SeenTip | None:
        """The tip that the risk is told given; None: there is none, it is too old, or the model has
        something against it."""
        tip = self._risk.sight.tip
        fresh = self._seen_ns is not None and abs(t_ns - self._seen_ns) <= _SEEN_FOR_NS
        return tip if fresh and tip is not None and tip.agrees else None

    def _forget_tip(self) -> None:
        self._seen_ns = None
        self._risk.forget_tip()

    def body(self, u: Sequence[float]) -> KnownBody | None:
        """As `BodyKnowing` has it."""
        return self._risk.body(u)

    def warm_up(self) -> None:
        """Have all compiled that answers may need."""
        self._risk.warm_up()

    def clearance(self, u: Sequence[float], risk: float) -> Clearance | None:
        """What is told beside the risk is of this place from now on: no step has to wait for it."""
        self._beside = self._risk.beside(u)
        return self._risk.clearance(u, risk)


def files_of(risk: RiskSource) -> RiskFiles | None:
    """What it asks with; None: it knows no body."""
    return risk.files if isinstance(risk, BodyRiskSource) else None


def surroundings_stl(risk: RiskSource) -> bytes:
    """What it asks with, as a binary STL file in mm; empty: it knows no surroundings."""
    files = files_of(risk)
    return b"" if files is None else binary_stl(files.surroundings.mesh)


def identity_of(risk: RiskSource) -> RiskIdentity | None:
    """Of what it asks with; None: it knows no body."""
    files = files_of(risk)
    return None if files is None else files.identity


def make_risk_source(
    file: RobotFile, clock: WallClock, tip_loads_g: Iterable[float] | None = None
) -> RiskSource:
    """What the gate of this robot asks. Takes seconds where the grid has to be made first.

    tip_loads_g: what will hang at the tip; None: what the robot file says. Raises RiskFilesError.
    """
    settings, paths = file.robot.risk, risk_paths(file.robot, file.path)
    if settings.surface is None or paths is None:
        return NoModel()
    files = read_risk_files(file, tip_loads_g)
    read = files.model
    try:
        check_way_in(files.surroundings, BodySize.of(read.model))
    except EnvironmentFaultError as error:
        raise RiskFilesError(str(error), "surface") from None
    given = None
    if settings.given_tip:
        accuracies = settings.tip_accuracy_mm, settings.tip_accuracy_rad
        given = TipConditioning(read.model.basis, *accuracies)
    try:
        risk = BodyRisk(read.model, files.environment, files.grid, settings.samples, given=given)
    except ValueError as error:
        raise RiskFilesError(str(error)) from None
    model_path = paths[0]
    until_ns = _believed_until_ns(read, settings, model_path)
    tip = TipModel(read.model, settings.tip_accuracy_mm)
    source = BodyRiskSource(risk, files, model_path.name, clock, until_ns, tip)
    _compile(source, tip, read.model.known[0])
    return source


def _what_is_not_named(file: RobotFile, model: Path | None, surface: Surface | None) -> str:
    """And where it comes from."""
    shipped, missing = f"{BUILTIN}{file.robot.robot}.npz", []
    if model is None:
        made = "`tentacled mdn train` makes one"
        known = f"{shipped} is shipped" if named_model(shipped).exists() else made
        missing.append(f"a model of the body (risk.model: {known})")
    if surface is None:
        missing.append("what is round the body (risk.surface: a mesh, regions, or both)")
    return f"{file.path} does not say what the risk is told with: {' and '.join(missing)}"


def read_risk_files(
    file: RobotFile,
    tip_loads_g: Iterable[float] | None = None,
    surface: Surface | None = None,
    model: Path | None = None,
) -> RiskFiles:
    """What the risk of this robot is told with.

    surface: other surroundings than the robot file's. model: another model. Raises RiskFilesError.
    """
    settings, paths = file.robot.risk, risk_paths(file.robot, file.path)
    model_path = model or (None if paths is None else paths[0])
    surface = surface or settings.surface
    if model_path is None or surface is None:
        raise RiskFilesError(_what_is_not_named(file, model_path, surface))
    try:
        read = read_model(model_path)
    except RiskModelError as error:
        text = f"{error}. Train it anew with `tentacled mdn train`"
        raise RiskFilesError(text, "model") from None
    if misfit := read.misfit(file.robot):
        raise RiskFilesError(f"{model_path} {misfit}", "model")
    made_with_g = float(read.about.get("tip_load_g", 0.0))
    for load_g in (settings.tip_load_g,) if tip_loads_g is None else tip_loads_g:
        if abs(load_g - made_with_g) > _SAME_LOAD_G:
            raise RiskFilesError(
                f"{model_path} was made with {made_with_g:g} g at the tip, and not with "
                f"{load_g:g} g: train one with that load, or go without a model",
                "model",
            )
    try:
        around = read_surroundings(surface, file.path, BodySize.of(read.model))
    except (EnvironmentFaultError, ValueError) as error:
        raise RiskFilesError(str(error), "surface") from None
    return RiskFiles(read, around)


def _believed_until_ns(read: ModelFile, settings: RiskSettings, path: Path) -> int | None:
    if settings.oldest_days is None:
        return None
    try:
        seen_on_day = int(np.datetime64(read.about["seen_on"], "D").astype(np.int64))
    except (KeyError, ValueError, TypeError):
        raise RiskFilesError(
            f"{path} does not say when its clouds were seen, which risk.oldest_days asks for: "
            "collect them with --seen-on",
            "oldest_days",
        ) from None
    return int((seen_on_day + settings.oldest_days) * _DAY_NS)


def _compile(source: BodyRiskSource, tip: TipModel, u: FloatArray) -> None:
    """The first answers take seconds: not in the loop."""
    source.warm_up()
    for _ in range(2):
        source.assess(u.tolist(), u.tolist(), 0)
        source.clearance(u.tolist(), 0.5)
        source.body(u.tolist())
        tip.place([u], np.zeros(3))


def _nearest(worst: WorstPlace, beside: Beside | None) -> Nearest:
    return Nearest(
        worst.clearance_mm,
        worst.arc_mm,
        tuple(worst.place_mm.tolist()),
        tuple(worst.nearest_mm.tolist()),
        () if beside is None else tuple(map(tuple, beside.means_mm.tolist())),
    )


def _words(nearest: Nearest) -> str:
    x, y, z = nearest.obstacle_mm
    return (
        f"clearance {nearest.clearance_mm:.1f} mm at {nearest.arc_mm:.0f} mm along the body, "
        f"nearest to ({x:.0f}, {y:.0f}, {z:.0f}) mm"
    )
