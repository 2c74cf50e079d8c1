"""Who hears of which messages, and in which order."""

from daemon.messages import Axes, Event, Message, Tip
from daemon.service.dependencies import Subscribers
from tests.daemon.recording.synthetic_run import messages

TELEMETRY = list(messages(1, 2.0))


def first(kind: type[Message]) -> Message:
    return next(message for message in TELEMETRY if isinstance(message, kind))


def test_who_wants_all_hears_all_and_who_wants_a_kind_hears_no_other() -> None:
    subscribers = Subscribers()
    everything: list[Message] = []
    tips: list[Tip] = []
    subscribers.add(everything.append)
    subscribers.add_for(Tip, tips.append)
    for message in TELEMETRY:
        subscribers.publish(message)
    assert everything == TELEMETRY
    assert tips == [message for message in TELEMETRY if isinstance(message, Tip)]


def test_listeners_are_told_in_the_order_of_joining() -> None:
    subscribers = Subscribers()
    told: list[str] = []
    subscribers.add_for(Tip, lambda _: told.append("first"))
    subscribers.add(lambda _: told.append("second"))
    subscribers.add_for(Tip, lambda _: told.append("third"))
    subscribers.publish(first(Tip))
    subscribers.publish(first(Axes))
    assert told == ["first", "second", "third", "second"]


def test_who_joins_late_hears_of_kinds_that_there_were_before() -> None:
    subscribers = Subscribers()
    subscribers.publish(first(Event))
    events: list[Event] = []
    subscribers.add_for(Event, events.append)
    subscribers.publish(first(Event))
    assert events == [first(Event)]
