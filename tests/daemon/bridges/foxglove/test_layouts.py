"""The shipped layouts: of topics that there are, and as the viewer's own library has them."""

import json
import re

import pytest

from daemon.commands.bridge.foxglove import VIEWERS, layout
from daemon.commands.terminal.command_line import main
from daemon.messages import Axes, Risk, Tip
from daemon.recording.format.channels import TOPICS

pytest.importorskip("foxglove", reason="pip install '.[bridges]'")
from daemon.bridges.foxglove.scene import LOG, SCENE, SURROUNDINGS

FIELDS = {TOPICS[kind]: set(kind.__struct_fields__) for kind in (Tip, Axes, Risk)}


@pytest.mark.parametrize("viewer", VIEWERS)
def test_a_layout_shows_what_is_told(viewer: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bridge", "foxglove", "--layout", viewer]) == 0
    text = capsys.readouterr().out
    assert json.loads(text) and text == layout(viewer)
    plotted = re.findall(r'"value": "(/\w+)\.(\w+)', text)
    assert len(plotted) >= 10
    for topic, field in plotted:
        assert field in FIELDS[topic]
    for topic in (SCENE, SURROUNDINGS):
        assert re.search(rf'"{topic}": \{{\s*"visible": true', text), "topics are hidden by default"
    assert f'"topicToRender": "{LOG}"' in text


def test_lichtblick_has_every_panel_that_its_layout_places() -> None:
    whole = json.loads(layout("lichtblick"))

    def placed(node: object) -> set[str]:
        if isinstance(node, dict):
            return placed(node["first"]) | placed(node["second"])
        return {str(node)}

    assert placed(whole["layout"]) == set(whole["configById"])
