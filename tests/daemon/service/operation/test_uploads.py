"""Files that come in parts: whole ones are there, all others are refused by name."""

import asyncio
import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.messages import Upload
from daemon.remote.wire import Format, WireError, decode, encode, most_bytes
from daemon.service.motion_loader import CommandRefusedError, at_once
from daemon.service.operation.uploads import MOST_BYTES, MOST_PART_BYTES, Uploads
from tests.safety.examples import examples

CONTENT = bytes(range(256)) * 600


def parts(content: bytes = CONTENT, size: int = MOST_PART_BYTES, **other: Any) -> list[Upload]:
    """As a client sends it."""
    about = {"name": "wall.stl", "sha256": hashlib.sha256(content).hexdigest()} | other
    return [
        Upload(size_bytes=len(content), offset=begin, data=content[begin : begin + size], **about)
        for begin in range(0, len(content), size)
    ]


def refused(uploads: Uploads, part: Upload, user: str = "local") -> str:
    with pytest.raises(CommandRefusedError) as caught:
        asyncio.run(uploads.take(user, part))
    return caught.value.name


def test_a_file_is_there_when_its_last_part_has_come(tmp_path: Path) -> None:
    uploads = Uploads(lambda: tmp_path, at_once)
    told = [asyncio.run(uploads.take("local", part)) for part in parts()]
    assert told == ["49152 of 153600 bytes", "98304 of 153600 bytes", "147456 of 153600 bytes",
                    "wall.stl is there"]  # fmt: skip
    path = uploads.path(parts()[0].sha256)
    assert path.name == "wall.stl" and path.read_bytes() == CONTENT


def test_no_more_files_are_kept_however_often_one_comes_under_another_name(tmp_path: Path) -> None:
    uploads = Uploads(lambda: tmp_path, at_once)

    def kept() -> list[str]:
        return sorted(path.name for path in tmp_path.rglob("*") if path.is_file())

    for name in ("a.stl", "b.stl", "b.stl", "c.stl"):
        for part in parts(name=name):
            asyncio.run(uploads.take("local", part))
        assert kept() == [name] == [uploads.path(parts()[0].sha256).name]
    for number in range(40):
        for part in parts(bytes([number])):
            asyncio.run(uploads.take("local", part))
    assert len(kept()) == 32


@examples(50)
@given(st.binary(min_size=1, max_size=4000), st.integers(1, 700))
def test_however_it_is_cut_it_comes_whole(content: bytes, size: int) -> None:
    import tempfile

    with tempfile.TemporaryDirectory() as name:
        uploads = Uploads(lambda: Path(name), at_once)
        for part in parts(content, size):
            for form in Format:
                assert decode(encode(part, form), Upload, form) == part
            asyncio.run(uploads.take("local", part))
        assert uploads.path(parts(content)[0].sha256).read_bytes() == content


def test_one_that_was_cut_off_is_told_with_what_there_is(tmp_path: Path) -> None:
    uploads = Uploads(lambda: tmp_path, at_once)
    for part in parts()[:2]:
        asyncio.run(uploads.take("local", part))
    with pytest.raises(CommandRefusedError, match="98304 of 153600 bytes have come") as caught:
        uploads.path(parts()[0].sha256)
    assert caught.value.name == "upload_incomplete"
    asyncio.run(uploads.take("local", parts(b"another")[0]))
    with pytest.raises(CommandRefusedError) as caught:
        uploads.path(parts()[0].sha256)
    assert caught.value.name == "no_such_upload"


def test_what_is_not_what_it_was_said_to_be_is_forgotten(tmp_path: Path) -> None:
    uploads = Uploads(lambda: tmp_path, at_once)
    lying = parts(sha256="0" * 64)
    for part in lying[:-1]:
        asyncio.run(uploads.take("local", part))
    assert refused(uploads, lying[-1]) == "wrong_hash"
    assert refused(uploads, lying[-1]) == "no_such_upload"
    assert list(tmp_path.iterdir()) == []


BAD: dict[str, tuple[str, Callable[[Upload], Upload]]] = {
    "name with a folder": ("bad_mesh", lambda one: with_(one, name="../wall.stl")),
    "no mesh": ("bad_mesh", lambda one: with_(one, name="wall.exe")),
    "no hash": ("wrong_hash", lambda one: with_(one, sha256="/etc/passwd")),
    "too large": ("too_large", lambda one: with_(one, size_bytes=MOST_BYTES + 1)),
    "nothing in it": ("bad_payload", lambda one: with_(one, data=b"")),
    "too much in it": ("bad_payload", lambda one: with_(one, data=bytes(MOST_PART_BYTES + 1))),
    "before its begin": ("wrong_offset", lambda one: with_(one, offset=-1)),
    "beyond its end": ("wrong_offset", lambda one: with_(one, size_bytes=100)),
    "not the next": ("no_such_upload", lambda one: with_(one, offset=49152)),
}


def with_(part: Upload, **other: object) -> Upload:
    return msgspec.structs.replace(part, **other)


@pytest.mark.parametrize(("name", "spoil"), BAD.values(), ids=BAD)
def test_a_part_that_is_none_is_refused_by_name(
    tmp_path: Path, name: str, spoil: Callable[[Upload], Upload]
) -> None:
    assert refused(Uploads(lambda: tmp_path, at_once), spoil(parts()[0])) == name


def test_a_part_that_comes_twice_or_too_early_is_refused_and_the_file_goes_on(
    tmp_path: Path,
) -> None:
    uploads = Uploads(lambda: tmp_path, at_once)
    first, second, third, fourth = parts()
    asyncio.run(uploads.take("local", first))
    assert refused(uploads, third) == "wrong_offset"
    asyncio.run(uploads.take("local", second))
    assert refused(uploads, second) == "wrong_offset"
    for part in (third, fourth):
        asyncio.run(uploads.take("local", part))
    assert uploads.path(first.sha256).read_bytes() == CONTENT


def test_users_do_not_disturb_each_other(tmp_path: Path) -> None:
    uploads = Uploads(lambda: tmp_path, at_once)
    one, other = parts(), parts(CONTENT[::-1])
    for a, b in zip(one, other, strict=True):
        asyncio.run(uploads.take("alice", a))
        asyncio.run(uploads.take("bob", b))
    assert uploads.path(one[0].sha256).read_bytes() == CONTENT
    assert uploads.path(other[0].sha256).read_bytes() == CONTENT[::-1]


def test_old_ones_make_room(tmp_path: Path) -> None:
    uploads = Uploads(lambda: tmp_path, at_once)
    sent = [parts(bytes([number]))[0] for number in range(40)]
    for part in sent:
        asyncio.run(uploads.take("local", part))
    assert uploads.path(sent[-1].sha256).read_bytes() == bytes([39])
    with pytest.raises(CommandRefusedError, match="nothing was uploaded"):
        uploads.path(sent[0].sha256)
    assert len(list(tmp_path.rglob("wall.stl"))) == 32


def test_a_part_fits_into_a_message_in_both_formats() -> None:
    part = parts()[0]
    for form in Format:
        assert len(encode(part, form)) <= most_bytes(Upload)


def test_bytes_stand_nowhere_else_in_a_message() -> None:
    raw = {"type": "upload/1", "name": b"wall.stl", "sha256": "", "size_bytes": 1, "offset": 0}
    payload = msgspec.msgpack.encode({**raw, "data": b"x"})
    with pytest.raises(WireError, match=r"a bytes has no place at \$.name"):
        decode(payload, Upload)
