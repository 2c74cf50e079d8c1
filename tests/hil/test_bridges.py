"""Bridges beside a live robot: lab, daemon, bridge and the other program, each a process."""

import time
from collections.abc import Iterator

import numpy as np
import pytest

from tests.daemon.bridges.test_openigtlink_bridge import bridge, witness
from tests.hil.daemon_rig import PATIENT, Rig, robot_file, short_folder

pytestmark = [pytest.mark.hil, pytest.mark.long]


@pytest.fixture(scope="module")
def moving() -> Iterator[Rig]:
    """A robot that goes round its circle."""
    with short_folder() as folder:
        rig = Rig(folder, robot_file(folder, PATIENT))
        try:
            rig.running()
            yield rig
        finally:
            rig.leave()


def test_slicer_s_protocol_shows_the_tip_where_it_is_and_the_whole_body(moving: Rig) -> None:
    pytest.importorskip("pyigtl", reason="pip install '.[test]'")
    with (
        bridge(moving.folder, "--body", "points") as (process, port),
        witness(port, "TipToBase", "ReferenceToBase", "BodyPoints", "State") as wait_for,
    ):
        # Told as it changes, and to who joins: it comes once.
        wait_for(lambda told: told["device"] == "State" and "(simulated)" in told["text"])
        tips: list[list[float]] = []
        while len(tips) < 20:
            told = wait_for(lambda told: told["device"] == "TipToBase")
            tips.append([row[3] for row in told["matrix"][:3]])
            turned = np.array(told["matrix"])[:3, :3]
            assert np.allclose(turned @ turned.T, np.eye(3), atol=1e-5)
        assert np.ptp(tips, axis=0).max() > 0.5, "it moves"
        now_mm = moving.status().tip_mm
        assert now_mm is not None and np.linalg.norm(np.subtract(tips[-1], now_mm)) < 30.0
        body = wait_for(lambda told: told["device"] == "BodyPoints")
        assert len(body["places_mm"]) > 5 and min(body["diameters_mm"]) > 1.0
        tip_mm = wait_for(lambda told: told["device"] == "TipToBase")["matrix"]
        end_mm = np.array(body["places_mm"][-1])
        assert np.linalg.norm(end_mm - [row[3] for row in tip_mm[:3]]) < 20.0
        assert abs(told["date_s"] - time.time()) < 20.0
        assert process.end() == 0
