"""The emulated tracker's line and rhythm: wire time, baud rates, breaks, resets, frames, faults."""

from collections.abc import Mapping
from itertools import pairwise

import pytest

from drivers.aurora.codec.commands import encode_command
from drivers.aurora.codec.replies import BinaryReply, DamagedReply, TextReply
from drivers.aurora.codec.status_bits import HandleState
from drivers.aurora.codec.tracking_data import TrackingData, decode_bx, decode_tx
from drivers.pose import Pose
from sim_backends.devices.aurora.command_interface import TrackerMode
from sim_backends.devices.aurora.faults import FAULTS
from sim_backends.faults import FaultError
from tests.sim_backends.aurora.bench import BASE, TIP, Bench

MS = 1_000_000


def tracking(**settings: object) -> Bench:
    bench = Bench(**settings)  # type: ignore[arg-type]
    bench.set_up()
    assert bench.ask("TSTART:80") == "OKAY"
    return bench


def frame(bench: Bench, options: str = "0801") -> TrackingData:
    return decode_tx(bench.ask(f"TX:{options}"))


# The line.


@pytest.mark.parametrize("baud_rate", [9600, 115200, 921600])
def test_a_reply_takes_the_time_of_its_bytes_both_ways(baud_rate: int) -> None:
    bench = Bench(reply_delay_s=0.002)
    bench.ask("INIT:")
    code = {9600: "0", 115200: "5", 921600: "6"}[baud_rate]
    assert bench.ask(f"COMM:{code}0000") == "OKAY"
    start_ns = bench.t_ns
    bench.send(encode_command("INIT"))
    bench.wait(1.0)
    ((t_ns, data, sent_at),) = bench.outputs
    assert (data, sent_at) == (b"OKAYA896\r", baud_rate)
    assert t_ns - start_ns == pytest.approx((10 + 9) * 10e9 / baud_rate + 2 * MS, abs=2)


def test_comm_is_answered_at_the_old_rate() -> None:
    bench = Bench()
    bench.send(encode_command("COMM", "50000"))
    bench.wait(0.5)
    assert bench.outputs[0][1:] == (b"OKAYA896\r", 9600)
    assert bench.device.line.baud_rate == 115200


def test_bytes_at_a_wrong_rate_are_noise_and_spoil_the_next_command() -> None:
    bench = Bench()
    bench.send(encode_command("INIT"), 115200)
    bench.wait(0.5)
    assert bench.replies() == []
    assert bench.device.port.left_unanswered
    assert bench.ask("INIT:") == "ERROR01"
    assert bench.ask("INIT:") == "OKAY"
    assert not bench.device.port.left_unanswered


def test_rates_do_not_matter_where_that_is_configured() -> None:
    bench = Bench(strict_baud_rate=False)
    bench.send(encode_command("INIT"), 115200)
    bench.wait(0.5)
    assert bench.replies() == [TextReply("OKAY")]


def test_a_flood_of_bytes_takes_bounded_room() -> None:
    bench = Bench()
    for _ in range(200):
        bench.send(b"x" * 1000)
    assert bench.device.port._on_the_way <= 8192
    bench.wait(60.0)
    assert bench.ask("INIT:") in ("ERROR01", "ERROR02")
    assert bench.ask("INIT:") == "OKAY"


# Restarting.


@pytest.mark.parametrize("reset_time_s", [0.5, 3.0])
def test_a_break_restarts_the_device_at_9600_baud(reset_time_s: float) -> None:
    bench = tracking(reset_time_s=reset_time_s)
    bench.ask("COMM:50000")
    start_ns = bench.t_ns
    bench.device.line_break(start_ns)
    bench.wait(reset_time_s + 0.1)
    ((t_ns, data, baud_rate),) = bench.outputs
    assert (data, baud_rate) == (b"RESETBE6F\r", 9600)
    assert t_ns - start_ns == pytest.approx(reset_time_s * 1e9 + 10 * 10e9 / 9600, abs=2)
    assert bench.device.mode is TrackerMode.POWERED
    assert bench.ask("PHSR:00") == "ERROR10"


def test_a_device_that_restarts_hears_nothing() -> None:
    bench = Bench(reset_time_s=2.0)
    bench.device.line_break(0)
    assert bench.ask("INIT:") == ""
    assert bench.device.port.left_unanswered


