"""`tentacled surroundings`: what is round the body; with options, what is to be there instead."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from config.documents.problems import ConfigError
from config.documents.yaml_document import read_yaml
from config.paths import BUILTIN
from daemon.commands.outcome.failures import CommandError, UsageError
from daemon.commands.outcome.result import Result
from daemon.commands.terminal.argument_types import seconds, so_many, take_negative_numbers
from daemon.commands.terminal.remote_arguments import (
    add_target_arguments,
    answer_result,
    as_json,
    run_talk,
)
from daemon.messages import Surroundings

if TYPE_CHECKING:
    from daemon.remote.client.client import RobotClient

_EXPLAINED: Final = """\
Without options: what the daemon asks its risk with. With some, that is replaced
while nothing moves; the lease is needed. Meshes are sent, checked and prepared;
until all is well, everything stays as it is. Coordinates are mm in the base
sensor's frame. A mesh replaces all that was there, the port excepted.
"""
_REGIONS: Final = {
    "ball": ("X,Y,Z,RADIUS", {"centre_mm": 3, "radius_mm": 1}),
    "box": ("X,Y,Z,DX,DY,DZ", {"centre_mm": 3, "size_mm": 3}),
    "capsule": ("X,Y,Z,X,Y,Z,RADIUS", {"from_mm": 3, "to_mm": 3, "radius_mm": 1}),
    "cylinder": ("X,Y,Z,X,Y,Z,RADIUS", {"from_mm": 3, "to_mm": 3, "radius_mm": 1}),
    "half-space": ("X,Y,Z,NX,NY,NZ", {"point_mm": 3, "normal": 3}),
}
"""Options, and how many numbers of each go where."""
_PORT: Final = {"centre_mm": 3, "inwards": 3, "radius_mm": 1, "depth_mm": 1}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.epilog, parser.formatter_class = _EXPLAINED, argparse.RawDescriptionHelpFormatter
    take_negative_numbers(parser)
    add_target_arguments(parser)
    instead = parser.add_mutually_exclusive_group()
    instead.add_argument(
        "--mesh", type=Path, action="append", default=[], metavar="FILE",
        help="STL, OBJ or PLY; said again, one more body",
    )  # fmt: skip
    instead.add_argument(
        "--file", type=Path, metavar="FILE.yaml", help="all of it, as `risk.surface` in robot files"
    )
    instead.add_argument("--reset", action="store_true", help="those of the robot file again")
    parser.add_argument(
        "--add", action="store_true", help="keep what is there (so do regions without a mesh)"
    )
    parser.add_argument("--unit", choices=("mm", "cm", "m", "in"), default="mm", help="of --mesh")
    parser.add_argument("--free", choices=("inside", "outside"), help="side of --mesh")
    port = parser.add_mutually_exclusive_group()
    port.add_argument(
        "--port", type=so_many(8, "X,Y,Z,DX,DY,DZ,RADIUS,DEPTH"), metavar="X,Y,...",
        help="with --mesh: where the body comes in, X,Y,Z,DX,DY,DZ,RADIUS,DEPTH",
    )  # fmt: skip
    port.add_argument("--no-port", action="store_true", help="with --mesh: nowhere")
    for kind, (names, parts) in _REGIONS.items():
        parser.add_argument(
            f"--{kind}", type=so_many(sum(parts.values()), names), action="append", default=[],
            metavar="X,Y,...", help=f"a region to keep out of, {names}; may be said again",
        )  # fmt: skip
    parser.add_argument("--keep-in", action="store_true", help="keep in these regions instead")
    parser.add_argument(
        "--timeout",
        type=seconds,
        default=150.0,
        metavar="S",
        help="how long to wait for the answer",
    )


def run(arguments: argparse.Namespace) -> Result:
    regions = _regions(arguments)
    content = _content(arguments.file) if arguments.file is not None else None
    if wrong := _wrong_usage(arguments, regions):
        raise UsageError(wrong)

    async def talk(client: "RobotClient") -> Result:
        if not (arguments.mesh or regions or content is not None or arguments.reset):
            about, _ = await client.surroundings()
            return Result(as_json(about), _told(about))
        if arguments.reset:
            return answer_result(await client.surround(within_s=arguments.timeout))
        if content is not None:
            surface, folder = dict(content), arguments.file.parent
        else:
            surface, folder = await _of_meshes(arguments, client), Path()
        surface["regions"] = [*surface.get("regions", []), *regions]
        add = arguments.add or not (arguments.mesh or content is not None)
        sent = await _sent(client, surface, folder)
        return answer_result(await client.surround(sent, add=add, within_s=arguments.timeout))

    return run_talk(arguments, talk)


async def _of_meshes(arguments: argparse.Namespace, client: "RobotClient") -> dict[str, Any]:
    bodies = [{"mesh": str(path), "unit": arguments.unit} for path in arguments.mesh]
    if arguments.add or not bodies:
        return {"bodies": bodies}
    surface: dict[str, Any] = {**bodies[0], "bodies": bodies[1:]}
    if arguments.free is not None:
        surface["free"] = arguments.free
    if arguments.port is not None:
        surface["port"] = _named(arguments.port, _PORT)
    elif not arguments.no_port:
        about, _ = await client.surroundings()
        surface["port"] = about.port
    return surface


async def _sent(client: "RobotClient", surface: dict[str, Any], folder: Path) -> dict[str, Any]:
    """With the names of uploaded files. Raises CommandError."""
    bodies = [await _mesh_sent(client, one, folder) for one in surface.get("bodies", [])]
    sent = {**surface, "bodies": bodies}
    return await _mesh_sent(client, sent, folder) if "mesh" in surface else sent


async def _mesh_sent(client: "RobotClient", one: Any, folder: Path) -> Any:
    """What is no body is left as it is: the daemon says so. Raises CommandError."""
    name = one.get("mesh") if isinstance(one, dict) else None
    if not isinstance(name, str) or name.startswith(BUILTIN):
        return one
    path = folder / name
    try:
        content = path.read_bytes()
    except OSError as error:
        text = f"{path}: {error.strerror or error}"
        raise CommandError("unusable_data", text, place=str(path)) from None
    return {**one, "mesh": await client.upload(path.name, content)}


def _content(path: Path) -> dict[str, Any]:
    """Of a file that holds a surface. Raises ConfigError."""
    document = read_yaml(path)
    if document.problems:
        raise ConfigError(document.problems)
    if not isinstance(document.value, dict) or not isinstance(document.value.get("mesh"), str):
        raise ConfigError([document.problem((), "there is no `mesh` in it")])
    wrong = [key for key in ("bodies", "regions") if not _is_list(document.value, key)]
    if wrong:
        text = "a list belongs here, or nothing: leave the key out"
        raise ConfigError([document.problem((key,), text) for key in wrong])
    return document.value


def _is_list(content: dict[str, Any], key: str) -> bool:
    return isinstance(content.get(key, []), list)


def _regions(arguments: argparse.Namespace) -> list[dict[str, Any]]:
    keep = "in" if arguments.keep_in else "out"
    return [
        {"kind": kind.replace("-", "_"), "keep": keep, **_named(values, parts)}
        for kind, (_, parts) in _REGIONS.items()
        for values in getattr(arguments, kind.replace("-", "_"))
    ]


def _named(values: tuple[float, ...], parts: dict[str, int]) -> dict[str, Any]:
    """The numbers, each under its key."""
    named: dict[str, Any] = {}
    left = list(values)
    for key, count in parts.items():
        taken, left = left[:count], left[count:]
        named[key] = taken if count > 1 else taken[0]
    return named


def _wrong_usage(arguments: argparse.Namespace, regions: list[dict[str, Any]]) -> str:
    if arguments.reset and (regions or arguments.add):
        return "--reset goes with nothing else"
    if arguments.keep_in and not regions:
        return "--keep-in goes with a region"
    replaces = bool(arguments.mesh) and not arguments.add
    for name, said in (
        ("--port", arguments.port is not None),
        ("--no-port", arguments.no_port),
        ("--free", arguments.free is not None),
    ):
        if said and not replaces:
            return f"{name} goes with --mesh, and not with --add"
    if arguments.add and arguments.file is not None:
        return "--add goes with --mesh or with regions"
    return (
        "--add needs a mesh or a region"
        if arguments.add and not (arguments.mesh or regions)
        else ""
    )


def _told(about: Surroundings) -> str:
    if not about.mesh:
        return "nobody knows what is round the body: the robot file names no model and no surface"
    lines = [f"{about.mesh}: {about.counts_sha256}"]
    for region in about.regions:
        numbers = " ".join(
            f"{key}={value}" for key, value in region.items() if key not in ("kind", "keep", "name")
        )
        lines.append(f"keep {region.get('keep')} of {region.get('kind')} {numbers}")
    return "\n".join(lines)
