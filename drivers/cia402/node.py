"""One node on the bus, from absent to operational and back: a supervised life of its own."""

import asyncio
from collections.abc import Callable, Sequence
from contextlib import suppress
from enum import Enum
from typing import Final

from config.bus import Bus
from drivers.bounded import end_tasks
from drivers.canopen.codec import cob_ids
from drivers.canopen.codec.error import CodecError
from drivers.canopen.codec.nmt import NmtCommand, NmtState, encode_nmt_command
from drivers.canopen.heartbeat_monitor import HeartbeatMonitor
from drivers.canopen.object_dictionary import EdsError, ObjectDictionary
from drivers.canopen.sdo_client import SdoClient, SdoError
from drivers.cia402 import conditions as c
from drivers.cia402 import objects
from drivers.cia402.axis_channel import AxisChannel
from drivers.cia402.bring_up import BringUpError, Identity, NodeSetUp
from drivers.cia402.emergencies import Emergencies
from drivers.cia402.power_state import StatuswordBit
from drivers.clock import Clock
from drivers.conditions import Condition, Conditions

# Judgements, where no source is named: CiA 301 sets no time for a boot-up.
_BOOT_UP_WITHIN_S: Final = 1.5  # of a reset of communication alone
_BOOTS_WITHIN_S: Final = 0.6  # of a drive whose supply had a dip; it is tried again anyway
_BOOTS_FOR_NS: Final = 30_000_000_000  # then the reset itself may have been lost
_RESET_JUST_NOW_NS: Final = 3_000_000_000  # in this attempt: the last one began before that
_SETTLE_S: Final = 0.1  # a boot loader announces itself first, then the drive does
_OPERATIONAL_WITHIN_S: Final = 1.0  # ten heartbeats, which tell of it
_TRY_AGAIN_S: Final = 0.5
_ASK_EVERY_S: Final = 0.1
_ASKING_ENDS_WITHIN_S: Final = 0.1
_LIMIT_STAYS_NS: Final = 500_000_000  # longer than between two steps of the slowest tracker
_PDO_SILENT_CYCLES: Final = 5  # one lost frame is common, five in a row are a drive that is silent
_FOUND_WHILE_SET_UP: Final = (
    c.SAFETY_MISSING,
    c.EMERGENCIES_UNHEARD,
    c.CYCLIC_MODE_NOT_LISTED,
    c.COUNTS_DIFFER,
    c.MODE_REFUSED,
)
_KEPT_WHEN_SET_UP: Final = (*_FOUND_WHILE_SET_UP, c.EMERGENCY)
_MALFORMED_STAYS_NS: Final = 500_000_000  # so that somebody can read it

Send = Callable[[int, bytes], bool]


class NodeState(Enum):
    """Where a node is in its life."""

    ABSENT = "absent"
    SETTING_UP = "setting up"
    OPERATIONAL = "operational"


