"""Tells where the whole body is, in time that the loop has to spare."""

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from daemon.messages import Body, Component, Message
from drivers.cia402.axis_channel import AxisChannel
from safety.risk_source import BodyKnowing, KnownBody, RiskSource, body_of

MOST_POINTS: Final = 32
_KNOWN_EVERY_NS: Final = 100_000_000
_UNKNOWN_EVERY_NS: Final = 1_000_000_000


class BodyTeller:
    """`use_spare_time` often; it works ten times a second where the body is known."""

    def __init__(
        self,
        source: RiskSource,
        channels: Sequence[AxisChannel],
        publish: Callable[[Message], None],
        snapped: Callable[[int], None],
    ) -> None:
        """source: asked for the body where it knows one. channels: in the order of u. snapped:
        hears how often an emulated body has snapped, whenever it has once more."""
        self.emulated: Callable[[], Body | None] = lambda: None
        """The newest that an emulated lab has told; it goes before what a model expects."""
        self._source = source if isinstance(source, BodyKnowing) else None
        self._channels = channels
        self._publish = publish
        self._snapped = snapped
        self._snaps: int | None = None
        self._due_ns = 0

    def use_spare_time(self, now_ns: int) -> None:
        """For a moment with nothing else to do."""
        if now_ns < self._due_ns:
            return
        body = self._body(now_ns)
        known = body.source != "none"
        self._due_ns = now_ns + (_KNOWN_EVERY_NS if known else _UNKNOWN_EVERY_NS)
        self._publish(body)
        self._tell_of_snaps(body.snaps)

    def _tell_of_snaps(self, snaps: int | None) -> None:
        """What was before somebody listened, or of another lab, is told to nobody."""
        if snaps is not None and self._snaps is not None and snaps > self._snaps:
            self._snapped(snaps)
        self._snaps = snaps

    def _body(self, now_ns: int) -> Body:
        known = self._of_model()
        components = None if known is None else _components(known)
        emulated = self.emulated()
        if emulated is not None and emulated.centreline_mm is not None:
            return Body(
                t_ns=now_ns,
                source="emulated truth",
                centreline_mm=emulated.centreline_mm,
                radius_mm=emulated.radius_mm,
                components=components,
                stability=emulated.stability,
                snaps=emulated.snaps,
            )
        if known is None:
            return Body(t_ns=now_ns, source="none")
        kept = spread(len(known.centreline_mm))
        return Body(
            t_ns=now_ns,
            source="model",
            centreline_mm=[known.centreline_mm[place] for place in kept],
            radius_mm=[known.radius_mm[place] for place in kept],
            components=components,
        )

    def _of_model(self) -> KnownBody | None:
        if self._source is None or any(one.received_ns is None for one in self._channels):
            return None
        u = [channel.scale.position(channel.position_counts) for channel in self._channels]
        return body_of(self._source, u)


def spread(count: int) -> list[int]:
    """At most MOST_POINTS of `count` places, the first and the last among them."""
    if count <= MOST_POINTS:
        return list(range(count))
    return [int(place) for place in np.linspace(0, count - 1, MOST_POINTS).round()]


def _components(known: KnownBody) -> list[Component]:
    return [
        Component(weight=weight, mean_mm=mean, covariance_mm2=covariance)
        for weight, mean, covariance in zip(
            known.weights, known.means_mm, known.covariances_mm2, strict=True
        )
    ]
