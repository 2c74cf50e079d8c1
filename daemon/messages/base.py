"""What every message is made of."""

import msgspec


class Message(msgspec.Struct, frozen=True, kw_only=True):
    """Base of all; a subclass sets its tag."""


class Reason(msgspec.Struct, frozen=True, kw_only=True):
    """Why the robot is not doing what somebody might want of it."""

    name: str
    """As in the table of causes."""
    severity: str
    subject: str
    """What it is about: `tracker`, `can0/3`, `loop`."""
    text: str
    remedy: str
    detail: str = ""
    since_s: float = 0.0
    """How long it has been so."""
    latched: bool = False
    """Gone by itself, but waits for a deliberate clear."""
    follows_from: str = ""
    """The cause, told before this one, that this one follows from: mend that first."""
    over: bool = False
    """Gone, and told because of what follows from it."""


def tag(kind: type[msgspec.Struct]) -> str:
    """Kind and version, as on the wire."""
    return str(kind.__struct_config__.tag)
