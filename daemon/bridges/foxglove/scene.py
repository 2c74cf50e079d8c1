"""The channels that Foxglove is told the robot on: the same in a file and live."""

from collections import deque
from collections.abc import Sequence
from typing import Final

import foxglove
from foxglove import Channel, Context
from foxglove.channels import FrameTransformChannel, LogChannel, SceneUpdateChannel
from foxglove.messages import SceneEntity, SceneEntityDeletion, SceneEntityDeletionType, SceneUpdate

from config.control import Region
from daemon.bridges.foxglove.drawing import (
    body_entity,
    clearance_entity,
    frames,
    gone,
    log,
    solids_entity,
    surroundings_entity,
    trail_entity,
)
from daemon.bridges.foxglove.solids import moving_solids, region_solids
from daemon.bridges.poses import is_place
from daemon.messages import Body, Event, Message, Risk, Status, Surroundings, Tip, WhoAmI
from daemon.recording.format.channels import TOPICS, channel_format, telemetry_payload
from daemon.recording.recorded_surroundings import known_regions

TRANSFORMS: Final = "/tf"
SCENE: Final = "/scene"
SURROUNDINGS: Final = "/surroundings"
LOG: Final = "/log"

_TRAIL_EACH_NS: Final = 100_000_000
_CLEARANCE_LASTS_NS: Final = 1_000_000_000
_TRAIL_PLACES: Final = 400
"""Of 10 a second: twice round a circle of 20 s."""


class FoxgloveScene:
    """Tells what it hears on channels of its own. Where to they go is the context's matter."""

    def __init__(self) -> None:
        self.context = Context()
        self._transforms = FrameTransformChannel(TRANSFORMS, context=self.context)
        self._scene = SceneUpdateChannel(SCENE, context=self.context)
        self._surroundings = SceneUpdateChannel(SURROUNDINGS, context=self.context)
        self._log = LogChannel(LOG, context=self.context)
        self._telemetry = {topic: self._channel(topic) for topic in TOPICS.values()}
        self._trails: dict[str, deque[list[float]]] = {
            name: deque(maxlen=_TRAIL_PLACES) for name in ("tip trail", "reference trail")
        }
        self._trail_ns = 0
        self._around: dict[str, SceneEntity] = {}
        self._shown: set[str] = set()
        """Names of what was shown round the body."""
        self._clearance_ns: int | None = None
        """Of the step whose clearance is shown; None: none is."""
        self._moves = False
        """Whether obstacles that move were shown."""

    def connected(self, me: WhoAmI, surroundings: Surroundings, mesh: bytes) -> None:  # noqa: ARG002
        """A live daemon. What was drawn of another time goes."""
        self._forget()
        self.surrounded(surroundings, mesh)

    def surrounded(self, surroundings: Surroundings, mesh: bytes) -> None:
        """What is round the body from now on; `show_surroundings` tells it."""
        regions = known_regions(surroundings.regions)
        self.set_surroundings(mesh, regions, surroundings.transform)

    def lost(self, why: str) -> None:  # noqa: ARG002
        """What was drawn is old from here on: nothing of it stays."""
        self._forget()

    def heard(self, message: Message, date_ns: int) -> None:
        topic = TOPICS.get(type(message))
        if topic is not None:
            self.copy(topic, telemetry_payload(message), date_ns)
        self.draw(message, date_ns)

    def copy(self, topic: str, payload: bytes, date_ns: int) -> None:
        """Telemetry as it is recorded, for plots and tables."""
        self._telemetry[topic].log(payload, log_time=date_ns)

    def draw(self, message: Message, date_ns: int) -> None:
        """What a picture is made of."""
        if isinstance(message, Tip):
            for frame in frames(message, date_ns):
                self._transforms.log(frame, log_time=date_ns)
            self._lengthen_trails(message, date_ns)
        elif isinstance(message, Body):
            self._show(body_entity(message, date_ns), "body", date_ns)
        elif isinstance(message, Risk):
            self._show(clearance_entity(message, date_ns), "clearance", date_ns)
            self._clearance_ns = message.t_ns
        elif isinstance(message, Status):
            self._show_moving(message, date_ns)
            self._end_clearance(message, date_ns)
        elif isinstance(message, Event):
            self._log.log(log(message, date_ns), log_time=date_ns)

    def set_surroundings(
        self, mesh: bytes, regions: Sequence[Region], transform: Sequence[float] | None = None
    ) -> None:
        """transform: of the mesh, into the base's frame; None: it is in it, as of a recording."""
        solids = [solid for region in regions for solid in region_solids(region)]
        found = {
            "surroundings": surroundings_entity(mesh, transform, 0),
            "regions": solids_entity("regions", solids, 0),
        }
        self._around = {name: one for name, one in found.items() if one is not None}

    def show_surroundings(self, date_ns: int) -> None:
        """When others take their place, and to whoever comes, live: all in one message, because
        who comes later, or goes to another moment of a file, is shown the last one."""
        over = [gone(name, date_ns) for name in sorted(self._shown - set(self._around))]
        self._shown = set(self._around)
        if over or self._around:
            update = SceneUpdate(entities=list(self._around.values()), deletions=over)
            self._surroundings.log(update, log_time=date_ns)

    def _show_moving(self, status: Status, date_ns: int) -> None:
        solids = moving_solids(status.risk.moving_mm)
        if solids or self._moves:
            self._moves = bool(solids)
            name = "moving obstacles"
            self._show(solids_entity(name, solids, date_ns), name, date_ns)

    def _end_clearance(self, status: Status, date_ns: int) -> None:
        """A robot that stands is told of no steps: what was near in the last one may not be now."""
        shown_ns = self._clearance_ns
        if shown_ns is not None and status.t_ns - shown_ns > _CLEARANCE_LASTS_NS:
            self._clearance_ns = None
            self._show(None, "clearance", date_ns)

    def _lengthen_trails(self, tip: Tip, date_ns: int) -> None:
        if 0 <= date_ns - self._trail_ns < _TRAIL_EACH_NS:
            return
        self._trail_ns = date_ns
        entities = []
        places = (("tip trail", tip.tip_mm), ("reference trail", tip.reference_mm))
        for name, place_mm in places:
            trail = self._trails[name]
            if place_mm is not None and is_place(place_mm):
                trail.append(list(place_mm))
            if len(trail) > 1:
                entities.append(trail_entity(name, list(trail), date_ns))
        if entities:
            self._scene.log(SceneUpdate(entities=entities), log_time=date_ns)

    def _show(self, entity: SceneEntity | None, name: str, date_ns: int) -> None:
        """Or take it away, where it is not known any more."""
        if entity is not None:
            update = SceneUpdate(entities=[entity])
        else:
            update = SceneUpdate(deletions=[gone(name, date_ns)])
        self._scene.log(update, log_time=date_ns)

    def _forget(self) -> None:
        for trail in self._trails.values():
            trail.clear()
        self._trail_ns = 0
        self._clearance_ns, self._moves = None, False
        everything = SceneEntityDeletion(type=SceneEntityDeletionType.All)
        self._scene.log(SceneUpdate(deletions=[everything]))

    def _channel(self, topic: str) -> Channel:
        told = channel_format(topic)
        schema = foxglove.Schema(name=told.schema_name, encoding="jsonschema", data=told.schema)
        return Channel(
            topic, schema=schema, message_encoding=told.message_encoding, context=self.context
        )
