"""`tentacled experiment` with a controller of a package that does everything wrong: the reason is
told with its name, and the robot has held. Under the running daemon: tests/hil/test_ten_defects.py.
"""

import json
from pathlib import Path

import pytest

from daemon.commands.terminal.command_line import main
from tests.daemon.plugins.defective import HELD, REFUSED, Defect, package
from tests.installed_package import installed

EXPERIMENT = """experiment: defective
robot: builtin:soft_arm
trajectory: {{kind: hold, position_mm: [0, 0, 168], duration_s: 3}}
controller: {controller}
longest_s: 4
"""


def carried_out(
    folder: Path, defect: Defect, capsys: pytest.CaptureFixture[str]
) -> tuple[int, str]:
    """The exit code, and what was told on stderr."""
    path = folder / "defective.yaml"
    path.write_text(EXPERIMENT.format(controller=json.dumps(defect.controller)))
    with installed(package(folder / "site")):
        code = main(["experiment", str(path), "--out", str(folder / "out"), "--no-report"])
    return code, capsys.readouterr().err


@pytest.mark.parametrize("defect", REFUSED.values(), ids=list(REFUSED))
def test_what_cannot_be_used_is_refused_before_anything_moves(
    defect: Defect, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, told = carried_out(tmp_path, defect, capsys)
    assert code != 0
    assert defect.whose in told
    assert defect.told in told


@pytest.mark.parametrize("defect", HELD.values(), ids=list(HELD))
def test_what_it_does_wrong_meanwhile_holds_the_robot(
    defect: Defect, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, told = carried_out(tmp_path, defect, capsys)
    assert code != 0
    assert f"{defect.whose}" in told
    assert defect.told in told
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["faults"][0] == "controller_failed"
    assert result["holds"] > 0
