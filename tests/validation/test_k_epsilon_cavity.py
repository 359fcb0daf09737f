"""Lid-driven cavity against Ghia, Ghia and Shin (1982), J. Comput. Phys. 48, 387-411, tables I and II."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from tests.flow_cases import centers, lid_cavity
from warp_immersed.k_epsilon import KEpsilonSolver

Y = [0.0547, 0.0625, 0.0703, 0.1016, 0.1719, 0.2813, 0.4531, 0.5, 0.6172, 0.7344, 0.8516, 0.9531, 0.9609, 0.9688, 0.9766]
X = [0.0625, 0.0703, 0.0781, 0.0938, 0.1563, 0.2266, 0.2344, 0.5, 0.8047, 0.8594, 0.9063, 0.9453, 0.9531, 0.9609, 0.9688]
U = {
    100: [-0.03717, -0.04192, -0.04775, -0.06434, -0.10150, -0.15662, -0.21090, -0.20581, -0.13641, 0.00332, 0.23151, 0.68717,
          0.73722, 0.78871, 0.84123],
    1000: [-0.18109, -0.20196, -0.22220, -0.29730, -0.38289, -0.27805, -0.10648, -0.06080, 0.05702, 0.18719, 0.33304, 0.46604,
           0.51117, 0.57492, 0.65928],
}  # fmt: skip
V = {
    100: [0.09233, 0.10091, 0.10890, 0.12317, 0.16077, 0.17507, 0.17527, 0.05454, -0.24533, -0.22445, -0.16914, -0.10313,
          -0.08864, -0.07391, -0.05906],
    1000: [0.27485, 0.29012, 0.30353, 0.32627, 0.37095, 0.33075, 0.32235, 0.02526, -0.31966, -0.42665, -0.51550, -0.39188,
           -0.33714, -0.27669, -0.21388],
}  # fmt: skip


@pytest.mark.parametrize(
    ("reynolds", "cells", "du", "dv"),
    [(100, 64, 0.006, 0.012), pytest.param(1000, 128, 0.010, 0.020, marks=pytest.mark.slow)],
)
def test_centre_line_velocities(reynolds, cells, du, dv):
    solver = KEpsilonSolver(lid_cavity(cells, reynolds))
    assert solver.solve(4000).converged
    velocity = solver.fields()["velocity"][:, :, 0]
    at = np.concatenate([[0.0], centers(solver.setup, 0), [1.0]])
    middle = slice(cells // 2 - 1, cells // 2 + 1)
    u = CubicSpline(at, np.concatenate([[0.0], velocity[middle, :, 0].mean(axis=0), [1.0]]))
    v = CubicSpline(at, np.concatenate([[0.0], velocity[:, middle, 1].mean(axis=1), [0.0]]))
    assert np.abs(u(Y) - U[reynolds]).max() < du
    assert np.abs(v(X) - V[reynolds]).max() < dv  # at Re 100 the table itself is .009 off
