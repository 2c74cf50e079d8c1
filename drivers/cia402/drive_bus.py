"""All drives of one bus: the cycle that keeps them in step, and the life of the link to them."""

import asyncio
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from config.axis import Axis
from config.bus import Bus
from drivers.bounded import end_tasks
from drivers.can.bus_lock import BusTakenError
from drivers.can.conditions import CANNOT_OPEN, DOWN, GONE, OFF, PASSIVE, TAKEN
from drivers.can.frame import worst_case_bits
from drivers.can.link import CanLink, FrameReceiver, LinkError, TrafficTap
from drivers.canopen.codec import cob_ids
from drivers.canopen.codec.nmt import NmtCommand, NmtState, encode_heartbeat, encode_nmt_command
from drivers.canopen.object_dictionary import ObjectDictionary
from drivers.cia402.axis_channel import AxisChannel
from drivers.cia402.cycle_targets import CycleTargets
from drivers.cia402.foreign_frames import ForeignFrames
from drivers.cia402.homing import HomingError, HomingProcedure, ModeLeftError
from drivers.cia402.node import Node, NodeState
from drivers.cia402.power_state import PowerGoal, PowerState
from drivers.clock import Clock
from drivers.conditions import Condition, ConditionChange, Conditions
from safety.permit import PermittedHoming, PermittedStep, is_genuine


def _expected(data: bytes, t_ns: int) -> None:
    """What nodes say of a command that ends our time with them is no news."""


LinkOpener = Callable[[FrameReceiver], Awaitable[CanLink]]

_SYNC: Final = (cob_ids.SYNC, b"")
_OPEN_AGAIN_S: Final = 0.1  # as soon as an operator notices, and no load on a port that is gone
_LIVES_END_WITHIN_S: Final = 1.0  # an SDO request gives up after three times 0.2 s
_WATCH_EVERY_NS: Final = 10_000_000  # a tenth of 0.1 s, the shortest time-out that is watched
_LAST_FRAMES_S: Final = 0.01  # until what was sent has left the interface's queue
_BITS: Final = tuple(worst_case_bits(length) for length in range(9))


@dataclass
class Traffic:
    """What has gone over the bus since the start."""

    sent: int = 0
    received: int = 0
    refused: int = 0
    """Frames that the interface did not take; a newer one follows in the next cycle."""
    foreign: int = 0
    """Frames that neither we nor the nodes in the robot file have sent."""
    bits: int = 0
    """Of all of these, at their longest."""


