"""Flows with known answers, shared by the tests and benchmarks of the k-epsilon solver."""

import numpy as np

from warp_immersed.boundaries import Inlet, Outlet, Periodic, Slip, Wall
from warp_immersed.flow_setup import FlowSetup


def backward_step(cells_per_height, k=None, epsilon=None, length=20.0):
    """Backward-facing step of expansion ratio 1.5, Re_H 36,000, H = 1 m, U = 1 m/s, intensity 5 %, length scale .14 m."""
    n = cells_per_height
    cells = (int((4 + length) * n), 3 * n, 1)
    solid = np.zeros(cells, dtype=bool)
    solid[: 4 * n, :n] = True
    return FlowSetup(
        lower=(-4.0, 0.0, 0.0),
        upper=(length, 3.0, 1.0 / n),
        cells=cells,
        sides=(Inlet.from_intensity((1.0, 0.0, 0.0), 0.05, 0.14), Outlet(), Wall(), Wall(), Slip(), Slip()),
        viscosity=1.0 / 36000.0,
        solid=solid,
        k=k,
        epsilon=epsilon,
    )


def reattachment(velocity, x):
    """Where the flow next to the lower wall turns forward for good behind the step [m]; velocity (nx, ny, nz, 3), x (nx,)."""
    behind = x > 0.3
    u, x = velocity[behind, 0, 0, 0], x[behind]
    turns = np.nonzero((u[:-1] < 0.0) & (u[1:] >= 0.0))[0]
    if not len(turns):
        return float("nan")
    i = turns[-1]
    return float(x[i] - u[i] * (x[i + 1] - x[i]) / (u[i + 1] - u[i]))


def centers(setup, axis):
    """Coordinates of the cell centres along an axis [m]."""
    return setup.lower[axis] + (np.arange(setup.cells[axis]) + 0.5) * setup.spacing[axis]


def lid_cavity(n, reynolds):
    """Unit square with a lid at y = 1 sliding at 1 m/s, laminar."""
    lid = Wall(velocity=(1.0, 0.0, 0.0))
    return FlowSetup(
        lower=(0.0, 0.0, 0.0),
        upper=(1.0, 1.0, 1.0 / n),
        cells=(n, n, 1),
        sides=(Wall(), Wall(), Wall(), lid, Slip(), Slip()),
        viscosity=1.0 / reynolds,
        turbulent=False,
    )


def decaying_duct(cells=100, turnovers=10.0):
    """Uniform stream of 1 m/s with k0 = epsilon0 = .01, decaying over `turnovers` k0/epsilon0; cells (cells, 3, 1)."""
    length = turnovers
    h = length / cells
    return FlowSetup(
        lower=(0.0, 0.0, 0.0),
        upper=(length, 4 * h, h),
        cells=(cells, 4, 1),
        sides=(Inlet((1.0, 0.0, 0.0), 0.01, 0.01), Outlet(), Slip(), Slip(), Slip(), Slip()),
        viscosity=1e-6,
    )


def cube_in_wind(n, axis=0, forward=True, height=4.0):
    """A cube of edge 1 m on the ground in a uniform wind along +-x or +-z, n cells an edge; 10 x 4 x 5 m, mirror symmetric."""
    size = {axis: 10, 2 - axis: 5}
    cells = (size[0] * n, int(height) * n, size[2] * n)
    solid = np.zeros(cells, dtype=bool)
    along = slice(3 * n, 4 * n) if forward else slice(6 * n, 7 * n)
    across = slice(2 * n, 3 * n)
    solid[(along if axis == 0 else across), :n, (along if axis == 2 else across)] = True
    wind = [0.0, 0.0, 0.0]
    wind[axis] = 1.0 if forward else -1.0
    sides = [Slip(), Slip(), Wall(), Slip(), Slip(), Slip()]
    sides[2 * axis + (0 if forward else 1)] = Inlet.from_intensity(tuple(wind), 0.1, 0.3)
    sides[2 * axis + (1 if forward else 0)] = Outlet()
    return FlowSetup((0.0, 0.0, 0.0), tuple(c / n for c in cells), cells, tuple(sides), 1e-5, solid=solid)


def periodic_box(cells, size, viscosity, turbulent=True, k=None, epsilon=None, velocity=None):
    """A box that repeats in x and y (and z unless it is one cell)."""
    across = Slip() if cells[2] == 1 else Periodic()
    sides = (Periodic(), Periodic(), Periodic(), Periodic(), across, across)
    return FlowSetup((0.0, 0.0, 0.0), size, cells, sides, viscosity, velocity=velocity, k=k, epsilon=epsilon, turbulent=turbulent)
