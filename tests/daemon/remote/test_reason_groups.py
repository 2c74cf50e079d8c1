"""What is to be mended is told once, with its remedy; what follows from it is told under it."""

from daemon.messages import Reason, Refusal
from daemon.remote.client.client_errors import RefusedError
from daemon.remote.reason_groups import detail_of, grouped, reason_lines


def reason(name: str, subject: str, follows_from: str = "", detail: str = "") -> Reason:
    return Reason(
        name=name,
        severity="fault",
        subject=subject,
        text=f"{name} happened",
        remedy=f"mend {name}",
        detail=detail,
        follows_from=follows_from,
    )


STALL = [
    reason("loop_stalled", "loop", detail="300 ms"),
    *(reason("node_lost", f"can0/{n} node_lost", "loop_stalled") for n in range(1, 7)),
    reason("node_not_ready", "can0/1 state", "loop_stalled"),
    reason("node_not_ready", "can0/1 node_absent", "loop_stalled"),
    reason("disk_low", "recorder"),
]


def test_twenty_reasons_become_a_few_lines() -> None:
    assert list(reason_lines(STALL)) == [
        "  loop: loop_stalled happened (300 ms); mend loop_stalled",
        "    from that: can0/1, can0/2, can0/3, can0/4 and 2 more: node_lost happened",
        "    from that: can0/1: node_not_ready happened",
        "  recorder: disk_low happened; mend disk_low",
    ]


def test_the_same_about_other_subjects_is_told_with_the_first() -> None:
    lost = [reason("node_lost", "can0/1"), reason("node_lost", "can0/2", "node_lost")]
    (group,) = grouped(lost)
    assert group.subjects == "can0/1, can0/2"
    assert list(reason_lines(lost)) == ["  can0/1, can0/2: node_lost happened; mend node_lost"]


def test_a_consequence_whose_lead_is_missing_stands_for_itself() -> None:
    assert [group.lead.name for group in grouped([reason("node_lost", "a", "bus_off")])] == [
        "node_lost"
    ]


def test_a_refusal_is_told_like_that_too() -> None:
    refusal = Refusal(request="", state="fault", name="not_ready", text="see", reasons=STALL)
    assert str(RefusedError(refusal)).splitlines() == ["see", *reason_lines(STALL)]


def test_a_detail_that_says_the_same_is_left_out() -> None:
    text = "a drive holds back because of one of its own limits"
    assert detail_of(text, "the drive holds back because of one of its own limits") == ""
    assert detail_of(text, "") == ""
    assert detail_of(text, "0.3 s") == " (0.3 s)"
