"""From clouds to a model of the body that the daemon reads, and what that model is worth."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="pip install '.[training]'")

from daemon.commands.outcome.exit_codes import EXIT_DATA, EXIT_OK, EXIT_USAGE  # noqa: E402
from daemon.commands.terminal.command_line import main  # noqa: E402
from daemon.host.progress import Unheard  # noqa: E402
from daemon.risk.model_file import ModelFile, read_model, write_model  # noqa: E402
from daemon.workbench.body_model.clouds.cloud_dataset import CloudDataset  # noqa: E402
from daemon.workbench.body_model.evaluation.component_sweep import Counted, recommended, summary  # noqa: E402
from daemon.workbench.body_model.evaluation.evaluation import (  # noqa: E402
    Evaluation,
    against_reference,
    evaluate,
)
from daemon.workbench.body_model.evaluation.mdn_figures import write_sweep  # noqa: E402
from daemon.workbench.body_model.training.body_training import (  # noqa: E402
    BodySettings,
    Start,
    TrainedBody,
    nats_in_metres,
    train_body,
)
from daemon.workbench.body_model.training.calibration import scores  # noqa: E402
from daemon.workbench.body_model.training.network import NetworkShape  # noqa: E402
from daemon.workbench.body_model.training.training import TrainingSettings  # noqa: E402
from safety.risk.model.risk_model import risk_model  # noqa: E402
from tests.daemon.workbench.body_model.small_clouds import SOFT_ARM, TENDON_ARM, dataset  # noqa: E402

pytestmark = pytest.mark.xdist_group("body_training")  # whose model is trained once for all tests

SETTINGS = BodySettings(
    points=NetworkShape(3, (32, 32)),
    shapes=NetworkShape(2, (32,)),
    coefficients=3,
    training=TrainingSettings(steps=160, groups=32, samples=32, learning_rate=1e-2, check_every=50),
    shapes_training=TrainingSettings(
        steps=160, groups=32, learning_rate=1e-2, check_every=50, alone=0.5
    ),
)


@pytest.fixture(autouse=True, scope="module")
def _one_thread() -> Iterator[None]:
    """Small networks on a busy machine: threads would only wait for each other."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="module")
def trained() -> TrainedBody:
    return train_body(dataset(n=240), SETTINGS, lambda *_: None)


BEGUN = replace(
    SETTINGS,
    training=replace(SETTINGS.training, steps=20),
    shapes_training=replace(SETTINGS.shapes_training, steps=20),
)
"""What counts from the first step on, and what does not, shows in a few."""


@pytest.fixture(scope="module")
def begun() -> TrainedBody:
    return train_body(dataset(n=240), BEGUN, lambda *_: None)


def test_a_trained_body_is_a_model_that_is_read_again(trained: TrainedBody, tmp_path: Path) -> None:
    path = tmp_path / "model.npz"
    write_model(path, trained.arrays, trained.about)
    file = read_model(path)
    assert file.robot == "tendon_arm"
    assert (file.model.points.components, file.model.shapes.components) == (3, 4)
    assert file.model.basis.coefficients == 3
    assert file.about["clouds_sha256"] == dataset(n=240).sha256
    assert file.about["training"]["seed"] == 1


def test_it_has_learnt_where_the_body_is(trained: TrainedBody) -> None:
    data = dataset(n=240, seed=5)
    model = risk_model(trained.arrays, "silu", "silu")
    found = scores(model.points, data.configurations, data.points_mm(np.ones(240, np.bool_)))
    assert found.mean_nll_mm < trained.points.checks[0].kept_back
    assert 0.4 < found.coverage((0.5,))[0] < 0.65
    for u, lines in zip(data.configurations[:20], data.centrelines_mm, strict=False):
        mixture = model.shapes.mixture(u)
        assert mixture is not None
        expected = mixture.weights @ mixture.means_mm @ model.basis.modes[:, -1]
        off = model.basis.base_mm[-1] + expected - lines[:, -1].mean(axis=0)
        assert np.linalg.norm(off) < 25.0


def test_it_knows_its_configurations_and_not_what_is_far(trained: TrainedBody) -> None:
    data, model = dataset(n=240), risk_model(trained.arrays, "silu", "silu")
    assert all(model.knows(u) for u in data.configurations[~data.test])
    assert np.mean([model.knows(u) for u in data.configurations[data.test]]) > 0.9
    assert not model.knows([25.0, 25.0, -25.0, 25.0])


def test_what_is_kept_back_is_not_learnt_from(begun: TrainedBody) -> None:
    data = dataset(n=240)
    other = data.clouds_mm.copy()
    other[data.test] += 15.0
    again = train_body(replace(data, clouds_mm=other), BEGUN, lambda *_: None)
    for name, array in begun.arrays.items():
        np.testing.assert_array_equal(array, again.arrays[name])


