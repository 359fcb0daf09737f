"""Flows with known answers, shared by the charts, tests and benchmarks of the k-epsilon solver."""

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from warp_immersed.boundaries import Boundary, Inlet, Outlet, Periodic, Slip, Wall
from warp_immersed.flow_setup import FlowSetup
from warp_immersed.k_epsilon import KEpsilonSolver
from warp_immersed.unsteady import UnsteadySolver

Array = NDArray[np.float64]

C2 = 1.92
# Reattachment behind `backward_step` [H]: OpenFOAM v1912 (simpleFoam, standard k-epsilon) on 16 cells a step height.
STEP_REATTACHMENT = 5.81
# Lid-driven cavity: Ghia, Ghia & Shin, J. Comput. Phys. 48 (1982) 387-411, tables I and II.
CAVITY_Y = [0.0547, 0.0625, 0.0703, 0.1016, 0.1719, 0.2813, 0.4531, 0.5, 0.6172, 0.7344, 0.8516, 0.9531, 0.9609, 0.9688, 0.9766]
CAVITY_X = [0.0625, 0.0703, 0.0781, 0.0938, 0.1563, 0.2266, 0.2344, 0.5, 0.8047, 0.8594, 0.9063, 0.9453, 0.9531, 0.9609, 0.9688]
CAVITY_U = {
    100: [-0.03717, -0.04192, -0.04775, -0.06434, -0.10150, -0.15662, -0.21090, -0.20581, -0.13641, 0.00332, 0.23151, 0.68717,
          0.73722, 0.78871, 0.84123],
    1000: [-0.18109, -0.20196, -0.22220, -0.29730, -0.38289, -0.27805, -0.10648, -0.06080, 0.05702, 0.18719, 0.33304, 0.46604,
           0.51117, 0.57492, 0.65928],
}  # fmt: skip
CAVITY_V = {
    100: [0.09233, 0.10091, 0.10890, 0.12317, 0.16077, 0.17507, 0.17527, 0.05454, -0.24533, -0.22445, -0.16914, -0.10313,
          -0.08864, -0.07391, -0.05906],
    1000: [0.27485, 0.29012, 0.30353, 0.32627, 0.37095, 0.33075, 0.32235, 0.02526, -0.31966, -0.42665, -0.51550, -0.39188,
           -0.33714, -0.27669, -0.21388],
}  # fmt: skip


def exact_decay(time: Array | float, k: float = 1.0, epsilon: float = 1.0) -> tuple[Array, Array]:
    """k and epsilon of homogeneous turbulence after a time [s] without production: d k/dt = -eps, d eps/dt = -C2 eps^2/k."""
    f = 1.0 + (C2 - 1.0) * np.asarray(time) * epsilon / k
    return k * f ** (-1.0 / (C2 - 1.0)), epsilon * f ** (-C2 / (C2 - 1.0))


def taylor_green(cells: int, cfl: float) -> float:
    """Relative L2 error of a decaying 2-D Taylor-Green vortex, nu = .01, after 2 pi s (exact: exp(-2 nu t))."""
    h = 2.0 * np.pi / cells
    setup = periodic_box((cells, cells, 1), (2 * np.pi, 2 * np.pi, h), 0.01, turbulent=False, velocity=(1.0, 0.0, 0.0))
    base = KEpsilonSolver(setup, threads=1)
    x, y = np.meshgrid(centers(setup, 0), centers(setup, 1), indexing="ij")
    exact = np.stack([np.cos(x) * np.sin(y), -np.sin(x) * np.cos(y), 0.0 * x], axis=-1)[:, :, None]
    base.velocity.assign(exact.astype(np.float32))
    base.pressure.assign((-(np.cos(2 * x) + np.cos(2 * y)) / 4)[:, :, None].astype(np.float32))
    duration = 2.0 * np.pi
    solver = UnsteadySolver(base, dt=duration / round(duration / (cfl * h)))
    solver.advance(duration)
    exact *= np.exp(-0.02 * duration)
    return float(np.linalg.norm(base.velocity.numpy() - exact) / np.linalg.norm(exact))


