"""How far long work is, on a terminal and where there is none; and kernels that are compiled."""

import io
import os
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

from daemon.commands.terminal.progress_line import Aside, ProgressLine


class Screen(io.StringIO):
    """A terminal, or a file."""

    def __init__(self, terminal: bool) -> None:
        super().__init__()
        self._terminal = terminal

    def isatty(self) -> bool:
        return self._terminal

    def seen(self) -> str:
        """The last line, as a terminal shows it."""
        return self.getvalue().rpartition("\n")[2].rpartition("\r\x1b[K")[2]


class Clock:
    now_s = 0.0

    def now_ns(self) -> int:
        return round(self.now_s * 1e9)


@pytest.fixture
def clock() -> Clock:
    return Clock()


def work(line: ProgressLine, clock: Clock, parts: int = 100, each_s: float = 1.0) -> list[str]:
    """Returns what a terminal showed after each part."""
    line.begin("learning", 100.0)
    seen = []
    for _ in range(parts):
        clock.now_s += each_s
        line.advance()
        out = line._place._out
        assert isinstance(out, Screen)
        seen.append(out.seen())
    return seen


def test_on_a_terminal_one_line_is_written_over_and_goes_in_the_end(clock: Clock) -> None:
    screen = Screen(terminal=True)
    with ProgressLine(screen, clock) as line:
        seen = work(line, clock, 60)
        assert "\n" not in screen.getvalue()
        assert seen[0] == "learning, 1%"
        assert seen[-1] == "learning, 60%, about 40 s to go"
        assert all(len(one) < 80 for one in seen)
    assert screen.seen() == ""


def test_elsewhere_there_is_a_line_for_each_tenth_and_nothing_is_written_over(clock: Clock) -> None:
    file = Screen(terminal=False)
    with ProgressLine(file, clock) as line:
        work(line, clock, each_s=1.5)
    lines = file.getvalue().splitlines()
    assert len(lines) == 10
    assert lines[0] == "learning, 10%, about 2 min to go"
    assert lines[-1] == "learning, 100%"
    assert "\r" not in file.getvalue()


@pytest.mark.parametrize("terminal", [True, False])
def test_short_work_is_not_shown(clock: Clock, terminal: bool) -> None:
    screen = Screen(terminal)
    with ProgressLine(screen, clock) as line:
        work(line, clock, 100, 0.004)
    assert screen.getvalue() == ""


def test_what_is_told_stays_and_goes_to_stdout(
    clock: Clock, capsys: pytest.CaptureFixture[str]
) -> None:
    screen = Screen(terminal=True)
    with ProgressLine(screen, clock) as line:
        work(line, clock, 10)
        line.tell("14.2 g at the tip")
        assert screen.seen() == ""
        clock.now_s += 1.0
        line.advance()
        assert screen.seen().startswith("learning, 11%")
    said = capsys.readouterr()
    assert said.out == "14.2 g at the tip\n"
    assert said.err == ""


def test_nothing_goes_to_stdout_by_itself(clock: Clock, capsys: pytest.CaptureFixture[str]) -> None:
    with ProgressLine(clock=clock) as line:
        line.begin("learning", 10.0)
        for _ in range(10):
            clock.now_s += 40.0
            line.advance()
    said = capsys.readouterr()
    assert said.out == ""
    assert "learning, 50%" in said.err


def test_a_reader_that_has_left_is_no_reason_to_stop(clock: Clock) -> None:
    screen = Screen(terminal=True)
    with ProgressLine(screen, clock) as line:
        line.begin("learning", 10.0)
        screen.close()
        clock.now_s += 5.0
        line.advance()


def test_what_is_done_between_does_not_disturb_how_far_the_rest_is(clock: Clock) -> None:
    screen = Screen(terminal=True)
    with ProgressLine(screen, clock) as line:
        work(line, clock, 30)
        between = line.between()
        between.begin("compiling kernels", 40_000.0)
        clock.now_s += 1.0
        between.reach(10_000.0)
        assert screen.seen() == "compiling kernels, 25%"
        clock.now_s += 1.0
        line.reach(31.0)
        assert screen.seen().startswith("learning, 31%, about 1 min to go")
        between.reach(20_000.0)
        line.tell("past all of it")
        assert screen.seen() == ""


def test_who_must_not_wait_has_it_told_aside(clock: Clock) -> None:
    screen = Screen(terminal=True)
    with ProgressLine(screen, clock) as line:
        with Aside(line) as aside:
            aside.begin("following", 10.0)
            while line._pace is None:
                time.sleep(0.001)
            clock.now_s += 5.0
            aside.reach(5.0)
        assert screen.seen() == "following, 50%"


KERNELS = """
    from numba import njit

    @njit(cache=True)
    def inner(x):
        return x * 2.0 + 1.0

    @njit(cache=True)
    def outer(x):
        return inner(x) + inner(x + 1.0)

    @njit(cache=True)
    def alone(x):
        return x - 1.0
"""
HEARD = """
    import sys, importlib
    from daemon.host import compilation
    sys.path.insert(0, {folder!r})
    told = []

    class Ear:
        def begin(self, what, total, done=0.0): told.append((what, 0.0))
        def advance(self, by=1.0): raise AssertionError
        def reach(self, done, total=0.0, what=""): told.append((what, done / total))

    import {name} as made
    compilation._OURS = ("{name}",)
    wanted = compilation.kernels_to_compile()
    with compilation.compilation_told(Ear()):
        made.outer(1.0)
        made.alone(1.0)
    made.alone(1)
    print(len(wanted)); print(told[0] if told else None); print(told[-1] if told else None)
"""


def test_kernels_that_are_compiled_are_counted_and_those_on_disk_are_not(tmp_path: Path) -> None:
    name = "kernels_of_a_test"
    (tmp_path / f"{name}.py").write_text(textwrap.dedent(KERNELS))
    script = textwrap.dedent(HEARD).format(folder=str(tmp_path), name=name)
    cold, warm = (
        subprocess.run(
            [sys.executable, "-c", script],
            capture_output=True,
            text=True,
            check=True,
            env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")},
        ).stdout.splitlines()
        for _ in range(2)
    )
    assert cold[0] == "3"
    assert cold[1] == "('compiling kernels (once per machine): 0 of about 3', 0.0)"
    assert cold[2] == "('compiling kernels (once per machine): 3 of about 3', 1.0)"
    assert warm == ["0", "None", "None"]
