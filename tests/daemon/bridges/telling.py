"""What a robot may tell, for tests of what others are told of it."""

from hypothesis import strategies as st

from daemon.messages import Body, Status, Tip
from tests.daemon.remote.rig import FakeRobot

NUMBERS = st.floats(-500.0, 500.0, width=32)
PLACES = st.tuples(NUMBERS, NUMBERS, NUMBERS).map(list)
QUATERNIONS = (
    st.tuples(*[st.floats(-1.0, 1.0) for _ in range(4)])
    .filter(lambda q: sum(part * part for part in q) > 0.5)
    .map(list)
)
DATE_NS = 1_800_000_000_123_456_789


def tip(**more: object) -> Tip:
    fields: dict[str, object] = {
        "sequence": 7,
        "t_ns": 1_000_000_000,
        "state": "running",
        "tip_mm": [10.0, -20.0, 190.5],
        "quaternion": [1.0, 0.0, 0.0, 0.0],
        "reference_mm": [11.0, -20.0, 190.0],
        **more,
    }
    return Tip(**fields)  # type: ignore[arg-type]


def body(points: int = 5) -> Body:
    return Body(
        t_ns=1_000_000_000,
        source="model",
        centreline_mm=[[0.0, 1.0 * i, 10.0 * i] for i in range(points)],
        radius_mm=[5.0 - 0.5 * i for i in range(points)],
    )


def status(**more: object) -> Status:
    from msgspec.structs import replace

    return replace(FakeRobot().status(), **more)
