"""What the device says about its handles, tools, volumes, versions and parameters."""

from collections.abc import Callable
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.aurora.codec.errors import CodecError
from drivers.aurora.codec.parameters import (
    decode_parameters,
    device_names,
    encode_parameters,
    timeouts_s,
)
from drivers.aurora.codec.replies import TextReply, encode_text_reply
from drivers.aurora.codec.reply_reader import ReplyReader
from drivers.aurora.codec.status_bits import PortStatus
from drivers.aurora.codec.tool_information import (
    Fields,
    Identity,
    PortHandle,
    PortLocation,
    SensorLocation,
    Sensors,
    ToolInformation,
    decode_port_handles,
    decode_tool_information,
    encode_port_handles,
    encode_tool_information,
)
from drivers.aurora.codec.versions import ApiRevision, VersionText, encode_version_text
from drivers.aurora.codec.volumes import Volume, decode_volumes, encode_volumes
from tests.drivers.aurora.golden import IDENTITY, VOLUME

byte = st.integers(0, 0xFF)
printable = st.characters(min_codepoint=0x21, max_codepoint=0x7E)


def text_of(data: bytes) -> str:
    (reply,) = ReplyReader().feed(data)
    assert isinstance(reply, TextReply)
    return reply.text


FRESH = PortStatus.OCCUPIED
ENABLED = PortStatus.OCCUPIED | PortStatus.INITIALISED | PortStatus.ENABLED


@pytest.mark.parametrize(
    ("text", "handles"),
    [
        ("00", ()),
        ("010A001", (PortHandle(0x0A, FRESH),)),
        ("020A0010B001", (PortHandle(0x0A, FRESH), PortHandle(0x0B, FRESH))),
        ("020A0310B031", (PortHandle(0x0A, ENABLED), PortHandle(0x0B, ENABLED))),
    ],
)
def test_known_handle_lists_both_ways(text: str, handles: tuple[PortHandle, ...]) -> None:
    assert decode_port_handles(text) == handles
    assert encode_port_handles(handles) == text


@given(st.lists(st.builds(PortHandle, byte, st.integers(0, 0xFFF).map(PortStatus)), max_size=40))
def test_handle_lists_come_back_as_they_were(handles: list[PortHandle]) -> None:
    assert list(decode_port_handles(encode_port_handles(handles))) == handles


def test_a_known_identity_both_ways() -> None:
    information = decode_tool_information(text_of(IDENTITY), Fields.IDENTITY)
    assert information == ToolInformation(
        identity=Identity(0x02, "000000", "NDI", "001", "3C112801", ENABLED)
    )
    assert encode_text_reply(encode_tool_information(information)) == IDENTITY


padded = st.text(printable, max_size=3)
tool_information = st.builds(
    ToolInformation,
    identity=st.none()
    | st.builds(
        Identity,
        byte,
        st.text(printable, min_size=6, max_size=6),
        st.text(printable, max_size=12),
        st.text(printable, min_size=3, max_size=3),
        st.integers(0, 2**32 - 1).map("{:08X}".format),
        byte.map(PortStatus),
    ),
    part_number=st.none() | st.text(printable, max_size=20),
    accessories=st.none() | byte,
    port=st.none()
    | st.builds(PortLocation, st.text(printable, min_size=8, max_size=8), byte, byte),
    switches=st.none() | st.text(printable, min_size=4, max_size=4),
    sensors=st.none()
    | st.builds(
        Sensors,
        byte,
        st.lists(st.builds(SensorLocation, byte, byte, byte, byte), max_size=4).map(tuple),
    ),
)


@given(tool_information)
def test_tool_information_comes_back_as_it_was_whichever_fields_were_asked_for(
    information: ToolInformation,
) -> None:
    fields = Fields(0)
    for field, value in {
        Fields.IDENTITY: information.identity,
        Fields.PART_NUMBER: information.part_number,
        Fields.ACCESSORIES: information.accessories,
        Fields.PORT: information.port,
        Fields.SWITCHES: information.switches,
        Fields.SENSORS: information.sensors,
    }.items():
        fields |= field if value is not None else Fields(0)
    assert decode_tool_information(encode_tool_information(information), fields) == information