def test_shapes_are_learnt_from_the_clouds_and_not_from_the_true_centrelines(
    begun: TrainedBody,
) -> None:
    data = dataset(n=240)
    assert data.true_centrelines_mm is not None
    elsewhere = replace(data, true_centrelines_mm=data.true_centrelines_mm + 20.0)
    unknown = replace(data, true_centrelines_mm=None)
    for other in (elsewhere, unknown):
        again = train_body(other, BEGUN, lambda *_: None)
        for name, array in begun.arrays.items():
            np.testing.assert_array_equal(array, again.arrays[name])
    off = replace(data, centrelines_mm=data.centrelines_mm + np.float32(20.0))
    again = train_body(off, BEGUN, lambda *_: None)
    moved = again.arrays["basis/base_mm"] - begun.arrays["basis/base_mm"]
    np.testing.assert_allclose(moved, 20.0, atol=1e-3)


def model_file(trained: TrainedBody) -> ModelFile:
    return ModelFile(risk_model(trained.arrays, "silu", "silu"), trained.about)


def evaluated(trained: TrainedBody, data: CloudDataset) -> Evaluation:
    return evaluate(model_file(trained), data, 1, 2, None, Unheard())


def some(data: CloudDataset, which: np.ndarray) -> CloudDataset:
    """These configurations, in this order."""
    assert data.true_centrelines_mm is not None
    parts = {
        name: getattr(data, name)[which]
        for name in (
            "configurations",
            "starts",
            "clouds_mm",
            "centrelines_mm",
            "forces",
            "test",
            "block",
            "true_centrelines_mm",
        )
    }
    return replace(data, **parts)


def test_nothing_is_called_a_test_that_the_model_was_trained_at(trained: TrainedBody) -> None:
    """Whoever has collected it, in whatever order it is, whatever it says of itself."""
    data = dataset(n=240)
    kept = int(data.test.sum())
    as_trained = evaluated(trained, data)
    assert (as_trained.unseen.left_out, as_trained.unseen.same_clouds) == (0, True)

    order = np.random.default_rng(0).permutation(240)[:100]
    fewer = some(data, order)
    found = evaluated(trained, fewer)
    assert (found.unseen.left_out, found.unseen.same_clouds) == (0, False)
    assert found.unseen.test.sum() == fewer.test.sum()
    assert found.training_nll_mm is not None

    relabelled = replace(data, test=~data.test)
    with pytest.raises(ValueError, match=f"trained at all {240 - kept} configurations"):
        evaluated(trained, relabelled)
    seen_again = replace(relabelled, clouds_mm=data.clouds_mm[:, ::-1] + np.float32(0.1))
    with pytest.raises(ValueError, match="trained at all"):
        evaluated(trained, seen_again)
    mixed = replace(data, test=np.arange(240) % 12 < 6)
    found = evaluated(trained, mixed)
    assert found.unseen.left_out == int((mixed.test & ~data.test).sum()) > 0
    np.testing.assert_array_equal(found.unseen.test, mixed.test & data.test)


def test_clouds_that_were_learnt_from_are_known_whatever_configuration_they_are_given_to(
    trained: TrainedBody,
) -> None:
    data = dataset(n=240)
    scale = trained.arrays["points/input_scale"]
    measured = replace(
        data,
        configurations=data.configurations + 0.05 * scale,
        clouds_mm=data.clouds_mm[:, ::-1],
        test=~data.test,
    )
    with pytest.raises(ValueError, match="trained at all"):
        evaluated(trained, measured)


def test_data_that_the_model_has_never_seen_are_all_there_to_test_with(
    trained: TrainedBody,
) -> None:
    data = dataset(n=240, seed=5)
    made = evaluated(trained, data)
    assert (made.unseen.left_out, made.unseen.same_clouds) == (0, False)
    assert made.training_nll_mm is None
    assert made.summary()["training_nll_nats_m"] is None
    np.testing.assert_array_equal(made.unseen.test, data.test)


def test_what_the_fit_costs_is_told_where_the_truth_is_known(trained: TrainedBody) -> None:
    data = dataset(n=240)
    assert data.true_centrelines_mm is not None
    off = np.zeros_like(data.true_centrelines_mm)
    off[..., 0] = 3.0
    made = evaluated(trained, replace(data, true_centrelines_mm=data.true_centrelines_mm + off))
    assert made.truth is not None
    # Across the curve, which goes mostly along z: along it, nothing is off.
    median, most = made.truth.fit_off_mm
    assert 2.9 < median <= most == pytest.approx(3.0, abs=1e-2)
    true, stated = made.truth.fit_error_mm
    assert 2.5 < true <= 3.0
    assert stated == pytest.approx(float(np.sqrt(np.square(data.fit_error_mm).mean())))
    assert made.truth.shapes.mean_nll_mm > made.shapes.mean_nll_mm
    assert made.truth.tip_error_mm != made.tip_error_mm
    summary = made.summary()["true_shapes"]
    assert summary["fit_off_mm"] == {"median": median, "p99": most}
    assert summary["fit_error_mm"] == {"true": true, "stated": stated}
    blind = evaluated(trained, replace(data, true_centrelines_mm=None))
    assert blind.truth is None
    assert blind.summary()["true_shapes"] is None


