"""A made-up run that looks like a real one: a soft arm that learns to follow a circle."""

import asyncio
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from daemon.messages import (
    Axes,
    AxisStatus,
    Body,
    Component,
    Event,
    LeaseStatus,
    Loop,
    LoopStatus,
    Message,
    Reason,
    ReferenceStatus,
    Risk,
    RiskStatus,
    Status,
    SurroundingsChanged,
    Tip,
    TrackerStatus,
)
from daemon.recording.direct_recorder import DirectRecorder
from daemon.recording.flight_recorder import Recorder
from daemon.recording.run_folder import RUN_FILE, SURROUNDINGS_FILE, segment_file, unfinished

BOOT_NS = 5_000_000_000
WALL_NS = 1_577_836_800_000_000_000
"""2020-01-01T00:00:00Z: the date at BOOT_NS on the monotonic clock."""

RATE_HZ = 40.0
LEAD_S = 3.0
CYCLE_S = 20.0
HEADER = {"robot": "soft_arm", "experiment": "circle"}


def messages(cycles: int = 3, cycle_s: float = CYCLE_S, seed: int = 1) -> Iterator[Message]:
    """Telemetry of a run in the order in which a daemon publishes it."""
    random = np.random.default_rng(seed)
    steps = round((LEAD_S + cycles * cycle_s + 1.0) * RATE_HZ)
    state, events = "armed", 0
    t_ns = BOOT_NS
    for step in range(steps):
        t_ns += round(1e9 / RATE_HZ + random.normal(0.0, 2e5))
        elapsed_s = step / RATE_HZ
        cycle = int((elapsed_s - LEAD_S) // cycle_s) if elapsed_s >= LEAD_S else -1
        held = cycle == 1 and 3.0 < elapsed_s - LEAD_S - cycle_s < 4.5
        now = "hold" if held else "running" if elapsed_s > 1.0 else "armed"
        if cycle >= cycles:
            now, cycle = "armed", -1
        if now != state:
            events += 1
            yield event(events, t_ns, state, now)
            state = now
        yield from _step(step, t_ns, state, cycle, elapsed_s, cycle_s, random)
        if step % 40 == 39:
            timing = loop_status(random)
            yield Loop(t_ns=t_ns, status=timing)
            yield body(t_ns, [10.0, 5.0, 180.0])
            yield status(step, t_ns, state, cycle, cycles, timing)


def event(number: int, t_ns: int, before: str, now: str) -> Event:
    texts = {"hold": "the tracker has lost the tip", "running": "follows the reference"}
    return Event(
        sequence=number,
        t_ns=t_ns,
        kind="state",
        name=now,
        subject="robot",
        present=True,
        text=texts.get(now, f"from {before} to {now}"),
        severity="hold" if now == "hold" else "",
    )


def _step(
    step: int,
    t_ns: int,
    state: str,
    cycle: int,
    elapsed_s: float,
    cycle_s: float,
    random: np.random.Generator,
) -> Iterator[Message]:
    angle = 2 * np.pi * (elapsed_s - LEAD_S) / cycle_s
    reference = np.array([30 * np.cos(angle), 30 * np.sin(angle), 180.0])
    size = 6.0 if cycle < 0 else 4.5 / (1 + 1.6 * cycle)
    wobble = np.array([np.sin(3 * angle), np.cos(2 * angle), 0.4 * np.sin(5 * angle)])
    tip = reference + size * (0.5 + 0.5 * np.sin(angle) ** 2) * wobble + random.normal(0, 0.08, 3)
    if state == "armed":
        reference_mm, error_mm = None, None
    else:
        reference_mm, error_mm = reference.tolist(), float(np.linalg.norm(tip - reference))
    yield Tip(
        sequence=step,
        t_ns=t_ns,
        state=state,
        measured_mm=(tip + random.normal(0, 0.2, 3)).tolist(),
        tip_mm=tip.tolist(),
        velocity_mm_s=[0.0, 0.0, 0.0],
        quaternion=[1.0, 0.0, 0.0, 0.0],
        reference_mm=reference_mm,
        error_mm=error_mm,
        cycle=cycle,
    )
    target = 20 + 12 * np.cos(angle - np.arange(6) * np.pi / 3)
    yield Axes(
        sequence=step,
        t_ns=t_ns,
        actual=(target + random.normal(0, 0.02, 6) - 0.3 * np.sin(angle)).tolist(),
        target=target.tolist(),
        proposed=random.normal(0, 0.1, 6).tolist(),
        permitted=random.normal(0, 0.1, 6).tolist(),
        force=(40 + 1.5 * target + random.normal(0, 1.0, 6)).tolist(),
    )
    contact = float(np.clip(0.03 * (1 + np.sin(angle)) + random.normal(0, 0.004), 0, 1))
    yield Risk(
        sequence=step,
        t_ns=t_ns,
        source="mixture",
        contact_risk=contact,
        body_point_risk=0.2 * contact,
        threshold=0.05,
        scale=1.0 if contact < 0.05 else 0.4,
        reasons=[] if contact < 0.05 else ["risk"],
        clearance_mm=float(8.0 - 100.0 * contact),
        arc_mm=150.0,
        place_mm=tip.tolist(),
        obstacle_mm=(tip + np.array([12.0, 0.0, 0.0])).tolist(),
        means_mm=[(share * tip).tolist() for share in (0.3, 0.6, 0.9)],
    )


def body(t_ns: int, tip_mm: list[float]) -> Body:
    along = np.linspace(0.0, 1.0, 20)[:, None]
    return Body(
        t_ns=t_ns,
        source="model",
        centreline_mm=(along * np.array(tip_mm) * [along**2, along**2, 1.0][0]).tolist(),
        radius_mm=[9.0] * len(along),
        components=[
            Component(
                weight=1.0,
                mean_mm=[0.5 * part for part in tip_mm],
                covariance_mm2=[20.0, 0.0, 0.0, 20.0, 0.0, 90.0],
            )
        ],
    )


def loop_status(random: np.random.Generator) -> LoopStatus:
    late = float(abs(random.normal(6e-5, 2e-5)))
    return LoopStatus(
        rate_hz=RATE_HZ,
        cycle_rate_hz=100.0,
        lateness_p50_s=late,
        lateness_p99_s=2.5 * late,
        lateness_max_s=5 * late,
        missed=0,
        step_p50_s=4e-4 + late,
        step_p99_s=9e-4 + late,
    )


def status(step: int, t_ns: int, state: str, cycle: int, cycles: int, timing: LoopStatus) -> Status:
    names = [f"{part}_{number}" for part in ("proximal", "distal") for number in (1, 2, 3)]
    return Status(
        robot="soft_arm",
        state=state,
        reasons=[
            Reason(
                name="simulated",
                severity="warning",
                subject="robot",
                text="devices are emulated",
                remedy="",
            )
        ],
        t_ns=t_ns,
        sequence=step,
        tip_mm=[0.0, 0.0, 180.0],
        reference_mm=None,
        error_mm=None,
        tracker=TrackerStatus(
            state="tracking", rate_hz=RATE_HZ, age_s=0.02, quality=1.0, latency_s=0.02
        ),
        axes=[
            AxisStatus(
                name=name,
                unit="mm",
                actual=20.0,
                target=20.0,
                drive_state="operation enabled",
                node_state="operational",
                force=50.0,
                force_unit="N",
            )
            for name in names
        ],
        risk=RiskStatus(
            source="mixture", contact_risk=0.01, body_point_risk=0.0, threshold=0.05, scale=1.0
        ),
        loop=timing,
        lease=LeaseStatus(holder="operator", expires_in_s=1.5),
        recording="runs/x",
        simulated=True,
        reference=ReferenceStatus(
            trajectory="circle",
            controller="online_local_gaussian",
            elapsed_s=0.0,
            duration_s=None,
            cycle=cycle,
            cycles=cycles,
        ),
    )


def record(recorder: Recorder, telemetry: list[Message]) -> None:
    """What happened, with a little traffic beside it, in the order in which it happened."""
    tap = recorder.can_tap("can0")
    for number, message in enumerate(telemetry):
        recorder.message(message)
        t_ns = int(message.t_ns)  # type: ignore[attr-defined]
        if isinstance(message, Tip):
            recorder.tracker_traffic("to_device", b"BX 1801\r", t_ns)
            recorder.tracker_traffic("from_device", bytes([number % 256] * 24), t_ns)
            for node in range(1, 7):
                tap.received(0x180 + node, bytes([number % 256] * 8), t_ns)


async def direct_run(folder: Path, telemetry: list[Message], name: str = RUN_FILE) -> None:
    recorder = DirectRecorder()
    await recorder.start(folder, HEADER, BOOT_NS, WALL_NS, name)
    record(recorder, telemetry)
    await recorder.stop()


def make_run(folder: Path, cycles: int = 3, cycle_s: float = CYCLE_S, seed: int = 1) -> Path:
    """A finished run in `folder`. Returns its recording."""
    asyncio.run(direct_run(folder, list(messages(cycles, cycle_s, seed))))
    return folder / RUN_FILE


def make_surrounded_run(folder: Path, cycle_s: float = CYCLE_S) -> list[SurroundingsChanged]:
    """A run in `folder` in which others take the place of what was round the body: from the
    beginning a mesh, a ball besides from half of the time on, and after three quarters a mesh whose
    file was not kept. Returns what was told of them."""
    telemetry = list(messages(1, cycle_s))
    ball = {"kind": "ball", "keep": "out", "centre_mm": [0.0, 30.0, 60.0], "radius_mm": 9.0}
    told = [
        SurroundingsChanged(
            t_ns=BOOT_NS + int(share * cycle_s * 1e9),
            sha256=file,
            mesh=mesh,
            triangles=1,
            surface=json.dumps({"regions": regions}),
            file=file,
        )
        for share, mesh, file, regions in (
            (0.0, "room.stl", SURROUNDINGS_FILE, []),
            (0.5, "other.stl", "surroundings-2.stl", [ball]),
            (0.75, "lost.stl", "surroundings-3.stl", []),
        )
    ]
    everything = sorted([*telemetry, *told], key=lambda one: int(one.t_ns))  # type: ignore[attr-defined]
    asyncio.run(direct_run(folder, everything))
    for number, file in enumerate((SURROUNDINGS_FILE, "surroundings-2.stl"), start=1):
        facets = bytes(50 * number)
        (folder / file).write_bytes(bytes(80) + number.to_bytes(4, "little") + facets)
    return told


def make_parts(folder: Path, gap: slice) -> list[Message]:
    """A run whose recorder was lost and started again. Returns all that was recorded of it.

    gap: of its telemetry, what is in neither recording. The first one was never ended.
    """
    telemetry = list(messages(cycles=2, cycle_s=4.0))
    first, second = telemetry[: gap.start], telemetry[gap.stop :]
    asyncio.run(direct_run(folder, first))
    (folder / RUN_FILE).rename(unfinished(folder / RUN_FILE))
    asyncio.run(direct_run(folder, second, segment_file(2)))
    return first + second
