"""Only the page in control keeps the lease alive, and only while it is heard."""

from daemon.dashboard.robot_link import HEARD_WITHIN_S, PageControl


def test_a_page_that_is_not_heard_is_no_operator() -> None:
    control = PageControl()
    assert not control.alive(0.0) and not control.heard("a", 0.0)
    assert control.take("a", 0.0) == ""
    assert control.alive(HEARD_WITHIN_S) and not control.alive(HEARD_WITHIN_S + 0.01)
    assert control.heard("a", 5.0) and control.alive(5.1)


def test_another_page_s_heart_keeps_nothing_alive() -> None:
    control = PageControl()
    control.take("a", 0.0)
    assert not control.heard("b", 5.0) and not control.heard("", 5.0)
    assert not control.alive(5.0)


def test_who_takes_over_has_it_alone() -> None:
    control = PageControl()
    control.take("a", 0.0)
    assert control.take("a", 0.1) == ""
    assert control.take("b", 0.2) == "a"
    assert not control.heard("a", 0.3) and not control.give("a") and control.heard("b", 0.3)
    assert control.give("b") and not control.alive(0.3) and not control.give("")
