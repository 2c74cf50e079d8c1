"""Every command of the emulated tracker: what it answers, when it is allowed, how it refuses."""

import pytest

from drivers.aurora.codec.commands import encode_command
from drivers.aurora.codec.tracking_data import decode_tx
from sim_backends.devices.aurora.command_interface import TrackerMode
from sim_backends.devices.aurora.device import RULES
from tests.drivers.aurora.golden import VOLUME
from tests.sim_backends.aurora.bench import BASE, TIP, Bench

EACH = {
    "APIREV": "APIREV:",
    "BEEP": "BEEP:1",
    "BX": "BX:0801",
    "COMM": "COMM:00000",
    "DFLT": "DFLT:",
    "ECHO": "ECHO:hello",
    "GET": "GET:Device.*",
    "GETINFO": "GETINFO:Features.Firmware.Version",
    "INIT": "INIT:",
    "LED": "LED:0A1S",
    "PDIS": "PDIS:0A",
    "PENA": "PENA:0AD",
    "PHF": "PHF:0B",
    "PHINF": "PHINF:0A",
    "PHSR": "PHSR:00",
    "PINIT": "PINIT:0A",
    "PPRD": "PPRD:0A0000",
    "PPWR": "PPWR:0A0000" + "11" * 64,
    "PSEL": "PSEL:0A0000000000000001",
    "PSOUT": "PSOUT:0ANNN",
    "PSRCH": "PSRCH:0A",
    "PURD": "PURD:0A0040",
    "PUWR": "PUWR:0A0040" + "22" * 64,
    "PVWR": "PVWR:0A0000" + "33" * 64,
    "RESET": "RESET:0",
    "SAVE": "SAVE:",
    "SET": "SET:Param.System Beeper=0",
    "SFLIST": "SFLIST:03",
    "SSTAT": "SSTAT:0001",
    "TSTART": "TSTART:80",
    "TSTOP": "TSTOP:",
    "TTCFG": "TTCFG:0A",
    "TX": "TX:0801",
    "VER": "VER:0",
    "VSEL": "VSEL:1",
}
"""One call of each command that works in its mode."""

NEEDS_INIT = {"PHSR", "TSTART", "VSEL"}
TRACKING_ONLY = {"BX", "TX", "TSTOP"}
ANY_MODE = {
    "APIREV", "BEEP", "COMM", "DFLT", "ECHO", "GET", "GETINFO", "INIT", "LED", "PSOUT", "RESET",
    "SAVE", "SET", "SSTAT",
}  # fmt: skip


def reply_to(bench: Bench, text: str) -> str:
    """The reply's text, or `BX` for a binary one."""
    word, _, arguments = text.partition(":")
    bench.replies()
    bench.send(encode_command(word, arguments))
    bench.wait(0.5)
    (_, data, _) = bench.outputs[-1]
    return "BX" if data.startswith(b"\xc4\xa5") else data[:-5].decode()


def test_every_command_is_tried_here() -> None:
    assert set(EACH) == set(RULES)


@pytest.mark.parametrize("word", EACH)
def test_before_init(word: str) -> None:
    reply = reply_to(Bench(), EACH[word])
    if word in NEEDS_INIT:
        assert reply == "ERROR10"
    elif word in TRACKING_ONLY:
        assert reply == "ERROR0C"
    else:
        assert reply not in ("ERROR0C", "ERROR10", "ERROR01")


@pytest.mark.parametrize("word", EACH)
def test_in_setup(word: str) -> None:
    bench = Bench()
    bench.set_up()
    reply = reply_to(bench, EACH[word])
    assert reply == "ERROR0C" if word in TRACKING_ONLY else not reply.startswith("ERROR")


