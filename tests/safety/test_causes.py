"""The table of causes: complete, unambiguous, in words that help."""

import pytest

from safety.causes import Cause, ClearRule, Severity, cause, causes_as_markdown

BY_SEVERITY = {
    Severity.WARNING: "tracker_warning bus_degraded drive_warning drive_limit loop_slow "
    "giving_way near_at_rest kept_away real_time_degraded recording_dropped",
    Severity.NOT_READY: "tracker_not_ready node_not_ready not_referenced "
    "drive_settings_changed bus_not_open recorder_failed disk_low",
    Severity.HOLD: "tracker_late tracker_quality bus_queue_full drive_emergency loop_late "
    "lease_lost setpoint_late risk_too_high minute_risk_too_high path_risk_too_high "
    "risk_unavailable body_not_as_modelled "
    "obstacles_late body_failed "
    "gate_refused controller_failed tracking_diverges tip_jumped out_of_workspace tendon_slack "
    "not_recorded disk_full operator_hold",
    Severity.DISARM: "tracker_gone lease_abandoned arming_failed",
    Severity.FAULT: "foreign_master bus_gone bus_off drive_fault drive_following_error "
    "drive_not_enabled node_lost node_reset loop_stalled tendon_over_tension internal_error",
    Severity.ESTOP: "drive_no_voltage",
}
ARE_OVER_BEFORE_ANYBODY_LOOKS = {
    "drive_emergency",
    "risk_too_high",
    "minute_risk_too_high",
    "risk_unavailable",
    "body_failed",
    "gate_refused",
    "controller_failed",
    "out_of_workspace",
    "tracking_diverges",
    "tip_jumped",
    "operator_hold",
}


def test_every_cause_is_as_bad_as_agreed() -> None:
    assert {row.value: row.severity for row in Cause} == {
        name: severity for severity, names in BY_SEVERITY.items() for name in names.split()
    }


def test_severities_are_ordered_so_that_the_worst_wins() -> None:
    assert [int(severity) for severity in Severity] == list(range(7))
    assert [severity.name for severity in sorted(Severity)] == [
        "NONE",
        "WARNING",
        "NOT_READY",
        "HOLD",
        "DISARM",
        "FAULT",
        "ESTOP",
    ]


def test_names_are_unique() -> None:
    assert len({row.value for row in Cause}) == len(Cause)


@pytest.mark.parametrize("row", Cause, ids=lambda row: row.value)
def test_every_cause_says_in_words_what_it_means_and_what_helps(row: Cause) -> None:
    for words in (row.text, row.remedy):
        assert len(words.split()) >= 2
        assert words == words.strip()
        assert not words.endswith(".")
        assert "|" not in words, "it would break the Markdown table"
    assert row.text != row.remedy


@pytest.mark.parametrize("row", Cause, ids=lambda row: row.value)
def test_what_powers_off_for_good_must_be_cleared_and_nothing_else(row: Cause) -> None:
    assert (row.clears is ClearRule.DELIBERATELY) is (row.severity >= Severity.FAULT)
    assert (row.clears is ClearRule.BY_RESUME) is (row.value in ARE_OVER_BEFORE_ANYBODY_LOOKS)


def test_only_what_may_be_a_moment_of_noise_is_waited_for() -> None:
    assert {row.value: row.debounce_s for row in Cause if row.debounce_s} == {
        "tracker_warning": 0.5,
        "bus_degraded": 0.5,
        "drive_warning": 0.2,
        "drive_limit": 0.2,
        "loop_slow": 1.0,
        "giving_way": 0.2,
        "near_at_rest": 0.2,
        "kept_away": 2.0,
        "tracker_quality": 0.1,
        "bus_queue_full": 0.05,
        "risk_too_high": 0.2,
        "risk_unavailable": 0.1,
        "gate_refused": 1.0,
        "out_of_workspace": 0.1,
        "tendon_slack": 0.2,
        "tendon_over_tension": 0.05,
    }


def test_a_cause_is_found_by_its_name() -> None:
    assert cause("bus_gone").severity is Severity.FAULT
    with pytest.raises(KeyError, match="bus_went"):
        cause("bus_went")


def test_the_table_can_be_read_in_markdown() -> None:
    lines = causes_as_markdown().splitlines()
    assert lines[0].startswith("| cause | severity |")
    assert set(lines[1]) == {"|", "-"}
    assert len(lines) == 2 + len(Cause)
    assert all(line.count("|") == 7 for line in lines)
    assert lines[2].startswith("| `drive_no_voltage` | ESTOP | at once | by clearing | the motor")
    assert lines[-1].startswith("| `recording_dropped` | WARNING | at once | by itself |")
    assert any(line.startswith("| `gate_refused` | HOLD | 1 s | by resuming |") for line in lines)
    assert causes_as_markdown().endswith("|\n")
