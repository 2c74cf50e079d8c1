"""What Prometheus reads of a robot: its text format, version 0.0.4."""

from collections.abc import Iterable

from daemon.messages import Status
from safety.states import OperatingState


def metrics(robots: Iterable[tuple[str, Status | None]]) -> str:
    """One family after the other. A robot without a status is told as not connected."""
    known = [(name, status) for name, status in robots]
    here = [(name, status) for name, status in known if status is not None]
    families = [
        _family("connected", "Whether the daemon is heard", _each(known)),
        _family(
            "state",
            "1 for the state that the robot is in",
            [
                (
                    f'robot="{_quoted(name)}",state="{state.value}"',
                    float(status.state == state.value),
                )
                for name, status in here
                for state in OperatingState
            ],
        ),
        _family(
            "cause",
            "1 for each reason why the robot is not doing what is wanted",
            [
                (
                    f'robot="{_quoted(name)}",cause="{_quoted(r.name)}",subject="{_quoted(r.subject)}"',
                    1.0,
                )
                for name, status in here
                for r in status.reasons
            ],
        ),
    ]
    for metric, text, value in (
        ("step_rate_hz", "Control steps per second", lambda s: s.loop.rate_hz),
        ("cycle_rate_hz", "Bus cycles per second", lambda s: s.loop.cycle_rate_hz),
        ("cycle_lateness_p99_seconds", "Lateness of bus cycles", lambda s: s.loop.lateness_p99_s),
        ("missed_cycles_total", "Bus cycles that were skipped", lambda s: s.loop.missed),
        ("tracking_error_mm", "Distance of the tip from its reference", lambda s: s.error_mm),
        ("expected_error_mm", "As the controller expects it", lambda s: s.expected_mm),
        ("pointing_error_rad", "Of the tip's direction", lambda s: s.error_rad),
        ("contact_risk", "Of the last step", lambda s: s.risk.contact_risk),
        ("lease_held", "Whether somebody is in control", lambda s: s.lease.holder is not None),
    ):
        rows = [
            (f'robot="{_quoted(name)}"', float(number))
            for name, status in here
            if (number := value(status)) is not None
        ]
        families.append(_family(metric, text, rows, metric.endswith("_total")))
    return "".join(families)


def _connected(status: Status | None) -> float:
    return float(status is not None)


def _each(known: list[tuple[str, Status | None]]) -> list[tuple[str, float]]:
    return [(f'robot="{_quoted(name)}"', _connected(status)) for name, status in known]


def _family(name: str, text: str, rows: list[tuple[str, float]], counter: bool = False) -> str:
    kind = "counter" if counter else "gauge"
    head = f"# HELP tentacled_{name} {text}\n# TYPE tentacled_{name} {kind}\n"
    return head + "".join(f"tentacled_{name}{{{labels}}} {number:g}\n" for labels, number in rows)


def _quoted(value: str) -> str:
    return value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
