"""The boundary-element solver on given meshes: exact values, order of convergence, invariance, sectors."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tests.surfaces import airplane, disk, ellipsoid, leaf, square
from warp_immersed.exact_tensors import cross_matrix, ellipsoid_tensor, elliptic_sheet_tensor, shifted_tensor
from warp_immersed.fluid_sectors import fluid_sectors
from warp_immersed.panel_solver import surface_tensor


def worst_error(found: np.ndarray, exact: np.ndarray) -> float:
    """Largest |error_ij| / sqrt(K_ii K_jj) over the modes that have added mass."""
    scale = np.sqrt(np.diag(exact))
    real = scale > 1e-9 * scale.max()
    return float((np.abs(found - exact)[np.ix_(real, real)] / np.outer(scale[real], scale[real])).max())


def turned(rotation: np.ndarray) -> np.ndarray:
    """How a tensor turns with its body: K' = T K T^T."""
    return np.kron(np.eye(2), rotation)


@pytest.mark.parametrize(
    ("semi_axes", "at_320", "at_1280"),
    [
        ((0.05, 0.05, 0.05), 0.001, 0.0003),
        ((0.03, 0.02, 0.01), 0.005, 0.0006),
        ((1.0, 1.0, 0.2), 0.004, 0.0006),
        ((0.02, 0.02, 0.0002), 0.015, 0.003),
    ],
)
def test_closed_ellipsoids_meet_lamb(semi_axes: tuple[float, float, float], at_320: float, at_1280: float) -> None:
    exact = ellipsoid_tensor(semi_axes, 1.0)
    assert worst_error(surface_tensor(*ellipsoid(semi_axes, 2), closed=True).matrix, exact) < at_320
    assert worst_error(surface_tensor(*ellipsoid(semi_axes, 3), closed=True).matrix, exact) < at_1280


@pytest.mark.parametrize("ratio", [1.0, 0.25])
def test_graded_sheets_converge_with_the_second_power(ratio: float) -> None:
    """A disk AND an ellipse AND rotations: a closed-body method gets the disk's broadside value right by accident."""
    exact = elliptic_sheet_tensor(1.0, ratio, 1.0)
    stretch = np.array([1.0, ratio, 1.0])
    found = {n: surface_tensor(disk(n)[0] * stretch, disk(n)[1], closed=False).matrix for n in (5, 10)}
    for i in (2, 3, 4):
        coarse, fine = (found[n][i, i] / exact[i, i] - 1.0 for n in (5, 10))
        assert -0.06 < coarse < fine < 0.0  # a lower bound on a mesh inside the outline
        assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.25)
    assert worst_error((4.0 * found[10] - found[5]) / 3.0, exact) < 0.003


def test_uniform_sheets_converge_with_the_first_power_only() -> None:
    errors = [1.0 - surface_tensor(*disk(n, graded=False), closed=False).matrix[2, 2] / (8.0 / 3.0) for n in (5, 10)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(1.0, abs=0.2)


def test_square_plate_broadside_coefficient() -> None:
    """C rho pi / 4 a^2 b with C = 0.579 (DNV-RP-C205, table D-2), from below."""
    found = surface_tensor(*square(20), closed=False).matrix[2, 2] / (np.pi / 4.0)
    assert 0.53 < found < 0.579


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from(["leaf", "airplane", "solid"]))
def test_moves_with_the_body(seed: int, kind: str) -> None:
    """Rotation, translation (parallel axes), scale from 1 mm to 10 m and renumbering leave the same tensor."""
    rng = np.random.default_rng(seed)
    vertices, faces = {"leaf": lambda: leaf(3), "airplane": airplane, "solid": lambda: ellipsoid((0.3, 0.2, 0.1), 1)}[kind]()
    base = surface_tensor(vertices, faces, closed=kind == "solid").matrix
    size = np.abs(vertices).max()
    rotation = Rotation.random(rng=rng).as_matrix()
    offset = rng.normal(size=3) * size
    scale = 10.0 ** rng.uniform(-3.0, 1.0) / size
    order = rng.permutation(len(vertices))
    renumbered = np.argsort(order)[faces][rng.permutation(len(faces))]
    spin = rng.integers(0, 3, len(faces))
    renumbered = renumbered[np.arange(len(faces))[:, None], (np.arange(3) + spin[:, None]) % 3]
    found = surface_tensor(scale * (vertices[order] @ rotation.T + offset), renumbered, closed=kind == "solid").matrix
    powers = scale ** np.array([1.5, 1.5, 1.5, 2.5, 2.5, 2.5])
    expected = turned(rotation) @ base @ turned(rotation).T * np.outer(powers, powers)
    expected = shifted_tensor(expected, scale * offset)
    allowed = 2e-4 if kind == "solid" else 1e-9
    assert found == pytest.approx(expected, abs=allowed * np.abs(expected).max())