@pytest.mark.parametrize("word", EACH)
def test_while_tracking(word: str) -> None:
    bench = Bench()
    bench.set_up()
    bench.ask("TSTART:80")
    reply = reply_to(bench, EACH[word])
    allowed = word in ANY_MODE | TRACKING_ONLY
    assert not reply.startswith("ERROR") if allowed else reply == "ERROR0C"


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("NONSENSE:", "01"),
        ("PSTAT:0A", "01"),
        ("PHRQ:*********1****", "01"),
        ("BEEP:0", "23"),
        ("COMM:70000", "06"),
        ("COMM:5000", "06"),
        ("ECHO:abc", "03"),
        ("GET:No.Such.Thing", "34"),
        ("SET:Param.System Beeper", "07"),
        ("SET:Param.System Beeper=2", "36"),
        ("SET:Param.System Beeper=x", "35"),
        ("SET:Device.Type.0=PC", "39"),
        ("SET:Param.*=1", "34"),
        ("SET:No.Such.Thing=1", "34"),
        ("VER:1", "23"),
        ("VER:8", "23"),
        ("SFLIST:01", "23"),
        ("VSEL:2", "23"),
        ("PHSR:05", "23"),
        ("PHINF:0A0002", "23"),
        ("PHINF:0C0001", "08"),
        ("PINIT:0C", "08"),
        ("PENA:0AX", "09"),
        ("PENA:0AB", "09"),
        ("LED:0A4S", "0A"),
        ("LED:0A1X", "0B"),
        ("PSOUT:0AXXX", "31"),
        ("PPRD:0A0001", "23"),
        ("PPWR:0A000011", "07"),
        ("TSTART:01", "23"),
        ("RESET:2", "23"),
    ],
)
def test_what_cannot_be_done_is_refused_with_its_code(text: str, error: str) -> None:
    bench = Bench()
    bench.set_up()
    assert bench.ask(text) == f"ERROR{error}"


@pytest.mark.parametrize(
    ("data", "error"),
    [
        (b"INIT:E3A4\r", "04"),
        (b"INIT\r", "01"),
        (b"\r", "01"),
        (b"INIT:" + b"0" * 2000 + b"\r", "02"),
    ],
)
def test_broken_commands_are_refused_with_their_code(data: bytes, error: str) -> None:
    bench = Bench()
    bench.send(data)
    bench.wait(3.0)
    (reply,) = bench.replies()
    assert getattr(reply, "text", None) == f"ERROR{error}"


def test_commands_may_be_lower_case_and_without_a_checksum() -> None:
    bench = Bench()
    for data in (b"init \r", b"INIT \r", b"Init \r"):
        bench.send(data)
        bench.wait(0.1)
    assert [getattr(reply, "text", None) for reply in bench.replies()] == ["OKAY"] * 3


def test_pena_needs_an_initialised_tool() -> None:
    bench = Bench()
    bench.ask("INIT:")
    bench.ask("PHSR:00")
    assert bench.ask("PENA:0AD") == "ERROR0E"


def test_handles_go_through_their_states() -> None:
    bench = Bench()
    bench.ask("INIT:")
    assert bench.ask("PHSR:02") == "020A0010B001"
    assert bench.ask("PINIT:0A") == "OKAY"
    assert bench.ask("PHSR:02") == "010B001"
    assert bench.ask("PHSR:03") == "010A011"
    assert bench.ask("PENA:0AD") == "OKAY"
    assert bench.ask("PHSR:04") == "010A031"
    assert bench.ask("PINIT:0A") == "OKAY"
    assert bench.ask("PHSR:04") == "00"
    assert bench.ask("PHF:0A") == "OKAY"
    assert bench.ask("PHSR:00") == "020B0010C001"


def test_a_replugged_tool_gets_a_new_handle_and_the_old_one_waits_to_be_freed() -> None:
    bench = Bench()
    bench.set_up()
    bench.inject("unplug_tool=tip")
    assert bench.ask("PHSR:01") == "010A010"
    assert bench.ask("PHINF:0A0001") == "UNOCCUPIED"
    assert bench.ask("PINIT:0A") == "ERROR2C"
    bench.inject("plug_tool=tip")
    assert bench.ask("PHSR:02") == "010C001"
    assert bench.ask("PHF:0A") == "OKAY"
    assert bench.ask("PHSR:01") == "00"


def test_the_second_half_of_a_dual_sensor_shows_up_once_the_first_is_initialised() -> None:
    second = TIP.model_copy(update={"channel": 1, "attached_to": "base"})
    bench = Bench(TIP, second)
    bench.ask("INIT:")
    assert bench.ask("PHSR:02") == "010A001"
    bench.ask("PINIT:0A")
    assert bench.ask("PHSR:02") == "010B001"
    assert bench.ask("PHINF:0B0020")[-4:] == "0101"


def test_tool_information() -> None:
    bench = Bench()
    bench.set_up("0A")
    assert bench.ask("PHINF:0A") == "02000000tentacled   0013C11280131"
    assert bench.ask("PHINF:0A0004") == "610061".ljust(20)
    assert bench.ask("PHINF:0A0080") == "06020001010000010100"
    assert len(bench.ask("PHINF:0A00ED")) == 33 + 20 + 2 + 14 + 4 + 20


