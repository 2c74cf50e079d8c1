"""The robot in ROS' words: units, names and types as others know them."""

from typing import Any

import pytest
from msgspec.structs import replace

from daemon.bridges.ros2.graph import Node, Topic, attachment, publisher_identifier
from daemon.messages import Axes, AxisStatus, Body, Message, Reason
from tests.daemon.bridges.telling import DATE_NS, body, status, tip

rosbags = pytest.importorskip("rosbags.typesys", reason="pip install '.[bridges]'")

STORE = rosbags.get_typestore(rosbags.Stores.ROS2_JAZZY)
AXES = [
    AxisStatus(name=name, unit=unit, drive_state="on", node_state="operational", force_unit=force)
    for name, unit, force in (("pull", "mm", "N"), ("turn", "rad", "N mm"))
]
POSE_HASH = "RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8"
"""As rmw_zenoh and its re-implementations in other languages have it for Jazzy."""


def told(*messages: Message) -> dict[str, Any]:
    from daemon.bridges.ros2.translation import RosTranslation

    translation = RosTranslation("arm")
    topics = translation.topics()
    found: dict[str, Any] = {}
    for message in messages:
        for name, cdr, date_ns in translation.told(message, DATE_NS):
            assert date_ns == DATE_NS
            found[name] = STORE.deserialize_cdr(cdr, topics[name].type)
    return found


def test_topics_have_the_names_types_and_hashes_that_others_look_for() -> None:
    from daemon.bridges.ros2.translation import RosTranslation

    topics = RosTranslation("arm").topics()
    assert topics["tip"].key(3) == f"3/arm/tip/geometry_msgs::msg::dds_::PoseStamped_/{POSE_HASH}"
    assert topics["tf"].name == "/tf" and topics["diagnostics"].name == "/diagnostics"


def test_tokens_and_attachments_are_those_of_rmw_zenoh() -> None:
    node = Node(0, "a1b2", "tentacled_arm")
    assert node.token == "@ros2_lv/0/a1b2/0/0/NN/%/%/tentacled_arm"
    topic = Topic("/arm/tip", "geometry_msgs/msg/PoseStamped", POSE_HASH)
    token = node.publisher_token(4, topic)
    assert token == (
        "@ros2_lv/0/a1b2/0/4/MP/%/%/tentacled_arm/%arm%tip/"
        f"geometry_msgs::msg::dds_::PoseStamped_/{POSE_HASH}/::,10:,:,:,,"
    )
    identifier = publisher_identifier(token)
    assert identifier != publisher_identifier(node.publisher_token(5, topic))
    packed = attachment(7, DATE_NS, identifier)
    assert len(packed) == 33 and packed[:8] == (7).to_bytes(8, "little")
    assert packed[16] == 16 and packed[17:] == identifier
    for domain, name in ((233, "arm"), (-1, "arm"), (0, "an arm"), (0, "")):
        with pytest.raises(ValueError, match=r"domain|name"):
            Node(domain, "a", name)


def test_the_tip_is_in_metres_with_its_date() -> None:
    found = told(tip(quaternion=[0.0, 0.0, 0.0, 2.0]))
    pose = found["tip"]
    assert (pose.header.stamp.sec, pose.header.stamp.nanosec) == divmod(DATE_NS, 10**9)
    place, turn = pose.pose.position, pose.pose.orientation
    assert (place.x, place.y, place.z) == pytest.approx((0.01, -0.02, 0.1905))
    assert (turn.x, turn.y, turn.z, turn.w) == (0.0, 0.0, 1.0, 0.0)
    assert [one.child_frame_id for one in found["tf"].transforms] == ["arm/tip", "arm/reference"]


def test_what_is_not_known_is_not_told() -> None:
    assert told(tip(tip_mm=None, reference_mm=None)) == {}
    assert told(Body(t_ns=1, source="none")) == {}


def test_the_body_is_a_path_whose_poses_point_along_it() -> None:
    poses = told(body(4))["body"].poses
    assert len(poses) == 4 and poses[-1].pose.position.z == pytest.approx(0.03)
    turn = poses[1].pose.orientation
    along_y = 2 * (turn.y * turn.z - turn.w * turn.x)
    assert along_y == pytest.approx(1 / 101**0.5)


def test_axes_are_joints_in_si_once_their_names_are_known() -> None:
    axes = Axes(sequence=1, t_ns=1, actual=[10.0, 0.5], target=[0.0, 0.0], force=[3.0, 0.1])
    assert told(axes) == {}
    joints = told(status(axes=AXES), axes)["joint_states"]
    assert joints.name == ["pull", "turn"]
    assert joints.position.tolist() == [0.01, 0.5] and joints.effort.tolist() == pytest.approx(
        [3.0, 1e-4]
    )
    assert "joint_states" not in told(status(axes=AXES), replace(axes, actual=[1.0]))


def test_every_reason_is_a_diagnostic_with_its_remedy() -> None:
    reasons = [
        Reason(name="a", severity="warning", subject="loop", text="late", remedy="wait"),
        Reason(name="b", severity="fault", subject="can0/3", text="gone", remedy="plug it in"),
    ]
    entries = told(status(state="fault", reasons=reasons))["diagnostics"].status
    assert [(one.level, one.name) for one in entries] == [
        (2, "arm: state"),
        (1, "arm: loop: a"),
        (2, "arm: can0/3: b"),
    ]
    assert {pair.key: pair.value for pair in entries[2].values}["remedy"] == "plug it in"
    assert {pair.key: pair.value for pair in entries[0].values}["simulated"] == "true"
