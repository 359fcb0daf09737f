"""The baked flow at a point, for any kernel that moves bodies: trilinear, linear in time, solid cells not mixed in.

    sample = sample_flow(field, position, time)          # velocity [m/s], k [m^2/s^2], epsilon [m^2/s^3]
    slope = sample_slope(field, position, time)          # slope.velocity[i, j] = d velocity_i / d x_j [1/s], ...

A field without cells (steps = 0) is the far field alone: uniform, or a logarithmic wind profile.
"""

import warp as wp

from warp_immersed.kernels.grid import VON_KARMAN, Side, boundary_turbulence, boundary_velocity

wp.set_module_options({"enable_backward": False})

# velocity, k, epsilon, 1 in fluid and 0 in solid, two unused: one load a corner.
CellState = wp.types.vector(length=8, dtype=wp.float32)


@wp.struct
class FlowField:
    """A baked flow on the device.

    states: (steps, nx * ny * nz) cell values, z fastest. steps: snapshots in time (1: steady, 0: far field only).
    cells (3,); origin: centre of cell (0, 0, 0) [m]; inverse: 1 / cell size [1/m]; start [s] and rate [1/s] of the snapshots.
    far: what is met away from the grid, reached over `fade` [m] outside it.
    """

    states: wp.array2d(dtype=CellState)
    steps: int
    cells: wp.vec3i
    origin: wp.vec3
    inverse: wp.vec3
    start: float
    rate: float
    far: Side
    fade: float


@wp.struct
class FlowSample:
    """Mean velocity [m/s], k [m^2/s^2] and epsilon [m^2/s^3] at a point."""

    velocity: wp.vec3
    k: float
    epsilon: float


@wp.struct
class FlowSlope:
    """Gradients at a point: of the mean velocity, [i, j] = d u_i / d x_j [1/s], of k [m/s^2] and of epsilon [m/s^3]."""

    velocity: wp.mat33
    k: wp.vec3
    epsilon: wp.vec3


@wp.func
def axis_cell(x: float, n: int) -> int:
    """Lower of the two cells that a coordinate (in cells, from the first centre) lies between."""
    return wp.clamp(int(wp.floor(x)), 0, wp.max(n - 2, 0))


@wp.func
def corner_strides(cells: wp.vec3i, cell: wp.vec3i) -> wp.vec3i:
    """Steps in the flat index to the next cell along x, y, z; zero at the upper end."""
    return wp.vec3i(
        wp.where(cell[0] + 1 < cells[0], cells[1] * cells[2], 0),
        wp.where(cell[1] + 1 < cells[1], cells[2], 0),
        wp.where(cell[2] + 1 < cells[2], 1, 0),
    )


@wp.func
def mix_cells(field: FlowField, step: int, cell: wp.vec3i, f: wp.vec3) -> CellState:
    """Trilinear mean over the fluid corners of the box of cell centres at `cell`; zero if all are solid.

    Solid cells are stored as zeros with [5] = 0, so the sum over all corners over its [5] is the mean over the fluid ones.
    """
    d = corner_strides(field.cells, cell)
    a = (cell[0] * field.cells[1] + cell[1]) * field.cells[2] + cell[2]
    b = a + d[1]
    near = 1.0 - f[2]
    low = (1.0 - f[1]) * (near * field.states[step, a] + f[2] * field.states[step, a + d[2]])
    low += f[1] * (near * field.states[step, b] + f[2] * field.states[step, b + d[2]])
    a += d[0]
    b += d[0]
    high = (1.0 - f[1]) * (near * field.states[step, a] + f[2] * field.states[step, a + d[2]])
    high += f[1] * (near * field.states[step, b] + f[2] * field.states[step, b + d[2]])
    total = (1.0 - f[0]) * low + f[0] * high
    if total[5] > 0.0:
        return (1.0 / total[5]) * total
    return total


@wp.func
def lower_cell(cells: wp.vec3i, x: wp.vec3) -> wp.vec3i:
    """The lowest of the eight cells whose centres surround a point x (in cells from the first centre)."""
    return wp.vec3i(axis_cell(x[0], cells[0]), axis_cell(x[1], cells[1]), axis_cell(x[2], cells[2]))


@wp.func
def fraction(x: wp.vec3, cell: wp.vec3i) -> wp.vec3:
    """Where a point lies between cell centres, each in 0..1."""
    return wp.vec3(
        wp.clamp(x[0] - float(cell[0]), 0.0, 1.0),
        wp.clamp(x[1] - float(cell[1]), 0.0, 1.0),
        wp.clamp(x[2] - float(cell[2]), 0.0, 1.0),
    )


@wp.func
def far_flow(far: Side, position: wp.vec3) -> FlowSample:
    """The flow away from the grid."""
    sample = FlowSample()
    t = boundary_turbulence(far, position[1])
    sample.velocity = boundary_velocity(far, position[1])
    sample.k = t[0]
    sample.epsilon = t[1]
    return sample


@wp.func
def time_fraction(field: FlowField, time: float) -> float:
    """Time in snapshots from the first one, held at both ends."""
    return wp.clamp((time - field.start) * field.rate, 0.0, float(field.steps - 1))


@wp.func
def first_step(field: FlowField, time: float) -> int:
    """The snapshot before a time."""
    if field.steps == 1:
        return 0
    return wp.min(int(time_fraction(field, time)), field.steps - 2)


@wp.func
def far_share(field: FlowField, x: wp.vec3) -> float:
    """Share of the far field at x (in cells from the first centre): 0 inside the grid, rising smoothly to 1 at `fade` outside."""
    if field.steps == 0:
        return 1.0
    a = wp.min(distance_outside(field.cells, field.inverse, x) / field.fade, 1.0)
    return a * a * (3.0 - 2.0 * a)