def test_sheet_orientation_does_not_matter() -> None:
    vertices, faces = leaf(4)
    mixed = np.where((np.arange(len(faces)) % 3 == 0)[:, None], faces[:, [0, 2, 1]], faces)
    expected = surface_tensor(vertices, faces, closed=False).matrix
    assert surface_tensor(vertices, mixed, closed=False).matrix == pytest.approx(expected, abs=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("closed", [False, True])
def test_symmetric_and_positive(closed: bool) -> None:
    found = surface_tensor(*(ellipsoid((0.3, 0.2, 0.1), 1) if closed else leaf(5)), closed=closed)
    assert (found.matrix == found.matrix.T).all()
    assert np.linalg.eigvalsh(found.matrix).min() > -1e-12 * np.abs(found.matrix).max()
    assert found.correction < (5e-3 if closed else 1e-12)


@pytest.mark.parametrize(("closed", "count"), [(False, 10), (True, 2)])
def test_threads_do_not_change_a_bit(closed: bool, count: int) -> None:
    body = ellipsoid((1.0, 0.7, 0.3), count) if closed else disk(count)
    one, three = (surface_tensor(*body, closed=closed, threads=threads).matrix for threads in (1, 3))
    assert one.tobytes() == three.tobytes()


@pytest.mark.parametrize("aspect_ratio", [1, 50, 400])
def test_single_precision_is_enough_to_hold_a_tensor(aspect_ratio: int) -> None:
    """Integrals and solution are float64 on every device; only bodies in motion hold the result as float32."""
    double = surface_tensor(*ellipsoid((1.0, 0.9, 1.0 / aspect_ratio), 2), closed=True).matrix
    assert double.dtype == np.float64
    assert worst_error(double.astype(np.float32), double) < 1e-6


def test_sectors_of_sheets_creases_and_solids() -> None:
    vertices, faces = disk(3)
    assert fluid_sectors(vertices, faces).count == 19  # vertices off the rim
    assert fluid_sectors(*airplane()).count == 0  # every vertex is on a rim
    sphere = ellipsoid((1.0, 1.0, 1.0), 1)
    sectors = fluid_sectors(*sphere)
    assert (sectors.count, sectors.chambers.shape[1]) == (42, 1)
    wall = np.vstack([sphere[1], sphere[1] + 42])
    assert fluid_sectors(np.vstack([sphere[0], sphere[0] + 5.0]), wall).chambers.shape[1] == 2


def test_a_membrane_inside_a_solid_is_not_felt_outside() -> None:
    """Three faces at every edge of the equator, two chambers: the energy outside is that of the plain octahedron."""
    points = np.array([(1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1), (0, 0, 0)], dtype=np.float64)
    top = [(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)]
    bottom = [(b, a, 5) for a, b, _ in top]
    membrane = [(0, 1, 6), (1, 2, 6), (2, 3, 6), (3, 0, 6)]
    plain = fluid_sectors(points[:6], np.array(top + bottom))
    divided = fluid_sectors(points, np.array(top + bottom + membrane))
    assert (plain.count, plain.chambers.shape[1]) == (6, 1)
    # Two poles of one jump each, four equator points of two, and the middle of the membrane.
    assert (divided.count, divided.chambers.shape[1]) == (11, 2)


def test_parallel_axes_are_what_shifted_tensor_says() -> None:
    vertices, faces = leaf(3)
    offset = np.array([0.01, -0.02, 0.03])
    moved = surface_tensor(vertices + offset, faces, closed=False).matrix
    transform = np.eye(6)
    transform[:3, 3:] = -cross_matrix(offset)
    base = surface_tensor(vertices, faces, closed=False).matrix
    assert moved == pytest.approx(transform.T @ base @ transform, abs=1e-12)
