"""Shapes from meshes: what is computed, what is repaired, what is refused."""

import warnings

import numpy as np
import pytest
import trimesh

from warp_immersed.errors import InputError, MeshRepairWarning
from warp_immersed.mass_properties import PointMass
from warp_immersed.shape import Shape
from warp_immersed.sheet_mesh import ellipse_mesh, outline_mesh, rectangle_mesh


def test_closed_mesh_converges_to_its_ellipsoid() -> None:
    axes = np.array([0.03, 0.02, 0.01])
    errors = []
    for subdivisions in (2, 3, 4):
        ball = trimesh.creation.icosphere(subdivisions)
        ball.vertices *= axes
        shape = Shape.from_mesh(ball, 500.0)
        errors.append(np.abs(shape.semi_axes / axes - 1.0).max())
        assert shape.mass == pytest.approx(500.0 * 4.0 / 3.0 * np.pi * axes.prod(), rel=4.0 * errors[-1])
    assert errors[2] < 2e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.15), "second order in the edge length"


def test_sheet_converges_to_its_ellipse() -> None:
    coarse, fine = (Shape.from_mesh(ellipse_mesh(0.02, 0.01, rings), 800.0, 1e-4).semi_axes for rings in (8, 32))
    exact = np.array([0.02, 0.01, 5e-5])
    assert np.abs(fine / exact - 1.0).max() < 3e-4
    assert np.abs(coarse / exact - 1.0).max() > 10.0 * np.abs(fine / exact - 1.0).max()


def test_principal_frame_is_ordered_and_can_be_undone() -> None:
    mesh = rectangle_mesh(0.1, 0.3)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(0.7, [1.0, 2.0, 3.0], [0.1, 0.0, 0.0]))
    given = mesh.vertices.copy()
    shape = Shape.from_mesh(mesh, 800.0, 1e-4)
    assert (np.diff(shape.inertia) > 0.0).all()
    assert np.allclose(np.ptp(shape.mesh.vertices, axis=0), [0.3, 0.1, 0.0], atol=1e-12), "longest edge along x, normal z"
    assert np.allclose(shape.mesh.vertices @ shape.rotation.T + shape.center_of_mass, given, atol=1e-12)


def test_face_thickness_moves_the_centre_of_mass_but_not_the_ellipse() -> None:
    mesh = rectangle_mesh(0.2, 0.1)
    heavy = np.where(mesh.triangles_center[:, 0] > 0.0, 3e-4, 1e-4)
    shape = Shape.from_mesh(mesh, 800.0, heavy)
    assert shape.center_of_mass[0] == pytest.approx(0.025)
    assert np.abs(shape.geometric_center)[0] == pytest.approx(0.025), "the middle of the sheet, seen from the centre of mass"
    assert shape.mass == pytest.approx(800.0 * 0.2 * 0.1 * 2e-4)


def test_ballast_separates_the_centres_of_mass_and_buoyancy() -> None:
    shape = Shape.from_mesh(trimesh.creation.icosphere(3, 0.01), 500.0, ballast=[PointMass(0.001, (0.0, 0.0, -0.01))])
    offset = 0.001 * 0.01 / shape.mass
    assert np.linalg.norm(shape.center_of_buoyancy) == pytest.approx(offset)


def test_scale_turns_centimetres_into_metres() -> None:
    shape = Shape.from_mesh(trimesh.creation.box((1.0, 2.0, 3.0)), 1000.0, scale=0.01)
    assert shape.mass == pytest.approx(0.006)


def test_mesh_files_are_read(tmp_path) -> None:
    path = tmp_path / "box.stl"
    trimesh.creation.box((0.1, 0.2, 0.3)).export(path)
    assert Shape.from_mesh(path, 1000.0).mass == pytest.approx(6.0, rel=1e-6)
    assert Shape.from_mesh(str(path), 1000.0).mass == pytest.approx(6.0, rel=1e-6)


def test_inverted_closed_mesh_is_turned_and_said() -> None:
    box = trimesh.creation.box((0.1, 0.2, 0.3))
    box.invert()
    with pytest.warns(MeshRepairWarning, match="inside out"):
        assert Shape.from_mesh(box, 1000.0).mass == pytest.approx(6.0)


