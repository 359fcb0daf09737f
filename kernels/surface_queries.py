"""Questions to a triangle mesh held by Warp: the nearest point on it, and where it passes through itself."""

import warp as wp

wp.set_module_options({"enable_backward": False})


@wp.kernel
def nearest_points(
    mesh: wp.uint64,
    points: wp.array(dtype=wp.vec3f),
    face_out: wp.array(dtype=int),
    weights_out: wp.array(dtype=wp.vec3f),
):
    """Face nearest to each point and the barycentric weights of the nearest point on it; the mesh has about unit size."""
    i = wp.tid()
    query = wp.mesh_query_point_no_sign(mesh, points[i], 10.0)
    face_out[i] = query.face
    weights_out[i] = wp.vec3f(query.u, query.v, 1.0 - query.u - query.v)


@wp.kernel
def ray_hits(mesh: wp.uint64, origin: wp.vec3f, directions: wp.array(dtype=wp.vec3f), distance_out: wp.array(dtype=float)):
    """Distance at which each ray, of unit direction, from one origin meets the mesh first; 0 if it does not."""
    i = wp.tid()
    query = wp.mesh_query_ray(mesh, origin, directions[i], 10.0)
    distance_out[i] = wp.where(query.result, query.t, 0.0)


@wp.func
def segment_crosses(a: wp.vec3d, b: wp.vec3d, p: wp.vec3d, q: wp.vec3d, r: wp.vec3d, margin: wp.float64):
    """Whether the segment a b passes through the inside of the triangle p q r, `margin` (a fraction) away from all borders."""
    n = wp.cross(q - p, r - p)
    at_a = wp.dot(a - p, n)
    at_b = wp.dot(b - p, n)
    crosses = bool(False)
    if at_a * at_b < wp.float64(0.0):
        t = at_a / (at_a - at_b)
        x = a + t * (b - a)
        n2 = wp.dot(n, n)
        u = wp.dot(wp.cross(q - p, x - p), n) / n2
        v = wp.dot(wp.cross(r - q, x - q), n) / n2
        w = wp.dot(wp.cross(p - r, x - r), n) / n2
        crosses = t > margin and t < wp.float64(1.0) - margin and u > margin and v > margin and w > margin
    return crosses


@wp.func
def lies_on(x: wp.vec3d, p: wp.vec3d, q: wp.vec3d, r: wp.vec3d, gap: wp.float64):
    """Whether x lies over the inside of the triangle p q r, closer than gap."""
    n = wp.cross(q - p, r - p)
    n2 = wp.dot(n, n)
    small = wp.float64(1.0e-6)
    u = wp.dot(wp.cross(q - p, x - p), n) / n2
    v = wp.dot(wp.cross(r - q, x - q), n) / n2
    w = wp.dot(wp.cross(p - r, x - r), n) / n2
    height = wp.dot(x - p, n)
    return u > small and v > small and w > small and height * height < gap * gap * n2


@wp.kernel
def self_contacts(
    mesh: wp.uint64,
    vertices: wp.array(dtype=wp.vec3d),
    faces: wp.array2d(dtype=int),
    gap: wp.float64,
    other_out: wp.array(dtype=int),
    kind_out: wp.array(dtype=int),
):
    """For each face another one that it crosses (kind 1) or lies on, closer than gap (kind 2); kind 0 if there is none."""
    f = wp.tid()
    margin = wp.float64(1.0e-6)
    i0 = faces[f, 0]
    i1 = faces[f, 1]
    i2 = faces[f, 2]
    a = vertices[i0]
    b = vertices[i1]
    c = vertices[i2]
    middle = (a + b + c) / wp.float64(3.0)
    pad = wp.vec3d(gap, gap, gap) + wp.vec3d(wp.float64(1.0e-6), wp.float64(1.0e-6), wp.float64(1.0e-6))
    lower = wp.min(wp.min(a, b), c) - pad
    upper = wp.max(wp.max(a, b), c) + pad
    query = wp.mesh_query_aabb(mesh, wp.vec3f(lower), wp.vec3f(upper))
    g = int(0)  # noqa: RUF046 (a variable of Warp, not a constant)
    kind_out[f] = 0
    while wp.mesh_query_aabb_next(query, g):
        if g != f and kind_out[f] == 0:
            j0 = faces[g, 0]
            j1 = faces[g, 1]
            j2 = faces[g, 2]
            p = vertices[j0]
            q = vertices[j1]
            r = vertices[j2]
            if lies_on(middle, p, q, r, gap):
                kind_out[f] = 2
                other_out[f] = g
            else:
                crosses = segment_crosses(a, b, p, q, r, margin) or segment_crosses(b, c, p, q, r, margin)
                crosses = crosses or segment_crosses(c, a, p, q, r, margin)
                if crosses:
                    kind_out[f] = 1
                    other_out[f] = g
