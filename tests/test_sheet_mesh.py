"""Meshes of outlines: they cover the polygon and nothing else."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from warp_immersed import leaf_outlines
from warp_immersed.sheet_mesh import ellipse_mesh, inside_polygon, outline_mesh, polygon_area, rectangle_mesh


@settings(max_examples=25, deadline=None)
@given(radii=st.lists(st.floats(0.3, 1.0), min_size=5, max_size=14), clockwise=st.booleans())
def test_star_polygons_are_covered_exactly(radii, clockwise) -> None:
    angle = 2.0 * np.pi * np.arange(len(radii)) / len(radii)
    polygon = np.array(radii)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    mesh = outline_mesh(polygon[::-1] if clockwise else polygon)
    assert mesh.area == pytest.approx(polygon_area(polygon), rel=1e-9)
    assert (mesh.face_normals[:, 2] > 0.0).all()
    assert inside_polygon(mesh.triangles_center[:, :2], polygon).all()


@pytest.mark.parametrize(
    "outline", [leaf_outlines.maple, leaf_outlines.oak, leaf_outlines.birch, leaf_outlines.willow, leaf_outlines.ginkgo]
)
def test_leaf_outlines_are_symmetric_simple_and_of_unit_length(outline) -> None:
    points = outline()
    mesh = outline_mesh(points, spacing=0.06)
    assert mesh.area == pytest.approx(abs(polygon_area(points)), rel=1e-9)
    assert points[:, 1].max() == pytest.approx(1.0)
    assert abs(mesh.vertices[:, 0].min() + mesh.vertices[:, 0].max()) < 1e-9


def test_triangles_are_well_shaped() -> None:
    mesh = outline_mesh([[0, 0], [1, 0], [1, 1], [0, 1]], spacing=0.1)
    edges = np.linalg.norm(np.diff(mesh.triangles[:, [0, 1, 2, 0]], axis=1), axis=2)
    quality = 4.0 * np.sqrt(3.0) * mesh.area_faces / (edges**2).sum(axis=1)
    assert np.median(quality) > 0.9
    assert quality.min() > 0.25


def test_ellipse_and_rectangle_have_their_areas() -> None:
    assert rectangle_mesh(0.4, 0.1).area == pytest.approx(0.04)
    for rings in (4, 8, 16):
        polygon = 0.5 * 6 * rings * np.sin(2.0 * np.pi / (6 * rings)) * 0.02 * 0.01
        mesh = ellipse_mesh(0.02, 0.01, rings)
        assert mesh.area == pytest.approx(polygon, rel=1e-9)
        assert len(mesh.faces) == 6 * rings**2
        assert (mesh.face_normals[:, 2] > 0.0).all()


def test_texture_coordinates_span_the_unit_square() -> None:
    uv = np.asarray(outline_mesh([[0, 0], [2, 0], [2, 1], [0, 1]]).visual.uv)
    assert uv.min() == 0.0
    assert uv.max() == pytest.approx(1.0)
