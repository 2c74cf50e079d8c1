"""The ports of the emulated tracker: what is plugged in, and which handle it got."""

from dataclasses import dataclass, field

from config.emulation.lab import EmulatedTool
from drivers.aurora.codec.status_bits import PortStatus
from drivers.aurora.codec.tool_information import HandleList, PortHandle

_OCCUPIED = PortStatus.OCCUPIED.value
_INITIALISED = PortStatus.INITIALISED.value
_ENABLED = PortStatus.ENABLED.value

FIRST_HANDLE, LAST_HANDLE = 0x0A, 0x31
MEMORY_BYTES = 1024


@dataclass
class Socket:
    """One channel of a port, and the tool that belongs there."""

    tool: EmulatedTool
    plugged: bool = True
    blank: bool = False
    memory: bytearray = field(default_factory=lambda: bytearray(MEMORY_BYTES))
    definition: dict[int, bytes] = field(default_factory=dict)
    """Uploaded by the client instead of the one in the tool's memory."""

    @property
    def name(self) -> str:
        """`tip`, `base`, or for others `port3`."""
        tool = self.tool
        return tool.attached_to if tool.attached_to != "nothing" else f"port{tool.port}"


@dataclass
class Handle:
    """A port handle. It stays with a tool that was unplugged until the client frees it."""

    socket: Socket
    initialised: bool = False
    enabled: bool = False
    gone: bool = False

    @property
    def status(self) -> PortStatus:
        """Its status bits."""
        return PortStatus(self.bits)

    @property
    def bits(self) -> int:
        """The same as a number, for replies at every frame: flags of an enumeration are slow."""
        bits = 0 if self.gone else _OCCUPIED
        if self.initialised:
            bits |= _INITIALISED
        return bits | _ENABLED if self.enabled else bits


class Rack:
    """All sockets and handles."""

    def __init__(self, tools: list[EmulatedTool]) -> None:
        self.sockets = [Socket(tool, blank=tool.blank_memory) for tool in tools]
        self.handles: dict[int, Handle] = {}
        self._next = FIRST_HANDLE

    def clear(self) -> None:
        """Free every handle: the device was reset or initialised."""
        self.handles.clear()
        self._next = FIRST_HANDLE
        for socket in self.sockets:
            socket.definition.clear()

    def socket(self, name: str) -> Socket | None:
        """The socket of this name."""
        return next((socket for socket in self.sockets if socket.name == name), None)

    def unplug(self, socket: Socket) -> None:
        """Pull the plug: its handles are not followed any more, and wait to be freed."""
        socket.plugged = False
        for handle in self.handles.values():
            if handle.socket is socket:
                handle.gone, handle.enabled = True, False

    def plug(self, socket: Socket) -> None:
        """Push the plug in. It gets a new handle when the client asks for handles."""
        socket.plugged = True

    def assign_handles(self) -> None:
        """Give a handle to every tool that has none. The second sensor of a dual plug shows up
        only once the first is initialised."""
        for socket in self.sockets:
            if socket.plugged and self._live(socket) is None and self._is_known(socket):
                if len(self.handles) > LAST_HANDLE - FIRST_HANDLE:
                    return
                while self._next in self.handles:
                    self._advance()
                self.handles[self._next] = Handle(socket)
                self._advance()

    def listed(self, which: HandleList) -> list[PortHandle]:
        """The handles that PHSR with this option lists."""
        return [
            PortHandle(number, handle.status)
            for number, handle in self.handles.items()
            if _is_listed(handle, which)
        ]

    def _live(self, socket: Socket) -> Handle | None:
        handles = (h for h in self.handles.values() if h.socket is socket and not h.gone)
        return next(handles, None)

    def _is_known(self, socket: Socket) -> bool:
        if socket.tool.channel == 0:
            return True
        for other in self.sockets:
            if other.tool.port == socket.tool.port and other.tool.channel == 0:
                handle = self._live(other)
                return handle is not None and handle.initialised
        return True

    def _advance(self) -> None:
        self._next = FIRST_HANDLE if self._next == LAST_HANDLE else self._next + 1


def _is_listed(handle: Handle, which: HandleList) -> bool:
    return {
        HandleList.ALL: True,
        HandleList.TO_FREE: handle.gone,
        HandleList.TO_INITIALISE: not handle.gone and not handle.initialised,
        HandleList.TO_ENABLE: not handle.gone and handle.initialised and not handle.enabled,
        HandleList.ENABLED: handle.enabled,
    }[which]
