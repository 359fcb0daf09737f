"""The load coefficients against published drag laws."""

import numpy as np
import pytest

from warp_immersed import library
from warp_immersed.fluid import AIR, WATER, Fluid
from warp_immersed.force_law import flatness, quasi_steady_coefficients, stokes_resistance
from warp_immersed.shape import Shape


def drag(shape: Shape, fluid: Fluid, speed: float, axis: int) -> float:
    """Drag [N] of a body moving along a principal axis, assembled as kernels/aerodynamics.py does."""
    c = quasi_steady_coefficients(shape, fluid)
    rate = c.drag_root[axis] * np.sqrt(speed) + c.drag_quadratic[axis] * speed
    if axis == 2:
        rate = max(rate, c.drag_broadside * speed - c.drag_linear[2])
    return float((rate + c.drag_linear[axis]) * speed)


def test_stokes_limits_are_exact() -> None:
    force, torque = stokes_resistance([0.01] * 3, 2.0)
    assert np.allclose(force, 6.0 * np.pi * 2.0 * 0.01)
    assert np.allclose(torque, 8.0 * np.pi * 2.0 * 1e-6)
    force, torque = stokes_resistance([0.01, 0.01, 1e-8], 2.0)
    assert np.allclose(force, np.array([32 / 3, 32 / 3, 16]) * 2.0 * 0.01, rtol=1e-5)
    assert np.allclose(torque, 32 / 3 * 2.0 * 1e-6, rtol=1e-5)


def test_long_spheroid_follows_slender_body_theory() -> None:
    """Drag along the axis tends to 4 pi mu a / (ln(2 a / b) - 1/2) (Happel & Brenner, sec. 4-30)."""
    force, _ = stokes_resistance([1.0, 1e-4, 1e-4], 1.0)
    assert force[0] == pytest.approx(4.0 * np.pi / (np.log(2e4) - 0.5), rel=1e-4)


@pytest.mark.parametrize("reynolds", [0.01, 1.0, 10.0, 41.6, 100.0, 300.0, 800.0])
def test_sphere_drag_follows_schiller_and_naumann(reynolds: float) -> None:
    shape = library.sphere(0.001, 2000.0)
    speed = reynolds * WATER.kinematic_viscosity / 0.002
    coefficient = drag(shape, WATER, speed, 2) / (0.5 * WATER.density * speed**2 * np.pi * 1e-6)
    measured = 24.0 / reynolds * (1.0 + 0.15 * reynolds**0.687)
    assert coefficient == pytest.approx(measured, rel=0.06 if reynolds < 500.0 else 0.16)


@pytest.mark.parametrize("reynolds", [0.1, 1.5, 10.0, 50.0, 133.0, 1000.0, 1e4])
def test_disk_drag_follows_clift_grace_and_weber(reynolds: float) -> None:
    """Broadside, Bubbles, Drops and Particles (1978): (64 / pi Re)(1 + 0.138 Re^0.792) below Re 133, 1.17 above."""
    shape = library.disk(0.02, 1e-5, 800.0)
    speed = reynolds * AIR.kinematic_viscosity / 0.02
    coefficient = drag(shape, AIR, speed, 2) / (0.5 * AIR.density * speed**2 * np.pi * 1e-4)
    measured = 64.0 / (np.pi * reynolds) * (1.0 + 0.138 * reynolds**0.792) if reynolds < 133.0 else 1.17
    assert coefficient == pytest.approx(measured, rel=0.10)


def test_edge_on_drag_is_small_and_broadside_drag_large() -> None:
    shape = library.disk(0.04, 1e-4, 800.0)
    assert drag(shape, AIR, 1.0, 0) < 0.25 * drag(shape, AIR, 1.0, 2)


def test_compact_bodies_have_no_plate_loads() -> None:
    for shape in (library.sphere(), library.ellipsoid((0.03, 0.01, 0.01))):
        assert flatness(shape) == pytest.approx(0.0, abs=1e-12)
        c = quasi_steady_coefficients(shape, WATER)
        assert c.lift == 0.0
        assert not c.circulation.any()
        assert c.munk_cut_edge == 0.0
    along, across = (drag(library.ellipsoid((0.03, 0.01, 0.01)), WATER, 1.0, axis) for axis in (0, 2))
    assert across == pytest.approx(3.0 * along, rel=0.05), "in the ratio of the frontal areas"


def test_coefficients_scale_with_size_at_equal_reynolds_number() -> None:
    small, large = library.disk(0.02, 1e-4), library.disk(0.08, 4e-4)
    one, four = (drag(shape, AIR, speed, 2) for shape, speed in ((small, 0.8), (large, 0.2)))
    assert one == pytest.approx(four, rel=1e-9), "the same force: rho V^2 L^2 is unchanged"
