"""The baked flow at a point, for any kernel that moves bodies: trilinear, linear in time, solid cells not mixed in.

    sample = sample_flow(field, position, time)          # velocity [m/s], k [m^2/s^2], epsilon [m^2/s^3]
    gradient = sample_gradient(field, position, time)    # gradient[i, j] = d velocity_i / d x_j [1/s]

A field without cells (steps = 0) is the far field alone: uniform, or a logarithmic wind profile.
"""

import warp as wp

from warp_immersed.kernels.grid import VON_KARMAN, Side, boundary_turbulence, boundary_velocity

wp.set_module_options({"enable_backward": False})

# velocity, k, epsilon, 1 in fluid and 0 in solid, two unused: one aligned load a corner.
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


@wp.func
def axis_cell(x: float, n: int) -> int:
    """Lower of the two cells that a coordinate (in cells, from the first centre) lies between."""
    return wp.clamp(int(wp.floor(x)), 0, wp.max(n - 2, 0))


@wp.func
def corner_index(cells: wp.vec3i, i: int, j: int, k: int, corner: int) -> int:
    """Flat index of corner 0..7 of the box of cell centres that starts at (i, j, k)."""
    x = wp.min(i + (corner & 1), cells[0] - 1)
    y = wp.min(j + ((corner >> 1) & 1), cells[1] - 1)
    z = wp.min(k + (corner >> 2), cells[2] - 1)
    return (x * cells[1] + y) * cells[2] + z


@wp.func
def corner_weight(f: wp.vec3, corner: int) -> float:
    """Trilinear weight of corner 0..7."""
    x = wp.where((corner & 1) == 1, f[0], 1.0 - f[0])
    y = wp.where((corner & 2) == 2, f[1], 1.0 - f[1])
    z = wp.where(corner > 3, f[2], 1.0 - f[2])
    return x * y * z


@wp.func
def mix_cells(field: FlowField, step: int, i: int, j: int, k: int, f: wp.vec3) -> CellState:
    """Weighted mean over the fluid corners, [5] the weight they have together; k and epsilon stay as stored if all are solid."""
    total = CellState()
    for corner in range(8):
        total += corner_weight(f, corner) * field.states[step, corner_index(field.cells, i, j, k, corner)]
    if total[5] > 0.0:
        return total / total[5]
    return total


@wp.func
def far_flow(field: FlowField, position: wp.vec3) -> FlowSample:
    """The flow away from the grid."""
    sample = FlowSample()
    t = boundary_turbulence(field.far, position[1])
    sample.velocity = boundary_velocity(field.far, position[1])
    sample.k = t[0]
    sample.epsilon = t[1]
    return sample


@wp.func
def time_fraction(field: FlowField, time: float) -> float:
    """Time in snapshots from the first one, held at both ends."""
    return wp.clamp((time - field.start) * field.rate, 0.0, float(field.steps - 1))


@wp.func
def sample_flow(field: FlowField, position: wp.vec3, time: float) -> FlowSample:
    """Mean flow and turbulence at a position [m] and time [s]; at rest with k = epsilon = 0 deep inside an obstacle."""
    if field.steps == 0:
        return far_flow(field, position)
    x = wp.cw_mul(position - field.origin, field.inverse)
    n = field.cells
    i = axis_cell(x[0], n[0])
    j = axis_cell(x[1], n[1])
    k = axis_cell(x[2], n[2])
    f = wp.vec3(wp.clamp(x[0] - float(i), 0.0, 1.0), wp.clamp(x[1] - float(j), 0.0, 1.0), wp.clamp(x[2] - float(k), 0.0, 1.0))
    state = CellState()
    if field.steps == 1:
        state = mix_cells(field, 0, i, j, k, f)
    else:
        t = time_fraction(field, time)
        first = wp.min(int(t), field.steps - 2)
        a = t - float(first)
        state = (1.0 - a) * mix_cells(field, first, i, j, k, f) + a * mix_cells(field, first + 1, i, j, k, f)
    sample = FlowSample()
    sample.velocity = wp.vec3(state[0], state[1], state[2])
    sample.k = state[3]
    sample.epsilon = state[4]
    outside = distance_outside(field, x)
    if outside > 0.0:
        far = far_flow(field, position)
        a = wp.min(outside / field.fade, 1.0)
        a = a * a * (3.0 - 2.0 * a)
        sample.velocity = (1.0 - a) * sample.velocity + a * far.velocity
        sample.k = (1.0 - a) * sample.k + a * far.k
        sample.epsilon = (1.0 - a) * sample.epsilon + a * far.epsilon
    return sample


