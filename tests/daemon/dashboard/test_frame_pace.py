"""How often the page draws, by what pictures cost: its own module, run by playwright's node."""

import json
import subprocess
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import pytest

_MODULE: Final = Path("daemon/dashboard/static/frame_pace.js").resolve()
_DRAW: Final = """
import { Pace } from "./frame_pace.mjs";
const [cost, half_ms, led] = JSON.parse(process.argv[2]);
const pace = new Pace();
pace.led = led;
let asked = 0, pictures = 0, spent = 0, longest = 0, last = half_ms;
for (let now = 0; now < 2 * half_ms; now += 1000 / 60) {
  if (!pace.due(now)) continue;
  asked += 1;
  const took = cost.each + cost.pixels * pace.fineness ** 2 + (asked % 6 ? 0 : cost.odd);
  pace.began(now);
  pace.took(took);
  if (now < half_ms) continue;
  pictures += 1;
  spent += took;
  longest = Math.max(longest, now - last);
  last = now;
}
const { fineness } = pace;
const per_s = 1000 * pictures / half_ms;
console.log(JSON.stringify({ per_s, share: spent / half_ms, longest, fineness }));
"""


def drawn(tmp_path: Path, each: float, pixels: float, led: bool = False, odd: float = 0) -> Any:
    """The second half of 20 s. each: ms of every picture; pixels: and of one of plain fineness;
    odd: more for one of six."""
    package = find_spec("playwright")
    if package is None or package.origin is None:
        pytest.skip("there is no playwright, whose node runs this")
    node = Path(package.origin).parent / "driver" / "node"
    (tmp_path / "frame_pace.mjs").write_bytes(_MODULE.read_bytes())
    script = tmp_path / "draw.mjs"
    script.write_text(_DRAW)
    what = json.dumps([{"each": each, "pixels": pixels, "odd": odd}, 10_000, led])
    done = subprocess.run([node, script, what], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def test_where_pictures_are_cheap_every_one_is_drawn_and_finely(tmp_path: Path) -> None:
    found = drawn(tmp_path, 0.3, 0.4)
    assert found["per_s"] > 58 and found["fineness"] == 2


@pytest.mark.parametrize(("each", "pixels"), [(2, 9), (4, 15), (10, 40), (15, 60)])
def test_where_they_are_dear_a_bounded_share_of_a_core_goes_into_them(
    tmp_path: Path, each: float, pixels: float
) -> None:
    found = drawn(tmp_path, each, pixels)
    assert found["share"] <= 0.125, (
        "a tenth, or an eighth where they are few, and the rest is the robot's"
    )
    assert found["longest"] <= 267, "and still it moves"


def test_dear_pictures_grow_coarser_before_they_grow_seldom(tmp_path: Path) -> None:
    assert drawn(tmp_path, 2, 9)["fineness"] == 1
    assert drawn(tmp_path, 4, 15)["fineness"] == 0.75
    coarse = drawn(tmp_path, 4, 60)
    assert coarse["fineness"] == 0.5 and coarse["longest"] <= 209


def test_whoever_leads_the_tip_sees_it_eight_times_a_second_whatever_it_costs(
    tmp_path: Path,
) -> None:
    found = drawn(tmp_path, 60, 100, led=True)
    assert found["per_s"] >= 7 and found["longest"] <= 142


def test_whoever_leads_the_tip_sees_it_twice_as_often_for_a_fifth_of_a_core(tmp_path: Path) -> None:
    led, alone = drawn(tmp_path, 4, 6, led=True), drawn(tmp_path, 4, 6)
    assert led["per_s"] > 1.6 * alone["per_s"] and led["share"] <= 0.21


def test_one_picture_that_waited_for_another_program_changes_nothing(tmp_path: Path) -> None:
    assert drawn(tmp_path, 0.3, 0.4, odd=200)["per_s"] > 58
