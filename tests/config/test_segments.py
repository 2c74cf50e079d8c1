"""A soft arm's segments in its file: as many chambers as axes, and what does not fit."""

from pathlib import Path

import pytest
from pydantic import ValidationError

from config.emulation.plants import SoftArmPlant
from tests import SHIPPED_ROBOTS
from tests.config.edited import problems_of

ONE_SEGMENT = SHIPPED_ROBOTS / "one_segment_arm.yaml"
ONE = [{"length_mm": 100.0}]
THREE = [{"length_mm": 60.0, "chambers": n} for n in (3, 4, 5)]


def plant(**given: object) -> SoftArmPlant:
    return SoftArmPlant.model_validate({"kind": "soft_arm", **given})


def test_an_arm_is_as_long_as_its_segments_and_has_their_chambers() -> None:
    assert (plant().length_mm, plant().chambers) == (155.0, 6)
    assert (plant(segments=ONE).length_mm, plant(segments=ONE).chambers) == (100.0, 3)
    assert (plant(segments=THREE).length_mm, plant(segments=THREE).chambers) == (180.0, 12)


@pytest.mark.parametrize(("segments", "chambers"), [(ONE, 3), (THREE, 12)])
def test_a_named_body_has_a_figure_for_each_chamber(
    segments: list[dict[str, object]], chambers: int
) -> None:
    assert plant(segments=segments).chamber_area_ratios == (1.0,) * chambers
    ratios = plant(segments=segments, body="mismatched").chamber_area_ratios
    six = plant(body="mismatched").chamber_area_ratios
    assert ratios == tuple(six[i % 6] for i in range(chambers))


def test_ratios_that_are_given_must_be_one_for_each_chamber() -> None:
    assert plant(segments=ONE, chamber_area_ratios=[1.1, 0.9, 1.0]).chambers == 3
    with pytest.raises(ValidationError, match="2 ratios are not one for each of 3 chambers"):
        plant(segments=ONE, chamber_area_ratios=[1.1, 0.9])


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("chambers: 3}", "chambers: 2}", "emulation.plant.segments[0].chambers: "),
        ("chambers: 3}", "chambers: many}", "emulation.plant.segments[0].chambers: "),
        ("chambers: 3}", "chambers: 4}", "axes: 3 axes cannot fill the 4 chambers"),
        ("- {length_mm: 100.0, chambers: 3}", "- 100.0", "emulation.plant.segments[0]: "),
        ("length_mm: 100.0, ", "", "emulation.plant.segments[0].length_mm: this key is required"),
    ],
)
def test_a_mistake_is_told_at_its_place(old: str, new: str, told: str, tmp_path: Path) -> None:
    problems = problems_of(tmp_path, ONE_SEGMENT, (old, new))
    assert any(told in problem for problem in problems), problems