@pytest.mark.parametrize(
    ("command", "reply", "after_s"),
    [("RESET:", "RESET", 1.1), ("RESET:1", "RESET", 1.1), ("RESET:0", "OKAY", 0.1)],
)
def test_reset_leaves_time_to_change_the_rate(command: str, reply: str, after_s: float) -> None:
    bench = Bench(reset_time_s=1.0)
    bench.ask("COMM:50000")
    start_ns = bench.t_ns
    assert bench.ask(command, wait_s=0.0) == ""
    bench.wait(3.0)
    ((t_ns, data, baud_rate),) = bench.outputs
    assert data.startswith(reply.encode())
    assert baud_rate == 9600
    assert (t_ns - start_ns) * 1e-9 == pytest.approx(after_s, abs=0.02)


# Frames.


def test_frames_come_every_25_ms_and_count_by_eight() -> None:
    bench = tracking(clock_error_ppm=0.0)
    numbers = [frame(bench).readings[0].frame_number or 0 for _ in range(5)]
    assert [b - a for a, b in pairwise(numbers)] == [160] * 4


def test_the_counter_runs_on_from_power_up_unless_told_to_start_at_zero() -> None:
    bench = Bench()
    bench.wait(100.0)
    bench.set_up()
    bench.ask("TSTART:")
    assert (frame(bench).readings[0].frame_number or 0) > 100 * 320
    bench.ask("TSTOP:")
    bench.ask("TSTART:80", wait_s=0.06)
    assert frame(bench).readings[0].frame_number in (8, 16, 24)


def test_the_same_frame_is_given_again_until_there_is_a_new_one() -> None:
    bench = tracking()
    bench.ask("COMM:60000")
    first = bench.ask("BX:0801", 0.0) or ""
    numbers = []
    for _ in range(30):
        bench.send(encode_command("BX", "0801"))
        bench.wait(0.005)
    for reply in bench.replies():
        assert isinstance(reply, BinaryReply)
        numbers.append(decode_bx(reply.body).readings[0].frame_number)
    assert first == ""
    assert len(numbers) > len(set(numbers)) > 4


def test_a_reply_can_be_held_until_there_is_a_new_frame() -> None:
    bench = tracking(hold_until_new_frame=True)
    bench.ask("COMM:60000")
    bench.replies()
    for _ in range(10):
        bench.send(encode_command("BX", "0801"))
    bench.wait(1.0)
    times = [t_ns for t_ns, _, _ in bench.outputs]
    gaps = [b - a for a, b in pairwise(times)]
    assert gaps[1:] == pytest.approx([25 * MS] * 8, rel=0.01)


def test_the_body_is_asked_for_its_poses_once_per_frame_at_its_time() -> None:
    bench = Bench(clock_error_ppm=0.0)
    asked: list[int] = []
    poses = bench.device.tracking._body_poses

    def note(t_ns: int) -> Mapping[str, Pose]:
        asked.append(t_ns)
        return poses(t_ns)

    bench.device.tracking._body_poses = note
    bench.set_up()
    bench.wait(5.0)
    assert asked == []
    bench.ask("TSTART:80", wait_s=0.0)
    bench.wait(1.0)
    assert len(asked) == 39
    assert {b - a for a, b in pairwise(asked)} == {25 * MS}


def test_the_body_stands_where_the_configuration_puts_its_base() -> None:
    quarter = (0.5**0.5, 0.0, 0.5**0.5, 0.0)  # z of the base points along x of the generator
    bench = tracking(base_position_mm=(10.0, 20.0, -300.0), base_quaternion=quarter)
    tip, base = frame(bench).readings
    assert base.position_mm == pytest.approx((10.0, 20.0, -300.0))
    assert tip.position_mm == pytest.approx((160.0, 20.0, -300.0))
    assert tip.quaternion == pytest.approx(quarter, abs=1e-4)


def test_a_tool_that_is_not_on_the_robot_lies_outside_the_volume() -> None:
    spare = TIP.model_copy(update={"attached_to": "nothing"})
    bench = Bench(spare, BASE)
    bench.set_up()
    bench.ask("TSTART:")
    (seen, _) = frame(bench, "0801").readings
    assert seen.state is HandleState.VALID
    assert seen.port_status & 0x40
    (hidden, _) = frame(bench, "0001").readings
    assert hidden.state is HandleState.MISSING
    assert hidden.port_status & 0x40


