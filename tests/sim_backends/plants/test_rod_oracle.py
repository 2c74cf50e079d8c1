"""The rod against a second formulation, written and integrated independently.

Rucker and Webster (T-RO 27, 2011) in differential form: tendons as distributed loads on the bare
backbone, a 6 × 6 system for the derivatives of the strains, and point loads where tendons end. It
is started from the strains that the solver found at the base; if these are right, the conditions at
the tip hold, which nothing in the integration enforces.
"""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sim_backends.plants.rod import Section
from sim_backends.plants.rod_kernels import FloatArray
from tests.sim_backends.plants.rods import (
    ARM_LENGTH_MM,
    ARM_SECTION,
    CHAMBER_RADIUS_MM,
    LENGTH_MM,
    TENDON_ANGLES,
    TENDON_RADIUS_MM,
    TENDON_SECTION,
    TENDON_TURNS,
    chamber_rod,
    equilibrium,
    tendon_rod,
)

E3 = np.array([0.0, 0.0, 1.0])
Field = Callable[[float, FloatArray, FloatArray, FloatArray], tuple[FloatArray, FloatArray]]


def hat(a: FloatArray) -> FloatArray:
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def route(i: int, s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Offset of tendon i and its first two derivatives."""
    turn = TENDON_TURNS[i]
    angle = TENDON_ANGLES[i] + turn * s
    out = TENDON_RADIUS_MM * np.array([np.cos(angle), np.sin(angle), 0.0])
    across = TENDON_RADIUS_MM * np.array([-np.sin(angle), np.cos(angle), 0.0])
    return out, turn * across, -turn * turn * out


def solved(matrix: FloatArray, right: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)


def stiffness(section: Section) -> tuple[FloatArray, FloatArray]:
    diagonal = section.diagonal()
    return np.diag(diagonal[:3]), np.diag(diagonal[3:])


def integrate(
    field: Field, v: FloatArray, u: FloatArray, start: FloatArray, span: tuple[float, float]
) -> FloatArray:
    """p (3), R (9), v (3), u (3) at the end of `span`."""

    def slope(s: float, y: FloatArray) -> FloatArray:
        rotation, v, u = y[3:12].reshape(3, 3), y[12:15], y[15:]
        dv, du = field(s, rotation, v, u)
        return np.concatenate([rotation @ v, (rotation @ hat(u)).ravel(), dv, du])

    state = np.concatenate([start, v, u])
    solution = solve_ivp(slope, span, state, method="DOP853", rtol=1e-12, atol=1e-12)
    assert solution.success
    return np.asarray(solution.y[:, -1])


def tendon_field(tension: Sequence[float], weight_per_mm: FloatArray) -> Field:
    shear, bend = stiffness(TENDON_SECTION)

    def field(
        s: float, rotation: FloatArray, v: FloatArray, u: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        matrix = np.block([[shear, np.zeros((3, 3))], [np.zeros((3, 3)), bend]])
        n, m = shear @ (v - E3), bend @ u
        right = -np.concatenate(
            [np.cross(u, n) + rotation.T @ weight_per_mm, np.cross(u, m) + np.cross(v, n)]
        )
        for i, pull in enumerate(tension):
            r, dr, ddr = route(i, s)
            g = np.cross(u, r) + dr + v
            a_matrix = -pull * hat(g) @ hat(g) / np.linalg.norm(g) ** 3
            a = a_matrix @ (np.cross(u, g) + np.cross(u, dr) + ddr)
            matrix[:3, :3] += a_matrix
            matrix[:3, 3:] -= a_matrix @ hat(r)
            matrix[3:, :3] += hat(r) @ a_matrix
            matrix[3:, 3:] -= hat(r) @ a_matrix @ hat(r)
            right -= np.concatenate([a, np.cross(r, a)])
        change = solved(matrix, right)
        return change[:3], change[3:]

    return field


@pytest.mark.parametrize(
    ("tension", "tip", "weight"),
    [
        ([3.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
        ([0.0, 0.0, 0.0, 8.0], [0.0, 0.0, 0.0], [0.0, -0.3, 0.0]),
        ([2.0, 5.0, 0.5, 6.0], [0.1, -0.3, 0.2], [0.0, -0.3, 0.0]),
        ([0.5, 0.5, 6.0, 16.0], [-0.2, 0.1, -0.2], [0.0, 0.0, -0.4]),
        ([9.0, 1.0, 1.0, 2.0], [0.0, 0.4, 0.0], [-0.3, 0.0, 0.0]),
    ],
)
def test_tendons_agree_with_the_differential_form(
    tension: list[float], tip: list[float], weight: list[float]
) -> None:
    found = equilibrium(tendon_rod(180), tension, tip, weight)
    base = found.march.strain[0, 0]
    field = tendon_field(tension, np.array(weight) / LENGTH_MM)
    start = np.concatenate([np.zeros(3), np.eye(3).ravel()])
    end = integrate(field, base[:3], base[3:], start, (0.0, LENGTH_MM))
    position, rotation, v, u = end[:3], end[3:12].reshape(3, 3), end[12:15], end[15:]
    shear, bend = stiffness(TENDON_SECTION)
    force, moment = shear @ (v - E3) - rotation.T @ np.array(tip), bend @ u
    for i, pull in enumerate(tension):
        r, dr, _ = route(i, LENGTH_MM)
        g = np.cross(u, r) + dr + v
        force = force + pull * g / np.linalg.norm(g)
        moment = moment + pull * np.cross(r, g / np.linalg.norm(g))
    np.testing.assert_allclose(force, 0.0, atol=1e-6)
    np.testing.assert_allclose(moment, 0.0, atol=1e-5)
    np.testing.assert_allclose(found.march.position_mm[-1], position, atol=5e-6)


@pytest.mark.parametrize(
    ("pull", "tip"),
    [
        ([-10.0, 0, 0, -15.0, -3.0, 0], [0.0, 0.0, -0.3]),
        ([-4.0, -20.0, 0, 0, 0, -12.0], [0.0, 0.0, -0.14]),
        ([-22.0, -4.0, -4.0, -4.0, -25.0, -4.0], [0.05, 0.1, 0.0]),
        ([-8.0] * 6, [0.1, 0.0, -0.2]),
    ],
)
def test_chambers_agree_with_the_differential_form(pull: list[float], tip: list[float]) -> None:
    """Each segment by itself; force and moment, not strain, pass from one to the other."""
    weight = np.array([0.0, 0.0, -0.41])
    found = equilibrium(chamber_rod(180), pull, tip, weight)
    shear, bend = stiffness(ARM_SECTION)
    half = ARM_LENGTH_MM / 2

    def push(first: int, turn: float) -> tuple[FloatArray, FloatArray]:
        force, moment = np.zeros(3), np.zeros(3)
        for i in range(3):
            angle = turn + 2 * np.pi / 3 * i
            arm = CHAMBER_RADIUS_MM * np.array([np.cos(angle), np.sin(angle), 0.0])
            force, moment = (
                force + pull[first + i] * E3,
                moment + pull[first + i] * np.cross(arm, E3),
            )
        return force, moment

    def field_of(force: FloatArray, moment: FloatArray) -> Field:
        def field(
            s: float, rotation: FloatArray, v: FloatArray, u: FloatArray
        ) -> tuple[FloatArray, FloatArray]:
            n, m = shear @ (v - E3) + force, bend @ u + moment
            body_weight = rotation.T @ weight / ARM_LENGTH_MM
            dn, dm = -np.cross(u, n) - body_weight, -np.cross(u, m) - np.cross(v, n)
            return solved(shear, dn), solved(bend, dm)

        return field

    lower, upper = push(0, 0.0), push(3, np.pi / 3)
    base = found.march.strain[0, 0]
    start = np.concatenate([np.zeros(3), np.eye(3).ravel()])
    middle = integrate(field_of(*lower), base[:3], base[3:], start, (0.0, half))
    n = shear @ (middle[12:15] - E3) + lower[0] - upper[0]
    m = bend @ middle[15:] + lower[1] - upper[1]
    v, u = solved(shear, n) + E3, solved(bend, m)
    end = integrate(field_of(*upper), v, u, middle[:12], (half, ARM_LENGTH_MM))
    rotation = end[3:12].reshape(3, 3)
    force = shear @ (end[12:15] - E3) + upper[0] - rotation.T @ np.array(tip)
    np.testing.assert_allclose(force, 0.0, atol=1e-6)
    np.testing.assert_allclose(bend @ end[15:] + upper[1], 0.0, atol=1e-5)
    np.testing.assert_allclose(found.march.position_mm[-1], end[:3], atol=5e-6)
