"""Kinds that a file may name: controllers, plants and trajectories, ours and those of packages.

A kind is a name, a class of options, and a function that makes what the options describe. Ours are
listed here exactly as an installed package lists its own, as entry points of the same three groups;
nothing else tells them apart. Whoever names a kind names an entry of that list: no file and no
message leads to an import of anything else. A package is imported when a file names a kind of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, reduce
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, get_args

from pydantic import (
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    TypeAdapter,
    ValidationError,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import PydanticCustomError, PydanticKnownError, core_schema

from config.documents.model import ConfigModel

API_VERSION: Final = 1
"""Of what a package sees of us (`daemon/api`). Raised when something that is there is changed or
taken away; what is added does not change it."""

Group = Literal["tentacled.controllers", "tentacled.plants", "tentacled.trajectories"]
CONTROLLERS: Final = "tentacled.controllers"
PLANTS: Final = "tentacled.plants"
TRAJECTORIES: Final = "tentacled.trajectories"
GROUPS: Final[tuple[Group, ...]] = get_args(Group)

_SINGULAR: Final[Mapping[Group, str]] = {
    CONTROLLERS: "controller",
    PLANTS: "plant",
    TRAJECTORIES: "trajectory",
}
_SHIPPED: Final[Mapping[Group, Mapping[str, str]]] = {
    CONTROLLERS: {
        "broyden": "config.tasks.controllers:BROYDEN",
        "constant_curvature": "config.tasks.controllers:CONSTANT_CURVATURE",
        "designed_exploration": "config.tasks.controllers:DESIGNED_EXPLORATION",
        "forward_jacobian": "config.tasks.controllers:FORWARD_JACOBIAN",
        "gaussian_process": "config.tasks.peers:GAUSSIAN_PROCESS",
        "iterative_learning": "config.tasks.peers:ITERATIVE_LEARNING",
        "learned_kinematics": "config.tasks.controllers:LEARNED_KINEMATICS",
        "model_predictive": "config.tasks.peers:MODEL_PREDICTIVE",
        "pid_constant_curvature": "config.tasks.peers:PID_CONSTANT_CURVATURE",
        "reward_weighted": "config.tasks.controllers:REWARD_WEIGHTED",
        "waypoint_exploration": "config.tasks.controllers:WAYPOINT_EXPLORATION",
    },
    PLANTS: {
        "soft_arm": "config.emulation.plants:SOFT_ARM",
        "tendon_arm": "config.emulation.plants:TENDON_ARM",
        "concentric_tubes": "config.emulation.plants:CONCENTRIC_TUBES",
    },
    TRAJECTORIES: {
        "rectangle": "config.tasks.trajectory:RECTANGLE",
        "circle": "config.tasks.trajectory:CIRCLE",
        "lissajous": "config.tasks.trajectory:LISSAJOUS",
        "helix": "config.tasks.trajectory:HELIX",
        "star": "config.tasks.trajectory:STAR",
        "random_smooth": "config.tasks.trajectory:RANDOM_SMOOTH",
        "waypoints": "config.tasks.trajectory:WAYPOINTS",
        "hold": "config.tasks.trajectory:HOLD",
        "planned": "config.tasks.trajectory:PLANNED",
    },
}


class KindOptions(ConfigModel):
    """What can be set on one of a kind. A kind's own class has a field `kind` with its name."""

    if TYPE_CHECKING:

        @property
        def kind(self) -> str:
            """Which it is."""


@dataclass(frozen=True)
class Kind:
    """What an entry point leads to.

    options: the class that checks what a file says of it. make: `package.module:function`, which is
    imported when one is made. variation: of a plant, the function that makes another body of the
    same design, (options, seed) → options; empty: there is none. api: the version of `daemon.api`
    that it was written for.
    """

    options: type[KindOptions]
    make: str
    variation: str = ""
    api: int = API_VERSION


class KindError(ValueError):
    """A kind that cannot be used. The text says which, whose it is, and why."""


@dataclass(frozen=True)
class Entry:
    """One kind as it is listed. Nothing of it has been imported."""

    group: Group
    name: str
    points: tuple[EntryPoint, ...]
    """Of each that gives it: one, or nobody knows which is meant."""
    shipped: bool

    @property
    def source(self) -> str:
        """The package that it comes from, with its version."""
        names = [f"{of.name} {of.version}" for one in self.points if (of := one.dist) is not None]
        return ", ".join(sorted(names)) or "tentacled"

    def __str__(self) -> str:
        return f"the {_SINGULAR[self.group]} '{self.name}' of {self.source}"


def entries(group: Group) -> Mapping[str, Entry]:
    """All kinds that a file may name in this place, ours first. Imports none of them."""
    return {**_shipped(group), **{n: e for n, e in _installed(group).items() if not _ours(e)}}


def shadowed(group: Group) -> list[Entry]:
    """Installed kinds that have the name of one of ours, and are not used."""
    return [entry for entry in _installed(group).values() if _ours(entry)]


def kind_of(group: Group, name: str) -> Kind:
    """What the kind is. Raises KindError for one that there is not, or that cannot be used."""
    entry = _shipped(group).get(name) or _installed(group).get(name)
    if entry is None:
        raise KindError(f"there is no '{name}' among {', '.join(entries(group))}")
    kind = _loaded(entry)
    if isinstance(kind, KindError):
        raise kind
    return kind


def entry_of(group: Group, options: KindOptions) -> Entry:
    """The entry that these options belong to. Raises KindError for one that there is not."""
    entry = entries(group).get(options.kind)
    if entry is None:
        raise KindError(f"there is no '{options.kind}' among {', '.join(entries(group))}")
    return entry


