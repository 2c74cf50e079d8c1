"""Timers of the bus and its nodes."""

from sim_backends.devices.can.bus import CanBus


def test_a_timer_fires_once_at_its_time() -> None:
    bus, fired = CanBus(1_000_000), list[int]()
    timer = bus.queue.timer(fired.append)
    timer.set(1000)
    assert timer.running
    assert bus.advance(999) == 1000
    assert fired == []
    assert bus.advance(5000) is None
    assert fired == [1000]
    assert not timer.running


def test_a_deadline_can_be_moved_either_way() -> None:
    bus, fired = CanBus(1_000_000), list[int]()
    timer = bus.queue.timer(fired.append)
    timer.set(1000)
    timer.set(3000)
    bus.advance(2000)
    assert fired == []
    timer.set(2500)
    bus.advance(10_000)
    assert fired == [2500]


def test_a_cancelled_timer_does_not_fire_and_can_be_set_again() -> None:
    bus, fired = CanBus(1_000_000), list[int]()
    timer = bus.queue.timer(fired.append)
    timer.set(1000)
    timer.cancel()
    bus.advance(2000)
    timer.set(3000)
    bus.advance(4000)
    assert fired == [3000]


def test_timers_fire_in_order_however_late_the_bus_is_told() -> None:
    bus, fired = CanBus(1_000_000), list[tuple[str, int]]()
    for name, at in (("late", 3000), ("early", 1000), ("same", 3000)):
        bus.queue.timer(lambda t_ns, name=name: fired.append((name, t_ns))).set(at)  # type: ignore[misc]
    bus.advance(1_000_000)
    assert fired == [("early", 1000), ("late", 3000), ("same", 3000)]


def test_a_timer_can_set_itself_again() -> None:
    bus, fired = CanBus(1_000_000), list[int]()

    def again(t_ns: int) -> None:
        fired.append(t_ns)
        timer.set(t_ns + 100)

    timer = bus.queue.timer(again)
    timer.set(100)
    assert bus.advance(350) == 400
    assert fired == [100, 200, 300]


def test_moving_a_deadline_with_every_frame_leaves_no_entries_behind() -> None:
    bus = CanBus(1_000_000)
    timer = bus.queue.timer(lambda _: None)
    for at in range(1000, 100_000):
        timer.set(at)
    assert len(bus.queue.heap) == 1
