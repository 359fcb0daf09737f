"""Boundary elements on flat triangles: the integrals of 1/r that the added-mass solver is made of.

Every kernel works in float64: across a body a few hundred times as wide as thick float32 would leave three digits. Rows of the
output belong to one thread each, and sums run in a fixed order, so results do not depend on how a launch is sliced.

With n the unit normal, h the height of the point x above the plane, and for each edge i of length l_i: m_i its outward normal
in the plane, d_i the distance from the foot of x to it (positive inside) and L_i = int dl / r along it,
    int dA / r = sum_i d_i L_i - h Omega,
    int lambda d(1/r)/dn dA = lambda(foot) Omega - h sum_i (grad lambda . m_i) L_i   for linear lambda,
where Omega is the solid angle with the sign of h (Wilton et al., IEEE Trans. Antennas Propag. 32, 1984; van Oosterom and
Strackee, IEEE Trans. Biomed. Eng. 30, 1983, for Omega).
"""

from typing import Any

import warp as wp

wp.set_module_options({"enable_backward": False})

vec6d = wp.types.vector(length=6, dtype=wp.float64)


@wp.func
def line_potential(a: Any, b: Any, length: Any):
    """int dl / r along a segment; a, b: distances to its ends. Free of cancellation; finite on the segment itself."""
    total = a + b
    # On the segment the logarithm is infinite, but it is always multiplied by a distance that vanishes there.
    gap = wp.max(total - length, type(total)(1.0e-7) * type(total)(1.0e-7) * total)
    return wp.log((total + length) / gap)


@wp.func
def solid_angle(height: Any, doubled_area: Any, p: Any, q: Any, r: Any, a: Any, b: Any, c: Any):
    """Solid angle of a triangle with the sign of height; p, q, r: corners seen from the point, at distances a, b, c."""
    below = a * b * c + wp.dot(p, q) * c + wp.dot(q, r) * a + wp.dot(r, p) * b
    return type(height)(2.0) * wp.atan2(doubled_area * height, below)


@wp.func
def source_potential(x: Any, v0: Any, v1: Any, v2: Any, n: Any, area: Any):
    """int dA / |x - y| over the triangle v0 v1 v2 with unit normal n and area [length]."""
    p = v0 - x
    q = v1 - x
    r = v2 - x
    a = wp.length(p)
    b = wp.length(q)
    c = wp.length(r)
    e0 = v1 - v0
    e1 = v2 - v1
    e2 = v0 - v2
    l0 = wp.length(e0)
    l1 = wp.length(e1)
    l2 = wp.length(e2)
    height = -wp.dot(p, n)
    # (e x n) / l is the outward normal in the plane, so dot(p, e x n) / l is the distance d to the edge.
    total = wp.dot(p, wp.cross(e0, n)) / l0 * line_potential(a, b, l0)
    total += wp.dot(q, wp.cross(e1, n)) / l1 * line_potential(b, c, l1)
    total += wp.dot(r, wp.cross(e2, n)) / l2 * line_potential(c, a, l2)
    return total - height * solid_angle(height, type(area)(2.0) * area, p, q, r, a, b, c)


@wp.func
def mean_source_potential(u0: Any, u1: Any, u2: Any, v0: Any, v1: Any, v2: Any, n: Any, area: Any):
    """Mean over the triangle u of the potential of the triangle v, by a three-point rule of degree 2."""
    near = type(area)(2.0) / type(area)(3.0)
    far = type(area)(1.0) / type(area)(6.0)
    total = source_potential(near * u0 + far * u1 + far * u2, v0, v1, v2, n, area)
    total += source_potential(far * u0 + near * u1 + far * u2, v0, v1, v2, n, area)
    total += source_potential(far * u0 + far * u1 + near * u2, v0, v1, v2, n, area)
    return total / type(area)(3.0)


@wp.kernel
def pair_potentials(
    first_row: int,
    lanes: int,
    near_factor: Any,
    v0: wp.array(dtype=Any),
    v1: wp.array(dtype=Any),
    v2: wp.array(dtype=Any),
    centroid: wp.array(dtype=Any),
    normal: wp.array(dtype=Any),
    area: wp.array(dtype=Any),
    longest_edge: wp.array(dtype=Any),
    second_moment: wp.array(dtype=Any),
    potentials_out: wp.array2d(dtype=Any),
):
    """potentials_out[f, g] = int_f int_g 1/r [length^3], both halves; launch dim (rows, lanes).

    near_factor: pairs closer than this many longest edges take the analytic inner integral; others 1/R with the
    second moments (3, 3) of both triangles about their centroids, divided by their areas.
    """
    row, lane = wp.tid()
    f = first_row + row
    c = centroid[f]
    half = area.dtype(0.5)
    g = f + lane
    while g < centroid.shape[0]:
        offset = centroid[g] - c
        r2 = wp.dot(offset, offset)
        reach = near_factor * wp.max(longest_edge[f], longest_edge[g])
        value = r2
        if r2 < reach * reach:
            from_g = mean_source_potential(v0[f], v1[f], v2[f], v0[g], v1[g], v2[g], normal[g], area[g])
            from_f = mean_source_potential(v0[g], v1[g], v2[g], v0[f], v1[f], v2[f], normal[f], area[f])
            value = half * (area[f] * from_g + area[g] * from_f)
        else:
            moment = second_moment[f] + second_moment[g]
            inverse = area.dtype(1.0) / r2
            stretch = area.dtype(3.0) * wp.dot(offset, moment * offset) * inverse - wp.trace(moment)
            value = area[f] * area[g] * wp.sqrt(inverse) * (area.dtype(1.0) + half * stretch * inverse)
        potentials_out[f, g] = value
        potentials_out[g, f] = value
        g += lanes


