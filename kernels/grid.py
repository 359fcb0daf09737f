"""The voxel grid as the flow kernels see it: neighbours, what lies behind each face, and the values given there.

Axes are x, y, z with y up; arrays are (nx, ny, nz). Every cell has one code word of 4 bits a face in the order
x-, x+, y-, y+, z-, z+, which says what the neighbour is, and one bit that says the cell itself is solid.
"""

import warp as wp

wp.set_module_options({"enable_backward": False})

# What lies behind a face. A WALL is a side of the domain, an OBSTACLE is a solid cell inside it.
OPEN = wp.constant(0)
WALL = wp.constant(1)
SLIP = wp.constant(2)
INLET = wp.constant(3)
OUTLET = wp.constant(4)
OBSTACLE = wp.constant(5)
SOLID_BIT = wp.constant(24)
OBSTACLE_SIDE = wp.constant(6)

VON_KARMAN = wp.constant(0.41)

# An implicit equation of one cell: six neighbour coefficients (x-, x+, y-, y+, z-, z+), 1 / diagonal, right-hand side.
Stencil = wp.types.vector(length=8, dtype=wp.float32)


@wp.struct
class Grid:
    """A uniform grid: cells, whether each axis wraps (1 or 0), lower corner [m], cell size [m] and its inverse [1/m]."""

    cells: wp.vec3i
    wraps: wp.vec3i
    lower: wp.vec3
    spacing: wp.vec3
    inverse: wp.vec3


@wp.struct
class Side:
    """What is given on one side of the domain, or on the obstacles.

    velocity [m/s]: of an inlet or of a moving wall; for a logarithmic inlet the unit horizontal direction.
    k [m^2/s^2], epsilon [m^2/s^3]: of a uniform inlet. friction_velocity [m/s]: positive for a logarithmic inlet.
    roughness z0 [m]: of a logarithmic inlet or of a rough wall (0: smooth). ground [m]: height where the profile starts.
    """

    velocity: wp.vec3
    k: float
    epsilon: float
    friction_velocity: float
    roughness: float
    ground: float


@wp.func
def next_cell(i: int, n: int, wraps: int) -> int:
    """Index of the neighbour on the + side; the cell itself where there is none."""
    if i + 1 < n:
        return i + 1
    return wp.where(wraps == 1, 0, i)


@wp.func
def previous_cell(i: int, n: int, wraps: int) -> int:
    """Index of the neighbour on the - side; the cell itself where there is none."""
    if i > 0:
        return i - 1
    return wp.where(wraps == 1, n - 1, i)


@wp.func
def face_kind(code: int, face: int) -> int:
    """What lies behind face 0..5 (x-, x+, y-, y+, z-, z+)."""
    return (code >> (4 * face)) & 15


@wp.func
def is_solid(code: int) -> bool:
    """Whether the cell itself is inside an obstacle."""
    return ((code >> SOLID_BIT) & 1) == 1


@wp.func
def side_of(kind: int, face: int) -> int:
    """Row of the table of sides that a wall or inlet face takes its values from."""
    return wp.where(kind == OBSTACLE, OBSTACLE_SIDE, face)


@wp.func
def boundary_velocity(side: Side, height: float) -> wp.vec3:
    """Velocity given on a side [m/s] at `height` [m].

    A logarithmic inlet has u* / kappa ln((y + z0) / z0), y above its ground (Richards and Hoxey 1993).
    """
    if side.friction_velocity > 0.0:
        above = wp.max(height - side.ground, 0.0)
        return side.velocity * (side.friction_velocity / VON_KARMAN * wp.log((above + side.roughness) / side.roughness))
    return side.velocity


@wp.func
def boundary_turbulence(side: Side, height: float) -> wp.vec2:
    """(k, epsilon) given on an inlet at `height`; u*^2 / sqrt(C_mu), u*^3 / (kappa (y + z0)) for a logarithmic one."""
    if side.friction_velocity > 0.0:
        above = wp.max(height - side.ground, 0.0)
        u = side.friction_velocity
        return wp.vec2(u * u / 0.3, u * u * u / (VON_KARMAN * (above + side.roughness)))
    return wp.vec2(side.k, side.epsilon)


@wp.func
def red_black_cell(first_plane: int, i: int, j: int, k: int, color: int, cells: wp.vec3i) -> wp.vec3i:
    """The cell of one colour of the checkerboard that a thread works on; the axis halved is z, or y where z is one cell."""
    x = first_plane + i
    if cells[2] > 1:
        return wp.vec3i(x, j, 2 * k + ((x + j + color) & 1))
    return wp.vec3i(x, 2 * j + ((x + color) & 1), 0)
