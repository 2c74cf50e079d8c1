"""Who hears of which messages, and in which order."""

from daemon.messages import Axes, Event, Message, Tip
from daemon.service.audience import Audience
from tests.daemon.recording.synthetic_run import messages

TELEMETRY = list(messages(1, 2.0))


def first(kind: type[Message]) -> Message:
    return next(message for message in TELEMETRY if isinstance(message, kind))


def test_who_wants_all_hears_all_and_who_wants_a_kind_hears_no_other() -> None:
    audience = Audience()
    everything: list[Message] = []
    tips: list[Tip] = []
    audience.add(everything.append)
    audience.add_for(Tip, tips.append)
    for message in TELEMETRY:
        audience.tell(message)
    assert everything == TELEMETRY
    assert tips == [message for message in TELEMETRY if isinstance(message, Tip)]


def test_listeners_are_told_in_the_order_of_joining() -> None:
    audience = Audience()
    told: list[str] = []
    audience.add_for(Tip, lambda _: told.append("first"))
    audience.add(lambda _: told.append("second"))
    audience.add_for(Tip, lambda _: told.append("third"))
    audience.tell(first(Tip))
    audience.tell(first(Axes))
    assert told == ["first", "second", "third", "second"]


def test_who_joins_late_hears_of_kinds_that_there_were_before() -> None:
    audience = Audience()
    audience.tell(first(Event))
    events: list[Event] = []
    audience.add_for(Event, events.append)
    audience.tell(first(Event))
    assert events == [first(Event)]
