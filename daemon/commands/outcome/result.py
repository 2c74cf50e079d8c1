"""What a command has found out, and how it is told: text for people, or JSON for programs.

With `--json` standard output carries JSON and nothing else: whatever a library, a child process or
a command itself prints meanwhile goes to standard error. Each line is one object; all commands but
those that go on until they are ended (`probe`, `status --watch`) write exactly one.
"""

import json
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, is_dataclass
from functools import cache
from pathlib import PurePath
from typing import Any, Final, TextIO

from daemon.commands.outcome.exit_codes import EXIT_OK
from daemon.commands.outcome.failures import Failure

_FORM: Final = 1
"""Of the objects: it changes where a key goes or means something else, not where one is added."""

_PACKAGES: Final = ("eclipse-zenoh", "numba", "numpy", "scipy", "python-can", "mcap", "msgspec")

_json_out: list[TextIO] = []
"""Standard output as it was before it was kept for JSON; the last one counts."""


@dataclass(frozen=True)
class Result:
    """How a command ended."""

    data: Mapping[str, Any] | None = field(default_factory=dict)
    """What `--json` prints; None: all has been told already, by `tell`."""
    text: str | Callable[[], None] = ""
    """What people see, or what shows it to them; empty: they have seen it already."""
    code: int = EXIT_OK


@contextmanager
def only_json_on_stdout() -> Iterator[None]:
    """While it lasts everything but what `tell` writes goes to standard error."""
    before = sys.stdout
    with suppress(OSError, ValueError):
        before.flush()
    out, restored = _apart(before)
    _json_out.append(out)
    sys.stdout = sys.stderr
    try:
        yield
    finally:
        sys.stdout = before
        _json_out.pop()
        restored()


def _apart(stdout: TextIO) -> tuple[TextIO, Callable[[], None]]:
    """A stream of its own to where stdout leads, and what leads stdout there again."""
    try:
        is_ours = stdout.fileno() == 1
    except (OSError, ValueError):  # what a test has put there
        is_ours = False
    if not is_ours:
        return stdout, lambda: None
    kept = os.dup(1)
    os.dup2(2, 1)  # for child processes, and for libraries that are not Python

    def restored() -> None:
        with suppress(OSError, ValueError):
            out.flush()
        os.dup2(kept, 1)
        with suppress(OSError, ValueError):
            out.close()

    out = os.fdopen(kept, "w", encoding="utf-8", closefd=True)
    return out, restored


def telling_json() -> bool:
    """Whether standard output is kept for JSON."""
    return bool(_json_out)


def tell(command: str, data: Mapping[str, Any], text: str = "") -> None:
    """Something of a command that goes on: a line of JSON, or else of text."""
    if _json_out:
        _write({**_head(command), "result": data})
    elif text:
        print(text, flush=True)


def tell_result(command: str, result: Result) -> None:
    """How a command ended, at its end."""
    if _json_out:
        if result.data is not None:
            _write({**_head(command), "exit_code": result.code, "result": result.data})
    elif callable(result.text):
        result.text()
    elif result.text:
        print(result.text, flush=True)


def tell_failure(command: str, failure: Failure) -> None:
    """Why a command could not: on stderr, or as JSON where that can be written."""
    told = False
    if _json_out:
        error = {"exit_code": failure.kind.code, "error": failure.as_json(command)}
        with suppress(OSError):
            _write({**_head("error"), **error})
            told = True
    if failure.text and not told:
        print(failure.text, file=sys.stderr, flush=True)


def _head(what: str) -> dict[str, Any]:
    name = what.replace(" ", "_")
    return {"schema": f"tentacled.{name}/{_FORM}", "version": program_version()}


@cache
def program_version() -> str:
    """Of what is installed."""
    from importlib.metadata import version  # which `--help` has no use for

    return version("tentacled")


def versions() -> dict[str, Any]:
    """What a report of a defect should name, by name; None: not installed."""
    import platform

    from config.documents.kinds import API_VERSION

    return {
        "tentacled": program_version(),
        "api_version": API_VERSION,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "packages": {name: _version_of(name) for name in _PACKAGES},
    }


def _version_of(package: str) -> str | None:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _write(line: Mapping[str, Any]) -> None:
    out = _json_out[-1]
    out.write(json.dumps(plain(line), ensure_ascii=False, separators=(",", ":")) + "\n")
    out.flush()


def plain(value: Any) -> Any:
    """As JSON has it: arrays as lists, messages and data classes as objects, no NaN."""
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, Sequence | set | frozenset) and not isinstance(value, bytes):
        return [plain(one) for one in value]
    if isinstance(value, PurePath):
        return str(value)
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    if hasattr(value, "__struct_fields__"):
        import msgspec

        return plain(msgspec.to_builtins(value))
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    return str(value)
