"""Decay behind a grid: Comte-Bellot and Corrsin (1971), J. Fluid Mech. 48, 273-337, mesh 5.08 cm, 10 m/s."""

import numpy as np
import pytest

from warp_immersed.boundaries import Inlet, Outlet, Slip
from warp_immersed.charts.flow_cases import centers
from warp_immersed.flow_setup import FlowSetup
from warp_immersed.k_epsilon import KEpsilonSolver

# At 42 mesh lengths u_rms 22.2 cm/s and epsilon 4740 cm^2/s^3; at 98 mesh lengths k = 245.8 cm^2/s^2.
K_START, EPSILON_START, K_END = 739.3e-4, 4740e-4, 245.8e-4
LENGTH = (98 - 42) * 0.0508


def test_k_decays_as_measured_behind_the_grid():
    h = LENGTH / 60
    sides = (Inlet((10.0, 0.0, 0.0), K_START, EPSILON_START), Outlet(), Slip(), Slip(), Slip(), Slip())
    setup = FlowSetup((0, 0, 0), (LENGTH, 4 * h, h), (60, 4, 1), sides, 1.5e-5)
    solver = KEpsilonSolver(setup, threads=1)
    assert solver.solve(1000).converged
    k = np.interp(LENGTH - h / 2, centers(setup, 0), solver.fields()["k"][:, 1, 0])
    assert k == pytest.approx(K_END, rel=0.12)
