"""Named bodies: what they set, and what comes on top."""

from typing import get_args

import pytest
from pydantic import ValidationError

from config.emulation.bodies import BODY_NAMES, BodyName, body_figures
from config.emulation.plants import SoftArmPlant, TendonArmPlant

KINDS: dict[str, type[SoftArmPlant] | type[TendonArmPlant]] = {
    "soft_arm": SoftArmPlant,
    "tendon_arm": TendonArmPlant,
}


@pytest.mark.parametrize("kind", KINDS)
def test_as_made_is_the_arm_as_it_was_designed(kind: str) -> None:
    model = KINDS[kind]
    assert model.model_validate({"kind": kind, "body": "as_made"}) == model.model_validate(
        {"kind": kind}
    )


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", BODY_NAMES)
def test_every_body_is_sound_and_none_is_like_another(kind: str, name: BodyName) -> None:
    plant = KINDS[kind].model_validate({"kind": kind, "body": name})
    assert plant.body == name
    others = [body_figures(kind, other) for other in BODY_NAMES if other != name]
    assert body_figures(kind, name) not in others


def test_every_body_sets_the_same_figures_so_that_one_replaces_another() -> None:
    for kind in KINDS:
        assert len({frozenset(body_figures(kind, name)) for name in BODY_NAMES}) == 1


def test_what_is_given_beside_a_body_comes_on_top_of_it() -> None:
    plant = SoftArmPlant.model_validate({"kind": "soft_arm", "body": "slow", "dead_time_s": 0.1})
    assert (plant.dead_time_s, plant.pneumatic_lag_s) == (0.1, 0.5)


def test_an_unknown_body_is_refused_with_the_names_that_there_are() -> None:
    assert get_args(BodyName) == BODY_NAMES
    with pytest.raises(ValidationError, match="'worn', 'slow', 'heavy' or 'mismatched'"):
        SoftArmPlant.model_validate({"kind": "soft_arm", "body": "old"})


def test_a_checked_plant_is_not_changed_by_checking_it_again() -> None:
    plant = SoftArmPlant.model_validate({"kind": "soft_arm", "body": "worn", "creep": 0.01})
    assert SoftArmPlant.model_validate(plant.model_dump()) == plant