def maker(group: Group, options: KindOptions) -> Callable[..., Any]:
    """The function that makes what these options describe. Raises KindError."""
    entry = entry_of(group, options)
    return _function(entry, kind_of(group, options.kind).make)


def variation(group: Group, options: KindOptions) -> Callable[..., Any] | None:
    """The function that makes another of the same design; None: it has none. Raises KindError."""
    reference = kind_of(group, options.kind).variation
    return _function(entry_of(group, options), reference) if reference else None


# Entry points, and what they lead to.


def _ours(entry: Entry) -> bool:
    return entry.name in _SHIPPED[entry.group]


@cache
def _shipped(group: Group) -> Mapping[str, Entry]:
    return {
        name: Entry(group, name, (EntryPoint(name, value, group),), shipped=True)
        for name, value in _SHIPPED[group].items()
    }


@cache
def _installed(group: Group) -> Mapping[str, Entry]:
    found: dict[str, dict[tuple[str, str], EntryPoint]] = {}
    for point in entry_points(group=group):
        # The same distribution may be found twice, as in an editable installation.
        owner = "" if point.dist is None else point.dist.name
        found.setdefault(point.name, {})[(owner, point.value)] = point
    return {
        name: Entry(group, name, tuple(points.values()), shipped=False)
        for name, points in sorted(found.items())
    }


_KINDS: Final[dict[Entry, Kind | KindError]] = {}


def _loaded(entry: Entry) -> Kind | KindError:
    """Imported once; what could not be is not tried again, for half of it may be there."""
    if entry not in _KINDS:
        try:
            _KINDS[entry] = _load(entry)
        except KindError as error:
            _KINDS[entry] = error
    return _KINDS[entry]


def _load(entry: Entry) -> Kind:
    if len(entry.points) > 1:
        raise KindError(f"{entry}: several packages have one of this name; uninstall the others")
    try:
        kind = entry.points[0].load()
    except (Exception, SystemExit) as error:  # whatever a package does as it is imported
        raise KindError(f"{entry} cannot be imported: {described(error)}") from error
    if not isinstance(kind, Kind):
        raise KindError(f"{entry}: {entry.points[0].value} is no Kind, but {kind!r:.60}")
    if kind.api != API_VERSION:
        text = f"{entry} is written for API version {kind.api}, and this is version {API_VERSION}"
        raise KindError(f"{text}: install the version of it that goes with this tentacled")
    options = kind.options
    if not (isinstance(options, type) and issubclass(options, KindOptions)):
        raise KindError(f"{entry}: its options are no class of KindOptions, but {options!r:.60}")
    field = options.model_fields.get("kind")
    if field is None or entry.name not in get_args(field.annotation):
        raise KindError(f"{entry}: its options need a field kind: Literal['{entry.name}']")
    return kind


def _function(entry: Entry, reference: str) -> Callable[..., Any]:
    module, _, name = str(reference).partition(":")
    try:
        function = getattr(import_module(module), name)
    except (Exception, SystemExit) as error:  # as above
        raise KindError(f"{entry} cannot be imported: {described(error)}") from error
    if not callable(function):
        raise KindError(f"{entry}: {reference} cannot be called")
    made: Callable[..., Any] = function
    return made


def described(error: BaseException) -> str:
    """An error of somebody else's code in one line."""
    text = " ".join(str(error).split())[:300]
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


# Fields of a file that hold one of a kind.


@dataclass(frozen=True)
class Named:
    """Annotates a field whose `kind` names one of the group: its options are checked by its class.

    Options that are made already stay as they are.
    """

    group: Group

    def __get_pydantic_core_schema__(
        self, source: object, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        del source, handler
        return core_schema.no_info_plain_validator_function(
            self._checked, serialization=core_schema.simple_ser_schema("any")
        )

    def __get_pydantic_json_schema__(
        self, schema: core_schema.CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """Of ours, and of the packages' that have been named in this process."""
        del schema
        known = [*_shipped(self.group).values(), *(e for e in _KINDS if e.group == self.group)]
        kinds = [kind for e in dict.fromkeys(known) if isinstance(kind := _loaded(e), Kind)]
        union: Any = reduce(or_, (kind.options for kind in kinds))
        known_by: Any = Annotated[union, Field(discriminator="kind")]
        return handler(TypeAdapter[Any](known_by).core_schema)

    def _checked(self, value: object) -> KindOptions:
        if isinstance(value, KindOptions):
            return value
        if not isinstance(value, Mapping):
            raise PydanticKnownError("dict_type")
        if "kind" not in value:
            raise PydanticKnownError("union_tag_not_found", {"discriminator": "'kind'"})
        name, known = value["kind"], entries(self.group)
        if name not in known if isinstance(name, str) else True:
            expected = ", ".join(f"'{one}'" for one in known)
            context = {"discriminator": "'kind'", "tag": str(name), "expected_tags": expected}
            raise PydanticKnownError("union_tag_invalid", context)
        try:
            options = kind_of(self.group, name).options
        except KindError as error:
            raise PydanticCustomError("kind_refused", "{why}", {"why": str(error)}) from None
        try:
            return options.model_validate(value)
        except ValidationError:
            raise
        except (Exception, SystemExit) as error:  # whatever a package's own checks do
            if known[name].shipped:
                raise
            why = f"{known[name]} cannot check its options: {described(error)}"
            raise PydanticCustomError("kind_refused", "{why}", {"why": why}) from error


@contextmanager
def forgotten() -> Iterator[None]:
    """Within it, and after it, what is installed is looked for anew: for tests."""

    def forget() -> None:
        _installed.cache_clear()
        for entry in [one for one in _KINDS if not one.shipped]:
            del _KINDS[entry]

    forget()
    try:
        yield
    finally:
        forget()
