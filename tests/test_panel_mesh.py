"""Meshes made for the solver: remeshing, rims, grading, and what is refused."""

import warnings

import numpy as np
import pytest
from trimesh.creation import box, icosphere

from tests.surfaces import airplane, disk, fan, lobed_outline, square
from warp_immersed.errors import InputError, MeshRepairWarning
from warp_immersed.mesh_checks import clean_surface
from warp_immersed.panel_mesh import coarse_mesh, graded_mesh, surface_from
from warp_immersed.panel_refinement import total_area
from warp_immersed.remesh import mesh_edges


def rim_length(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Length of the edges of one face."""
    halves = np.sort(np.stack([faces, faces[:, [1, 2, 0]]], axis=2).reshape(-1, 2), axis=1)
    edges, counts = np.unique(halves, axis=0, return_counts=True)
    rim = edges[counts == 1]
    return float(np.linalg.norm(vertices[rim[:, 0]] - vertices[rim[:, 1]], axis=1).sum())


def test_a_disk_gets_a_smooth_graded_mesh() -> None:
    surface = surface_from(*disk(12), closed=False)
    coarse = coarse_mesh(surface, 24)
    assert len(coarse.faces) < 40
    vertices, faces = graded_mesh(surface, coarse, 6)
    assert total_area(vertices, faces) == pytest.approx(np.pi, rel=0.01)
    radii = np.linalg.norm(vertices, axis=1)
    halves = np.sort(np.stack([faces, faces[:, [1, 2, 0]]], axis=2).reshape(-1, 2), axis=1)
    edges, counts = np.unique(halves, axis=0, return_counts=True)
    assert radii[np.unique(edges[counts == 1])] == pytest.approx(1.0, abs=2e-4)  # on the circle, not on the 72-gon
    depth = np.sort(1.0 - radii[radii < 0.9999])
    assert depth[0] < 0.6 / 6**2  # crowded towards the rim


@pytest.mark.parametrize("lobes", [3, 5, 7])
def test_lobed_outlines_of_slivers_keep_area_and_rim(lobes: int) -> None:
    outline = lobed_outline(lobes, 0.3, 120)
    vertices, faces = fan(outline)
    area, rim = total_area(vertices, faces), rim_length(vertices, faces)
    surface = surface_from(vertices / 1.3, faces, closed=False)
    vertices, faces = graded_mesh(surface, coarse_mesh(surface, 120), 4)
    assert total_area(vertices, faces) * 1.3**2 == pytest.approx(area, rel=0.01)
    assert rim_length(vertices, faces) * 1.3 == pytest.approx(rim, rel=0.03)


def test_a_crease_stays_a_crease() -> None:
    vertices, faces = airplane()
    surface = surface_from(vertices / 0.2, faces, closed=False)
    coarse = coarse_mesh(surface, 40)
    edges = mesh_edges(coarse)
    kinds = np.bincount(edges.of_face.ravel())
    crease = edges.ends[kinds == 3]
    lengths = np.linalg.norm(coarse.vertices[crease[:, 0]] - coarse.vertices[crease[:, 1]], axis=1)
    assert lengths.sum() * 0.2 == pytest.approx(0.28)
    assert kinds.max() == 3
    vertices, faces = graded_mesh(surface, coarse, 4)
    assert total_area(vertices, faces) * 0.2**2 == pytest.approx(0.030447602627252525, rel=1e-9)


def test_a_box_keeps_its_edges_and_volume() -> None:
    mesh = box((1.0, 0.5, 0.02))
    surface = surface_from(np.asarray(mesh.vertices), np.asarray(mesh.faces, dtype=np.int64), closed=True)
    vertices, faces = graded_mesh(surface, coarse_mesh(surface, 60), 4)
    corners = vertices[faces]
    volume = np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    assert volume == pytest.approx(0.01, rel=1e-9)
    assert total_area(vertices, faces) == pytest.approx(mesh.area, rel=1e-9)


def test_same_mesh_every_time() -> None:
    vertices, faces = fan(lobed_outline(5, 0.3, 120))
    meshes = [coarse_mesh(surface_from(vertices, faces, closed=False), 40) for _ in range(2)]
    assert meshes[0].vertices.tobytes() == meshes[1].vertices.tobytes()
    assert meshes[0].faces.tobytes() == meshes[1].faces.tobytes()


def nan_vertex() -> tuple[np.ndarray, np.ndarray]:
    vertices, faces = disk(2)
    vertices[3, 1] = np.nan
    return vertices, faces


def crossing() -> tuple[np.ndarray, np.ndarray]:
    vertices, faces = disk(2)
    return np.vstack([vertices, vertices[:, [2, 0, 1]] + 0.013]), np.vstack([faces, faces + len(vertices)])


def overlapping() -> tuple[np.ndarray, np.ndarray]:
    vertices, faces = disk(2)
    return np.vstack([vertices, vertices + np.array([0.31, 0.17, 0.0])]), np.vstack([faces, faces + len(vertices)])


def crossed_solids() -> tuple[np.ndarray, np.ndarray]:
    ball = icosphere(1)
    return np.vstack([ball.vertices, ball.vertices + np.array([0.9, 0.1, 0.05])]), np.vstack(
        [ball.faces, ball.faces + len(ball.vertices)]
    )


def touching_boxes() -> tuple[np.ndarray, np.ndarray]:
    one = box((1.0, 1.0, 1.0))
    return np.vstack([one.vertices, one.vertices + np.array([1.0, 1.0, 0.0])]), np.vstack([one.faces, one.faces + 8])


@pytest.mark.parametrize(
    ("body", "closed", "words"),
    [
        (lambda: (np.zeros((3, 3)), np.zeros((0, 3), dtype=int)), False, "0 faces"),
        (nan_vertex, False, r"vertex \d+ is .*finite"),
        (lambda: (np.zeros((3, 3)), np.array([[0, 1, 2]])), False, "one point"),
        (lambda: (np.eye(3)[:, [0, 0, 0]] * 1.0, np.array([[0, 1, 2]])), False, "without area"),
        (lambda: disk(2), True, r"open at edge \(.*thickness"),
        (touching_boxes, True, "4 faces meet at edge"),
        (crossing, False, "crosses face"),
        (crossed_solids, True, "crosses face"),
        (overlapping, False, "lies on face"),
    ],
)
def test_bad_input_is_named(body, closed: bool, words: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InputError, match=words) as caught:
        clean_surface(*body(), closed)
    assert "\n" not in str(caught.value)


def test_repairs() -> None:
    vertices, faces = square(3)
    doubled = np.vstack([vertices[faces].reshape(-1, 3), vertices[faces].reshape(-1, 3)])  # soup, and a coincident sheet
    soup = np.arange(len(doubled)).reshape(-1, 3)
    with pytest.warns(MeshRepairWarning, match="given twice"):
        clean, kept = clean_surface(doubled, soup, closed=False)
    assert (len(clean), len(kept)) == (16, 18)


def test_solids_come_out_outward_and_without_cavities() -> None:
    ball = icosphere(1)
    faces = np.asarray(ball.faces)
    mixed = np.where((np.arange(80) % 2 == 0)[:, None], faces[:, [0, 2, 1]], faces)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        vertices, clean = clean_surface(ball.vertices, mixed, closed=True)
    corners = vertices[clean]
    assert np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) > 0.0
    hollow = np.vstack([ball.vertices, 0.5 * ball.vertices]), np.vstack([faces, faces[:, ::-1] + len(ball.vertices)])
    with pytest.warns(MeshRepairWarning, match="cavities"):
        assert len(clean_surface(*hollow, closed=True)[1]) == 80
