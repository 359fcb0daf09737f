"""Volume integrals against closed forms, and their behaviour under rigid motions."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from warp_immersed.mass_properties import PointMass, closed_integrals, mass_properties, principal_frame, sheet_integrals
from warp_immersed.sheet_mesh import rectangle_mesh

finite = st.floats(-1.0, 1.0)
vectors = st.tuples(finite, finite, finite)


def test_box_is_exact() -> None:
    box = closed_integrals(trimesh.creation.box((1.0, 2.0, 3.0)).triangles)
    assert box.volume == pytest.approx(6.0, rel=1e-12)
    assert np.allclose(box.second_moment, np.diag([1.0, 4.0, 9.0]) * 6.0 / 12.0, rtol=1e-12)


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1e3])
def test_closed_integrals_hold_at_every_size(scale: float) -> None:
    triangles = trimesh.creation.box((1.0, 2.0, 3.0)).triangles * scale + 5.0 * scale
    box = closed_integrals(triangles)
    assert box.volume == pytest.approx(6.0 * scale**3, rel=1e-9)
    assert np.allclose(box.centroid, 5.0 * scale, rtol=1e-9)
    assert np.allclose(np.diag(box.second_moment), np.array([0.5, 2.0, 4.5]) * scale**5, rtol=1e-9)


def test_rectangle_is_exact_and_has_its_thickness() -> None:
    mesh = rectangle_mesh(0.3, 0.1)
    sheet = sheet_integrals(mesh.triangles, np.full(len(mesh.faces), 0.02))
    volume = 0.3 * 0.1 * 0.02
    assert sheet.volume == pytest.approx(volume, rel=1e-12)
    assert np.allclose(np.diag(sheet.second_moment), volume * np.array([0.3, 0.1, 0.02]) ** 2 / 12.0, rtol=1e-12)


@settings(max_examples=30, deadline=None)
@given(turn=vectors, shift=vectors)
def test_a_rigid_motion_moves_the_frame_and_nothing_else(turn, shift) -> None:
    mesh = trimesh.creation.box((1.0, 2.0, 3.0))
    rotation = Rotation.from_rotvec(turn).as_matrix()
    moved = mesh_properties(mesh.triangles @ rotation.T + shift)
    assert np.allclose(moved.inertia, 2.0 * np.array([1 + 4, 1 + 9, 4 + 9]) * 6.0 / 12.0, rtol=1e-9)
    assert np.allclose(moved.center_of_mass, shift, atol=1e-9)
    axes = np.abs(rotation.T @ moved.rotation)
    assert np.allclose(axes, np.eye(3)[[2, 1, 0]], atol=1e-6), "principal axes follow the body, longest edge first"
    assert np.linalg.det(moved.rotation) == pytest.approx(1.0)


def mesh_properties(triangles):
    return mass_properties(closed_integrals(triangles), 2.0)


def test_ballast_adds_by_the_parallel_axis_theorem() -> None:
    box = closed_integrals(trimesh.creation.box((1.0, 1.0, 1.0)).triangles)
    body = mass_properties(box, 3.0, [PointMass(1.0, (2.0, 0.0, 0.0))])
    assert body.mass == pytest.approx(4.0)
    assert np.allclose(body.center_of_mass, [0.5, 0.0, 0.0])
    around_x = 3.0 / 6.0
    around_y = 3.0 / 6.0 + 3.0 * 0.5**2 + 1.0 * 1.5**2
    assert np.allclose(body.inertia, [around_x, around_y, around_y])


def test_equal_moments_keep_the_axes_of_the_drawing() -> None:
    noise = 1e-9 * np.array([[0.0, 1.0, 0.3], [1.0, 0.0, 0.2], [0.3, 0.2, 0.0]])
    _, axes = principal_frame(np.eye(3) + noise)
    assert np.allclose(axes, np.eye(3), atol=1e-6)
    _, axes = principal_frame(np.diag([1.0, 1.0, 2.0]) + noise)
    assert np.allclose(axes, np.eye(3), atol=1e-6)