class DriveBus:
    """The master of one bus. Implements FrameReceiver.

    `run` keeps link and nodes alive until cancelled; `tick` is the bus cycle and must be called
    once per period by whoever owns the rhythm. Drives whose `goal` is None are left as they are.
    """

    def __init__(
        self,
        name: str,
        bus: Bus,
        axes: Sequence[tuple[int, Axis]],
        dictionaries: Mapping[int, ObjectDictionary],
        open_link: LinkOpener,
        clock: Clock,
        *,
        on_change: Callable[[ConditionChange], None] | None = None,
        tap: TrafficTap | None = None,
        listens_first_s: float = 0.0,
    ) -> None:
        """axes: those of this bus, with their places in the actuation vector.

        dictionaries: by node. tap: sees every data frame, sent or received. listens_first_s: how
        long it listens for another master, each time that the link is open, before it says a word.
        """
        self.name = name
        self.bus = bus
        self.traffic = Traffic()
        self.conditions = Conditions(on_change)
        self.channels = [AxisChannel(axis, index) for index, axis in axes]
        self.targets = CycleTargets(bus, self.channels)
        self._foreign_frames = ForeignFrames(
            name,
            bus.master_node,
            [channel.rpdo_id for channel in self.channels],
            self.conditions,
            self._written_by_others,
        )
        self._listens_first_s = listens_first_s
        self.nodes = self._make_nodes(dictionaries, clock)
        self._open_link = open_link
        self._clock = clock
        self._tap = tap
        self._link: CanLink | None = None
        self._lost = asyncio.Event()
        self._reads_in_cycle = False
        self._heartbeat = (
            cob_ids.heartbeat(bus.master_node),
            encode_heartbeat(NmtState.OPERATIONAL),
        )
        self._heartbeat_period_ns = round(bus.master_heartbeat_period_s * 1e9)
        self._heartbeat_due_ns = self._watch_due_ns = 0
        self._handlers = self._make_handlers()

    # The cycle.

    def tick(self, t_ns: int, healthy: bool = True) -> None:
        """One bus cycle: SYNC, then targets for the next one, then the master's heartbeat.

        healthy: False keeps the heartbeat back, and the drives stop by themselves.
        """
        if self._link is not None:
            self._link.drain()
        link = self._link
        if link is None:
            return
        self.targets.begin_cycle(t_ns)
        frames = [_SYNC, *self.targets.frames()]
        if healthy and t_ns >= self._heartbeat_due_ns:
            self._heartbeat_due_ns = t_ns + self._heartbeat_period_ns
            frames.append(self._heartbeat)
        self._sent(frames, link.send_all(frames))
        if t_ns >= self._watch_due_ns:
            self._watch_due_ns = t_ns + _WATCH_EVERY_NS
            self._watch(link, t_ns)

    def takes(self, step: PermittedStep) -> bool:
        """Whether all axes follow, and `step` does not come too late. To be asked of all buses
        before any is written to: axes that went on without the others would move apart.
        """
        return step.is_fresh(self._clock.now_ns()) and self.following

    def write(self, step: PermittedStep) -> None:
        """Follow `step`, which all buses take, from the next SYNC on, however late that has become
        meanwhile. Raises TypeError for what the gate has not given.
        """
        if not is_genuine(step):
            raise TypeError("only what the gate has permitted moves drives")
        at_once = self.targets.take(step, self._clock.now_ns())
        if at_once and self._link is not None:
            frames = self.targets.frames_at_once()
            self._sent(frames, self._link.send_all(frames))

    def set_goal(self, goal: PowerGoal | None) -> None:
        """What all drives of this bus shall do; those that are not operational are left out."""
        self.targets.drop()
        now_ns = self._clock.now_ns()
        for node in self.nodes.values():
            for channel in node.channels:
                usable = node.state is NodeState.OPERATIONAL
                channel.set_goal(goal if usable else None, now_ns)

    def stop_now(self) -> None:
        """Quick stop of all drives: on the bus at once, not in the next cycle."""
        self.set_goal(PowerGoal.QUICK_STOP)
        if self._link is None:
            return
        # Drives act on a new controlword at the SYNC that follows it.
        frames = [*self.targets.frames_at_rest(), _SYNC]
        self._sent(frames, self._link.send_all(frames))

    def reset_faults(self) -> None:
        """Take drives out of their faults, and leave them off."""
        for channel in self.channels:
            if channel.state is PowerState.FAULT:
                channel.begin_fault_reset(self._clock.now_ns())

    async def check_settings(self, within_s: float) -> list[str]:
        """Read back what the drives' own safety depends on: what is wrong with it, in words."""
        found = await asyncio.gather(*(n.check_settings(within_s) for n in self.nodes.values()))
        return [wrong for wrong in found if wrong]

    async def home(self, permitted: PermittedHoming) -> None:
        """Let one axis of this bus look for its zero. Raises HomingError; and TypeError for what
        the gate has not given. A drive that stays in homing mode is set up anew.
        """
        if not is_genuine(permitted):
            raise TypeError("only what the gate has permitted moves drives")
        channel = next(one for one in self.channels if one.index == permitted.axis)
        node = self.nodes[channel.axis.drive.node]
        if node.state is not NodeState.OPERATIONAL:
            raise HomingError(f"{channel.axis.name}: its drive is {node.state.value}")
        try:
            await HomingProcedure(channel, node.dictionary, node.sdo, permitted).run()
        except ModeLeftError as error:
            node.set_up_anew(str(error))
            raise

    @property
    def goal_reached(self) -> bool:
        """Whether every drive has done what it was last told."""
        return all(channel.goal_reached for channel in self.channels)

    @property
    def known_unpowered(self) -> bool:
        """Whether every drive is heard, and says that its motor has no torque."""
        return all(
            node.state is NodeState.OPERATIONAL
            and all(
                channel.received_ns is not None and channel.state.unpowered
                for channel in node.channels
            )
            for node in self.nodes.values()
        )

    @property
    def energised(self) -> bool:
        """Whether any drive says that its motor has torque."""
        return any(channel.state.energised for channel in self.channels)

    @property
    def leads_torque(self) -> bool:
        """Whether any of these is set up, and so does what it is told."""
        return any(
            node.state is NodeState.OPERATIONAL
            and any(channel.state.energised for channel in node.channels)
            for node in self.nodes.values()
        )

    @property
    def following(self) -> bool:
        """Whether every axis is enabled and moves when its target moves."""
        return self.targets.following

    @property
    def operational(self) -> bool:
        """Whether every node is set up and running."""
        return all(node.state is NodeState.OPERATIONAL for node in self.nodes.values())

    @property
    def connected(self) -> bool:
        """Whether the interface is open."""
        return self._link is not None

    # The life.

    async def run(self) -> None:
        """Open the link, keep the nodes alive, open it again when it is lost. Until cancelled."""
        while True:
            if not await self._open():
                await asyncio.sleep(_OPEN_AGAIN_S)
                continue
            lives = [asyncio.create_task(node.life()) for node in self.nodes.values()]
            try:
                await self._lost.wait()
            finally:
                await end_tasks(lives, _LIVES_END_WITHIN_S)
                for node in self.nodes.values():
                    node.link_lost()

    async def close(self, within_s: float = 1.0) -> None:
        """Stop the drives, take their power off, fall silent. `tick` must go on meanwhile.

        Drives that nobody has wanted anything of are left as they are.
        """
        if any(channel.goal is not None for channel in self.channels):
            try:
                async with asyncio.timeout(within_s):
                    for goal in (PowerGoal.QUICK_STOP, PowerGoal.OFF):
                        await self._reach(goal)
            except TimeoutError:
                pass  # the drives' own watchdogs are next
        if self._link is not None:
            command = encode_nmt_command(NmtCommand.ENTER_PRE_OPERATIONAL, cob_ids.ALL_NODES)
            self._handlers = dict.fromkeys(self._handlers, _expected)
            self.send(cob_ids.NMT, command)
            link, self._link = self._link, None  # from here on the cycle sends nothing
            await asyncio.sleep(_LAST_FRAMES_S)
            link.close()

    def send(self, can_id: int, data: bytes) -> bool:
        """Hand one frame to the interface, now or not at all."""
        if self._link is None:
            return False
        taken = self._link.send(can_id, data)
        self._sent([(can_id, data)], int(taken))
        return taken

    # What the link tells.

    def frame_received(self, can_id: int, data: bytes, t_ns: int) -> None:
        traffic = self.traffic
        traffic.received += 1
        traffic.bits += _BITS[len(data)]
        if self._tap is not None:
            self._tap.received(can_id, data, t_ns)
        handler = self._handlers.get(can_id)
        if handler is not None:
            handler(data, t_ns)
        else:
            traffic.foreign += 1
            self._foreign_frames.received(can_id, data, t_ns)

    def condition_seen(self, condition: Condition, present: bool, detail: str) -> None:
        now_ns = self._clock.now_ns()
        if present:
            self.conditions.set(condition, self.name, now_ns, detail)
            return
        # A controller that was set down and up begins anew, and does not say so.
        for over in (DOWN, OFF, PASSIVE) if condition is DOWN else (condition,):
            self.conditions.clear(over, self.name, now_ns)

    def link_lost(self, error: OSError) -> None:
        self._link = None
        self._foreign_frames.forget()
        now_ns = self._clock.now_ns()
        self.conditions.clear_subject(self.name, now_ns)
        self.conditions.set(GONE, self.name, now_ns, str(error))
        self._lost.set()

    def _sent(self, frames: Sequence[tuple[int, bytes]], taken: int) -> None:
        traffic = self.traffic
        traffic.sent += taken
        if taken < len(frames):
            traffic.refused += len(frames) - taken
            frames = frames[:taken]
        bits = 0
        for _, data in frames:
            bits += _BITS[len(data)]
        traffic.bits += bits
        if self._tap is not None:
            self._tap.sent(frames, self._clock.now_ns())

    def _watch(self, link: CanLink, t_ns: int) -> None:
        """Look after the nodes; once all are well, their frames need not wake us one by one."""
        self._foreign_frames.watch(t_ns)
        in_cycle = True
        for node in self.nodes.values():
            node.watch(t_ns)
            if node.state is not NodeState.OPERATIONAL:
                in_cycle = False
        if in_cycle is not self._reads_in_cycle:
            self._reads_in_cycle = in_cycle
            link.read_in_cycle(in_cycle)

    def _bus_is_ours(self) -> bool:
        return not self._foreign_frames.master_present

    def _written_by_others(self, node: int, index: int, subindex: int) -> None:
        if node in self.nodes:
            self.nodes[node].written(index, subindex)

    async def _open(self) -> bool:
        self._lost.clear()
        try:
            link = await self._open_link(self)
        except LinkError as error:
            now_ns = self._clock.now_ns()
            why, other = TAKEN, CANNOT_OPEN
            if not isinstance(error, BusTakenError):
                why, other = other, why
            self.conditions.clear(other, self.name, now_ns)
            self.conditions.set(why, self.name, now_ns, str(error))
            return False
        try:
            await self._listen()
        except asyncio.CancelledError:
            link.close()
            raise
        if self._lost.is_set():
            return False
        self._link, self._reads_in_cycle = link, False
        for condition in (CANNOT_OPEN, TAKEN, GONE):
            self.conditions.clear(condition, self.name, self._clock.now_ns())
        return True

    async def _listen(self) -> None:
        """Say nothing before the bus is known to have no other master: its robot may be moving."""
        if self._listens_first_s:
            await asyncio.sleep(self._listens_first_s)
        while not self._bus_is_ours() and not self._lost.is_set():
            await asyncio.sleep(_OPEN_AGAIN_S)
            self._foreign_frames.watch(self._clock.now_ns())

    async def _reach(self, goal: PowerGoal) -> None:
        self.set_goal(goal)
        while not self.goal_reached:
            await asyncio.sleep(self.bus.cycle_period_s)

    def _make_nodes(
        self, dictionaries: Mapping[int, ObjectDictionary], clock: Clock
    ) -> dict[int, Node]:
        by_node: dict[int, list[AxisChannel]] = {}
        for channel in self.channels:
            by_node.setdefault(channel.axis.drive.node, []).append(channel)
        return {
            number: Node(
                f"{self.name}/{number}",
                self.bus,
                channels,
                dictionaries[number],
                self.send,
                clock,
                self.conditions,
                self._bus_is_ours,
            )
            for number, channels in by_node.items()
        }

    def _make_handlers(self) -> dict[int, Callable[[bytes, int], None]]:
        handlers: dict[int, Callable[[bytes, int], None]] = {}
        for number, node in self.nodes.items():
            handlers[cob_ids.heartbeat(number)] = node.heartbeat_received
            handlers[cob_ids.emergency(number)] = node.emergencies.received
            handlers[node.sdo.response_id] = node.sdo.receive
            for channel in node.channels:
                handlers[channel.pdos.tpdo.can_id] = node.state_handler(channel)
        return handlers
