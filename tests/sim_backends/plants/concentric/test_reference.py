"""Our statics beside solutions that were found by two other formulations."""

from pathlib import Path

import pytest

from tests.ctr_conformance import LIMITS, differences, load, main

DATA = Path(__file__).parent / "data"
NPZ, JSON = DATA / "ctr_reference.npz", DATA / "ctr_reference.json"


def test_all_groups_agree_with_the_reference() -> None:
    found = differences(*load(NPZ, JSON))
    assert set(found) == {
        "paper_unloaded",
        "paper_twist",
        "paper_tipforce",
        "paper_gravity",
        "general",
        "closed arc",
        "closed pair",
        "closed no twist",
    }
    for group, worst in found.items():
        for kind, value in worst.items():
            assert value <= LIMITS[kind], (group, kind)
    assert {"jacobian"} < set(found["paper_unloaded"])
    assert {"compliance", "asymmetry"} < set(found["paper_tipforce"])


def test_a_wrong_tip_is_noticed() -> None:
    robots, arrays = load(NPZ, JSON)
    moved = {**arrays, "paper_twist/p_tip": arrays["paper_twist/p_tip"] + 2e-6}
    assert differences(robots, moved)["paper_twist"]["tip_um"] == pytest.approx(2.0, abs=0.1)


def test_files_that_say_nothing_are_explained(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    empty = tmp_path / "empty.json"
    empty.write_text("{}")
    assert main([str(NPZ), str(empty)]) == 2
    assert "empty.json" in capsys.readouterr().err
