"""Fixed-width text fields, read strictly: what Python's own `int` forgives is an error here."""

import re

from drivers.aurora.codec.errors import CodecError

_HEX = re.compile(r"[0-9A-Fa-f]+")


def hex_number(text: str, what: str) -> int:
    """A number in hex digits and nothing else. Raises CodecError, which names `what`."""
    if _HEX.fullmatch(text) is None:
        raise CodecError(f"{what}: '{text}' is not a number in hex digits")
    return int(text, 16)


class FieldReader:
    """Takes fields off a reply from left to right."""

    def __init__(self, text: str, what: str) -> None:
        self._text = text
        self._what = what
        self._at = 0

    def text(self, width: int) -> str:
        """The next `width` characters. Raises CodecError where the reply ends before."""
        end = self._at + width
        if end > len(self._text):
            raise CodecError(f"{self._what}: ends after {len(self._text)} of {end} characters")
        field, self._at = self._text[self._at : end], end
        return field

    def hex(self, width: int) -> int:
        """The next `width` hex digits as a number. Raises CodecError."""
        return hex_number(self.text(width), self._what)

    def rest(self) -> str:
        """All that has not been taken yet."""
        field, self._at = self._text[self._at :], len(self._text)
        return field

    def end(self) -> None:
        """Nothing may follow. Raises CodecError."""
        if self._at != len(self._text):
            surplus = len(self._text) - self._at
            raise CodecError(f"{self._what}: {surplus} characters too many")
