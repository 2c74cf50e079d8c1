"""The names under which everything is published, asked for and streamed."""

import re
from dataclasses import dataclass
from typing import Final

from daemon.messages import (
    Axes,
    Body,
    Event,
    Loop,
    Message,
    Risk,
    SetpointRefused,
    Status,
    Tip,
)

_NAME: Final = re.compile(r"[a-z][a-z0-9_]{0,62}")

TELEMETRY_KEYS: Final[dict[str, tuple[type[Message], ...]]] = {
    "state": (Status,),
    "tip": (Tip,),
    "axes": (Axes,),
    "risk": (Risk,),
    "loop": (Loop,),
    "event": (Event, SetpointRefused),
    "body": (Body,),
}
"""What is published, and the kinds of message that come there, the usual one first."""

ANY_ROBOT_ALIVE: Final = "tentacled/*/alive"


@dataclass(frozen=True)
class Keys:
    """All keys of one robot. Raises ValueError where a name cannot be part of a key."""

    robot: str

    def __post_init__(self) -> None:
        _valid(self.robot)

    @property
    def root(self) -> str:
        return f"tentacled/{self.robot}"

    @property
    def alive(self) -> str:
        """Liveliness token of the daemon. It says that the process is there, nothing more."""
        return f"{self.root}/alive"

    @property
    def schemas(self) -> str:
        """All JSON Schemas, for a query."""
        return f"{self.root}/schema/*"

    def telemetry(self, name: str) -> str:
        """Where `name` of TELEMETRY_KEYS is published, and its last value answered."""
        if name not in TELEMETRY_KEYS:
            raise ValueError(f"'{name}' is not published; there are {', '.join(TELEMETRY_KEYS)}")
        return f"{self.root}/{name}"

    def schema(self, kind: str) -> str:
        """The JSON Schema of a kind of message, named without its version."""
        return f"{self.root}/schema/{_valid(kind)}"

    @property
    def events(self) -> str:
        """The last events, for a query."""
        return f"{self.root}/events"

    @property
    def surroundings(self) -> str:
        """What is round the body, for a query."""
        return f"{self.root}/surroundings"

    def surroundings_part(self, number: int | None = None) -> str:
        """One part of the mesh's bytes, for a query; None: of whichever, to declare."""
        return f"{self.surroundings}/{'*' if number is None else number}"

    def command(self, user: str, verb: str) -> str:
        """Where `user` asks for `verb`. Access control lets each user use only the own ones."""
        return f"{self.root}/cmd/{_valid(user)}/{_valid(verb)}"

    def commands(self, user: str) -> str:
        """All commands of `user`, to declare and to permit; never to ask."""
        return f"{self.root}/cmd/{_valid(user)}/*"

    def setpoint(self, user: str) -> str:
        """Where `user` streams set-points."""
        return f"{self.root}/setpoint/{_valid(user)}"

    def obstacles(self, user: str) -> str:
        """Where `user` streams obstacles that move."""
        return f"{self.root}/obstacles/{_valid(user)}"

    def whoami(self, user: str) -> str:
        """Where `user` asks what he may do."""
        return f"{self.root}/whoami/{_valid(user)}"


def last_part(key: str) -> str:
    """What a key ends in: the verb of a command, the kind of a schema."""
    return key.rpartition("/")[2]


def robot_of(alive_key: str) -> str:
    """Whose `alive` key this is."""
    return alive_key.split("/")[1]


def is_exact(key: str) -> bool:
    """Whether a key names one thing only."""
    return "*" not in key and "$" not in key


def _valid(name: str) -> str:
    if not _NAME.fullmatch(name):
        raise ValueError(f"'{name}' cannot be part of a key: lower-case letters, digits and _ only")
    return name
