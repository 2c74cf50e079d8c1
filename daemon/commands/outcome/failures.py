"""Why a command could not do what it was asked for: one table from errors to kinds of failure.

Errors are named by where they are defined, so that nobody imports what has not failed.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from config.documents.problems import ConfigError, in_words
from daemon.commands.outcome import exit_codes


@dataclass(frozen=True)
class Kind:
    """One kind of failure."""

    name: str
    code: int
    remedy: str
    """What helps against any of them, where the failure itself does not know better."""
    errors: tuple[str, ...] = ()
    """Classes, by module and name; those derived from them are of this kind, too."""


_DATA: Final = "name another file, or make it anew by the command that wrote it"
_FILES: Final = "see whether path, permissions and room on the disk are right"

KINDS: Final = (
    Kind("failed", exit_codes.EXIT_FAILED, "what the message says", (
        "daemon.workbench.experiments.trial.TrialError",
        "daemon.workbench.body_model.clouds.collection.CollectionError",
        "daemon.workbench.body_model.clouds.emulated_body.UnreachableError",
        "daemon.workbench.body_model.training.training.TrainingError",
        "daemon.workbench.pretraining.pose_learning.PoseLearningError",
        "daemon.learning.forward.pretraining.PretrainingError",
        "sim_backends.plants.concentric.relative.RelativeRangeError",
        "daemon.remote.client.client_errors.ClientError",
    )),
    Kind("usage", exit_codes.EXIT_USAGE, "`tentacled COMMAND --help` says what it takes", (
        "daemon.workbench.studies.run.PlanError",
        "daemon.robot.lab_connections.LabRefusedError",
    )),
    Kind("unusable_data", exit_codes.EXIT_DATA, _DATA, (
        "daemon.array_files.ModelError",
        "daemon.learning.samples.dataset.DatasetError",
        "daemon.recording.run_reader.UnreadableRunError",
        "daemon.reference.planned_path.PlannedPathError",
        "daemon.reference.waypoints.WaypointError",
        "daemon.steering.station.JournalError",
        "daemon.workbench.body_model.clouds.cloud_dataset.CloudDatasetError",
        "safety.risk.model.mixture.MixtureError",
        "safety.risk.model.risk_model.RiskModelError",
        "safety.risk.surroundings.environment.EnvironmentFaultError",
    )),
    Kind("no_input", exit_codes.EXIT_NO_INPUT, "name one that is there", (
        "builtins.FileNotFoundError", "builtins.NotADirectoryError",
        "daemon.recording.run_reader.MissingRunError",
    )),
    Kind("unavailable", exit_codes.EXIT_UNAVAILABLE, "start it, plug it in, or end who has it", (
        "daemon.recording.export.files.ExportLibraryError",
        "daemon.remote.client.client_errors.DaemonNotRunningError",
        "daemon.remote.client.client_errors.DisconnectedError",
        "daemon.remote.discovery.FolderError",
        "daemon.remote.discovery.SecondDaemonError",
        "daemon.remote.server.server.RemoteOpenError",
        "daemon.robot.lab_connections.LabUnreachableError",
        "daemon.steering.hid_device.HidDeviceError",
        "daemon.workbench.cluster.cluster_workers.ClusterError",
        "drivers.can.bus_lock.BusTakenError",
        "sim_backends.lab.lab_ports.LabTakenError",
    )),
    Kind("internal", exit_codes.EXIT_INTERNAL, "report it, with the traceback on stderr"),
    Kind("cannot_create", exit_codes.EXIT_CANNOT_CREATE, "name a new file or folder", (
        "builtins.FileExistsError", "daemon.files.CannotMakeError",
        "daemon.remote.certificates.CertificateError",
    )),
    Kind("input_output", exit_codes.EXIT_IO, _FILES, ("builtins.OSError",)),
    Kind("no_answer", exit_codes.EXIT_NO_ANSWER, "try again", (
        "daemon.remote.client.client_errors.LeaseLostError",
        "daemon.remote.client.client_errors.TimedOutError",
    )),
    Kind("protocol", exit_codes.EXIT_PROTOCOL, "install the same version on both sides", (
        "daemon.remote.client.client_errors.BadAnswerError",
        "daemon.remote.client.client_errors.VersionMismatchError",
        "daemon.workbench.cluster.cluster_workers.ClusterMismatchError",
    )),
    Kind("refused", exit_codes.EXIT_REFUSED, "see to the reasons that are told, then ask again", (
        "builtins.PermissionError",
        "daemon.remote.client.client_errors.AccessDeniedError",
        "daemon.remote.client.client_errors.RefusedError",
    )),
    Kind("configuration", exit_codes.EXIT_CONFIGURATION, "`tentacled check FILE` names all that is "
        "wrong with it", (
        "config.documents.problems.ConfigError",
        "daemon.risk.body_risk_source.RiskFilesError",
        "drivers.canopen.object_dictionary.EdsError",
        "sim_backends.lab.bodies.LabError",
    )),
    Kind("interrupted", exit_codes.EXIT_INTERRUPTED, "start it again", (
        "builtins.KeyboardInterrupt",
    )),
)  # fmt: skip

_BY_NAME: Final = {kind.name: kind for kind in KINDS}
_BY_ERROR: Final = {error: kind for kind in KINDS for error in kind.errors}

NO_LEASE: Final = (
    "hold the lease in another terminal, with `tentacled lease`, while you work with the robot"
)


class CommandError(Exception):
    """A command cannot go on, and says itself what kind of failure that is."""

    def __init__(self, kind: str, message: str, *, place: str = "", remedy: str = "") -> None:
        """kind: name of one of KINDS. place: the file, option or device that it is about."""
        super().__init__(message)
        self.kind = _BY_NAME[kind]
        self.place = place
        self.remedy = remedy


class UsageError(CommandError):
    """The command line does not say enough, or too much."""

    def __init__(self, message: str, *, place: str = "") -> None:
        super().__init__("usage", message, place=place)


@contextmanager
def about(path: Path) -> Iterator[None]:
    """Errors of the system that name no file while it lasts are about this one."""
    try:
        yield
    except OSError as error:
        if error.filename is None and error.strerror is not None:
            error.filename = str(path)
        raise


def as_failed(error: Exception) -> Exception:
    """For what also raises ValueError where it cannot do what it is asked for."""
    return error if _kind_of(error) is not None else CommandError("failed", str(error))


@dataclass(frozen=True)
class Failure:
    """What is told of an error, to people and to programs."""

    kind: Kind
    message: str
    place: str = ""
    remedy: str = ""
    """Of its own; empty: only what its kind says."""
    details: Mapping[str, Any] = field(default_factory=dict)

    @property
    def text(self) -> str:
        """For people."""
        return f"{self.message}\n{self.remedy}" if self.remedy else self.message

    def as_json(self, command: str) -> dict[str, Any]:
        """For programs: what, where, and what helps."""
        return {
            "command": command,
            "kind": self.kind.name,
            "message": self.message,
            "place": self.place,
            "remedy": self.remedy or self.kind.remedy,
            "exit_code": self.kind.code,
            **self.details,
        }


def failure_of(error: BaseException) -> Failure | None:
    """What an error means for whoever has typed the command; None: it is one of our own."""
    if isinstance(error, CommandError):
        return Failure(error.kind, str(error), error.place, error.remedy)
    kind = _kind_of(error)
    if kind is None:
        return None
    if kind.name == "interrupted":
        return Failure(kind, "interrupted")
    message = in_words(error) if isinstance(error, Exception) else str(error)
    refusal = getattr(error, "refusal", None)
    if refusal is not None:  # the daemon's own words, in full
        remedy = NO_LEASE if refusal.name == "no_lease" else ""
        return Failure(kind, message, "", remedy, {"refusal": refusal})
    if isinstance(error, ConfigError) and error.problems:
        problems = error.problems
        first = problems[0]
        place = f"{first.file}:{first.line}:{first.column}" if first.line else first.file
        return Failure(kind, message, place, "", {"problems": list(problems)})
    named = getattr(error, "filename", None)
    return Failure(kind, message, str(named) if named else "")


def _kind_of(error: BaseException) -> Kind | None:
    """That of the nearest of its classes that is in the table."""
    for one in type(error).__mro__:
        if (kind := _BY_ERROR.get(f"{one.__module__}.{one.__qualname__}")) is not None:
            if one.__module__ != "builtins" or not isinstance(error, OSError):
                return kind
            if error.strerror is None:  # a time-out, or raised by some code: not the system's
                return None
            # One that names no file is none that another file would mend.
            return kind if error.filename is not None else _BY_NAME["input_output"]
    return None
