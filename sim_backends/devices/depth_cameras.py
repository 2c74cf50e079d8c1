"""Two stereo depth cameras on opposite sides of the body, as Thompson et al. had them.

Each sees only what faces it and nothing stands before. Its depths come from disparities: they are
quantised, and their noise grows with the square of the depth. At silhouettes some pixels fly
backwards, and a few are matched wrongly. The cameras do not stand quite where their calibration
says, so that the two halves of a cloud do not quite fit.
"""

from dataclasses import dataclass
from math import pi

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sim_backends.devices.body_surface import BodySurface, FloatArray, PlacedSurface
from sim_backends.devices.depth_camera_kernels import draw

IndexArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_EDGE_MM = 10.0
"""Where the next pixel is so much farther off, a silhouette ends."""


@dataclass(frozen=True)
class DepthCameraSettings:
    """By default two Intel RealSense D405 at half their resolution, as the paper's group uses."""

    columns: int = 640
    rows: int = 400
    focal_px: float = 322.0
    baseline_mm: float = 18.0
    distance_mm: float = 350.0
    """From the middle of the straight body."""
    disparity_step_px: float = 1.0 / 32.0
    disparity_noise_px: float = 0.02
    """Standard deviation, at this resolution: 0.4 mm at 350 mm."""
    flying_share: float = 0.02
    """Of the pixels at a silhouette."""
    flying_mm: float = 5.0
    """How far behind, on the average."""
    mismatched_share: float = 0.001
    """Of all pixels: their depth is anything within `mismatched_mm`."""
    mismatched_mm: float = 30.0
    misplaced_mm: float = 0.3
    """Standard deviation of where a camera is against its calibration, per coordinate."""
    misturned_rad: float = 0.001
    """The same of how it is turned, per axis."""

    def __post_init__(self) -> None:
        if not all(np.isfinite(value) and value >= 0.0 for value in vars(self).values()):
            raise ValueError("no figure of a camera is below zero")
        if not min(self.columns, self.rows, self.focal_px, self.baseline_mm) > 0.0:
            raise ValueError("a camera has pixels, a focal length and a baseline")


@dataclass(frozen=True, eq=False)
class _Camera:
    """position_mm (3,) and axes (3, 3), columns x, y, z of its frame; both true and calibrated."""

    position_mm: FloatArray
    axes: FloatArray
    calibrated_mm: FloatArray
    calibrated_axes: FloatArray


class DepthCameras:
    """Both cameras, for a body that stands along z of the base frame.

    seed: of how they are misplaced. The same seed is the same rig.
    """

    def __init__(
        self,
        surface: BodySurface,
        length_mm: float,
        seed: int,
        settings: DepthCameraSettings | None = None,
    ) -> None:
        self.settings = settings or DepthCameraSettings()
        self._surface = surface
        random = np.random.default_rng(seed)
        middle = np.array([0.0, 0.0, 0.5 * length_mm])
        self._cameras = tuple(
            _placed(side * pi, middle, self.settings, random) for side in (0.0, 1.0)
        )
        self._image = np.empty((self.settings.rows, self.settings.columns))

    def cloud(self, centreline_mm: FloatArray, random: Generator) -> FloatArray:
        """(n, 3) points in the base frame, of both cameras. n: as many pixels as see the body.

        centreline_mm: (nodes, 3) from base to tip. random: of the noise.
        """
        placed = PlacedSurface.along(self._surface, np.asarray(centreline_mm, np.float64))
        return np.concatenate([self._seen(camera, placed, random) for camera in self._cameras])

    def _seen(self, camera: _Camera, body: PlacedSurface, random: Generator) -> FloatArray:
        settings, image, surface = self.settings, self._image, body.surface
        draw(
            image,
            settings.focal_px,
            (body.balls_mm - camera.position_mm) @ camera.axes,
            surface.tube_radius_mm,
            (body.disks_mm - camera.position_mm) @ camera.axes,
            body.disk_axes @ camera.axes,
            surface.disk_radius_mm,
            0.5 * surface.disk_thickness_mm,
        )
        row, column = np.nonzero(np.isfinite(image))
        depth = self._measured(image[row, column], _at_edge(image, row, column), random)
        x = (column - 0.5 * (settings.columns - 1)) / settings.focal_px
        y = (row - 0.5 * (settings.rows - 1)) / settings.focal_px
        points = np.stack([x * depth, y * depth, depth], axis=1)
        result: FloatArray = points @ camera.calibrated_axes.T + camera.calibrated_mm
        return result

    def _measured(self, depth_mm: FloatArray, at_edge: BoolArray, random: Generator) -> FloatArray:
        """What becomes of true depths."""
        settings, count = self.settings, depth_mm.size
        flying = at_edge & (random.random(count) < settings.flying_share)
        depth = depth_mm + flying * random.exponential(settings.flying_mm, count)
        mismatched = random.random(count) < settings.mismatched_share
        depth += mismatched * random.uniform(-1.0, 1.0, count) * settings.mismatched_mm
        scale = settings.focal_px * settings.baseline_mm
        disparity = scale / depth + settings.disparity_noise_px * random.standard_normal(count)
        step = settings.disparity_step_px
        if step > 0.0:
            disparity = step * np.round(disparity / step)
        return np.asarray(scale / disparity)


def _placed(
    angle_rad: float, middle_mm: FloatArray, settings: DepthCameraSettings, random: Generator
) -> _Camera:
    """A camera that looks at the middle from aside, with the body's z axis to its right."""
    outwards = np.array([np.cos(angle_rad), np.sin(angle_rad), 0.0])
    right = np.array([0.0, 0.0, 1.0])
    axes = np.stack([right, np.cross(-outwards, right), -outwards], axis=1)
    position = middle_mm + settings.distance_mm * outwards
    moved = settings.misplaced_mm * random.standard_normal(3)
    turned = Rotation.from_rotvec(settings.misturned_rad * random.standard_normal(3)).as_matrix()
    return _Camera(position + moved, turned @ axes, position, axes)


def _at_edge(image: FloatArray, row: IndexArray, column: IndexArray) -> BoolArray:
    """(n,) whether something farther off, or nothing, is beside these pixels."""
    padded = np.pad(image, 1, constant_values=np.inf)
    here = image[row, column]
    beside = [padded[row + 1 + i, column + 1 + j] for i, j in ((0, 1), (0, -1), (1, 0), (-1, 0))]
    return np.asarray(np.max(beside, axis=0) > here + _EDGE_MM)
