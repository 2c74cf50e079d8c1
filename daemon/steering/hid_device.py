"""Opens an input device and reads what it says. The only file of this folder that does.

A device of the kernel (`/dev/input/event…`) is asked for its axes by the package `evdev`. A pipe
that carries the same bytes is read as it is: a scripted hand, or one on another machine.
"""

import asyncio
import os
import stat
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Final

from daemon.steering.devices import PROFILES, Profile
from daemon.steering.input_events import EV_ABS, EV_KEY, EV_REL
from daemon.steering.station import DeviceKind

_MOST_BYTES: Final = 65536
_NEEDS_EVDEV: Final = (
    "a device of the kernel's is read with evdev, and it is not installed: in the source folder, "
    "pip install '.[steering]'"
)


class HidDeviceError(RuntimeError):
    """There is no such device to steer with. Says what to do."""


class HidDevice:
    """One open device, held by nobody else as far as the kernel can see to that."""

    def __init__(self, path: Path, profile: str | None) -> None:
        """profile: None: as the device's axes and keys look.

        Raises HidDeviceError. A pipe is waited for until somebody writes to it.
        """
        self._device: Any = None
        try:
            is_device = stat.S_ISCHR(path.stat().st_mode)
            self._fd = self._opened(path) if is_device else os.open(path, os.O_RDONLY)
        except OSError as error:
            raise HidDeviceError(f"{path}: {error.strerror or error}") from None
        name = profile or ("3d_mouse" if self._device is None else looks_like(self._device))
        if name not in PROFILES:
            raise HidDeviceError(f"{path}: name its --profile: {', '.join(PROFILES)}")
        self.kind = DeviceKind(name, self._ranges())
        os.set_blocking(self._fd, False)

    def _opened(self, path: Path) -> int:
        try:
            import evdev
        except ModuleNotFoundError:
            raise HidDeviceError(_NEEDS_EVDEV) from None
        self._device = evdev.InputDevice(str(path))
        self._device.grab()
        return int(self._device.fd)

    def _ranges(self) -> dict[int, tuple[float, float]]:
        if self._device is None:
            return {}
        absolute: Iterable[tuple[int, Any]] = self._device.capabilities().get(EV_ABS, ())
        return {code: (float(info.min), float(info.max)) for code, info in absolute}

    async def follow(self, heard: Callable[[bytes], object]) -> None:
        """Tell of what comes, until the device is unplugged, or the pipe's writer has gone."""
        loop = asyncio.get_running_loop()
        ended: asyncio.Future[None] = loop.create_future()

        def readable() -> None:
            try:
                piece = os.read(self._fd, _MOST_BYTES)
            except BlockingIOError:
                return
            except OSError:  # ENODEV: it was pulled out
                piece = b""
            if piece:
                heard(piece)
            elif not ended.done():
                ended.set_result(None)

        loop.add_reader(self._fd, readable)
        try:
            await ended
        finally:
            loop.remove_reader(self._fd)

    def close(self) -> None:
        if self._device is not None:
            self._device.close()
        else:
            os.close(self._fd)


def looks_like(device: Any) -> str:
    """Of an `evdev.InputDevice`, the profile most of whose axes there are, and the dead-man's key;
    empty: it is none of them."""
    there = device.capabilities(absinfo=False)
    codes = {(kind, code) for kind in (EV_KEY, EV_REL, EV_ABS) for code in there.get(kind, ())}

    def fits(profile: Profile) -> float:
        keys = {(EV_KEY, code) for code in profile.dead_man}
        kinds = {kind for kind, _ in profile.axes}
        alike = max(
            len(codes & (axes := {key for key in profile.axes if key[0] == kind})) / len(axes)
            for kind in kinds
        )
        return alike if keys & codes else 0.0

    best = max(PROFILES.values(), key=fits)
    return best.name if fits(best) > 0.0 else ""