def test_a_blank_tool_cannot_be_initialised_until_a_definition_is_uploaded() -> None:
    bench = Bench(TIP.model_copy(update={"blank_memory": True}), BASE)
    bench.ask("INIT:")
    bench.ask("PHSR:02")
    assert bench.ask("PINIT:0A") == "ERROR13"
    assert bench.ask("PINIT:0B") == "OKAY"
    assert bench.ask("PVWR:0A0000" + "5A" * 64) == "OKAY"
    assert bench.ask("PINIT:0A") == "OKAY"


def test_a_tool_s_memory_can_be_written_once_and_read() -> None:
    bench = Bench()
    bench.set_up()
    assert bench.ask("PPRD:0A0040") == "00" * 64
    assert bench.ask("PPWR:0A0040" + "A5" * 64) == "OKAY"
    assert bench.ask("PPRD:0A0040") == "A5" * 64
    assert bench.ask("PPWR:0A0040" + "5A" * 64) == "ERROR1F"


def test_versions() -> None:
    bench = Bench(freeze_tag="AURORA Rev 008")
    assert bench.ask("APIREV:") == "D.002.005"
    assert bench.ask("VER:5") == "008"
    assert "Freeze Tag: AURORA Rev 008\n" in bench.ask("VER:0")
    assert "Freeze Tag: AURORA Rev 008.000\n" in bench.ask("VER:4")
    assert "Field Generator S/N" in bench.ask("VER:7")
    assert len(bench.ask("VER:0").split("\n")) == 7


def test_the_volume_is_the_maker_s_cube() -> None:
    assert Bench().ask("SFLIST:03") == VOLUME[:-5].decode()


def test_parameters_are_found_by_name_and_by_wildcard() -> None:
    bench = Bench()
    assert bench.ask("GET:Device.Type.1") == "Device.Type.1=FG"
    assert bench.ask("GET:SCU-0.Info.Timeout.PINIT") == "Info.Timeout.PINIT=5"
    assert bench.ask("GET:Info.Timeout.T*").split("\n") == [
        "Info.Timeout.TSTART=5",
        "Info.Timeout.TSTOP=2",
        "Info.Timeout.TX=1",
    ]
    assert bench.ask("GETINFO:Features.Firmware.Version").startswith("Features.Firmware.Version=")


def test_parameters_can_be_set_until_defaults_or_reset() -> None:
    bench = Bench()
    assert bench.ask("SET:Param.System Beeper=0") == "OKAY"
    assert bench.ask("GET:Param.System Beeper") == "Param.System Beeper=0"
    assert bench.ask("DFLT:") == "OKAY"
    assert bench.ask("GET:Param.System Beeper") == "Param.System Beeper=1"


def test_frequencies_hold_only_while_tracking() -> None:
    bench = Bench()
    bench.set_up()
    wanted = "GET:Param.Tracking.Track Frequency"
    assert bench.ask(wanted).endswith("=0")
    bench.ask("TSTART:")
    assert bench.ask(wanted).endswith("=40")
    bench.ask("TSTOP:")
    bench.ask("TSTART:40")
    assert bench.ask(wanted).endswith("=66.6667")
    assert bench.ask("GET:Param.Tracking.Frame Frequency").endswith("=320")


def test_simulated_alerts_are_new_until_they_are_read() -> None:
    bench = Bench()
    bench.set_up()
    bench.ask("TSTART:")
    assert bench.ask("SET:FG-0.Param.Simulated Alerts=2") == "OKAY"
    assert decode_tx(bench.ask("TX:0801")).system_status == 0x0100
    assert bench.ask("GET:FG-0.Info.Status.New Alerts").endswith("=2")
    assert bench.ask("GET:FG-0.Info.Status.New Alerts").endswith("=0")
    assert bench.ask("GET:FG-0.Info.Status.Alerts").endswith("=2")
    assert decode_tx(bench.ask("TX:0801")).system_status == 0x0000
    assert bench.ask("SET:FG-0.Param.Simulated Alerts=0") == "OKAY"
    assert decode_tx(bench.ask("TX:0801")).system_status == 0x0100


def test_init_ends_tracking_and_forgets_the_tools() -> None:
    bench = Bench()
    bench.set_up()
    bench.ask("TSTART:")
    assert bench.ask("INIT:") == "OKAY"
    assert bench.device.mode is TrackerMode.SETUP
    assert bench.ask("PHSR:04") == "00"


def test_tracking_without_a_field_generator_cannot_start() -> None:
    bench = Bench()
    bench.set_up()
    bench.inject("unplug_field_generator=10s")
    assert bench.ask("TSTART:") == "ERROR12"
    assert bench.ask("VER:7") == "ERROR42"
