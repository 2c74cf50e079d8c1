"""A command that is not carried out, and why."""

from collections.abc import Sequence

from safety.failsafe import ActiveReason


class RefusedError(Exception):
    """A command that is not carried out."""

    def __init__(self, name: str, text: str, reasons: Sequence[ActiveReason] = ()) -> None:
        super().__init__(text)
        self.name = name
        self.text = text
        self.reasons = reasons
