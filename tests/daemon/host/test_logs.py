"""A process logs to stderr without its loop's ever waiting, reading or writing for it."""

import io
import json
import logging
import os
import re
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


def told(style: str) -> list[str]:
    out = io.StringIO()
    with logging_to_stderr("daemon", out, style) as log:
        log.tell(
            logging.WARNING, "cause", "tracker tip_missing: no 100 % of it", name="tip_missing"
        )
        log.tell(logging.INFO, "state", "robot hold: held")
        log_an_error()
    return out.getvalue().splitlines()


def test_a_process_that_another_one_has_started_writes_in_its_style() -> None:
    out = io.StringIO()
    with logging_to_stderr("daemon", io.StringIO(), "json"), logging_to_stderr("recorder", out):
        _log.warning("said")
    line = json.loads(out.getvalue())
    assert (line["process"], line["text"]) == ("recorder", "said")
    with logging_to_stderr("recorder", out):
        _log.warning("said again")
    assert out.getvalue().endswith(" recorder WARNING tests.logs: said again\n")


def test_what_happens_is_told_in_text_with_date_process_and_level() -> None:
    first, second, error, *_ = told("text")
    assert first.endswith(" daemon WARNING cause: tracker tip_missing: no 100 % of it")
    assert second.endswith(" daemon INFO state: robot hold: held")
    assert error.endswith(" daemon ERROR tests.logs: a part has failed")


def test_what_happens_is_told_as_an_object_a_line() -> None:
    first, second, error = (json.loads(line) for line in told("json"))
    assert first["schema"] == "tentacled.log/1"
    assert (first["process"], first["level"], first["source"]) == ("daemon", "warning", "cause")
    assert (first["text"], first["name"]) == ("tracker tip_missing: no 100 % of it", "tip_missing")
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}[+-]\d\d:\d\d", first["date"])
    assert second["level"] == "info"
    assert "RuntimeError: the reason" in error["traceback"]


def test_every_line_of_the_journal_has_its_priority() -> None:
    lines = told("journal")
    assert lines[0] == "<4>cause: tracker tip_missing: no 100 % of it"
    assert lines[1] == "<6>state: robot hold: held"
    assert lines[2] == "<3>tests.logs: a part has failed"
    assert all(line.startswith("<3>") for line in lines[2:])
    assert len(lines) > 4


def test_whoever_tells_never_waits_for_a_stream_that_stands_still() -> None:
    out = _Stuck()
    with logging_to_stderr("daemon", out, "journal") as log:
        before = time.monotonic()
        for number in range(5000):  # more than the queue holds
            log.tell(logging.INFO, "state", f"{number}")
        assert time.monotonic() - before < 2.0
        out.go_on.set()
    while not out.getvalue() and time.monotonic() - before < 10.0:
        time.sleep(0.01)
    assert out.getvalue().startswith("<6>state: 0\n")


def test_the_same_happening_is_told_each_time() -> None:
    out = io.StringIO()
    with logging_to_stderr("daemon", out, "journal") as log:
        for _ in range(30):
            log.tell(logging.INFO, "state", "robot running")
    assert out.getvalue().count("robot running") == 30
