"""How a line of the log is written: for people, for programs, and for the journal of systemd."""

import json
import logging
from collections.abc import Mapping
from typing import Any, Final

STYLES: Final = ("text", "json", "journal")
"""text: date, process, level. json: an object a line. journal: a priority before each line, after
sd-daemon(3); the journal knows date and process itself."""

_TEXT: Final = "%(asctime)s %(process_name)s %(levelname)s %(name)s: %(message)s%(repeated)s"
_SCHEMA: Final = "tentacled.log/1"
_PRIORITIES: Final = (
    (logging.CRITICAL, 2),
    (logging.ERROR, 3),
    (logging.WARNING, 4),
    (logging.INFO, 6),
)
"""Of syslog(3): critical, error, warning, informational; 7 is for debugging."""


def formatter(style: str, process: str) -> logging.Formatter:
    """Of one of STYLES. process: its name."""
    if style == "json":
        return _Json(process)
    if style == "journal":
        return _Journal()
    return logging.Formatter(_TEXT, defaults={"process_name": process})


class _Json(logging.Formatter):
    def __init__(self, process: str) -> None:
        super().__init__()
        self._process = process

    def format(self, record: logging.LogRecord) -> str:
        fields: Mapping[str, Any] = getattr(record, "fields", {})
        date = self.formatTime(record, "%Y-%m-%dT%H:%M:%S")
        zone = self.formatTime(record, "%z")
        line = {
            "schema": _SCHEMA,
            "date": f"{date}.{int(record.msecs):03d}{zone[:-2]}:{zone[-2:]}",
            "process": self._process,
            "level": record.levelname.lower(),
            "source": record.name,
            "text": record.getMessage(),
            **fields,
        }
        if record.exc_info:
            line["traceback"] = self.formatException(record.exc_info)
        if kept_back := getattr(record, "kept_back", 0):
            line["kept_back"] = kept_back
        return json.dumps(line, ensure_ascii=False, default=str)


class _Journal(logging.Formatter):
    def __init__(self) -> None:
        super().__init__("%(name)s: %(message)s%(repeated)s")

    def format(self, record: logging.LogRecord) -> str:
        priority = next((number for level, number in _PRIORITIES if record.levelno >= level), 7)
        return "\n".join(f"<{priority}>{line}" for line in super().format(record).splitlines())
