"""Tracking against the emulated tracker: every frame, young, dated right, and reproducible."""

import asyncio
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from config.emulation.lab import EmulatedTool
from config.tracker import ToolSelector
from drivers.aurora.frame import TrackerFrame
from sim_backends.virtual_time import run_in_virtual_time
from tests.drivers.aurora.rig import (
    BASE,
    EXACT,
    TIP,
    Rig,
    configured,
    emulated,
    measured_s,
    running,
    until_tracking,
)

FOUR = (
    TIP,
    BASE,
    EmulatedTool(attached_to="base", port=3, serial="0000CAFE"),
    EmulatedTool(attached_to="tip", port=4, serial="0000F00D", degrees_of_freedom=5),
)
FOUR_ROLES = {
    "tip": ToolSelector(port=1),
    "base": ToolSelector(port=2),
    "elbow": ToolSelector(port=3),
    "needle": ToolSelector(port=4),
}


def track(seconds: float = 20.0, **settings: Any) -> Rig:
    async def main() -> Rig:
        rig = Rig(**settings)
        async with running(rig):
            await until_tracking(rig)
            await asyncio.sleep(seconds)
            assert rig.holding() == set()
        return rig

    return run_in_virtual_time(main())


def rate_hz(frames: list[TrackerFrame]) -> float:
    return (len(frames) - 1) / ((frames[-1].t_ns - frames[0].t_ns) * 1e-9)


def ages_ms(frames: list[TrackerFrame]) -> np.ndarray:
    """From measurement to the complete reply. The poses tell when they were measured."""
    return np.array([((f.received_ns * 1e-9 - measured_s(f)) % 100.0) * 1e3 for f in frames])


def dating_errors_ms(frames: list[TrackerFrame]) -> np.ndarray:
    wrapped = [(f.t_ns * 1e-9 - measured_s(f) + 50.0) % 100.0 - 50.0 for f in frames]
    return np.array(wrapped) * 1e3


@pytest.mark.parametrize("reply_format", ["binary", "text"])
@pytest.mark.parametrize("hold", [False, True])
def test_every_frame_of_two_sensors_comes_at_115200_baud(reply_format: str, hold: bool) -> None:
    rig = track(
        device_config=emulated(hold_until_new_frame=hold, **EXACT),
        config=configured(reply_format=reply_format),
    )
    counters = rig.tracker.status.counters
    assert counters.missed == 0
    assert rate_hz(rig.frames) == pytest.approx(40.0, abs=0.01)
    assert len(rig.frames) >= 800
    assert {b.frame_number - a.frame_number for a, b in pairwise(rig.frames)} == {8}
    assert counters.duplicates <= 0.03 * counters.frames


def test_every_frame_of_four_sensors_comes_at_115200_baud() -> None:
    rig = track(
        device_config=emulated(*FOUR, **EXACT), config=configured(tools=FOUR_ROLES), seconds=60.0
    )
    assert rig.tracker.status.counters.missed <= 1
    assert rate_hz(rig.frames) == pytest.approx(40.0, abs=0.05)
    assert set(rig.frames[-1].tools) == set(FOUR_ROLES)


@pytest.mark.parametrize("baud_rate", [230400, 921600])
def test_fast_mode_gives_every_frame_at_66_hz(baud_rate: int) -> None:
    rig = track(config=configured(baud_rate=baud_rate, frame_rate="fast"))
    assert rig.tracker.status.counters.missed == 0
    assert rate_hz(rig.frames) == pytest.approx(1000.0 / 15.0, abs=0.05)


def test_a_line_that_is_too_slow_gives_what_it_can_and_says_so() -> None:
    async def main() -> None:
        rig = Rig(config=configured(baud_rate=9600))
        async with running(rig):
            await until_tracking(rig)
            await asyncio.sleep(20.0)
            assert rig.holding() == {"frames_missed"}
        assert rate_hz(rig.frames) == pytest.approx(1.0 / 0.1135, rel=0.05)
        frames = rig.tracker.status.counters
        assert frames.missed == pytest.approx(40.0 * 20.0 - frames.frames, rel=0.05)

    run_in_virtual_time(main())


@pytest.mark.parametrize(
    ("baud_rate", "wire_ms"), [(115200, 95 * 10 / 115.2), (921600, 95 * 10 / 921.6)]
)
def test_frames_are_young_when_they_come(baud_rate: int, wire_ms: float) -> None:
    """All that is left is the reply's time on the wire and half a millisecond."""
    rig = track(config=configured(baud_rate=baud_rate))
    ages = ages_ms(rig.frames[200:])
    assert np.median(ages) < wire_ms + 0.8
    assert np.percentile(ages, 95) < wire_ms + 1.5
    assert ages.max() < 25.0


@pytest.mark.parametrize(("ppm", "hold"), [(25.0, False), (100.0, True), (-100.0, False)])
def test_frames_are_dated_to_within_a_millisecond(ppm: float, hold: bool) -> None:
    """The device's own reply delay cannot be seen from outside; here it adds up to 2 ms."""
    device = emulated(clock_error_ppm=ppm, hold_until_new_frame=hold, **EXACT)
    errors = dating_errors_ms(track(40.0, device_config=device).frames[400:])
    assert np.ptp(errors) < 0.6
    assert errors.min() > -0.1
    assert errors.max() < 1.0


def test_a_latency_that_was_measured_on_the_rig_is_taken_off() -> None:
    plain = track(5.0).frames[100].t_ns
    corrected = track(5.0, config=configured(acquisition_latency_s=0.01)).frames[100].t_ns
    assert corrected == plain - 10_000_000


def test_frame_times_always_go_forwards_and_precede_their_arrival() -> None:
    frames = track(device_config=emulated()).frames
    assert all(b.t_ns > a.t_ns for a, b in pairwise(frames))
    assert all(f.t_ns < f.received_ns for f in frames)


def test_the_same_seed_gives_the_same_samples_to_the_last_bit() -> None:
    def run(seed: int) -> tuple[list[tuple[Any, ...]], list[Any]]:
        rig = track(10.0, device_config=emulated(outliers_per_s=1.0), seed=seed)
        samples = [
            (f.frame_number, f.t_ns, f.received_ns, *f.tip.position_mm, *f.tip.quaternion)
            for f in rig.frames
            if f.tip is not None
        ]
        return samples, rig.traffic

    first, second, other = run(3), run(3), run(4)
    assert first == second
    assert first[0] != other[0]


def test_all_traffic_is_handed_to_the_recorder() -> None:
    rig = track(2.0)
    replies = b"".join(data for direction, data, _ in rig.traffic if direction == "from_device")
    assert replies.count(b"\xc4\xa5") >= len(rig.frames)
    assert b"OKAYA896\r" in replies
    times = [t_ns for _, _, t_ns in rig.traffic]
    assert times == sorted(times)


def test_a_tool_without_a_role_is_neither_enabled_nor_reported() -> None:
    rig = track(2.0, device_config=emulated(*FOUR, **EXACT))
    assert set(rig.frames[-1].tools) == {"tip", "base"}
    assert b"PENA:0C" not in b"".join(rig.sent())
    assert len(rig.tracker.status.tools.plugged) == 4
