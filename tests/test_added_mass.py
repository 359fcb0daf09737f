"""kirchhoff_tensor and what surrounds it: frames, options, cache, report, the baseline that fails."""

import json

import numpy as np
import pytest
import trimesh

from tests.surfaces import disk, ellipsoid, leaf
from warp_immersed.added_mass import kirchhoff_solution, kirchhoff_tensor
from warp_immersed.errors import InputError
from warp_immersed.exact_tensors import ellipsoid_tensor, elliptic_sheet_tensor
from warp_immersed.fluid import AIR, WATER
from warp_immersed.fundamental_solutions import TABLE_COLUMNS, failure_table, fundamental_solution_tensor
from warp_immersed.panel_refinement import MeshTensor
from warp_immersed.shape import Shape
from warp_immersed.tensor_cache import cache_directory, geometry_key, load_tensor, store_tensor
from warp_immersed.tensor_report import tensor_dict, tensor_table


@pytest.fixture(autouse=True)
def _own_cache(tmp_path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.setenv("WARP_IMMERSED_CACHE", str(tmp_path / "cache"))


def sheet(vertices: np.ndarray, faces: np.ndarray) -> Shape:
    return Shape.from_mesh(trimesh.Trimesh(vertices, faces, process=False), density=500.0, thickness=1e-4)


def solid(vertices: np.ndarray, faces: np.ndarray) -> Shape:
    return Shape.from_mesh(trimesh.Trimesh(vertices, faces, process=False), density=500.0)


def test_mesh_of_an_ellipse_meets_the_exact_sheet() -> None:
    vertices, faces = disk(8)
    found = kirchhoff_tensor(sheet(vertices * [0.02, 0.01, 1.0], faces), WATER)
    exact = elliptic_sheet_tensor(0.02, 0.01, WATER.density)
    assert np.diag(found)[2:5] == pytest.approx(np.diag(exact)[2:5], rel=0.01)


def test_principal_frame_about_the_centre_of_mass() -> None:
    """A solid given turned and far away has the tensor of one that lies along its axes."""
    vertices, faces = ellipsoid((0.03, 0.02, 0.01), 2)
    turn = trimesh.transformations.rotation_matrix(0.7, (1.0, 2.0, 3.0))[:3, :3]
    found = kirchhoff_tensor(solid(vertices @ turn.T + 0.5, faces), AIR)
    exact = ellipsoid_tensor((0.03, 0.02, 0.01), AIR.density)
    scale = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
    assert (np.abs(found - exact) / scale).max() < 0.01


def test_density_only_scales_and_the_cache_remembers() -> None:
    shape = sheet(*leaf(4))
    first = kirchhoff_solution(shape, AIR)
    second = kirchhoff_solution(shape, WATER)
    assert (first.cached, second.cached) == (False, True)
    assert second.matrix == pytest.approx(first.matrix * WATER.density / AIR.density, rel=1e-12)
    assert kirchhoff_solution(shape, AIR, cache=False).matrix.tobytes() == first.matrix.tobytes()
    assert not kirchhoff_solution(shape, AIR, tolerance=0.02).cached


def test_cache_survives_damage_and_absence(monkeypatch) -> None:  # type: ignore[no-untyped-def]
    tensor = MeshTensor(np.eye(6), 0.01, 100, "test")
    key = geometry_key(np.zeros((3, 3)), np.array([[0, 1, 2]]), False, ("auto",))
    assert load_tensor(key) is None
    store_tensor(key, tensor)
    loaded = load_tensor(key)
    assert loaded is not None
    assert (loaded.matrix == np.eye(6)).all()
    assert [path.name for path in cache_directory().iterdir()] == [f"tensor-{key}.json"]
    (cache_directory() / f"tensor-{key}.json").write_text('{"matrix": [[1, 2')
    assert load_tensor(key) is None
    blocker = cache_directory() / "file"
    blocker.write_text("")
    monkeypatch.setenv("WARP_IMMERSED_CACHE", str(blocker))
    store_tensor(key, tensor)
    assert load_tensor(key) is None


def test_key_depends_on_geometry_kind_and_settings() -> None:
    points, face = np.eye(3), np.array([[0, 1, 2]])
    keys = {
        geometry_key(points, face, False, ("auto", 0.01)),
        geometry_key(points * 1.001, face, False, ("auto", 0.01)),
        geometry_key(points, face[:, ::-1], False, ("auto", 0.01)),
        geometry_key(points, face, True, ("auto", 0.01)),
        geometry_key(points, face, False, ("auto", 0.02)),
    }
    assert len(keys) == 5


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"method": "magic"}, "method: found 'magic'"),
        ({"tolerance": 0.0}, "tolerance: found 0.0"),
        ({"faces": 3}, "faces: found 3"),
    ],
)
def test_options_out_of_range(options: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        kirchhoff_tensor(sheet(*disk(2)), AIR, **options)  # type: ignore[arg-type]


def test_budget_and_given_mesh() -> None:
    shape = sheet(*disk(6))
    given = kirchhoff_solution(shape, WATER, method="given-mesh")
    spent = kirchhoff_solution(shape, WATER, faces=500)
    exact = 8.0 / 3.0 * WATER.density
    assert given.faces == 216
    assert given.matrix[2, 2] == pytest.approx(exact, rel=0.03)
    assert given.error_estimate > 1.0 - given.matrix[2, 2] / exact
    assert spent.faces <= 650
    assert spent.matrix[2, 2] == pytest.approx(exact, rel=0.005)


def test_the_baseline_fits_thick_bodies_and_fails_on_thin_ones() -> None:
    vertices, faces = ellipsoid((1.0, 1.0, 1.0), 2)
    assert fundamental_solution_tensor(vertices, faces).matrix[0, 0] == pytest.approx(2.0 / 3.0 * np.pi, rel=0.01)
    thin = fundamental_solution_tensor(vertices * [1.0, 1.0, 0.005], faces).matrix
    assert thin[2, 2] < 0.1 * ellipsoid_tensor((1.0, 1.0, 0.005), 1.0)[2, 2]


def test_failure_table_has_its_columns() -> None:
    rows = failure_table(aspect_ratios=(2, 50), subdivisions=(1,), offsets=(0.5, 1.0))
    assert [tuple(row) for row in rows] == [TABLE_COLUMNS] * 4
    assert abs(rows[3]["error_broadside_percent"]) > 50.0


def test_report_reads_and_serialises() -> None:
    shape = sheet(*leaf(4))
    solution = kirchhoff_solution(shape, WATER, tolerance=0.05)
    text = tensor_table(solution, shape, WATER, "leaf.obj")
    titles = ("leaf.obj: sheet", "translation [kg]", "rotation [kg m^2]", "coupling [kg m]")
    for words in (*titles, "error", "of the mass"):
        assert words in text
    assert "%   " not in tensor_table(solution, shape, WATER, "leaf.obj", own_mass=False)
    stored = json.loads(json.dumps(tensor_dict(solution, shape, WATER, "leaf.obj")))
    assert np.array(stored["tensor"]) == pytest.approx(solution.matrix)
    assert stored["kind"] == "sheet"