def test_a_disabled_tool_is_listed_as_such() -> None:
    bench = Bench()
    bench.set_up("0B")
    bench.ask("TSTART:")
    assert [r.state for r in frame(bench).readings] == [HandleState.DISABLED, HandleState.VALID]


# Faults.


def test_a_fault_that_makes_no_sense_now_says_so() -> None:
    bench = Bench()
    for order, message in {
        "plug_tool=tip": "plugged in already",
        "missing=1s,elbow": "no tool 'elbow' .there are: tip, base",
        "alert=1,PC-0": "no 'PC-0'",
        "hang_up=1s": "nothing is connected",
    }.items():
        with pytest.raises(FaultError, match=message):
            bench.inject(order)


@pytest.mark.parametrize("order", ["bad_crc=2", "truncated=1"])
def test_damaged_replies_are_damaged_and_then_sound_again(order: str) -> None:
    bench = tracking()
    bench.inject(order)
    count = int(order[-1])
    for _ in range(count):
        bench.send(encode_command("APIREV"))
        bench.wait(0.2)
    assert not any(isinstance(reply, TextReply) for reply in bench.replies())
    assert bench.ask("APIREV:") == "D.002.005"


@pytest.mark.parametrize("word", ["BX", "TX"])
def test_a_wrong_checksum_is_seen_in_binary_and_text(word: str) -> None:
    bench = tracking()
    bench.inject("bad_crc=1")
    bench.send(encode_command(word, "0801"))
    bench.wait(0.5)
    (reply,) = bench.replies()
    assert isinstance(reply, DamagedReply)


def test_a_fragmented_reply_comes_in_pieces() -> None:
    bench = tracking()
    bench.inject("fragmented=1")
    bench.send(encode_command("BX", "0801"))
    bench.wait(0.5)
    assert [len(data) for _, data, _ in bench.outputs][:5] == [1, 2, 3, 5, 1]
    (reply,) = bench.replies()
    assert isinstance(reply, BinaryReply)


def test_sensor_faults_show_in_their_bits() -> None:
    bench = tracking()
    for fault, bit in {
        "out_of_volume": 0x40,
        "partially_out_of_volume": 0x80,
        "broken_sensor": 0x100,
    }.items():
        bench.inject(f"{fault}=0.3s")
        bench.wait(0.05)
        assert frame(bench).readings[0].port_status == 0x31 | bit
        bench.wait(0.5)
        assert frame(bench).readings[0].port_status == 0x31


def test_system_faults_show_in_their_bits() -> None:
    bench = tracking()
    for order, bit in {
        "unplug_field_generator=0.2s": 0x20,
        "unplug_tool=tip": 0x80,
        "plug_tool=tip": 0xC0,
        "change_configuration": 0x4C0,
        "alert=1": 0x5C0,
    }.items():
        bench.inject(order)
        assert frame(bench).system_status == bit
    bench.ask("TSTOP:")
    bench.ask("PHSR:00")
    bench.ask("TSTART:")
    assert frame(bench).system_status == 0x100


def test_a_frozen_tracker_repeats_and_a_jump_jumps() -> None:
    bench = tracking()
    bench.inject("frozen=1s")
    bench.wait(0.05)
    first, second = frame(bench), frame(bench)
    assert first == second
    bench.wait(1.0)
    before = frame(bench).readings[0].frame_number or 0
    bench.inject("frame_jump=100000")
    bench.wait(0.05)
    assert (frame(bench).readings[0].frame_number or 0) - before > 100_000


def test_an_outlier_is_one_frame_and_carries_no_flag() -> None:
    bench = tracking(hold_until_new_frame=True)
    bench.ask("COMM:60000")
    bench.inject("outlier=30")
    off = []
    for _ in range(10):
        tip = decode_tx(bench.ask("TX:0801", wait_s=0.03)).readings[0]
        assert tip.position_mm is not None
        assert tip.port_status == 0x31
        off.append(sum((a - b) ** 2 for a, b in zip(tip.position_mm, (0, 0, -150), strict=True)))
    assert sorted(round(square**0.5) for square in off) == [0] * 9 + [30]


def test_every_fault_says_what_it_does() -> None:
    assert all(fault.text and fault.usage().startswith(fault.name) for fault in FAULTS)
