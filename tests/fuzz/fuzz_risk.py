"""Arbitrary bytes at what reads the files of the risk: mixtures, meshes, models, clouds."""

from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from config.loader import load_robot
from daemon.risk.mesh_file import read_environment, write_mesh
from daemon.risk.model_file import read_model, write_model
from daemon.workbench.body_model.clouds.cloud_dataset import CloudDataset, CloudDatasetError
from daemon.workbench.body_model.clouds.cloud_import import CloudFileError, read_cloud
from daemon.workbench.body_model.evaluation.mixture_file import read_mixture
from daemon.workbench.body_model.evaluation.shapes import box
from safety.risk.model.mixture import MixtureError
from safety.risk.model.risk_model import RiskModelError
from safety.risk.surroundings.environment import EnvironmentFaultError
from tests import SOFT_ARM
from tests.safety.risk.networks import model_arrays

_MIXTURE = b"""{"weights": [0.25, 0.75], "means_mm": [[1, 2, 3], [4, 5, 6]],
 "factors_per_mm": [[[1, 0, 0], [0, 1, 0], [0, 0, 1]], [[2, 0.1, 0], [0, 1, 0], [0, 0, 1e-1]]]}"""
_ABOUT = {"robot": "arm", "points_activation": "silu", "shapes_activation": "relu"}


def changed(sound: bytes, data: bytes) -> bytes:
    """A file that was sound: three bytes of data say what is put where, the last one its end."""
    content = bytearray(sound)
    for k in range(0, len(data) - 3, 3):
        content[int.from_bytes(data[k : k + 2], "big") % len(content)] = data[k + 2]
    if len(data) % 2 and len(data) > 2:
        del content[int.from_bytes(data[-2:], "big") % len(content) :]
    return bytes(content)


@cache
def _sound(suffix: str) -> bytes:
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"sound{suffix}"
        if suffix == ".npz":
            write_model(path, model_arrays(), _ABOUT)
        else:
            write_mesh(path, box((20.0, 30.0, 40.0), (0.0, 0.0, 0.0)))
        return path.read_bytes()


def _at(name: str, contents: list[bytes], read: Callable[[Path], object]) -> None:
    """Each of these as a file; what cannot be read is explained in one line, but for its form."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / name
        for content in contents:
            path.write_bytes(content)
            try:
                read(path)
            except (
                MixtureError,
                EnvironmentFaultError,
                RiskModelError,
                CloudDatasetError,
                CloudFileError,
            ) as error:
                told = str(error).split("It must be of this form", 1)[0]
                assert told.split("must be of this form", 1)[0].count("\n") == 0
                assert "No module named" not in told


def mixture_file(data: bytes) -> None:
    """A mixture is read or explained."""
    _at("m.json", [data, changed(_MIXTURE, data), b"[" * (300 * len(data))], read_mixture)


def mesh_file(data: bytes) -> None:
    """Surroundings are read or explained, of whatever kind the file is."""
    for suffix in (".stl", ".obj", ".ply"):
        _at(f"m{suffix}", [data, changed(_sound(suffix), data)], read_environment)
    _at("m.stl", [b"solid " + data + b"\nendsolid"], read_environment)


def model_file(data: bytes) -> None:
    """A learned model is read or explained."""
    _at("m.npz", [data, changed(_sound(".npz"), data)], read_model)


def cloud_file(data: bytes) -> None:
    """A cloud, and a data set of clouds, is read or explained."""
    robot = load_robot(SOFT_ARM).robot
    damaged = [data, changed(_sound(".npz"), data)]
    _at("c.npz", damaged, lambda path: read_cloud(path, "mm"))
    _at("d.npz", damaged, lambda path: CloudDataset.load(path, robot))
    with suppress(CloudFileError):
        _at("c.ply", [data, changed(_sound(".ply"), data)], lambda path: read_cloud(path, "mm"))


TARGETS: dict[str, Callable[[bytes], None]] = {
    "mixture_file": mixture_file,
    "mesh_file": mesh_file,
    "model_file": model_file,
    "cloud_file": cloud_file,
}
