"""What bodies look like: tints, thickness, grounds."""

import numpy as np
import pytest
import trimesh
from PIL import Image

from warp_immersed import library
from warp_immersed.errors import InputError
from warp_immersed.height_field import height_field_mesh, hills_mesh, image_mesh
from warp_immersed.looks import Prototype, look_indices, looks
from warp_immersed.shape import LEAF_GREEN, Shape


def test_a_body_keeps_its_tint_whatever_else_there_is() -> None:
    leaf, paper = library.maple_leaf(), library.elliptic_paper()
    few = [Prototype.from_shape("maple", 100, leaf)]
    many = [Prototype.from_shape("maple", 5000, leaf), Prototype.from_shape("paper", 7, paper)]
    worn = look_indices(many)
    assert np.array_equal(worn[:100], look_indices(few))
    assert (worn[5000:] == len(leaf.colors)).all()
    counts = np.bincount(worn[:5000])
    assert counts.min() > 0.85 * 5000 / len(leaf.colors), "every tint is worn alike"
    names = [look.name for look in looks(many)]
    assert names == [f"maple_{i}" for i in range(len(leaf.colors))] + ["paper"]
    assert all(len(look.colors) == 1 for look in looks(many))


def test_a_coin_is_drawn_as_a_closed_solid_and_a_leaf_as_a_sheet() -> None:
    coin, leaf = library.coin(), library.birch_leaf()
    solid = Prototype.from_shape("coin", 1, coin)
    mesh = trimesh.Trimesh(solid.vertices, solid.faces)
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(coin.volume, rel=0.01)
    assert not solid.is_sheet
    assert solid.metallic == 1.0
    sheet = Prototype.from_shape("leaf", 1, leaf)
    assert sheet.is_sheet
    assert len(sheet.faces) == len(leaf.mesh.faces)


def test_hills_are_always_the_same_and_fade_into_the_plane() -> None:
    one, two = (hills_mesh(1.5, 8.0, (40.0, 30.0), (5.0, -3.0), 0.25) for _ in range(2))
    assert np.array_equal(one.vertices, two.vertices)
    low, high = one.bounds
    assert np.allclose(low[[0, 2]], [-15.0, -18.0])
    assert np.allclose(high[[0, 2]], [25.0, 12.0])
    assert low[1] == pytest.approx(0.25)
    assert 0.25 + 0.9 < high[1] <= 0.25 + 1.5 + 1e-9
    edge = np.isclose(one.vertices[:, 0], low[0]) | np.isclose(one.vertices[:, 2], high[2])
    assert np.allclose(one.vertices[edge, 1], 0.25)
    assert (one.face_normals[:, 1] > 0.0).all(), "it faces up"


def test_an_image_becomes_ground(tmp_path) -> None:
    grey = np.zeros((3, 4), dtype=np.uint8)
    grey[0, 3] = 255
    Image.fromarray(grey).save(tmp_path / "hill.png")
    mesh = image_mesh(tmp_path / "hill.png", 0.0, 2.0, (6.0, 4.0), (0.0, 0.0))
    top = mesh.vertices[np.argmax(mesh.vertices[:, 1])]
    assert np.allclose(top, [3.0, 2.0, -2.0]), "right in the picture is +x, its top is -z"
    with pytest.raises(InputError, match="no such file"):
        image_mesh(tmp_path / "gone.png", 0.0, 2.0, (6.0, 4.0), (0.0, 0.0))
    (tmp_path / "text.png").write_text("not an image")
    with pytest.raises(InputError, match="cannot be read as an image"):
        image_mesh(tmp_path / "text.png", 0.0, 2.0, (6.0, 4.0), (0.0, 0.0))


def test_a_height_field_has_its_heights() -> None:
    heights = np.arange(12.0).reshape(3, 4)
    mesh = height_field_mesh(heights, (1.0, 2.0), (4.0, 3.0))
    assert np.array_equal(mesh.vertices[:, 1], heights.ravel())
    assert mesh.area > 12.0


def test_a_mesh_keeps_the_colour_of_its_file(tmp_path) -> None:
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    assert Shape.from_mesh(box, 500.0).colors == (LEAF_GREEN,), "none given, none taken"
    box.visual.face_colors = [255, 128, 0, 255]
    box.export(tmp_path / "box.ply")
    assert np.allclose(Shape.from_mesh(tmp_path / "box.ply", 500.0).colors[0], (1.0, 0.2159, 0.0), atol=1e-3)
    material = trimesh.visual.material.PBRMaterial(baseColorFactor=[0.2, 0.4, 0.6, 1.0])
    uv = np.random.default_rng(1).random((len(box.vertices), 2))
    painted = trimesh.Trimesh(box.vertices, box.faces, visual=trimesh.visual.TextureVisuals(uv=uv, material=material))
    painted.export(tmp_path / "box.glb")
    assert np.allclose(Shape.from_mesh(tmp_path / "box.glb", 500.0).colors[0], (0.2, 0.4, 0.6), atol=5e-3)


def test_a_solid_with_a_texture_seam_is_a_solid() -> None:
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.05)
    corners = ball.vertices[ball.faces].reshape(-1, 3)
    uv = np.random.default_rng(2).random((len(corners), 2))
    picture = Image.fromarray(np.full((4, 4, 3), 188, dtype=np.uint8))
    visual = trimesh.visual.TextureVisuals(uv=uv, image=picture)
    cut = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), visual=visual, process=False)
    shape = Shape.from_mesh(cut, 500.0)
    assert shape.volume == pytest.approx(ball.volume, rel=1e-9)
    assert np.allclose(shape.colors[0], 0.5029, atol=2e-3), "the mean of its texture"
