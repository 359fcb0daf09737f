"""`FlowSetup`: everything that defines a flow on a voxel grid, checked, and its form for the kernels."""

from dataclasses import dataclass, field
from math import isfinite

import numpy as np
import warp as wp
from numpy.typing import NDArray
from scipy.ndimage import label

from warp_immersed.boundaries import SIDES, Boundary, Inlet, LogInlet, Outlet, Periodic, Slip, Vector, Wall
from warp_immersed.errors import InputError
from warp_immersed.kernels import grid as device_grid

KIND = {Wall: 1, Slip: 2, Inlet: 3, LogInlet: 3, Outlet: 4, Periodic: 0}
OBSTACLE = 5
SOLID_BIT = 24


@dataclass(frozen=True, eq=False)
class FlowSetup:
    """A flow domain of equal box-shaped cells.

    Args:
        lower, upper: (3,) corners [m]. cells: (3,) cells an axis; an axis of one cell is left out (two-dimensional).
        sides: boundary of x_min, x_max, y_min, y_max, z_min, z_max.
        solid: (nx, ny, nz) bool, cells inside obstacles; None for none. Hollows that no inlet or outlet reaches are filled.
        viscosity: kinematic viscosity nu [m^2/s].
        velocity (3,) [m/s], k [m^2/s^2], epsilon [m^2/s^3]: what the domain starts from; None for what enters.
        turbulent: whether the k-epsilon model acts; without it the flow is laminar.
        obstacle_roughness: z0 of obstacles [m], 0 for smooth.

    Raises:
        InputError: sizes, boundaries or obstacles that define no flow; the message says what would be right.
    """

    lower: Vector
    upper: Vector
    cells: tuple[int, int, int]
    sides: tuple[Boundary, Boundary, Boundary, Boundary, Boundary, Boundary]
    viscosity: float
    solid: NDArray[np.bool_] | None = None
    velocity: Vector | None = None
    k: float | None = None
    epsilon: float | None = None
    turbulent: bool = True
    obstacle_roughness: float = 0.0
    fluid_cells: int = field(init=False)

    def __post_init__(self) -> None:
        check_box(self)
        check_sides(self)
        count = int(np.prod(self.cells))
        if self.solid is not None:
            if self.solid.shape != tuple(self.cells):
                raise InputError(f"obstacle mask: found shape {self.solid.shape}, must be {tuple(self.cells)}")
            count -= int(np.count_nonzero(self.solid))
        if count == 0:
            raise InputError("obstacle: fills the whole domain, must leave room for the fluid")
        if self.solid is not None:
            object.__setattr__(self, "solid", fill_pockets(self))
            count = int(np.count_nonzero(~self.solid))
        object.__setattr__(self, "fluid_cells", count)

    @property
    def spacing(self) -> Vector:
        """Cell size (3,) [m]."""
        a, b, c = ((u - v) / n for u, v, n in zip(self.upper, self.lower, self.cells, strict=True))
        return a, b, c

    @property
    def effective_sides(self) -> tuple[Boundary, ...]:
        """The sides, with those of an axis of one cell as planes of symmetry."""
        return tuple(Slip() if self.cells[s // 2] == 1 else side for s, side in enumerate(self.sides))

    @property
    def reference_speed(self) -> float:
        """The largest speed given on a side or at the start [m/s]; 1 if all is at rest."""
        speeds = [0.0 if self.velocity is None else float(np.linalg.norm(self.velocity))]
        for side in self.effective_sides:
            if isinstance(side, Inlet | Wall):
                speeds.append(float(np.linalg.norm(side.velocity)))
            elif isinstance(side, LogInlet):
                speeds.append(side.speed(self.upper[1]))
        return max(speeds) or 1.0

    def fluid_mask(self) -> NDArray[np.bool_]:
        """(nx, ny, nz) bool: cells that hold fluid."""
        return np.ones(self.cells, dtype=bool) if self.solid is None else ~self.solid


def check_box(setup: FlowSetup) -> None:
    """Raise InputError unless the box, its cells and the viscosity make sense."""
    for axis, (low, high, n) in enumerate(zip(setup.lower, setup.upper, setup.cells, strict=True)):
        name = "xyz"[axis]
        if not (isfinite(low) and isfinite(high) and low < high):
            raise InputError(f"domain {name}: found lower {low!r}, upper {high!r}, must be finite with lower < upper")
        if n < 1 or n == 2:
            raise InputError(f"domain cells along {name}: found {n}, must be 1 (left out) or at least 3")
    if setup.cells[0] == 1 or setup.cells[1] == 1:
        raise InputError(f"domain cells: found {list(setup.cells)}, only z may have one cell (a two-dimensional flow in x and y)")
    if not (isfinite(setup.viscosity) and setup.viscosity > 0.0):
        raise InputError(f"viscosity: found {setup.viscosity!r}, must be a positive number [m^2/s]")


def check_sides(setup: FlowSetup) -> None:
    """Raise InputError unless what enters can leave, inlets point inwards, and periodic sides match."""
    sides = setup.effective_sides
    inflow = False
    for s, side in enumerate(sides):
        axis, outward = s // 2, 1.0 if s % 2 else -1.0
        if isinstance(side, Periodic) and not (isinstance(sides[s ^ 1], Periodic) and setup.cells[axis] % 2 == 0):
            raise InputError(
                f"boundary {SIDES[s]}: periodic needs {SIDES[s ^ 1]} periodic too and an even number of cells "
                f"(found {type(sides[s ^ 1]).__name__} and {setup.cells[axis]} cells)"
            )
        if isinstance(side, Inlet | LogInlet):
            velocity = side.velocity if isinstance(side, Inlet) else side.direction
            normal = outward * velocity[axis]
            if normal > 0.0:
                raise InputError(f"boundary {SIDES[s]}: inlet velocity {list(velocity)} points out of the domain; reverse it")
            if normal == 0.0:
                raise InputError(f"boundary {SIDES[s]}: inlet velocity {list(velocity)} runs along the side; use slip")
            inflow = True
            if isinstance(side, Inlet) and setup.turbulent and not (side.k > 0.0 and side.epsilon > 0.0):
                raise InputError(f"boundary {SIDES[s]}: found k {side.k}, epsilon {side.epsilon}, must be positive")
        if isinstance(side, Wall) and abs(side.velocity[axis]) > 0.0:
            raise InputError(f"boundary {SIDES[s]}: wall velocity {list(side.velocity)} must run along the wall")
    if inflow and not any(isinstance(side, Outlet) for side in sides):
        raise InputError("boundary: fluid enters but no side is an outlet; make one (usually opposite the inlet) an outlet")


def fill_pockets(setup: FlowSetup) -> NDArray[np.bool_]:
    """The obstacle mask with the hollows filled that neither an inlet nor an outlet reaches, so that nothing moves there.

    Raises:
        InputError: obstacles close every way from an inlet to an outlet.
    """
    fluid = setup.fluid_mask()
    sides = setup.effective_sides
    ends = [s for s, side in enumerate(sides) if isinstance(side, Inlet | LogInlet | Outlet)]
    if not ends or any(isinstance(side, Periodic) for side in sides):
        return ~fluid
    parts, _ = label(fluid)
    reached = {s: set(np.unique(parts.take(-1 if s % 2 else 0, axis=s // 2))) - {0} for s in ends}
    open_parts = set().union(*(reached[s] for s in ends if isinstance(sides[s], Outlet)))
    for s in ends:
        if reached[s] - open_parts:
            raise InputError(f"obstacle: closes the way from {SIDES[s]} to every outlet; leave a gap of at least a cell")
    return ~np.isin(parts, sorted(set().union(*reached.values())))


def face_codes(setup: FlowSetup) -> NDArray[np.int32]:
    """(nx, ny, nz) code words of the cells, as kernels.grid describes them."""
    fluid = setup.fluid_mask()
    codes = np.where(fluid, 0, 1 << SOLID_BIT).astype(np.int32)
    sides = setup.effective_sides
    for face in range(6):
        axis, forward = face // 2, face % 2 == 1
        behind = np.roll(fluid, -1 if forward else 1, axis)
        kind = np.where(behind, 0, OBSTACLE).astype(np.int32)
        edge: list[slice | int] = [slice(None)] * 3
        edge[axis] = -1 if forward else 0
        if not isinstance(sides[face], Periodic):
            kind[tuple(edge)] = KIND[type(sides[face])]
        codes |= np.where(fluid, kind << (4 * face), 0)
    return codes


def device_geometry(setup: FlowSetup) -> device_grid.Grid:
    """The grid as kernels take it."""
    grid = device_grid.Grid()
    grid.cells = wp.vec3i(*setup.cells)
    grid.wraps = wp.vec3i(*(int(isinstance(setup.effective_sides[2 * axis], Periodic)) for axis in range(3)))
    grid.lower = wp.vec3(*setup.lower)
    grid.spacing = wp.vec3(*setup.spacing)
    grid.inverse = wp.vec3(*(1.0 / h for h in setup.spacing))
    return grid


def device_sides(setup: FlowSetup, device: wp.Device) -> wp.array:
    """(7,) what is given on the six sides and on obstacles, as kernels take it."""
    rows = []
    for boundary in (*setup.effective_sides, Wall(roughness=setup.obstacle_roughness)):
        row = device_grid.Side()
        if isinstance(boundary, Inlet):
            row.velocity, row.k, row.epsilon = wp.vec3(*boundary.velocity), boundary.k, boundary.epsilon
        elif isinstance(boundary, LogInlet):
            row.velocity, row.friction_velocity = wp.vec3(*boundary.direction), boundary.friction_velocity
            row.roughness, row.ground = boundary.roughness, boundary.ground
        elif isinstance(boundary, Wall):
            row.velocity, row.roughness = wp.vec3(*boundary.velocity), boundary.roughness
        rows.append(row)
    return wp.array(rows, dtype=device_grid.Side, device=device)


def initial_state(setup: FlowSetup) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Velocity (nx, ny, nz, 3) [m/s] and (k, epsilon) (nx, ny, nz, 2) to start from: what enters, everywhere."""
    velocity = np.zeros((*setup.cells, 3), dtype=np.float32)
    turbulence = np.full((*setup.cells, 2), 1e-12, dtype=np.float32)
    inlets = [side for side in setup.effective_sides if isinstance(side, Inlet | LogInlet)]
    heights = setup.lower[1] + (np.arange(setup.cells[1]) + 0.5) * setup.spacing[1]
    if inlets:
        first = inlets[0]
        if isinstance(first, Inlet):
            velocity[:] = first.velocity
            turbulence[:] = first.k, first.epsilon
        else:
            speed = np.array([first.speed(y) for y in heights])
            velocity[:] = (speed[:, None] * np.array(first.direction))[None, :, None, :]
            u = first.friction_velocity
            above = np.maximum(heights - first.ground, 0.0) + first.roughness
            turbulence[..., 0] = u**2 / 0.3
            turbulence[..., 1] = (u**3 / (0.41 * above))[None, :, None]
    if setup.velocity is not None:
        velocity[:] = setup.velocity
    if setup.k is not None:
        turbulence[..., 0] = max(setup.k, 1e-12)
    if setup.epsilon is not None:
        turbulence[..., 1] = max(setup.epsilon, 1e-12)
    solid = ~setup.fluid_mask()
    velocity[solid] = 0.0
    turbulence[solid] = 0.0
    return velocity, turbulence
