"""What became of one run of a study: a file in its folder, by which it is known to be done."""

from pathlib import Path
from typing import Final, Literal

import msgspec

from daemon.recording.result import Result
from daemon.recording.run_files import write_whole
from daemon.recording.run_folder import formatted_json
from daemon.workbench.studies.run import Run

OUTCOME_FILE: Final = "outcome.json"

Verdict = Literal["finished", "held", "unstable", "failed"]


class Outcome(msgspec.Struct, frozen=True, kw_only=True):
    """One run. Fields are only added, and have a default."""

    experiment: str
    variant: str
    plant: int
    seed: int
    fingerprint: str
    """Of the run's own: another one, and it has to be done again."""
    failure: str = ""
    """Why it was given up; empty: it came to its end."""
    result: Result | None = None
    """None: it failed before anything was recorded."""
    commit: str | None = None
    """Of the program; with a `+` where files differed from it."""

    def verdict(self, unstable_above_mm: float) -> Verdict:
        """In one word: the worst that can be said."""
        if self.failure or self.result is None:
            return "failed"
        if any(cycle.max_mm >= unstable_above_mm for cycle in self.result.cycles):
            return "unstable"
        return "held" if self.result.holds else "finished"


def write_outcome(folder: Path, outcome: Outcome) -> None:
    """Raises OSError."""
    write_whole(folder / OUTCOME_FILE, formatted_json(outcome))


def read_outcome(run: Run, root: Path) -> Outcome | None:
    """None: this run has not been done yet, or under other conditions."""
    try:
        data = (run.folder(root) / OUTCOME_FILE).read_bytes()
        outcome = msgspec.json.decode(data, type=Outcome)
    except (OSError, msgspec.MsgspecError):
        return None
    return outcome if outcome.fingerprint == run.fingerprint else None