@wp.func
def sample_flow(field: FlowField, position: wp.vec3, time: float) -> FlowSample:
    """Mean flow and turbulence at a position [m] and time [s]; at rest with k = epsilon = 0 deep inside an obstacle."""
    x = wp.cw_mul(position - field.origin, field.inverse)
    sample = FlowSample()
    share = far_share(field, x)
    if share < 1.0:
        cell = lower_cell(field.cells, x)
        f = fraction(x, cell)
        first = first_step(field, time)
        later = time_fraction(field, time) - float(first)
        state = CellState()
        for step in range(first, wp.min(first + 2, field.steps)):  # one call, so that it is inlined
            state += wp.where(step == first, 1.0 - later, later) * mix_cells(field, step, cell, f)
        state = (1.0 - share) * state
        sample.velocity = wp.vec3(state[0], state[1], state[2])
        sample.k = state[3]
        sample.epsilon = state[4]
    if share > 0.0:
        far = far_flow(field.far, position)
        sample.velocity += share * far.velocity
        sample.k += share * far.k
        sample.epsilon += share * far.epsilon
    return sample


@wp.func
def beyond(x: float, n: int) -> float:
    """How far a coordinate (in cells from the first centre) lies outside the grid [cells]. An axis of one cell has no end."""
    if n == 1:
        return 0.0
    return wp.max(wp.max(-0.5 - x, x - float(n) + 0.5), 0.0)


@wp.func
def distance_outside(cells: wp.vec3i, inverse: wp.vec3, x: wp.vec3) -> float:
    """Distance [m] from the grid's box, 0 inside; x in cells from the first centre."""
    d = wp.vec3(beyond(x[0], cells[0]), beyond(x[1], cells[1]), beyond(x[2], cells[2]))
    if d[0] + d[1] + d[2] == 0.0:
        return 0.0
    return wp.length(wp.cw_div(d, inverse))


@wp.func
def slope_of_step(field: FlowField, step: int, cell: wp.vec3i, f: wp.vec3, mean: CellState) -> FlowSlope:
    """Derivative of the trilinear interpolation with solid corners held at the mean of the fluid ones."""
    slope = FlowSlope()
    d = corner_strides(field.cells, cell)
    base = (cell[0] * field.cells[1] + cell[1]) * field.cells[2] + cell[2]
    for corner in range(8):
        state = field.states[step, base + (corner & 1) * d[0] + ((corner >> 1) & 1) * d[1] + (corner >> 2) * d[2]]
        if state[5] > 0.0:
            x = wp.where((corner & 1) == 1, f[0], 1.0 - f[0])
            y = wp.where((corner & 2) == 2, f[1], 1.0 - f[1])
            z = wp.where(corner > 3, f[2], 1.0 - f[2])
            along = wp.vec3(
                wp.where((corner & 1) == 1, 1.0, -1.0) * y * z * field.inverse[0],
                wp.where((corner & 2) == 2, 1.0, -1.0) * x * z * field.inverse[1],
                wp.where(corner > 3, 1.0, -1.0) * x * y * field.inverse[2],
            )
            difference = state - mean
            slope.velocity += wp.outer(wp.vec3(difference[0], difference[1], difference[2]), along)
            slope.k += difference[3] * along
            slope.epsilon += difference[4] * along
    return slope


@wp.func
def far_slope(far: Side, position: wp.vec3) -> FlowSlope:
    """Gradients of the far field: those of the logarithmic profile (k constant, epsilon falling with height), or zero."""
    slope = FlowSlope()
    above = position[1] - far.ground
    if far.friction_velocity > 0.0 and above > 0.0:
        rate = 1.0 / (above + far.roughness)
        slope.velocity = wp.outer(far.velocity, wp.vec3(0.0, far.friction_velocity / VON_KARMAN * rate, 0.0))
        slope.epsilon = wp.vec3(0.0, -boundary_turbulence(far, position[1])[1] * rate, 0.0)
    return slope


@wp.func
def sample_slope(field: FlowField, position: wp.vec3, time: float) -> FlowSlope:
    """Gradients of mean flow and turbulence at a position [m] and time [s]; those of the far field outside the grid."""
    if field.steps == 0:
        return far_slope(field.far, position)
    x = wp.cw_mul(position - field.origin, field.inverse)
    if distance_outside(field.cells, field.inverse, x) > 0.0:
        return far_slope(field.far, position)
    cell = lower_cell(field.cells, x)
    f = fraction(x, cell)
    step = first_step(field, time)
    if field.steps > 1 and time_fraction(field, time) - float(step) > 0.5:
        step += 1
    return slope_of_step(field, step, cell, f, mix_cells(field, step, cell, f))


@wp.kernel
def sample_points(
    field: FlowField,
    time: float,
    positions: wp.array(dtype=wp.vec3),
    velocity_out: wp.array(dtype=wp.vec3),
    turbulence_out: wp.array(dtype=wp.vec2),
):
    """Velocity and (k, epsilon) at many positions."""
    i = wp.tid()
    sample = sample_flow(field, positions[i], time)
    velocity_out[i] = sample.velocity
    turbulence_out[i] = wp.vec2(sample.k, sample.epsilon)


@wp.kernel
def sample_gradients(field: FlowField, time: float, positions: wp.array(dtype=wp.vec3), gradient_out: wp.array(dtype=wp.mat33)):
    """Gradient of the mean velocity at many positions."""
    i = wp.tid()
    gradient_out[i] = sample_slope(field, positions[i], time).velocity
