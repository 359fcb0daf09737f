"""Backward-facing step, expansion ratio 1.5, Re_H 36,000, 16 cells a step height, against OpenFOAM v1912 on the same cells.

Reference: simpleFoam, standard k-epsilon with the same coefficients and wall functions, bounded linearUpwind for U and
limitedLinear for k and epsilon, uniform inflow U = 1 m/s, intensity 5 %, length scale .14 m. H = 1 m.
"""

import numpy as np
import pytest

from warp_immersed.charts.flow_cases import STEP_REATTACHMENT, backward_step, centers, reattachment
from warp_immersed.k_epsilon import KEpsilonSolver

# x/H: rows of y/H, u, v [m/s], k [m^2/s^2], epsilon [m^2/s^3], every fourth cell
PROFILES = {
    1: [
        (0.09375, -0.1326, 0.02172, 0.003879, 0.0009532),
        (0.34375, -0.08555, 0.0451, 0.007893, 0.000954),
        (0.59375, -0.01347, 0.04758, 0.008703, 0.001026),
        (0.84375, 0.15, 0.01855, 0.01751, 0.007884),
        (1.09375, 0.954, -0.00675, 0.007851, 0.005199),
        (1.34375, 1.02, -0.00733, 0.002651, 0.0001741),
        (1.59375, 1.016, -0.008226, 0.00275, 0.0001502),
        (1.84375, 1.013, -0.008256, 0.002756, 0.0001492),
        (2.09375, 1.011, -0.007763, 0.002755, 0.0001491),
        (2.34375, 1.01, -0.006896, 0.002751, 0.0001495),
        (2.59375, 1.009, -0.005798, 0.002689, 0.0001621),
        (2.84375, 1.008, -0.004461, 0.002481, 0.0005737),
    ],
    4: [
        (0.09375, -0.1651, -0.008834, 0.02233, 0.007351),
        (0.34375, -0.02563, -0.03199, 0.04291, 0.009464),
        (0.59375, 0.1868, -0.0553, 0.05393, 0.01466),
        (0.84375, 0.4945, -0.0758, 0.04857, 0.01659),
        (1.09375, 0.8704, -0.08275, 0.01147, 0.00315),
        (1.34375, 0.9489, -0.0709, 0.002371, 0.0001293),
        (1.59375, 0.9479, -0.05927, 0.002409, 0.0001155),
        (1.84375, 0.9465, -0.04859, 0.002409, 0.0001143),
        (2.09375, 0.9455, -0.03865, 0.002398, 0.0001138),
        (2.34375, 0.9451, -0.02927, 0.00236, 0.0001152),
        (2.59375, 0.9456, -0.0203, 0.002186, 0.0001351),
        (2.84375, 0.9102, -0.01053, 0.003138, 0.001039),
    ],
    8: [
        (0.09375, 0.2194, -0.005757, 0.01531, 0.004218),
        (0.34375, 0.3177, -0.01992, 0.02767, 0.004453),
        (0.59375, 0.443, -0.03053, 0.03232, 0.005569),
        (0.84375, 0.5963, -0.03513, 0.02728, 0.004883),
        (1.09375, 0.7523, -0.03246, 0.01157, 0.001643),
        (1.34375, 0.8207, -0.02723, 0.002377, 0.0001149),
        (1.59375, 0.8258, -0.02397, 0.002051, 8.277e-05),
        (1.84375, 0.8281, -0.02066, 0.002034, 8.188e-05),
        (2.09375, 0.8301, -0.0172, 0.001995, 8.183e-05),
        (2.34375, 0.8318, -0.01361, 0.001882, 8.502e-05),
        (2.59375, 0.8284, -0.009706, 0.001728, 0.000131),
        (2.84375, 0.6949, -0.002707, 0.005693, 0.001895),
    ],
}
SPACING = 1.0 / 16.0


def at_station(field, setup, station, heights):
    """Values of a field (nx, ny, 1) at x = station, interpolated along x, in the cells at the heights given."""
    x = centers(setup, 0)
    i = int(np.searchsorted(x, station)) - 1
    share = (station - x[i]) / (x[i + 1] - x[i])
    rows = [round(y / SPACING - 0.5) for y in heights]
    return ((1.0 - share) * field[i, :, 0] + share * field[i + 1, :, 0])[rows]


@pytest.fixture(scope="module", params=[5.0, 10.0])
def step(request):
    solver = KEpsilonSolver(backward_step(16), cfl=request.param)
    return solver, solver.solve(2500)


@pytest.mark.slow
def test_reattachment(step):
    solver, verdict = step
    assert verdict.converged, verdict.advice
    found = reattachment(solver.fields()["velocity"], centers(solver.setup, 0))
    assert found == pytest.approx(STEP_REATTACHMENT, rel=0.03)
    assert found == pytest.approx(5.875, rel=0.005)  # the same at CFL 5 and 10


@pytest.mark.slow
@pytest.mark.parametrize(("name", "column", "share"), [("velocity", 1, 0.02), ("k", 3, 0.04), ("epsilon", 4, 0.08)])
def test_profiles(step, name, column, share):
    solver, _ = step
    field = solver.fields()[name]
    if name == "velocity":
        field = field[..., 0]
    found, expected = [], []
    for station, rows in PROFILES.items():
        table = np.array(rows)
        found.append(at_station(field, solver.setup, station, table[:, 0]))
        expected.append(table[:, column])
    found, expected = np.concatenate(found), np.concatenate(expected)
    if name == "velocity":
        assert np.linalg.norm(found - expected) < share * np.linalg.norm(expected)
    else:
        assert np.abs(found - expected).sum() < share * expected.sum()
