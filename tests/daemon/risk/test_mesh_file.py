"""Surroundings from files: every format, every unit, and what is wrong named with the file."""

import subprocess
import sys
from importlib.resources import files
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import trimesh

from daemon.risk.mesh_file import _corners, read_environment, write_mesh
from daemon.workbench.body_model.evaluation.shapes import ball, box, chest, turned
from safety.risk.surroundings.environment import EnvironmentFaultError, InsertionPort, Mesh

BLOCK = box((40.0, 30.0, 20.0), (0.0, 0.0, 0.0), 2)


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".ply", ".STL"])
@pytest.mark.parametrize(
    "mesh", [BLOCK, turned(BLOCK), chest(600, 1)], ids=["block", "room", "chest"]
)
def test_what_was_written_is_read(suffix: str, mesh: Mesh, tmp_path: Path) -> None:
    path = tmp_path / f"mesh{suffix}"
    write_mesh(path, mesh)
    read = read_environment(path)
    assert len(read.triangles) == len(mesh.triangles)
    assert len(read.vertices_mm) == len(mesh.vertices_mm)
    written = np.sort(mesh.vertices_mm[mesh.triangles].mean(axis=1), axis=0)
    again = np.sort(read.vertices_mm[read.triangles].mean(axis=1), axis=0)
    np.testing.assert_allclose(again, written, atol=1e-4)
    assert read.solid_around == (mesh is not BLOCK)


def test_an_stl_of_words_is_read(tmp_path: Path) -> None:
    path = tmp_path / "words.stl"
    lines = ["solid block"]
    for triangle in BLOCK.vertices_mm[BLOCK.triangles]:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {x} {y} {z}" for x, y, z in triangle]
        lines += ["endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid block", ""]))
    assert len(read_environment(path).triangles) == len(BLOCK.triangles)


def test_a_ball_in_metres_is_read_in_millimetres(tmp_path: Path) -> None:
    path = tmp_path / "ball.stl"
    write_mesh(path, Mesh(BLOCK.vertices_mm / 1000.0, BLOCK.triangles))
    with pytest.raises(EnvironmentFaultError, match=r"ball\.stl: it is 0\.04 mm large.*in m\?"):
        read_environment(path)
    read = read_environment(path, unit="m")
    np.testing.assert_allclose(np.ptp(read.vertices_mm, axis=0), [40.0, 30.0, 20.0], rtol=1e-6)


def test_the_free_side_and_the_port_are_declared(tmp_path: Path) -> None:
    path = tmp_path / "room.stl"
    write_mesh(path, BLOCK)
    port = InsertionPort((0.0, 0.0, -10.0), (0.0, 0.0, 1.0), 5.0, 20.0)
    read = read_environment(path, free="inside", port=port)
    assert read.solid_around
    assert read.port is port
    assert not read_environment(path).solid_around


def test_triangles_of_no_size_do_no_harm(tmp_path: Path) -> None:
    path = tmp_path / "thin.obj"
    extra = np.array([[0, 0, 1], [3, 3, 3]])
    write_mesh(path, Mesh(BLOCK.vertices_mm, np.concatenate([BLOCK.triangles, extra])))
    assert len(read_environment(path).triangles) == len(BLOCK.triangles)


def holed(path: Path) -> None:
    write_mesh(path, Mesh(BLOCK.vertices_mm, BLOCK.triangles[1:]))


def not_finite(path: Path) -> None:
    vertices = BLOCK.vertices_mm.copy()
    vertices[4, 1] = np.nan
    write_mesh(path, Mesh(vertices, BLOCK.triangles))


def cut(path: Path, keep: float) -> None:
    write_mesh(path, BLOCK)
    content = path.read_bytes()
    path.write_bytes(content[: int(keep * len(content))])


def words_of_stl(path: Path, name: bytes, end: bytes) -> None:
    lines = [b"solid " + name]
    for triangle in BLOCK.vertices_mm[BLOCK.triangles]:
        lines += [b"facet normal 0 0 0", b"outer loop"]
        lines += [f"vertex {x} {y} {z}".encode() for x, y, z in triangle]
        lines += [b"endloop", b"endfacet"]
    path.write_bytes(b"\n".join([*lines, end]))


@pytest.mark.parametrize("keep", [0.02, 0.2, 0.5, 0.97, 0.999])
def test_a_cut_off_stl_file_is_said_to_be_cut_off(keep: float, tmp_path: Path) -> None:
    path = tmp_path / "cut.stl"
    cut(path, keep)
    with pytest.raises(EnvironmentFaultError, match=r"cut\.stl: is .*cut off") as error:
        read_environment(path)
    assert "module" not in str(error.value)
    words_of_stl(path, b"block", b"endso")
    with pytest.raises(EnvironmentFaultError, match="is cut off: there is no 'endsolid'"):
        read_environment(path)


