"""What is answered to commands and questions."""

from typing import Any

from daemon.messages.base import Message, Reason
from daemon.messages.telemetry import Event


class Answer(Message, frozen=True, kw_only=True, tag="answer/1"):
    """What every command that was carried out gets."""

    request: str
    state: str
    """After it."""
    text: str = ""
    token: str = ""
    """Of the lease, after `acquire`."""
    expires_in_s: float | None = None
    confirmed: bool = True
    """For stop and disarm: whether the drives have said that they did it."""
    path: dict[str, Any] | None = None
    """After `plan`: what its path file holds; None: it is too long for an answer."""
    file: str = ""
    """After `plan`: the name under which `load` takes it, as `{"kind": "planned", "file": ...}`."""


class Refusal(Message, frozen=True, kw_only=True, tag="refusal/1"):
    """Why a command was not carried out: all reasons at once."""

    request: str
    state: str
    name: str
    """`no_lease`, `wrong_state`, `not_ready`, `bad_payload`, `unreachable`, `busy`, ..."""
    text: str
    reasons: list[Reason] = []


class SetpointRefused(Message, frozen=True, kw_only=True, tag="setpoint_refused/1"):
    """Published as an event when a set-point is dropped."""

    sequence: int
    """-1 where it could not be read."""
    reason: str
    user: str = ""
    """Whose set-point it was."""


class Events(Message, frozen=True, kw_only=True, tag="events/1"):
    """Answer to `events`: the last 200 that there were, the oldest first."""

    events: list[Event]


class Surroundings(Message, frozen=True, kw_only=True, tag="surroundings/1"):
    """Answer to `surroundings`: what is round the body. `surround` replaces it; the state tells of
    that by another `risk.surroundings_sha256`."""

    mesh: str = ""
    """Name of its file, and how much there is besides; empty: nobody knows what is round the
    body."""
    sha256: str = ""
    """Of the mesh as it is answered: a binary STL file in mm, normals out of what is solid."""
    size_bytes: int = 0
    parts: int = 0
    """Into how many it is cut; `surroundings/0` and so on answer the bytes of each."""
    transform: list[float] = []
    """(16,) row by row, from the mesh's places to the base sensor's frame."""
    workspace_mm: list[list[float]] | None = None
    """(3, 2) from where to where references may lead the tip."""
    counts_sha256: str = ""
    """Of what counts: triangles, their free side, the port, and the regions."""
    regions: list[dict[str, Any]] = []
    """Regions that the body must not get into or out of, with the keys of robot files."""
    port: dict[str, Any] | None = None
    """Where the body comes in, with the keys of robot files; None: there is none."""


class WhoAmI(Message, frozen=True, kw_only=True, tag="whoami/1"):
    """Answer to `whoami`: that the daemon is there, and what the asker may do."""

    robot: str
    version: str
    role: str
    simulated: bool
