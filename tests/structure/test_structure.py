"""What the measure of the tree's cut finds: on a small tree that has every defect, and on ours."""

from pathlib import Path

import pytest

from tests.structure.__main__ import ROOT, lines, measure
from tests.structure.imports import graph_of, strongly_connected

FILES = {
    "low/__init__.py": "",
    "low/ground.py": "def one() -> int:\n    return 1\n",
    "low/round.py": "import low.about\n",
    "low/about.py": "from low import round\n",
    "low/typed.py": (
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from low.user import U\n"
    ),
    "low/user.py": "from low.typed import U\n",
    "high/__init__.py": "",
    "high/later.py": "def late():\n    import low.calls\n",
    "low/calls.py": "from high import later\n",
    "high/kernels.py": (
        "from numba import njit\n_kernel = njit(cache=True)\n\n\n@_kernel\n"
        "def wide(a, b, c, d, e, f, g, h, i):\n    return a\n\n\n@njit\ndef narrow(a, *, b):\n"
        "    return a\n\n\ndef plain(a, b, c):\n    return a\n"
    ),
    "tests/__init__.py": "",
    "tests/test_low.py": "import low.ground\n",
}


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    for name, text in FILES.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    return tmp_path


def test_it_counts_files_lines_and_arguments_but_not_the_tests(tree: Path) -> None:
    figures = measure(tree, run=False)
    assert figures["sizes"]["files"] == 8
    assert figures["sizes"]["package_files"] == 2
    assert figures["sizes"]["files_under_50"] == 8
    assert figures["sizes"]["folders_above_12_files"] == {}
    assert figures["functions"]["kernels"] == 2
    assert figures["functions"]["kernels_with_most_arguments"] == {
        "high.kernels.wide": 9,
        "high.kernels.narrow": 2,
    }
    assert figures["functions"]["kernels_above_8_arguments"] == 1


def test_a_full_folder_is_named(tree: Path) -> None:
    for number in range(12):
        (tree / f"low/more_{number}.py").write_text("")
    sizes = measure(tree, run=False)["sizes"]
    assert sizes["folders_above_12_files"] == {"low": 18}


def test_circles_are_told_apart_by_when_they_close(tree: Path) -> None:
    circles = measure(tree, run=False)["circles"]
    loaded = [["low.about", "low.round"]]
    assert circles["modules_as_loaded"] == loaded
    assert circles["packages_as_loaded"] == []
    in_functions = [["high.later", "low.calls"], *loaded]
    assert circles["modules_with_imports_in_functions"] == in_functions
    assert circles["packages_with_imports_in_functions"] == [["high", "low"]]
    assert circles["package_pairs_with_imports_in_functions"] == [["high", "low"]]
    typed = [*in_functions, ["low.typed", "low.user"]]
    assert circles["modules_with_type_checking_too"] == typed


def test_a_module_with_one_importer_beside_it_is_named(tree: Path) -> None:
    found = measure(tree, run=False)["single_importers"]["short_ones"]
    assert found["low.typed"] == "low.user (3 lines)"
    assert "low.calls" not in found  # its importer is in another folder
    assert "low.ground" not in found  # which nobody of the product imports


def test_a_long_chain_of_imports_is_no_circle() -> None:
    chain = [(f"m{number}", f"m{number + 1}") for number in range(5000)]
    assert strongly_connected(graph_of(chain)) == []
    assert len(strongly_connected(graph_of([*chain, ("m5000", "m0")]))[0]) == 5001


def test_a_tree_that_cannot_be_run_is_still_measured_and_says_so(tree: Path) -> None:
    figures = measure(tree)
    (said,) = figures["passages"]["failed"]
    assert "def on_a_rig(" in said
    assert any("LookupError" in line for line in lines(figures))


@pytest.mark.long
def test_of_this_tree_it_says_what_a_reply_and_a_start_pass_through() -> None:
    figures = measure(ROOT)
    reply, start = figures["passages"]["tracker_reply"], figures["passages"]["start"]
    for floor in ("drivers/", "safety/", "daemon/"):
        assert any(path.startswith(floor) for path in reply["passed"])
    assert not any(path.startswith("sim_backends/") for path in reply["passed"])
    assert 10 < start["files"] < reply["files"]
    assert any("propose" in name for names in reply["passed"].values() for name in names)
    later = list(lines(figures, before=figures))
    assert any("tracker_reply: files" in line and "->" in line for line in later)
