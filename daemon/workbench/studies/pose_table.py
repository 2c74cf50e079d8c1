"""Errors of position and direction over whole trajectories, coordinate by coordinate: as the paper
on concentric tubes has them (Fagogenis, Bergeles and Dupont, IROS 2016, Table III)."""

from collections.abc import Sequence
from math import degrees, hypot, inf, sqrt
from typing import Final, Literal, NamedTuple

from config.tasks.study import PoseFigures, StudyTable
from daemon.recording.result import PoseError
from daemon.workbench.studies.findings import Findings, StudyAim
from daemon.workbench.studies.run import Outcome
from daemon.workbench.studies.study_file import StudyFile
from daemon.workbench.studies.summary import spread
from daemon.workbench.studies.table import Section, Table, median_of, number, range_of

Seen = Literal["tip_pose", "reading_pose", "true_pose"]

_NOTE: Final = (
    "Root mean squares over the whole trajectory, without the way to its start, in mm and degrees. "
    "Ours: medians over all runs, each on its own body or with its own noise [best–worst]. First "
    "the tip as the tracker shows it, then the true tip, which holds the tracker's distortion as "
    "well. Sensor: the angle for who takes the sensor's axis for the tip's. ∞: not finished in "
    "half of the runs, or in one."
)


class PoseRms(NamedTuple):
    """mm, and degrees where the tip's direction was asked for."""

    x: float
    y: float
    z: float
    degrees: float | None

    @property
    def norm(self) -> float:
        """mm of the whole position error."""
        return hypot(self.x, self.y, self.z)


_LOST: Final = PoseRms(inf, inf, inf, inf)


def pose_table(file: StudyFile, table: StudyTable, found: Findings) -> Table:
    """The paper's rows with ours in them."""
    head = ("", "x", "y", "z", "norm", "θ", "true x", "y", "z", "θ", "sensor θ", "runs")
    made = Table(table.title, head, note=_NOTE)
    for name, row in file.rows.items():
        if row not in table.rows:
            continue
        section = Section(row.label)
        for variant in file.study.variants:
            published = row.published_pose.get(variant.variant)
            if published is not None:
                section.rows.append(_published(f"{file.study.source}: {variant.label}", published))
            runs = outcomes_of(found, name, variant.variant)
            if runs:
                section.rows.append([variant.label, *_cells(runs)])
        if section.rows:
            made.sections.append(section)
    return made


def pose_aims(file: StudyFile, found: Findings) -> list[StudyAim]:
    """What the study set out to show of these errors."""
    aims = []
    for name, row in file.rows.items():
        for variant, aim in row.aim_pose.items():
            runs = outcomes_of(found, name, variant)
            if runs:
                aims.append(_aim(name, variant, aim, runs))
    return aims


def outcomes_of(found: Findings, experiment: str, variant: str) -> list[Outcome]:
    """All runs of one experiment with one controller."""
    mine = (experiment, variant)
    return [one for one in found.runs if (one.experiment, one.variant) == mine]


def pose_rms(outcome: Outcome, seen: Seen) -> PoseRms:
    """Over all cycles; infinite for a run that was given up."""
    if outcome.failure or outcome.result is None:
        return _LOST
    rows: list[PoseError] = getattr(outcome.result, seen)
    count = sum(row.samples for row in rows)
    if not count:
        return _LOST

    def mean(values: Sequence[float]) -> float:
        squares = zip(rows, values, strict=True)
        return sqrt(sum(row.samples * value**2 for row, value in squares) / count)

    angles = [row.angle_rad for row in rows if row.angle_rad is not None]
    return PoseRms(
        mean([row.x_mm for row in rows]),
        mean([row.y_mm for row in rows]),
        mean([row.z_mm for row in rows]),
        degrees(mean(angles)) if len(angles) == len(rows) else None,
    )


def _aim(name: str, variant: str, aim: PoseFigures, runs: Sequence[Outcome]) -> StudyAim:
    said = [pose_rms(run, "tip_pose") for run in runs]
    pairs = [
        (spread([getattr(one, axis) for one in said]).median, getattr(aim, f"{axis}_mm"))
        for axis in ("x", "y", "z")
    ]
    ours = "/".join(number(mine) for mine, _ in pairs)
    theirs = "/".join(number(wanted) for _, wanted in pairs)
    reached = all(mine <= wanted for mine, wanted in pairs)
    text = f"{ours} mm, at most {theirs} mm, over {len(runs)} runs"
    return StudyAim(experiment=name, variant=variant, text=text, reached=reached)


def _published(label: str, figures: PoseFigures) -> list[str]:
    x, y, z = figures.x_mm, figures.y_mm, figures.z_mm
    cells = [number(value) for value in (x, y, z, hypot(x, y, z), figures.angle_deg)]
    return [label, *cells, *[""] * 6]


def _cells(runs: Sequence[Outcome]) -> list[str]:
    seen = [pose_rms(run, "tip_pose") for run in runs]
    true = [pose_rms(run, "true_pose") for run in runs]
    sensor = [
        degrees(sqrt(sum(angle**2 for angle in angles) / len(angles)))
        for run in runs
        if run.result is not None and (angles := run.result.sensor_angle_rad)
    ]
    return [
        *(_spread([getattr(one, axis) for one in seen]) for axis in ("x", "y", "z", "norm")),
        _spread([one.degrees for one in seen if one.degrees is not None]),
        *(median_of(spread([getattr(one, axis) for one in true])) for axis in ("x", "y", "z")),
        _median([one.degrees for one in true if one.degrees is not None]),
        _median(sensor),
        str(len(runs)),
    ]


def _spread(values: Sequence[float]) -> str:
    if not values:
        return "–"
    all_of_them = spread(values)
    return f"{median_of(all_of_them)} [{range_of(all_of_them)}]"


def _median(values: Sequence[float]) -> str:
    return median_of(spread(values)) if values else "–"
