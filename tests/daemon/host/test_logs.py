"""A process logs to stderr without its loop's ever waiting, reading or writing for it."""

import io
import logging
import os
import sys
import threading
import time
from typing import Any

import pytest

from daemon.host.logs import RateLimit, logging_to_stderr
from drivers.clock import Clock

_log = logging.getLogger("tests.logs")


class _Stuck(io.StringIO):
    """A terminal that takes nothing until it is let go."""

    def __init__(self) -> None:
        super().__init__()
        self.go_on = threading.Event()

    def write(self, text: str) -> int:
        self.go_on.wait(10.0)
        return super().write(text)


class _At(Clock):
    t_s = 0.0

    def now_ns(self) -> int:
        return round(self.t_s * 1e9)


def fails() -> None:
    raise RuntimeError("the reason")


def log_an_error() -> None:
    try:
        fails()
    except RuntimeError as error:
        _log.error("a part has failed", exc_info=error)


def test_an_error_is_written_with_its_process_its_place_and_its_traceback() -> None:
    out = io.StringIO()
    with logging_to_stderr("recorder", out):
        log_an_error()
    text = out.getvalue()
    assert "recorder ERROR tests.logs: a part has failed\n" in text
    assert "in fails" in text
    assert "RuntimeError: the reason" in text


def test_what_comes_again_and_again_is_written_once() -> None:
    out = io.StringIO()
    with logging_to_stderr("daemon", out):
        for _ in range(10_000):
            log_an_error()
        _log.warning("something else")
    assert out.getvalue().count("a part has failed") == 1
    assert "something else" in out.getvalue()


def test_later_it_is_written_again_with_how_often_it_came_meanwhile() -> None:
    clock = _At()
    limit = RateLimit(clock, again_after_s=10.0)
    record = logging.LogRecord("n", logging.ERROR, "file.py", 7, "again", None, None)
    passed = []
    for at_s in (0.0, 3.0, 9.9, 10.0, 11.0):
        clock.t_s = at_s
        passed.append(limit.filter(record))
    assert passed == [True, False, False, True, False]
    assert record.kept_back == 2  # type: ignore[attr-defined]


def test_places_without_end_take_no_memory_without_end() -> None:
    limit = RateLimit(_At())
    passed = 0
    for number in range(1000):
        passed += limit.filter(logging.LogRecord("n", 40, "f.py", number, "x", None, None))
    assert passed == 201
    assert len(limit._passed_s) == 201


def test_a_terminal_that_stands_still_holds_nobody() -> None:
    out = _Stuck()
    began_s = time.monotonic()
    with logging_to_stderr("daemon", out):
        for number in range(5000):
            _log.error("line %d", number)
            _log.error("other %s", number)
        logged_s = time.monotonic() - began_s
    ended_s = time.monotonic() - began_s - logged_s
    out.go_on.set()
    assert logged_s < 5.0  # 10 000 of them
    assert ended_s < 2.0


def test_who_logs_opens_no_file(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[Any] = []
    watched = threading.get_ident()
    watching = [False]

    def heard(event: str, arguments: tuple[Any, ...]) -> None:
        reads = event in ("open", "os.listdir", "os.scandir")
        if watching[0] and reads and threading.get_ident() == watched:
            opened.append(arguments)

    sys.addaudithook(heard)
    real_stat, stats = os.stat, []

    def stat(*arguments: Any, **more: Any) -> os.stat_result:
        if watching[0] and threading.get_ident() == watched:
            stats.append(arguments)
        return real_stat(*arguments, **more)

    monkeypatch.setattr(os, "stat", stat)
    monkeypatch.setattr(logging.getLogger(), "handlers", [])  # pytest's own read files
    out = io.StringIO()
    with logging_to_stderr("daemon", out):
        watching[0] = True
        log_an_error()
        watching[0] = False
    assert "in fails" in out.getvalue()
    assert opened == []
    assert stats == []
