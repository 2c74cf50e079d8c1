"""What Prometheus reads."""

import msgspec

from daemon.dashboard.metrics import metrics
from daemon.messages import Reason
from tests.daemon.remote.rig import FakeRobot


def test_states_causes_and_rates_are_told_and_names_are_quoted() -> None:
    reason = Reason(name="tip_lost", severity="hold", subject='a"b\\', text="", remedy="")
    status = msgspec.structs.replace(FakeRobot().status(), state="hold", reasons=[reason])
    lines = metrics([("arm", status), ("gone", None)]).splitlines()
    assert 'tentacled_connected{robot="arm"} 1' in lines
    assert 'tentacled_connected{robot="gone"} 0' in lines
    assert 'tentacled_state{robot="arm",state="hold"} 1' in lines
    assert 'tentacled_state{robot="arm",state="ready"} 0' in lines
    assert 'tentacled_cause{robot="arm",cause="tip_lost",subject="a\\"b\\\\"} 1' in lines
    assert 'tentacled_missed_cycles_total{robot="arm"} 0' in lines
    assert "# TYPE tentacled_missed_cycles_total counter" in lines
    assert 'tentacled_contact_risk{robot="arm"} 0' in lines
    assert not any("tracking_error_mm{" in line for line in lines), "unknown is left out"
    assert not any('robot="gone"' in line and "connected" not in line for line in lines)