@pytest.mark.parametrize("name", [b"K\xf6rper", b"\xff\xfe", "Körper".encode()])
def test_names_in_any_alphabet_do_no_harm(name: bytes, tmp_path: Path) -> None:
    path = tmp_path / "words.stl"
    words_of_stl(path, name, b"endsolid " + name)
    assert len(read_environment(path).triangles) == len(BLOCK.triangles)
    path = tmp_path / "words.obj"
    write_mesh(path, BLOCK)
    path.write_bytes(b"# " + name + b"\n" + path.read_bytes())
    assert len(read_environment(path).triangles) == len(BLOCK.triangles)


def test_a_binary_stl_file_may_begin_as_one_of_words(tmp_path: Path) -> None:
    path = tmp_path / "solid.stl"
    write_mesh(path, BLOCK)
    path.write_bytes(b"solid" + path.read_bytes()[5:])
    assert len(read_environment(path).triangles) == len(BLOCK.triangles)


@pytest.mark.parametrize("suffix", [".stl", ".obj", ".ply"])
def test_a_body_that_is_there_twice_is_refused_with_its_file(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"twice{suffix}"
    write_mesh(path, Mesh(BLOCK.vertices_mm, np.concatenate([BLOCK.triangles] * 2)))
    with pytest.raises(
        EnvironmentFaultError, match=rf"twice\{suffix}: the same triangles are there"
    ):
        read_environment(path)


def points_only(path: Path) -> None:
    words = ["ply", "format ascii 1.0", "element vertex 3"]
    words += [f"property float {axis}" for axis in "xyz"]
    path.write_text("\n".join([*words, "end_header", "0 0 0", "0 9 0", "9 0 0", ""]))


@pytest.mark.parametrize(
    ("name", "make", "told"),
    [
        ("hole.stl", holed, "hole.stl: not watertight: 3 edges"),
        ("nan.stl", not_finite, r"nan.stl: triangle \d+ has a corner that is not finite, near"),
        ("empty.stl", lambda path: path.write_bytes(b""), "empty.stl: is empty"),
        ("empty.ply", lambda path: path.write_bytes(b""), "empty.ply: is empty"),
        ("short.stl", lambda path: path.write_bytes(b"\0" * 90), "short.stl: is damaged"),
        ("points.ply", points_only, "points.ply: 0 triangles enclose nothing"),
        ("folder.stl", lambda path: path.mkdir(), "folder.stl: Is a directory"),
        ("words.ply", lambda path: path.write_text("no mesh at all"), "words.ply: is no mesh"),
        ("none.obj", lambda path: path.write_text("v 1 2 3\n"), "none.obj: "),
        ("mesh.step", lambda path: path.write_text(""), "mesh.step: must end with .stl, .obj"),
        ("missing.stl", lambda path: None, "missing.stl: No such file"),
    ],
)
def test_a_file_that_cannot_be_used_is_named_with_its_fault(
    name: str, make: object, told: str, tmp_path: Path
) -> None:
    assert callable(make)
    make(tmp_path / name)
    with pytest.raises(EnvironmentFaultError, match=told):
        read_environment(tmp_path / name)


def test_several_bodies_in_one_file_are_all_there(tmp_path: Path) -> None:
    path = tmp_path / "two.obj"
    lines, start = [], 1
    for number, mesh in enumerate((BLOCK, ball(5.0, (60.0, 0.0, 0.0), 60))):
        lines.append(f"o body{number}")
        lines += ["v {} {} {}".format(*vertex) for vertex in mesh.vertices_mm]
        lines += ["f {} {} {}".format(*(corners + start)) for corners in mesh.triangles]
        start += len(mesh.vertices_mm)
    path.write_text("\n".join(lines))
    read = read_environment(path)
    assert read.solid(np.array([[0.0, 0, 0], [60.0, 0, 0], [40.0, 0, 0]])).tolist() == [1, 1, 0]


def test_a_binary_stl_file_is_read_as_another_reader_reads_it() -> None:
    content = (Path(str(files("config"))) / "surfaces" / "chest.stl").read_bytes()
    theirs = trimesh.load_mesh(BytesIO(content), file_type="stl", process=False)
    ours = _corners(content, "stl")
    assert ours.shape == (3 * len(theirs.faces), 3)
    assert np.array_equal(ours, np.asarray(theirs.triangles).reshape(-1, 3))


def test_a_binary_stl_file_needs_no_other_reader() -> None:
    code = (
        "import sys\nfrom importlib.resources import files\nfrom pathlib import Path\n"
        "from daemon.risk.mesh_file import read_environment\n"
        "read_environment(Path(str(files('config'))) / 'surfaces' / 'chest.stl', 'inside')\n"
        "print('trimesh' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