def test_a_tool_that_is_gone_has_no_information() -> None:
    assert decode_tool_information("UNOCCUPIED", Fields.IDENTITY) is None
    assert encode_tool_information(None) == "UNOCCUPIED"


CUBE = Volume("cube", (-250.0, 250.0, -250.0, 250.0, -550.0, -50.0, 0.0, 0.0, 0.0, 0.0))


def test_a_known_volume_both_ways() -> None:
    assert decode_volumes(text_of(VOLUME)) == (CUBE,)
    assert encode_text_reply(encode_volumes([CUBE])) == VOLUME


@given(
    st.lists(
        st.builds(
            Volume,
            st.sampled_from(["cube", "dome"]),
            st.lists(
                st.integers(-999999, 999999).map(lambda n: n / 100.0), min_size=10, max_size=10
            ).map(tuple),
            st.sampled_from([None, True, False]),
        ),
        min_size=1,
        max_size=15,
    )
)
def test_volumes_come_back_as_they_were(volumes: list[Volume]) -> None:
    assert list(decode_volumes(encode_volumes(volumes))) == volumes


def test_revisions_both_ways_and_in_order() -> None:
    revision = ApiRevision.decode("D.002.005")
    assert (revision.family, revision.major, revision.minor) == ("D", 2, 5)
    assert str(revision) == "D.002.005"
    assert ApiRevision.decode("D.001.008") < revision


def test_version_text_gives_its_named_lines() -> None:
    text = encode_version_text(["Something", "NDI S/N: SCd-1", "Freeze Tag: AURORA Rev 008"])
    version = VersionText.decode(text)
    assert version.value("Freeze Tag") == "AURORA Rev 008"
    assert version.value("NDI S/N") == "SCd-1"
    assert version.value("Something") == version.value("absent") == ""


def test_parameters_both_ways() -> None:
    parameters = {"Device.Type.0": "SCU", "Device.Instance.0": "0", "Empty": "", "Formula": "a=b"}
    assert decode_parameters(encode_parameters(parameters)) == parameters
    assert not encode_parameters(parameters).endswith("\n")


def test_components_are_named_in_spite_of_gaps_in_their_numbers() -> None:
    text = "Device.Type.0=SCU\nDevice.Instance.0=0\nDevice.Type.3=SIU\nDevice.Instance.3=1"
    assert device_names(decode_parameters(text)) == ("SCU-0", "SIU-1")


def test_timeouts_are_told_by_command() -> None:
    text = "Info.Timeout.PINIT=5\nSCU-0.Info.Timeout.TSTART=7\nInfo.Timeout.ODD=soon\nOther=1"
    assert timeouts_s(decode_parameters(text)) == {"PINIT": 5.0, "TSTART": 7.0}


DECODERS: list[Callable[[str], object]] = [
    decode_port_handles,
    lambda text: decode_tool_information(text, Fields.IDENTITY | Fields.SENSORS),
    lambda text: decode_tool_information(text, Fields.PART_NUMBER | Fields.PORT),
    decode_volumes,
    ApiRevision.decode,
    VersionText.decode,
    decode_parameters,
]


@pytest.mark.parametrize("decode", DECODERS)
@given(text=st.one_of(st.text(max_size=120), st.text("0123456789ABCDEF+-.=\n", max_size=120)))
def test_any_text_gives_content_or_the_codec_s_own_error(
    decode: Callable[[str], object], text: str
) -> None:
    with suppress(CodecError):
        decode(text)


@pytest.mark.parametrize("text", ["+A", "0_", " 1", "0x", "１0"])
def test_what_python_forgives_in_a_number_is_no_hex_digit(text: str) -> None:
    with pytest.raises(CodecError):
        decode_port_handles(text)
