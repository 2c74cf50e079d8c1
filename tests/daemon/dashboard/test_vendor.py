"""What is vendored is what npm has, to the byte, with its licence; nothing is asked of others."""

import hashlib
import re

from daemon.dashboard.server import _STATIC

VENDOR = _STATIC / "vendor"


def test_vendored_files_are_those_that_were_fetched() -> None:
    listed = dict(
        re.findall(r"(?m)^    ([0-9a-f]{64})  (\S+)$", (VENDOR / "VENDOR.md").read_text())
    )
    named = {path: hash_ for hash_, path in listed.items()}
    there = {
        path.relative_to(VENDOR).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in VENDOR.glob("*/*")
    }
    assert there == named and len(there) == 7


def test_every_package_has_its_licence_beside_it() -> None:
    for package in ("three", "uplot"):
        assert "MIT" in (VENDOR / package / "LICENSE").read_text()


def test_our_own_modules_name_no_other_host_and_write_no_markup() -> None:
    own = [path for path in _STATIC.iterdir() if path.is_file()]
    assert len(own) > 5
    for path in own:
        text = path.read_text()
        assert not re.search(r"https?://", text), path
        for word in ("innerHTML", "outerHTML", "insertAdjacentHTML", "eval(", " style="):
            assert word not in text, (path, word)