def test_an_evaluation_says_all_of_it(trained: TrainedBody) -> None:
    data = dataset(n=240)
    block = (NetworkShape(3, (32, 32)), SETTINGS.training)
    made = evaluate(model_file(trained), data, 1, 8, block, Unheard())
    found = made.summary()
    assert found["test_configurations"] == int(data.test.sum())
    assert found["left_out_because_trained_at"] == 0
    assert found["clouds_of_the_training"]
    json.dumps(found)
    assert found["nll_nats_m"] == pytest.approx(found["nll_nats_mm"] - 3.0 * np.log(1000.0))
    assert set(found["coverage"]) == {"0.5", "0.8", "0.95"}
    assert made.reference.configurations == 8
    assert made.block is not None
    assert made.block.configurations == int(data.block.sum())
    assert made.tip_error_mm >= made.tip_spread_mm
    assert made.known > 0.9


def test_a_reference_beats_a_network_that_has_learnt_nothing() -> None:
    data = dataset(n=240)
    little = replace(SETTINGS, training=replace(SETTINGS.training, steps=1))
    lazy = risk_model(train_body(data, little, lambda *_: None).arrays, "silu", "silu")
    found = against_reference(lazy.points, data, data.test, 10, 1, Unheard())
    assert found.difference > 0.1
    assert found.interval[0] < found.difference < found.interval[1]
    assert found.in_sample < found.reference


def test_nats_go_from_millimetres_to_metres() -> None:
    assert nats_in_metres(0.0) == pytest.approx(-3.0 * np.log(1000.0))


def test_a_reference_does_not_know_the_start_before() -> None:
    """Two starts in a row give the same here: of every other one it would know the rest."""
    data = dataset(n=240, starts=8)
    random = np.random.default_rng(1)
    aside = np.repeat(20.0 * random.standard_normal((240, 4, 1, 3)), 2, axis=1)
    remembering = replace(data, clouds_mm=(data.clouds_mm + aside).astype(np.float32))
    trained = train_body(remembering, SETTINGS, lambda *_: None)
    model = risk_model(trained.arrays, "silu", "silu")
    own = against_reference(model.points, remembering, remembering.test, 20, 1, Unheard())
    assert own.difference < 0.0


def counted(
    components: int, nll: float, useless: float = 0.0, start: Start = "arc", idle: int = 0
) -> Counted:
    return Counted(start, components, nll, nll, 0.1, useless, idle)


def test_components_are_recommended_that_bring_something_and_do_not_collapse() -> None:
    falling = [counted(k, -8.0 - 1.0 / (4 - k)) for k in (1, 2, 3)]
    assert recommended(falling) == 3
    flat = [counted(1, -8.0), counted(2, -9.0), counted(3, -9.02), counted(4, -9.05)]
    assert recommended(flat) == 2
    late = [counted(1, -8.0), counted(2, -8.01), counted(3, -9.0)]
    assert recommended(late) == 3
    collapsing = [counted(1, -8.0), counted(2, -9.0), counted(3, -9.5, useless=0.3)]
    assert recommended(collapsing) == 2
    assert [one.collapsed for one in collapsing] == [False, False, True]
    assert recommended(collapsing[2:]) is None


def test_a_sweep_tells_of_each_start_where_it_collapses(tmp_path: Path) -> None:
    arc = [counted(k, -8.0 - 0.3 * k) for k in (1, 2, 3)]
    plain = [
        counted(k, -8.0 - 0.3 * min(k, 2), useless=0.4 * (k > 2), start="plain", idle=int(k > 2))
        for k in (1, 2, 3)
    ]
    found = summary([*arc, *plain])
    json.dumps(found)
    assert found["recommended"] == 3
    assert found["starts"]["arc"] == {"recommended": 3, "first_collapsed": None}
    assert found["starts"]["plain"] == {"recommended": 2, "first_collapsed": 3}
    assert [one["collapsed"] for one in found["sweep"]] == [False] * 5 + [True]
    assert "COLLAPSED (1 idle)" in plain[-1].line
    assert summary(plain)["recommended"] == 2
    write_sweep([*arc, *plain], tmp_path / "both.png")
    assert summary(plain[2:])["recommended"] is None
    write_sweep(plain[2:], tmp_path / "collapsed.png")
    write_sweep(arc, tmp_path / "arc.png")
    assert (tmp_path / "both.png").read_bytes() != (tmp_path / "arc.png").read_bytes()


