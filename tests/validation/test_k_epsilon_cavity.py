"""Lid-driven cavity against Ghia, Ghia and Shin (1982), J. Comput. Phys. 48, 387-411, tables I and II."""

import pytest

from warp_immersed.charts.flow_cases import cavity_errors, lid_cavity
from warp_immersed.k_epsilon import KEpsilonSolver


@pytest.mark.parametrize(
    ("reynolds", "cells", "du", "dv"),
    [(100, 64, 0.006, 0.012), pytest.param(1000, 128, 0.010, 0.020, marks=pytest.mark.slow)],
)
def test_centre_line_velocities(reynolds, cells, du, dv):
    solver = KEpsilonSolver(lid_cavity(cells, reynolds))
    assert solver.solve(4000).converged
    u, v = cavity_errors(solver)
    assert u < du
    assert v < dv  # at Re 100 the table itself is .009 off
