"""The page of the faults that emulated devices can be told to have."""

from sim_backends.devices.aurora.faults import FAULTS
from sim_backends.devices.can.faults import BUS_FAULTS
from sim_backends.devices.drive.faults import DRIVE_FAULTS
from tests.docs.reference.markdown import table

_HEAD = """\
# All faults

What `tentacled inject DEVICE.FAULT=VALUE,...` and a scenario's `inject:` may say, see
[Faults](../faults.md). Values in brackets may be left out. Durations have a unit: `0.5s`, `200ms`.
"""
_DEVICES = (
    ("The tracker", "tracker.", FAULTS),
    ("A drive", "drive.BUS/NODE.", DRIVE_FAULTS),
    ("A bus", "bus.BUS.", BUS_FAULTS),
)


def faults_page() -> str:
    """The page."""
    parts = [_HEAD]
    for title, begin, faults in _DEVICES:
        rows = ((f"`{begin}{fault.usage()}`", fault.text) for fault in faults)
        parts.append(f"\n## {title}: {len(faults)} faults\n\n")
        parts.append(table(("fault", "what happens"), rows))
    return "".join(parts)
