"""Alerts: what a component of the tracker says is wrong with it."""

from collections.abc import Mapping

from drivers.aurora.bring_up import CONTROL_UNIT
from drivers.aurora.codec.errors import CodecError
from drivers.aurora.codec.parameters import ALERTS, NEW_ALERTS, decode_parameters
from drivers.aurora.conditions import ALERT
from drivers.aurora.health import Health
from drivers.aurora.link import DamagedReplyError, DeviceRefusedError, Link

_TEXTS: Mapping[str, Mapping[int, str]] = {
    "SCU": {
        0x01: "processor fault",
        0x02: "fault of a peripheral",
        0x04: "fault of the field generator's driver",
        0x08: "a supply voltage is out of range",
    },
    "FG": {
        0x01: "communication fault",
        0x02: "coil fault",
        0x04: "no volume that fits this control unit",
    },
    "SIU": {
        0x01: "processor fault",
        0x02: "communication fault",
        0x04: "fault of the analogue part",
        0x08: "hardware and firmware do not fit together",
    },
}
_OVERFLOW = 0x80000000


def alert_texts(component: str, bits: int) -> str:
    """The alerts of a component like `SIU-1` in words; bits without a meaning as a number."""
    known = {**_TEXTS.get(component.partition("-")[0], {}), _OVERFLOW: "too many alerts to tell"}
    texts = [text for bit, text in known.items() if bits & bit]
    rest = bits & ~sum(known)
    return ", ".join([*texts, *([f"alert {rest:08X}"] if rest else [])])


async def fetch_alerts(link: Link, components: tuple[str, ...], health: Health) -> None:
    """Ask every component, which also clears the alert bit of the system status."""
    alerts: dict[str, str] = {}
    for component in components:
        prefix = "" if component == CONTROL_UNIT else f"{component}."
        new = await _value(link, prefix + NEW_ALERTS)
        bits = await _value(link, prefix + ALERTS)
        if bits:
            alerts[component] = alert_texts(component, bits)
        elif new and not health.holds(ALERT, component):
            health.note(ALERT, component, alert_texts(component, new))
    health.keep_only(ALERT, alerts)


async def _value(link: Link, name: str) -> int:
    """A number; 0 where the component does not have it, or was unplugged meanwhile."""
    try:
        return await link.query("GET", name, _number)
    except (DeviceRefusedError, DamagedReplyError):
        return 0


def _number(text: str) -> int:
    (value,) = decode_parameters(text).values()
    try:
        return int(value, 10) & 0xFFFFFFFF
    except ValueError:
        raise CodecError(f"GET: '{text}' is not a number") from None