def test_the_commands_train_sweep_and_evaluate(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clouds, model = tmp_path / "clouds.npz", tmp_path / "model.npz"
    dataset(n=120).save(clouds)
    data, quick = [str(TENDON_ARM), str(clouds)], ["--steps", "20"]
    words = ["train", *data, "--out", str(model), "--components", "2", "--coefficients", "3"]
    assert main(["mdn", *words, *quick]) == EXIT_OK
    assert "nats per point (places in m)" in capsys.readouterr().out
    about = read_model(model).about
    assert about["shapes_widths"]["narrow"] <= about["shapes_widths"]["wide"]
    assert about["training"]["shapes_training"]["steps"] == 26
    (command,) = read_model(model).about["commands"]
    assert command.startswith("tentacled mdn train tendon_arm.yaml clouds.npz --out model.npz")

    out = tmp_path / "evaluation"
    words = ["evaluate", *data, "--model", str(model), "--out", str(out), "--references", "3"]
    assert main(["mdn", *words, "--no-block"]) == EXIT_OK
    told = capsys.readouterr().out
    assert "coverage of points" in told
    assert told.startswith("tested at 20 configurations that the model was not trained at, of the")
    assert "of true shapes: coverage" in told
    written = {path.name for path in out.iterdir()}
    assert written == {"evaluation.json", "coverage.png", "samples.png"}

    figure = tmp_path / "nll.png"
    words = ["sweep", *data, "--components", "1..2", "--out", str(figure)]
    assert main(["mdn", *words, "--start", "plain", *quick]) == EXIT_OK
    assert "plain: none collapsed; recommended: " in capsys.readouterr().out
    assert main(["mdn", *words, "--json", *quick]) == EXIT_OK
    swept = json.loads(capsys.readouterr().out)["result"]
    assert [(one["start"], one["components"]) for one in swept["sweep"]] == [
        *(("arc", 1), ("arc", 2)),
        *(("plain", 1), ("plain", 2)),
    ]
    assert swept["recommended"] in (1, 2)
    assert figure.read_bytes().startswith(b"\x89PNG")


def test_more_components_of_shapes_than_can_become_two_are_refused(tmp_path: Path) -> None:
    words = ["mdn", "train", str(TENDON_ARM), "c.npz", "--out", str(tmp_path / "m.npz")]
    assert main([*words, "--shape-components", "9"]) == EXIT_USAGE


@pytest.mark.parametrize("components", ["0..3", "3..1", "1..17", "few", ""])
def test_a_sweep_of_no_components_is_refused(components: str, tmp_path: Path) -> None:
    words = ["mdn", "sweep", str(TENDON_ARM), "c.npz", "--out", str(tmp_path / "x.png")]
    assert main([*words, "--components", components]) == EXIT_USAGE


def test_a_model_of_another_robot_is_not_evaluated(
    trained: TrainedBody, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clouds, model = tmp_path / "clouds.npz", tmp_path / "model.npz"
    dataset().save(clouds)
    write_model(model, trained.arrays, {**trained.about, "robot": "another"})
    words = ["mdn", "evaluate", str(TENDON_ARM), str(clouds), "--model", str(model)]
    assert main([*words, "--out", str(tmp_path / "x")]) == EXIT_DATA
    assert "does not fit this robot" in capsys.readouterr().err
    words = ["mdn", "train", str(SOFT_ARM), str(clouds), "--out", str(tmp_path / "y.npz")]
    assert main(words) == EXIT_DATA
    assert "does not fit this robot" in capsys.readouterr().err


def test_a_body_whose_parts_have_stretched_differently_is_on_the_same_curve(
    trained: TrainedBody,
) -> None:
    """Its nodes lie elsewhere along it: nobody sees that, and nothing is off."""
    data = dataset(n=240)
    lines = data.centrelines_mm.astype(np.float64)
    nodes = lines.shape[2]
    moved = np.linspace(0.0, nodes - 1.0, nodes) + 0.4 * np.sin(np.linspace(0.0, np.pi, nodes))
    at, share = moved.astype(int).clip(0, nodes - 2), moved - moved.astype(int).clip(0, nodes - 2)
    between = (1.0 - share[:, None]) * lines[:, :, at] + share[:, None] * lines[:, :, at + 1]
    made = evaluated(trained, replace(data, true_centrelines_mm=between.astype(np.float32)))
    assert made.truth is not None
    assert np.linalg.norm(between - lines, axis=3).max() > 5.0
    assert made.truth.fit_off_mm[1] < 1.0
