"""A study is read whole, and what is wrong with it is told with its place."""

from pathlib import Path

import pytest

from config.documents.kinds import CONTROLLERS, entries
from config.documents.model import OptionsError
from config.documents.problems import ConfigError
from config.tasks.controllers import (
    Broyden,
    ConstantCurvature,
    ProportionalLaw,
    controller_type,
    load_controller_options,
)
from daemon.workbench.studies.study_file import load_study, merged
from tests.daemon.workbench.studies.made_up import STUDY, write_study


def test_experiments_go_by_their_own_names_in_the_order_of_the_tables(tmp_path: Path) -> None:
    file = load_study(write_study(tmp_path))
    assert list(file.experiments) == ["calm", "loaded"]
    assert file.rows["loaded"].label == "a load"
    assert file.experiments["loaded"].experiment.tip_load_g == 14.2


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (("calm.yaml", "quiet.yaml"), ":10:21: tables[0].rows[0].experiment: there is no file"),
        (("[calm, loaded]", "[calm, full]"), "figures[0].experiments[1]: no table has an exper"),
        (("than: calm", "than: quiet"), "first_no_worse_than: no table has an experiment quiet"),
        (("variant: arcs", "variant: broyden"), "the variant broyden is there twice"),
        (("loaded.yaml", "calm.yaml"), "the experiment calm.yaml is there twice"),
        (("constant_curvature", "magic"), "variants[1].controller: with calm: controller.kind"),
        (
            ("{kind: constant_curvature}", "{kind: constant_curvature, gian: 2}"),
            "with calm: controller.gian: unknown key",
        ),
        (("label: a load", "lable: a load"), "lable: unknown key (did you mean 'label'?)"),
    ],
)
def test_what_is_wrong_is_told(tmp_path: Path, change: tuple[str, str], problem: str) -> None:
    with pytest.raises(ConfigError) as raised:
        load_study(write_study(tmp_path, STUDY.replace(*change)))
    assert problem in str(raised.value)


def test_a_variant_is_set_on_top_of_the_experiments_controller() -> None:
    given = load_controller_options({"kind": "broyden", "gain_per_s": 2.0, "settle_s": 1.0})
    changed = merged(given, {"gain_per_s": 4.0})
    assert isinstance(changed, Broyden)
    assert (changed.gain_per_s, changed.settle_s) == (4.0, 1.0)


def test_another_kind_keeps_what_both_have_in_common() -> None:
    given = load_controller_options({"kind": "broyden", "gain_per_s": 2.0, "settle_s": 1.0})
    other = merged(given, {"kind": "constant_curvature", "tolerance_mm": 5.0})
    assert isinstance(other, ConstantCurvature)
    assert (other.gain_per_s, other.tolerance_mm) == (2.0, 5.0)
    with pytest.raises(OptionsError, match="settle_s"):
        merged(given, {"kind": "constant_curvature", "settle_s": 5.0})


@pytest.mark.parametrize("kind", sorted(entries(CONTROLLERS)))
def test_what_damps_one_kind_means_the_same_to_another(kind: str) -> None:
    """It is kept from kind to kind: of no kind may it be something else."""
    options = controller_type(kind)
    assert options is not None
    assert ("damping_mm" in options.model_fields) == issubclass(options, ProportionalLaw)
