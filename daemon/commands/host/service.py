"""`tentacled service --print | --write DIR`: what makes the daemon a service of a Linux machine.

A systemd unit with this installation's own program, udev rules, and the CAN interfaces of
systemd-networkd. Nothing is installed: the commands that do it are shown.
"""

import argparse
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from shlex import quote
from typing import Final

from config.loader import load_robot
from config.robot import Robot
from daemon.commands.outcome.result import Result
from daemon.files import make_folder
from daemon.robot.shipped_files import file_argument

_BITRATE: Final = 1_000_000
_PLAIN: Final = re.compile(r"[\w./@:+=-]+")
"""What is one word by itself."""
_PROTECTED: Final = ("/home", "/root", "/run/user")
"""By `ProtectHome=yes`, after systemd.exec(5)."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--print", action="store_true", help="all of them, with their names")
    what.add_argument("--write", type=Path, metavar="DIR", help="into this folder")
    parser.add_argument(
        "--robot",
        type=file_argument("robots"),
        metavar="ROBOT.yaml",
        help="whose CAN interfaces are set up (else can0 with 1 Mbit/s)",
    )


def run(arguments: argparse.Namespace) -> Result:
    robot = None if arguments.robot is None else load_robot(arguments.robot).robot
    files = service_files(_program(), robot)
    shown = [f"# {name}\n{text}" for name, text in files.items()] if arguments.print else []
    folder = Path("DIR") if arguments.print else arguments.write
    if not arguments.print:
        make_folder(folder)
        for name, text in files.items():
            (folder / name).write_text(text, encoding="utf-8")
    commands = _commands(folder, files, "NAME" if robot is None else robot.robot)
    told = {"folder": folder, "files": files, "commands": commands.splitlines()}
    return Result(told, "\n".join([*shown, commands]))


def service_files(program: Sequence[str], robot: Robot | None = None) -> dict[str, str]:
    """Each file's text by its name. program: what starts `tentacled`, word by word, the first one
    with its whole path."""
    files = {
        "tentacled@.service": _UNIT.replace("PROGRAM", " ".join(map(_for_systemd, program))),
        "90-tentacled.rules": _RULES,
    }
    for interface, bitrate in _interfaces(robot).items():
        values = {"INTERFACE": interface, "BITRATE": str(bitrate)}
        for kind, text in (("link", _LINK), ("network", _NETWORK)):
            for key, value in values.items():
                text = text.replace(key, value)
            files[f"80-tentacled-{interface}.{kind}"] = text
    return files


def _interfaces(robot: Robot | None) -> dict[str, int]:
    if robot is None:
        return {"can0": _BITRATE}
    buses = robot.buses.values()
    return {bus.channel: bus.bitrate_bit_s for bus in buses if bus.interface == "socketcan"}


def _for_systemd(word: str) -> str:
    """One word of a command, after systemd.service(5). No program has quotes in its path there."""
    escaped = word.replace("%", "%%")
    return escaped if _PLAIN.fullmatch(word) else f'"{escaped}"'


def _program() -> list[str]:
    """The command that this interpreter's environment has; else the interpreter and our module."""
    command = Path(sys.executable).parent / "tentacled"
    module = [sys.executable, "-m", "daemon.commands.terminal.command_line"]
    return [str(command)] if command.is_file() else module


def _out_of_sight() -> str:
    """Which of what the program is made of lies where the service sees nothing; empty: none."""
    python = Path(sys.executable)
    for place in (python, python.resolve()):
        if any(place.is_relative_to(hidden) for hidden in _PROTECTED):
            return str(place)
    return ""


