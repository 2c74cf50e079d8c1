"""An exploration that may be interrupted: recorded in parts, kept beside the file that it makes.

Each part is a run of its own, with its recording. What an interruption has left, whatever it was,
is gone on from with the lines, or the seconds, that are missing.
"""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np

from config.loader import RobotFile
from config.tasks.exploration import DesignedExploration
from daemon.files import write_whole
from daemon.host.progress import Progress
from daemon.learning.samples.dataset import Dataset, DatasetError, joined
from daemon.recording.recovery import recover_unfinished
from daemon.recording.run_folder import RUN_FILES
from daemon.workbench.experiments.trial import Tell
from daemon.workbench.pretraining.explore import (
    Exploring,
    config_sha256,
    dataset_of_run,
    explore,
)

_REQUEST_FILE = "exploration.json"
_NOT_WHOLE = 2
"""Stretches of a part that are no line, or not all of one: the first and the last."""
_SHORTEST_S = 2.0
"""Of a part."""


class ExplorationParts:
    """Of one exploration of a robot."""

    def __init__(
        self,
        out: Path,
        file: RobotFile,
        options: Exploring,
        seed: int,
        tip_load_g: float,
        real_time: bool,
    ) -> None:
        """out: of the file that it shall make."""
        self.folder = out.with_name(f"{out.name}.parts")
        self._file = file
        self._axes = len(file.robot.axes)
        self._options = options
        self._seed = seed
        self._tip_load_g = tip_load_g
        self._real_time = real_time

    def begin(self) -> None:
        """Raises FileExistsError where one was interrupted, OSError."""
        self.folder.mkdir(parents=True)
        write_whole(self.folder / _REQUEST_FILE, json.dumps(self._requested, indent=1).encode())

    def check(self) -> None:
        """Raises DatasetError where there is nothing to go on from, or something else was asked."""
        try:
            requested = json.loads((self.folder / _REQUEST_FILE).read_bytes())
        except (OSError, ValueError):
            raise DatasetError(f"there is no interrupted exploration in {self.folder}") from None
        other = [name for name, value in self._requested.items() if requested.get(name) != value]
        if other:
            raise DatasetError(
                f"the exploration in {self.folder} was asked for otherwise ({', '.join(other)}): "
                f"go on with the same words, or remove it"
            )

    @property
    def done(self) -> int:
        """How many of the lines have been gone along, or for how many seconds motions were tried,
        as far as the recordings tell."""
        if isinstance(self._options, DesignedExploration):
            moved_s = sum(part.frames.duration_s for part in self._parts())
            return min(int(moved_s), int(self._options.lasts_s(self._axes)))
        lines = (len(np.unique(part.frames.line)) - _NOT_WHOLE for part in self._parts())
        return min(sum(max(count, 0) for count in lines), self._options.waypoints)

    @property
    def how_far(self) -> str:
        """In words."""
        if isinstance(self._options, DesignedExploration):
            return f"{self.done} of {self._options.lasts_s(self._axes):.0f} s"
        return f"{self.done} of {self._options.waypoints} lines"

    def explore(self, tell: Tell, progress: Progress | None = None) -> None:
        """Go along what is missing. Raises TrialError, DatasetError, OSError."""
        options = self._left()
        if options is None:
            return
        number = 1 + max((int(path.name) for path in self._folders()), default=0)
        folder = self.folder / str(number)
        folder.mkdir()
        explore(
            self._file,
            options,
            self._seed_of(number),
            folder,
            tell,
            tip_load_g=self._tip_load_g,
            real_time=self._real_time,
            progress=progress,
        )

    def dataset(self) -> Dataset:
        """All that was seen. Raises DatasetError, OSError."""
        parts = self._parts()
        if not parts:
            raise DatasetError(f"{self.folder}: nothing was seen")
        return joined(parts)

    def end(self, kept: Path | None) -> None:
        """The recordings go to `kept`, a new folder, or are not needed any more. Raises OSError."""
        folders = self._folders()
        if kept is not None:
            shutil.move(folders[0] if len(folders) == 1 else self.folder, kept)
        shutil.rmtree(self.folder, ignore_errors=True)

    def _left(self) -> Exploring | None:
        """What is missing; None: nothing."""
        options, done = self._options, self.done
        if isinstance(options, DesignedExploration):
            lasts_s = options.lasts_s(self._axes)
            left_s = max(lasts_s - done, _SHORTEST_S)
            finished = done >= lasts_s - 1.0
            return None if finished else options.model_copy(update={"duration_s": left_s})
        left = options.waypoints - done
        return None if left <= 0 else options.model_copy(update={"waypoints": left})

    @property
    def _requested(self) -> dict[str, Any]:
        return {
            "exploration": self._options.model_dump(mode="json"),
            "seed": self._seed,
            "tip_load_g": self._tip_load_g,
            "real_time": self._real_time,
            "config_sha256": config_sha256(self._file),
        }

    def _seed_of(self, part: int) -> int:
        """Another one for each part: the same would go along the same lines."""
        if part == 1:
            return self._seed
        return int(np.random.SeedSequence((self._seed, part)).generate_state(1)[0])

    def _folders(self) -> list[Path]:
        found = [path for path in self.folder.glob("*") if path.name.isdecimal()]
        return sorted(found, key=lambda path: int(path.name))

    def _parts(self) -> list[Dataset]:
        """Of what was recorded; a part in which nothing moved is none."""
        parts = []
        for folder in self._folders():
            recover_unfinished(folder)
            how = {key: value for key, value in self._requested.items() if key != "config_sha256"}
            how["seed"] = self._seed_of(int(folder.name))
            if any(folder.glob(RUN_FILES)):
                try:
                    parts.append(dataset_of_run(folder, self._file, how))
                except DatasetError:
                    continue
        return parts