def cavity_errors(solver: KEpsilonSolver) -> tuple[float, float]:
    """Largest differences [m/s] of u and v on the centre lines of a solved `lid_cavity` from Ghia et al."""
    velocity = solver.fields()["velocity"][:, :, 0]
    reynolds, cells = round(1.0 / solver.setup.viscosity), len(velocity)
    at = np.concatenate([[0.0], centers(solver.setup, 0), [1.0]])
    middle = slice(cells // 2 - 1, cells // 2 + 1)
    u = CubicSpline(at, np.concatenate([[0.0], velocity[middle, :, 0].mean(axis=0), [1.0]]))
    v = CubicSpline(at, np.concatenate([[0.0], velocity[:, middle, 1].mean(axis=1), [0.0]]))
    return float(np.abs(u(CAVITY_Y) - CAVITY_U[reynolds]).max()), float(np.abs(v(CAVITY_X) - CAVITY_V[reynolds]).max())


def backward_step(cells_per_height: int, k: float | None = None, epsilon: float | None = None, length: float = 20.0) -> FlowSetup:
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


def reattachment(velocity: NDArray[np.float32], x: Array) -> float:
    """Where the flow next to the lower wall turns forward for good behind the step [m]; velocity (nx, ny, nz, 3), x (nx,)."""
    behind = x > 0.3
    u, x = velocity[behind, 0, 0, 0], x[behind]
    turns = np.nonzero((u[:-1] < 0.0) & (u[1:] >= 0.0))[0]
    if not len(turns):
        return float("nan")
    i = turns[-1]
    return float(x[i] - u[i] * (x[i + 1] - x[i]) / (u[i + 1] - u[i]))


def centers(setup: FlowSetup, axis: int) -> Array:
    """Coordinates of the cell centres along an axis [m]."""
    return np.asarray(setup.lower[axis] + (np.arange(setup.cells[axis]) + 0.5) * setup.spacing[axis], dtype=np.float64)


def lid_cavity(n: int, reynolds: float) -> FlowSetup:
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


def decaying_duct(cells: int = 100, turnovers: float = 10.0) -> FlowSetup:
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


def cube_in_wind(n: int, axis: int = 0, forward: bool = True, height: float = 4.0) -> FlowSetup:
    """A cube of edge 1 m on the ground in a uniform wind along +-x or +-z, n cells an edge; 10 x 4 x 5 m, mirror symmetric."""
    size = {axis: 10, 2 - axis: 5}
    cells = (size[0] * n, int(height) * n, size[2] * n)
    solid = np.zeros(cells, dtype=bool)
    along = slice(3 * n, 4 * n) if forward else slice(6 * n, 7 * n)
    across = slice(2 * n, 3 * n)
    solid[(along if axis == 0 else across), :n, (along if axis == 2 else across)] = True
    blows = 1.0 if forward else -1.0
    ends: list[Boundary] = [Inlet.from_intensity((blows, 0.0, 0.0) if axis == 0 else (0.0, 0.0, blows), 0.1, 0.3), Outlet()]
    first, last = ends if forward else reversed(ends)
    x, z = ((first, last), (Slip(), Slip())) if axis == 0 else ((Slip(), Slip()), (first, last))
    upper = (cells[0] / n, cells[1] / n, cells[2] / n)
    return FlowSetup((0.0, 0.0, 0.0), upper, cells, (*x, Wall(), Slip(), *z), 1e-5, solid=solid)


def periodic_box(
    cells: tuple[int, int, int],
    size: tuple[float, float, float],
    viscosity: float,
    turbulent: bool = True,
    k: float | None = None,
    epsilon: float | None = None,
    velocity: tuple[float, float, float] | None = None,
) -> FlowSetup:
    """A box that repeats in x and y (and z unless it is one cell)."""
    across: Boundary = Slip() if cells[2] == 1 else Periodic()
    sides = (Periodic(), Periodic(), Periodic(), Periodic(), across, across)
    return FlowSetup((0.0, 0.0, 0.0), size, cells, sides, viscosity, velocity=velocity, k=k, epsilon=epsilon, turbulent=turbulent)