def _commands(folder: Path, files: dict[str, str], name: str) -> str:
    network = " ".join(quote(str(folder / one)) for one in files if one.startswith("80-"))
    unit, rules = (quote(str(folder / one)) for one in ("tentacled@.service", "90-tentacled.rules"))
    hidden = _out_of_sight()
    lines = [
        f"# {hidden} lies in a home folder, which the service cannot see: install tentacled "
        "elsewhere first, in /opt/tentacled for one, and let that one write these files"
        if hidden
        else "",
        "# to install them; the robot file belongs to /etc/tentacled/" + f"{name}.yaml",
        "sudo useradd --system --user-group --groups dialout tentacled",
        f"sudo install -m 644 {unit} /etc/systemd/system/",
        f"sudo install -m 644 {rules} /etc/udev/rules.d/",
        f"sudo install -m 644 {network} /etc/systemd/network/" if network else "",
        f"sudo systemctl daemon-reload && sudo systemctl enable --now tentacled@{name}",
    ]
    return "\n".join(line for line in lines if line)


_UNIT: Final = """\
[Unit]
Description=tentacled, the control daemon of %i
After=network.target
StartLimitIntervalSec=60
StartLimitBurst=3

[Service]
Type=notify
NotifyAccess=main
ExecStart=PROGRAM run /etc/tentacled/%i.yaml --log journal --runtime-dir %t/tentacled/%i \\
    --runs %S/tentacled/%i
User=tentacled
SupplementaryGroups=dialout
UMask=0027
# Kernels are compiled at the first start.
TimeoutStartSec=300
# Fed by every sound bus cycle; the drives have stopped by themselves long before.
WatchdogSec=2
WatchdogSignal=SIGABRT
TimeoutAbortSec=2
KillMode=mixed
TimeoutStopSec=5
Restart=on-failure
RestartSec=2
# Wrong usage and wrong files are not mended by starting again.
RestartPreventExitStatus=64 65 78
Environment=PYTHONFAULTHANDLER=1 PYTHONUNBUFFERED=1 PYTHONSAFEPATH=1
# Places to write for a read-only installation: compiled kernels, distance grids, models.
Environment=NUMBA_CACHE_DIR=%C/tentacled/numba XDG_CACHE_HOME=%C XDG_DATA_HOME=%S/tentacled/%i
RuntimeDirectory=tentacled/%i
RuntimeDirectoryMode=0750
StateDirectory=tentacled/%i
CacheDirectory=tentacled
LimitRTPRIO=60
LimitMEMLOCK=infinity
LimitCORE=0
OOMScoreAdjust=-900
NoNewPrivileges=yes
CapabilityBoundingSet=
ProtectSystem=strict
ProtectHome=yes
PrivateTmp=yes
ProtectKernelTunables=yes
ProtectKernelModules=yes
ProtectKernelLogs=yes
ProtectControlGroups=yes
ProtectClock=yes
ProtectHostname=yes
ProtectProc=invisible
RestrictNamespaces=yes
RestrictSUIDSGID=yes
LockPersonality=yes
SystemCallArchitectures=native
SystemCallFilter=@system-service
SystemCallErrorNumber=EPERM
RestrictAddressFamilies=AF_UNIX AF_INET AF_INET6 AF_CAN AF_NETLINK

[Install]
WantedBy=multi-user.target
"""
# MemoryDenyWriteExecute, RestrictRealtime and PrivateDevices stay off: compiled kernels, the loop's
# priority and serial ports need what they take.

_RULES: Final = """\
# Serial adapters: replies at once instead of after 16 ms, and no modem manager that asks them.
ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTR{latency_timer}="1"
ACTION=="add", SUBSYSTEM=="tty", KERNEL=="ttyUSB[0-9]*|ttyACM[0-9]*", ENV{ID_MM_DEVICE_IGNORE}="1"
# Processors that do not sleep deeply while drives are energised.
SUBSYSTEM=="misc", KERNEL=="cpu_dma_latency", GROUP="dialout", MODE="0660"
"""

_LINK: Final = """\
[Match]
OriginalName=INTERFACE

[Link]
TransmitQueueLength=128
"""

_NETWORK: Final = """\
[Match]
Name=INTERFACE

[CAN]
BitRate=BITRATE
RestartSec=100ms
"""