@wp.func
def distance_outside(field: FlowField, x: wp.vec3) -> float:
    """Distance [m] from the grid's box, 0 inside; x in cells from the first centre. An axis of one cell has no end."""
    total = float(0.0)
    for axis in range(3):
        n = field.cells[axis]
        if n > 1:
            d = wp.max(wp.max(-0.5 - x[axis], x[axis] - float(n) + 0.5), 0.0) / field.inverse[axis]
            total += d * d
    return wp.sqrt(total)


@wp.func
def gradient_of_step(field: FlowField, step: int, i: int, j: int, k: int, f: wp.vec3, mean: CellState) -> wp.mat33:
    """Derivative of the trilinear interpolation with solid corners held at the mean of the fluid ones."""
    gradient = wp.mat33()
    center = wp.vec3(mean[0], mean[1], mean[2])
    for corner in range(8):
        state = field.states[step, corner_index(field.cells, i, j, k, corner)]
        if state[5] > 0.0:
            x = wp.where((corner & 1) == 1, f[0], 1.0 - f[0])
            y = wp.where((corner & 2) == 2, f[1], 1.0 - f[1])
            z = wp.where(corner > 3, f[2], 1.0 - f[2])
            slope = wp.vec3(
                wp.where((corner & 1) == 1, 1.0, -1.0) * y * z * field.inverse[0],
                wp.where((corner & 2) == 2, 1.0, -1.0) * x * z * field.inverse[1],
                wp.where(corner > 3, 1.0, -1.0) * x * y * field.inverse[2],
            )
            gradient += wp.outer(wp.vec3(state[0], state[1], state[2]) - center, slope)
    return gradient


@wp.func
def far_gradient(field: FlowField, position: wp.vec3) -> wp.mat33:
    """Gradient of the far field: the shear of the logarithmic profile, or zero."""
    gradient = wp.mat33()
    above = position[1] - field.far.ground
    if field.far.friction_velocity > 0.0 and above > 0.0:
        rate = field.far.friction_velocity / (VON_KARMAN * (above + field.far.roughness))
        gradient = wp.outer(field.far.velocity, wp.vec3(0.0, rate, 0.0))
    return gradient


@wp.func
def sample_gradient(field: FlowField, position: wp.vec3, time: float) -> wp.mat33:
    """Gradient of the mean velocity [1/s], [i, j] = d u_i / d x_j; that of the far field outside the grid."""
    if field.steps == 0:
        return far_gradient(field, position)
    x = wp.cw_mul(position - field.origin, field.inverse)
    if distance_outside(field, x) > 0.0:
        return far_gradient(field, position)
    n = field.cells
    i = axis_cell(x[0], n[0])
    j = axis_cell(x[1], n[1])
    k = axis_cell(x[2], n[2])
    f = wp.vec3(wp.clamp(x[0] - float(i), 0.0, 1.0), wp.clamp(x[1] - float(j), 0.0, 1.0), wp.clamp(x[2] - float(k), 0.0, 1.0))
    step = int(0)
    if field.steps > 1:
        step = int(time_fraction(field, time) + 0.5)
    return gradient_of_step(field, step, i, j, k, f, mix_cells(field, step, i, j, k, f))


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
def sample_gradients(
    field: FlowField, time: float, positions: wp.array(dtype=wp.vec3), gradient_out: wp.array(dtype=wp.mat33)
):
    """Gradient of the mean velocity at many positions."""
    i = wp.tid()
    gradient_out[i] = sample_gradient(field, positions[i], time)