class Node:
    """A node with one or more axes. `life` runs until cancelled."""

    def __init__(
        self,
        subject: str,
        bus: Bus,
        channels: Sequence[AxisChannel],
        dictionary: ObjectDictionary,
        send: Send,
        clock: Clock,
        conditions: Conditions,
        bus_is_ours: Callable[[], bool] = lambda: True,
    ) -> None:
        """bus_is_ours: False while another master commands on the bus. No node is set up then:
        its drives may be moving at the other's command."""
        drive = channels[0].axis.drive
        self.number = drive.node
        self.subject = subject
        self.channels = channels
        self.state = NodeState.ABSENT
        self.identity: Identity | None = None
        self.emergencies = Emergencies(subject, channels, conditions)
        self.heartbeat = HeartbeatMonitor(round(drive.heartbeat_timeout_s * 1e9))
        self.sdo = SdoClient(drive.node, send)
        self._bus = bus
        self.dictionary = dictionary
        self._send = send
        self._clock = clock
        self._conditions = conditions
        silence_s = max(_PDO_SILENT_CYCLES * bus.cycle_period_s, drive.state_timeout_s)
        self._pdo_timeout_ns = round(silence_s * 1e9)
        self._boot_ups_when_well: int | None = None
        """None: it has not been operational since it was last set up."""
        self._reset_ns: int | None = None
        """When it was reset, and how often it had booted before; None: not since it last booted."""
        self._boot_ups_before = 0
        self._unwilling: set[str] = set()
        """Axes that do not do what they are told."""
        self._limited_ns: dict[str, int] = {}
        """When each axis that is held back by a limit last said so."""
        self._malformed_ns: int | None = None
        """When a state last came in another form; None: not for a while."""
        self._bus_is_ours = bus_is_ours
        self._set_up_by: NodeSetUp | None = None
        self._must_be_rewritten = False
        """Somebody may have changed what we had set."""
        self._heard = asyncio.Event()
        self._trouble = asyncio.Event()

    # What comes from the bus.

    def heartbeat_received(self, data: bytes, t_ns: int) -> None:
        reported = self.heartbeat.receive(data, t_ns)
        self._heard.set()
        if self.state is not NodeState.OPERATIONAL:
            return
        if reported is None or reported is NmtState.OPERATIONAL:
            return
        if reported is not NmtState.BOOT_UP:
            self._conditions.note(c.NOT_OPERATIONAL, self.subject, t_ns, reported.name.lower())
        self._in_trouble()

    def state_handler(self, channel: AxisChannel) -> Callable[[bytes, int], None]:
        """What takes the TPDOs of `channel`: the busiest path of all."""

        def state_received(data: bytes, t_ns: int) -> None:
            before = channel.statusword
            if not channel.receive(data, t_ns):
                detail = f"{len(data)} bytes: {data.hex()}"
                self._conditions.set(c.PDO_MALFORMED, self.subject, t_ns, detail)
                self._malformed_ns = t_ns
            elif channel.statusword != before:
                self._status_changed(channel, t_ns)
                self._heard.set()

        return state_received

    def link_lost(self) -> None:
        """The bus is gone, and with it all that is known of the node."""
        self._boot_ups_when_well = self._reset_ns = None
        self.state = NodeState.ABSENT
        self._forget()
        self._conditions.clear_subject(self.subject, self._clock.now_ns())

    def watch(self, t_ns: int) -> None:
        """Look for what has not come. Called every cycle."""
        self.emergencies.watch(t_ns)
        if self.state is not NodeState.OPERATIONAL:
            return
        if self._must_be_rewritten and self._may_be_rewritten:
            self._in_trouble()
            return
        if self.heartbeat.is_lost(t_ns):
            self._conditions.set(c.LOST, self.subject, t_ns)
            self._in_trouble()
            return
        malformed_ns = self._malformed_ns
        if malformed_ns is not None and t_ns - malformed_ns > _MALFORMED_STAYS_NS:
            self._malformed_ns = None
            self._conditions.clear(c.PDO_MALFORMED, self.subject, t_ns)
        for channel in self.channels:
            if channel.is_silent(t_ns, self._pdo_timeout_ns):
                self._conditions.set(c.PDO_SILENT, self.subject, t_ns, channel.axis.name)
                self._in_trouble()
                return
            name = channel.axis.name
            if not channel.following and channel.is_unwilling(t_ns):
                told = channel.goal.value if channel.goal else ""
                detail = f"told {told}, is {channel.state.value}"
                self._unwilling.add(name)
                self._conditions.set(c.UNWILLING, name, t_ns, detail)
            elif name in self._unwilling:
                self._unwilling.remove(name)
                self._conditions.clear(c.UNWILLING, name, t_ns)
            if channel.statusword & StatuswordBit.INTERNAL_LIMIT or name in self._limited_ns:
                self._watch_limit(channel, t_ns)

    def _watch_limit(self, channel: AxisChannel, t_ns: int) -> None:
        """A limit that comes and goes with every step, as at the end of travel, is told once."""
        subject = channel.axis.name
        if channel.state.energised and channel.statusword & StatuswordBit.INTERNAL_LIMIT:
            self._limited_ns[subject] = t_ns
            self._conditions.set(c.LIMIT_ACTIVE, subject, t_ns)
        elif subject in self._limited_ns and t_ns - self._limited_ns[subject] > _LIMIT_STAYS_NS:
            del self._limited_ns[subject]
            self._conditions.clear(c.LIMIT_ACTIVE, subject, t_ns)

    # What it was set to.

    def written(self, index: int, subindex: int) -> None:
        """Somebody else has written to one of its objects."""
        meaning = self._set_up_by.meaning_of(index, subindex) if self._set_up_by else None
        if meaning is not None:
            self._settings_changed(f"somebody else wrote to {meaning}")

    async def check_settings(self, within_s: float) -> str:
        """Read back what the drives' own safety depends on. Never raises.

        Returns what is wrong with it, in words; empty: nothing, or the node is not operational,
        which is told as such. Where a setting differs the node is set up anew.
        """
        set_up, wrong = self._set_up_by, ""
        if self.state is not NodeState.OPERATIONAL or set_up is None:
            return ""
        try:
            async with asyncio.timeout(within_s):
                differences = await set_up.differences()
        except TimeoutError:
            wrong = f"has not shown its settings within {within_s:g} s"
        except (SdoError, EdsError, CodecError) as error:
            wrong = f"does not show its settings: {error}"
        else:
            if differences:
                wrong = ", ".join(differences)
                self._settings_changed(wrong)
        return f"{self.subject} {wrong}" if wrong and self.state is NodeState.OPERATIONAL else ""

    def set_up_anew(self, why: str) -> None:
        """What it was set to does not hold any more; it is written again once nothing moves."""
        self._settings_changed(why)

    def _settings_changed(self, detail: str) -> None:
        self._must_be_rewritten = True
        self._remark(c.SETTINGS_CHANGED, detail)

    @property
    def _may_be_rewritten(self) -> bool:
        """Setting it up resets its communication, at which drives with torque would stop."""
        return self._bus_is_ours() and not any(one.state.energised for one in self.channels)

    # Its life.

    async def life(self) -> None:
        """Set the node up, watch it, and begin anew whenever it is lost. Until cancelled."""
        while True:
            self.state = NodeState.SETTING_UP
            self._forget()
            while not self._bus_is_ours():
                await asyncio.sleep(_TRY_AGAIN_S)
            try:
                await self._set_up()
                await self._start()
            except BringUpError as error:
                self.state = NodeState.ABSENT
                self._cannot_be_used(error)
                await asyncio.sleep(_TRY_AGAIN_S)
                continue
            self.state = NodeState.OPERATIONAL
            self._boot_ups_when_well = self.heartbeat.boot_ups
            now_ns = self._clock.now_ns()
            self._conditions.clear_subject(self.subject, now_ns, keep=_KEPT_WHEN_SET_UP)
            for channel in self.channels:
                self._status_changed(channel, now_ns)
            self._trouble.clear()
            asking = asyncio.create_task(self._ask_about_faults(self._set_up_by))
            try:
                await self._trouble.wait()
            finally:
                await end_tasks([asking], _ASKING_ENDS_WITHIN_S)

    async def _ask_about_faults(self, set_up: NodeSetUp | None) -> None:
        """Of faults that no error explains: the drive had them before anybody listened, or tells
        its errors elsewhere. Until cancelled."""
        while set_up is not None:
            await asyncio.sleep(_ASK_EVERY_S)
            for channel in self.emergencies.unexplained(self._clock.now_ns()):
                try:
                    code = await set_up.error_code(channel.axis)
                except (SdoError, EdsError, CodecError):
                    code = 0
                self.emergencies.explained(channel, code, self._clock.now_ns())

    async def _set_up(self) -> None:
        """Take the node to pre-operational with its communication reset, and set it up."""
        if await self._restarts_by_itself() or await self._reset_communication():
            await asyncio.sleep(_SETTLE_S)
        else:
            await self._find_without_boot_up()
        if not await self._write_settings() and not await self._write_settings():
            raise BringUpError(c.RESET, "it restarts while it is being set up")

    async def _restarts_by_itself(self) -> bool:
        """Whether a node that has fallen silent says within its boot time that it restarted."""
        known, self._boot_ups_when_well = self._boot_ups_when_well, None
        if known is None:
            return False
        if not await self._hears(lambda: self.heartbeat.boot_ups > known, _BOOTS_WITHIN_S):
            return False
        self._conditions.note(c.RESET, self.subject, self._clock.now_ns())
        return True

    async def _reset_communication(self) -> bool:
        """Whether the node answers a reset with its boot-up. One that boots for longer than it is
        waited for is not reset again meanwhile: it would never come up. One that beats has not
        heard of it."""
        reset_ns, now_ns = self._reset_ns, self._clock.now_ns()
        if reset_ns is not None and now_ns - reset_ns <= _BOOTS_FOR_NS:
            await self._hears(lambda: self._booted or self._beats, _BOOT_UP_WITHIN_S)
            if not (self._booted or self._beats):
                return False
        if reset_ns is None or not self._booted:
            self._reset_ns, self._boot_ups_before = now_ns, self.heartbeat.boot_ups
            self._command(NmtCommand.RESET_COMMUNICATION)
            if not await self._hears(lambda: self._booted, _BOOT_UP_WITHIN_S):
                return False
        self._reset_ns = None
        return True

    @property
    def _booted(self) -> bool:
        """Since it was reset."""
        return self.heartbeat.boot_ups > self._boot_ups_before

    @property
    def _beats(self) -> bool:
        """Whether it is heard, and so is not booting."""
        return self.heartbeat.state not in (None, NmtState.BOOT_UP)

    async def _write_settings(self) -> bool:
        """Identify the node and set it up. False: it booted meanwhile, as boot loaders make it."""
        for condition in _FOUND_WHILE_SET_UP:  # what the set-up before found is looked for anew
            self._conditions.clear(condition, self.subject, self._clock.now_ns())
        boot_ups = self.heartbeat.boot_ups
        axes = [channel.axis for channel in self.channels]
        set_up = NodeSetUp(self._bus, axes, self.dictionary, self.sdo, self._remark)
        self._set_up_by, self._must_be_rewritten = set_up, False
        try:
            self.identity = await set_up.run()
        except BringUpError:
            if self.heartbeat.boot_ups == boot_ups:
                raise
        return self.heartbeat.boot_ups == boot_ups

    async def _find_without_boot_up(self) -> None:
        """Some nodes announce nothing after a reset; one that answers is there."""
        try:
            await self.sdo.read(objects.DEVICE_TYPE)
        except SdoError as error:
            if self._beats:
                self._reset_ns = None
            raise BringUpError(c.ABSENT, str(error)) from error
        reset_ns, self._reset_ns = self._reset_ns, None
        if self._booted:  # while it was asked
            return
        if reset_ns is not None and self._clock.now_ns() - reset_ns > _RESET_JUST_NOW_NS:
            raise BringUpError(c.ABSENT, "it was not there yet when it was reset, and is now")
        self._command(NmtCommand.ENTER_PRE_OPERATIONAL)

    async def _start(self) -> None:
        """Take the node to operational and wait until it says so and sends its state."""
        heartbeat, set_up = self.heartbeat, self._set_up_by
        assert set_up is not None
        self._command(NmtCommand.START)
        if await set_up.tells_errors_elsewhere():  # asked while its heartbeat has to be waited for
            self._command(NmtCommand.ENTER_PRE_OPERATIONAL)
            try:
                await set_up.have_errors_told_here()
            except (SdoError, EdsError, CodecError) as error:
                raise BringUpError(c.SETTING_REFUSED, str(error)) from error
            self._command(NmtCommand.START)
        if not await self._hears(
            lambda: heartbeat.state is NmtState.OPERATIONAL, _OPERATIONAL_WITHIN_S
        ):
            reported = heartbeat.state
            detail = "no heartbeat" if reported is None else f"it says {reported.name.lower()}"
            raise BringUpError(c.NOT_OPERATIONAL, detail)

        def sends_state() -> bool:
            return all(channel.received_ns is not None for channel in self.channels)

        if not await self._hears(sends_state, _OPERATIONAL_WITHIN_S):
            with suppress(SdoError, EdsError, CodecError):  # that it sends nothing says more
                await set_up.have_our_sync_taken()
            if not await self._hears(sends_state, _OPERATIONAL_WITHIN_S):
                raise BringUpError(c.PDO_SILENT, "no state since it was started")
        await self._check_modes()

    async def _check_modes(self) -> None:
        assert self._set_up_by is not None
        try:
            for refusal in await self._set_up_by.mode_refusals():
                self._remark(c.MODE_REFUSED, refusal)
        except SdoError as error:
            raise BringUpError(c.SDO_SILENT, str(error)) from error

    async def _hears(self, expected: Callable[[], bool], within_s: float) -> bool:
        """Wait until what the node sends makes `expected` true. False: it does not."""
        try:
            async with asyncio.timeout(within_s):
                while not expected():
                    self._heard.clear()
                    await self._heard.wait()
        except TimeoutError:
            return False
        return True

    def _status_changed(self, channel: AxisChannel, t_ns: int) -> None:
        """Keep the conditions that a statusword tells."""
        subject, word = channel.axis.name, channel.statusword
        self.emergencies.status_changed(channel, t_ns)
        for condition, present in (
            (c.WARNING, bool(word & StatuswordBit.WARNING)),
            (c.NO_VOLTAGE, channel.voltage_lost),
        ):
            if present:
                detail = self.emergencies.explanation(t_ns)
                self._conditions.set(condition, subject, t_ns, detail)
            else:
                self._conditions.clear(condition, subject, t_ns)

    def _cannot_be_used(self, error: BringUpError) -> None:
        """Of what stands in the way, only the latest counts; that it was lost stays."""
        now_ns = self._clock.now_ns()
        self._conditions.clear_subject(self.subject, now_ns, keep=(error.condition, c.LOST))
        self._conditions.set(error.condition, self.subject, now_ns, error.detail)

    def _in_trouble(self) -> None:
        self.state = NodeState.SETTING_UP
        self._forget()
        self._trouble.set()

    def _forget(self) -> None:
        self.heartbeat.forget()
        for channel in self.channels:
            channel.forget()

    def _command(self, command: NmtCommand) -> None:
        self._send(cob_ids.NMT, encode_nmt_command(command, self.number))

    def _remark(self, condition: Condition, detail: str) -> None:
        self._conditions.set(condition, self.subject, self._clock.now_ns(), detail)
