"""Closed-form added mass against published values, limits, and the parallel-axis law."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from warp_immersed import library
from warp_immersed.added_mass import kirchhoff_tensor
from warp_immersed.exact_tensors import ellipsoid_tensor, elliptic_sheet_tensor, shifted_tensor
from warp_immersed.fluid import AIR, WATER

vectors = st.tuples(*[st.floats(-1.0, 1.0)] * 3)


def test_sphere_is_half_its_displaced_mass() -> None:
    displaced = 1000.0 * 4.0 / 3.0 * np.pi * 0.05**3
    assert np.allclose(ellipsoid_tensor([0.05] * 3, 1000.0), np.diag([0.5] * 3 + [0.0] * 3) * displaced, atol=1e-12 * displaced)


def test_spheroid_has_the_published_coefficients() -> None:
    """1 : 1 : 0.5, over rho V and rho V a^2 (Lamb, art. 114)."""
    tensor = np.diag(ellipsoid_tensor([1.0, 1.0, 0.5], 1.0)) / (4.0 / 3.0 * np.pi * 0.5)
    assert np.allclose(tensor, [0.309586, 0.309586, 1.11506, 0.084644, 0.084644, 0.0], atol=6e-7)


def test_triaxial_ellipsoid_in_any_order() -> None:
    """30 x 20 x 10 mm semi-axes in water of 1000 kg/m^3; the tensor goes with its axes."""
    tensor = ellipsoid_tensor([0.03, 0.02, 0.01], 1000.0)
    assert tensor[0, 0] == pytest.approx(0.00465600127, rel=1e-8)
    assert tensor[1, 1] == pytest.approx(0.009161970907, rel=1e-8)
    other = ellipsoid_tensor([0.01, 0.03, 0.02], 1000.0)
    order = [2, 0, 1, 5, 3, 4]
    assert np.allclose(other, tensor[np.ix_(order, order)], rtol=1e-12)


def test_disk_is_the_classical_one() -> None:
    tensor = np.diag(elliptic_sheet_tensor(0.1, 0.1, 1.2))
    assert np.allclose(tensor, [0, 0, 8 / 3 * 1.2e-3, 16 / 45 * 1.2e-5, 16 / 45 * 1.2e-5, 0], rtol=1e-12)


@pytest.mark.parametrize("b", [0.999999, 0.5, 0.25, 0.02])
def test_sheet_is_the_limit_of_the_thin_ellipsoid(b: float) -> None:
    sheet, thin = elliptic_sheet_tensor(1.0, b, 1.0), ellipsoid_tensor([1.0, b, 1e-6], 1.0)
    assert np.allclose(np.diag(sheet)[[2, 3, 4]], np.diag(thin)[[2, 3, 4]], rtol=5e-6 / b)


def test_long_ellipse_is_a_strip() -> None:
    """Slender-body limit: int pi rho c(x)^2 / 4 dx of the local chord c = 2 b (1 - x^2 / a^2)^(1/2)."""
    tensor = elliptic_sheet_tensor(1.0, 1.0 / 400.0, 1.0)
    assert tensor[2, 2] == pytest.approx(np.pi * (1 / 400) ** 2 * 4.0 / 3.0, rel=1e-4)


def test_sheet_axes_may_be_given_either_way_round() -> None:
    order = [1, 0, 2, 4, 3, 5]
    assert np.allclose(elliptic_sheet_tensor(0.5, 1.0, 1.0), elliptic_sheet_tensor(1.0, 0.5, 1.0)[np.ix_(order, order)])


@given(offset=vectors, velocity=vectors, spin=vectors)
def test_shifting_keeps_the_kinetic_energy(offset, velocity, spin) -> None:
    tensor = ellipsoid_tensor([1.0, 0.7, 0.3], 1.0)
    at_old = np.concatenate([np.array(velocity) + np.cross(spin, offset), spin])
    at_new = np.concatenate([velocity, spin])
    assert at_new @ shifted_tensor(tensor, offset) @ at_new == pytest.approx(at_old @ tensor @ at_old, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("name", [n for n in library.SHAPES if n not in ("ellipsoid", "sheet")])
def test_tensors_are_symmetric_and_positive_and_scale_with_the_fluid(name: str) -> None:
    shape = library.SHAPES[name]()
    tensor = kirchhoff_tensor(shape, AIR)
    assert np.allclose(tensor, tensor.T, rtol=1e-12, atol=0.0)
    scale = np.diag([1.0] * 3 + [1.0 / shape.semi_axes[0]] * 3)
    values = np.linalg.eigvalsh(scale @ tensor @ scale)
    assert values.min() > -1e-9 * values.max()
    assert np.allclose(kirchhoff_tensor(shape, WATER), tensor * WATER.density / AIR.density, rtol=1e-9)