@wp.kernel
def exterior_trace(
    first_row: int,
    near_factor: Any,
    v0: wp.array(dtype=Any),
    v1: wp.array(dtype=Any),
    v2: wp.array(dtype=Any),
    centroid: wp.array(dtype=Any),
    normal: wp.array(dtype=Any),
    area: wp.array(dtype=Any),
    longest_edge: wp.array(dtype=Any),
    second_moment: wp.array(dtype=Any),
    jump0: wp.array(dtype=Any),
    jump1: wp.array(dtype=Any),
    jump2: wp.array(dtype=Any),
    potential_out: wp.array2d(dtype=Any),
):
    """potential_out[f, p] (6): the potentials outside a closed surface at point p of face f; launch dim (rows, 3).

    jump0, jump1, jump2: (F,) 6-vectors, the jumps of the six potentials at the corners of each face. The constant is taken out
    with the solid angle of the whole surface, -2 pi from a point on it: phi(x) = int (mu(y) - mu(x)) d(1/r)/dn dA / 4 pi.
    """
    row, point = wp.tid()
    f = first_row + row
    near = area.dtype(2.0) / area.dtype(3.0)
    w0 = area.dtype(1.0) / area.dtype(6.0)
    w1 = w0
    w2 = w0
    if point == 0:
        w0 = near
    elif point == 1:
        w1 = near
    else:
        w2 = near
    x = w0 * v0[f] + w1 * v1[f] + w2 * v2[f]
    total = jump0[f] * area.dtype(0.0)
    constant = area[f] * area.dtype(0.0)
    for g in range(centroid.shape[0]):
        if g != f:
            n = normal[g]
            offset = x - centroid[g]
            r2 = wp.dot(offset, offset)
            reach = near_factor * longest_edge[g]
            a0 = r2
            a1 = r2
            a2 = r2
            if r2 < reach * reach:
                p0 = v0[g] - x
                p1 = v1[g] - x
                p2 = v2[g] - x
                r0 = wp.length(p0)
                r1 = wp.length(p1)
                r2_ = wp.length(p2)
                m0 = wp.cross(p2 - p1, n)  # outward normals times lengths, of the edges opposite to the corners
                m1 = wp.cross(p0 - p2, n)
                m2 = wp.cross(p1 - p0, n)
                l0 = wp.length(m0)
                l1 = wp.length(m1)
                l2 = wp.length(m2)
                height = -wp.dot(p0, n)
                doubled_area = area.dtype(2.0) * area[g]
                omega = solid_angle(height, doubled_area, p0, p1, p2, r0, r1, r2_)
                along = m0 * (line_potential(r1, r2_, l0) / l0)
                along += m1 * (line_potential(r2_, r0, l1) / l1)
                along += m2 * (line_potential(r0, r1, l2) / l2)
                a0 = (wp.dot(p1, m0) * omega + height * wp.dot(m0, along)) / doubled_area
                a1 = (wp.dot(p2, m1) * omega + height * wp.dot(m1, along)) / doubled_area
                a2 = (wp.dot(p0, m2) * omega + height * wp.dot(m2, along)) / doubled_area
            else:
                moment = second_moment[g]
                inverse = area.dtype(1.0) / r2
                spread = area.dtype(7.5) * wp.dot(offset, moment * offset) * inverse - area.dtype(1.5) * wp.trace(moment)
                strength = area[g] * wp.dot(n, offset) * inverse * wp.sqrt(inverse)
                even = (area.dtype(1.0) + spread * inverse) / area.dtype(3.0)
                slope = area.dtype(0.25) * inverse
                c = centroid[g]
                a0 = strength * (even + slope * wp.dot(v0[g] - c, offset))
                a1 = strength * (even + slope * wp.dot(v1[g] - c, offset))
                a2 = strength * (even + slope * wp.dot(v2[g] - c, offset))
            total += a0 * jump0[g] + a1 * jump1[g] + a2 * jump2[g]
            constant += a0 + a1 + a2
    here = w0 * jump0[f] + w1 * jump1[f] + w2 * jump2[f]
    potential_out[f, point] = (total - constant * here) * area.dtype(0.07957747154594767)


_VECTORS, _SCALARS = wp.array(dtype=wp.vec3d), wp.array(dtype=wp.float64)
_FACES = [_VECTORS] * 5 + [_SCALARS] * 2 + [wp.array(dtype=wp.mat33d)]
wp.overload(pair_potentials, [int, int, wp.float64, *_FACES, wp.array2d(dtype=wp.float64)])
wp.overload(exterior_trace, [int, wp.float64, *_FACES, *[wp.array(dtype=vec6d)] * 3, wp.array2d(dtype=vec6d)])
