"""Who asks a controller of a package is told what keeps it from answering."""

import threading

import pytest

from daemon.control.controller import ControllerError
from daemon.control.guarded_controller import in_a_thread


def test_a_question_that_waits_for_learning_to_end_says_so() -> None:
    ends = threading.Event()
    answers = in_a_thread("mine")
    answers.begin("learn", lambda: ends.wait(10.0))
    with pytest.raises(ControllerError, match="no answer within 1 ms: learn"):
        answers.ask("propose", int, 0.001)
    with pytest.raises(ControllerError, match="still busy: learn"):
        answers.ask("observe", int, 0.001)
    ends.set()


def test_a_question_that_takes_too_long_itself_is_named() -> None:
    ends = threading.Event()
    answers = in_a_thread("mine")
    with pytest.raises(ControllerError, match="no answer within 1 ms: propose"):
        answers.ask("propose", lambda: ends.wait(10.0), 0.001)
    ends.set()
