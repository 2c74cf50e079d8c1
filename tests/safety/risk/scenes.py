"""Random surroundings of convex bodies, and mixtures among them, with a witness of their own.

The witness knows the bodies as half-spaces and no triangles: where points of a mixture are in
something solid is found by sampling alone.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.random import Generator
from numpy.typing import NDArray

from daemon.workbench.body_model.evaluation.shapes import ball, box, joined, turned
from safety.risk.model.mixture import FloatArray, Mixture
from safety.risk.surroundings.environment import Environment, Mesh, environment

ROOM_MM = 200.0
_CLEAR_MM = 58.0
"""From the middle, where no body reaches the wall even of a room of few sides."""


@dataclass(frozen=True)
class Scene:
    """What is round the mixture, as triangles and as half-spaces."""

    environment: Environment
    planes: FloatArray
    """(p, 4) a·x ≤ b in the body that the plane belongs to."""
    ends: NDArray[np.int64]
    """Where each body's planes end. In a room, the first body is what is free of it."""
    is_room: bool


def mixture_of(
    weights: list[float], means_mm: list[list[float]], sigmas_mm: list[list[float]]
) -> Mixture:
    """Of components along the axes."""
    return Mixture.checked(weights, means_mm, [np.diag(1.0 / np.array(s)) for s in sigmas_mm])


def factor_of(sigmas_mm: FloatArray, axes: FloatArray) -> FloatArray:
    """Ū of a component with these standard deviations along these (3, 3) columns."""
    covariance = axes @ np.diag(np.square(sigmas_mm)) @ axes.T
    factor: FloatArray = np.linalg.cholesky(np.linalg.inv(covariance)).T
    return factor


def rotation(random: Generator) -> FloatArray:
    axes: FloatArray = np.linalg.qr(random.normal(size=(3, 3)))[0]
    axes[:, 2] *= np.linalg.det(axes)
    return axes


def random_scene(random: Generator) -> Scene:
    """A room or nothing round it; in it up to six boxes and balls of few triangles.

    The room is a turned box, or a ball of many walls.
    """
    is_room = bool(random.random() < 0.7)
    if random.random() < 0.5:
        room = box([ROOM_MM] * 3, [0.0] * 3, int(random.integers(1, 4)))
    else:
        room = ball(ROOM_MM / 2.0, [0.0] * 3, 2 * int(random.integers(20, 120)))
    bodies = [_moved(room, random, [0.0] * 3)]
    places: list[FloatArray] = []
    for _ in range(int(random.integers(0 if is_room else 1, 7))):
        place = random.uniform(-60.0, 60.0, 3)
        if is_room and np.linalg.norm(place) > _CLEAR_MM:
            continue
        if all(np.linalg.norm(place - other) > 42.0 for other in places):
            places.append(place)
            bodies.append(_moved(_body(random), random, place))
    if not is_room:
        bodies = bodies[1:]
    planes = [_planes(body) for body in bodies]
    if is_room:
        bodies[0] = turned(bodies[0])
    return Scene(
        environment(*joined(bodies)),
        np.concatenate(planes),
        np.cumsum([len(part) for part in planes]),
        is_room,
    )


def _body(random: Generator) -> Mesh:
    """Not more than 20 mm from its middle."""
    if random.random() < 0.5:
        size = random.uniform(5.0, 23.0, 3)
        return box(size.tolist(), [0.0] * 3, int(random.integers(1, 4)))
    return ball(random.uniform(4.0, 20.0), [0.0] * 3, 2 * int(random.integers(6, 60)))


def _moved(mesh: Mesh, random: Generator, place: list[float] | FloatArray) -> Mesh:
    return Mesh(mesh.vertices_mm @ rotation(random).T + np.asarray(place), mesh.triangles)


def _planes(mesh: Mesh) -> FloatArray:
    """(p, 4) of a convex body, each once."""
    a, b, c = (mesh.vertices_mm[mesh.triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    planes = np.column_stack([normal, np.einsum("ti,ti->t", normal, a)])
    _, first = np.unique(planes.round(7), axis=0, return_index=True)
    result: FloatArray = planes[first]
    return result


def random_mixture(random: Generator) -> Mixture:
    """One to eight components, long and flat ones among them; some with their means in a body."""
    count = int(random.integers(1, 9))
    sigmas = np.exp(random.uniform(np.log(1.5), np.log(30.0), (count, 3)))
    return Mixture.checked(
        random.dirichlet(np.ones(count)),
        random.uniform(-80.0, 80.0, (count, 3)),
        [factor_of(sigma, rotation(random)) for sigma in sigmas],
    )


def solid_share(scene: Scene, points_mm: FloatArray) -> float:
    """The share of points that are in something solid."""
    return int(_count_solid(scene.planes, scene.ends, scene.is_room, points_mm)) / len(points_mm)


@njit(cache=True)
def _count_solid(planes, ends, is_room, points):  # type: ignore[no-untyped-def]
    count = 0
    for p in range(points.shape[0]):
        begin, solid = 0, False
        for body in range(ends.size):
            within = True
            for k in range(begin, ends[body]):
                side = planes[k, 0] * points[p, 0] + planes[k, 1] * points[p, 1]
                if side + planes[k, 2] * points[p, 2] > planes[k, 3]:
                    within = False
                    break
            begin = ends[body]
            if within != (is_room and body == 0):
                solid = True
                break
        count += solid
    return count