def test_inconsistent_closed_mesh_is_repaired_and_said() -> None:
    box = trimesh.creation.box((0.1, 0.2, 0.3))
    faces = box.faces.copy()
    faces[3] = faces[3][::-1]
    broken = trimesh.Trimesh(box.vertices, faces, process=False)
    with pytest.warns(MeshRepairWarning, match="flipped"):
        assert Shape.from_mesh(broken, 1000.0).mass == pytest.approx(6.0)


def test_faces_without_area_are_dropped_and_said() -> None:
    mesh = rectangle_mesh(0.2, 0.1)
    faces = np.concatenate([mesh.faces, [[0, 0, 1]]])
    with pytest.warns(MeshRepairWarning, match="dropped 1 face"):
        shape = Shape.from_mesh(trimesh.Trimesh(mesh.vertices, faces, process=False), 800.0, 1e-4)
    assert shape.mesh.area == pytest.approx(0.02)


def sheet(**changes):
    mesh = rectangle_mesh(0.2, 0.1)
    return trimesh.Trimesh(changes.get("vertices", mesh.vertices), changes.get("faces", mesh.faces), process=False)


REFUSED = [
    (lambda: Shape.from_mesh("no/such.obj", 800.0), "no such file"),
    (lambda: Shape.from_mesh(trimesh.Trimesh(), 800.0), "no faces"),
    (lambda: Shape.from_mesh(sheet(), 800.0), "needs a thickness"),
    (lambda: Shape.from_mesh(trimesh.creation.box((1.0, 1.0, 1.0)), 800.0, 1e-3), "takes no thickness"),
    (lambda: Shape.from_mesh(sheet(), -1.0, 1e-4), "density: found -1.0"),
    (lambda: Shape.from_mesh(sheet(), float("nan"), 1e-4), "density: found nan"),
    (lambda: Shape.from_mesh(sheet(), 800.0, 0.0), "thickness: found 0.0"),
    (lambda: Shape.from_mesh(sheet(), 800.0, -1e-4), "thickness: found -0.0001"),
    (lambda: Shape.from_mesh(sheet(), 800.0, [1e-4, 1e-4]), "thickness: found shape"),
    (lambda: Shape.from_mesh(sheet(vertices=rectangle_mesh(0.2, 0.1).vertices * [1, np.nan, 1]), 800.0, 1e-4), "not finite"),
    (lambda: Shape.from_mesh(sheet(vertices=rectangle_mesh(0.2, 0.1).vertices * [1, 0, 0]), 800.0, 1e-4), "without area"),
    (lambda: Shape.from_mesh(sheet(), 800.0, 1e-4, scale=0.0), "scale: found 0.0"),
    (lambda: outline_mesh([[0, 0], [2, 1], [2, 0], [0, 1.5]]), "cross"),
    (lambda: outline_mesh([[0, 0], [1, 1]]), "at least three"),
    (lambda: outline_mesh([[0, 0], [1, 1], [2, 2]]), "no area"),
]


@pytest.mark.parametrize(("make", "message"), REFUSED, ids=[m for _, m in REFUSED])
def test_refused(make, message) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with pytest.raises(InputError, match=message) as error:
            make()
    assert "\n" not in str(error.value)


def test_unreadable_file_is_refused(tmp_path) -> None:
    path = tmp_path / "noise.glb"
    path.write_bytes(b"not a mesh at all")
    with pytest.raises(InputError, match="cannot be read"):
        Shape.from_mesh(path, 800.0)


def test_edges_that_keep_a_mesh_from_being_closed_are_named() -> None:
    boxes = [trimesh.creation.box((1.0, 1.0, 1.0)) for _ in range(2)]
    boxes[1].apply_translation((1.0, 1.0, 0.0))
    with pytest.raises(InputError, match=r"4 faces meet at the edge \(0.5, 0.5, .*exactly 2"):
        Shape.from_mesh(trimesh.util.concatenate(boxes), density=500.0)
    with pytest.raises(InputError, match=r"is open \(it has free edges, as \(.*\) to \(.*thickness"):
        Shape.from_mesh(rectangle_mesh(1.0, 1.0), density=500.0)
