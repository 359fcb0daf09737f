"""Which side of which face touches which fluid: the unknowns of the boundary-element method on sheets, creases and solids.

Around an edge the faces that meet there cut the fluid into wedges. The two face sides that bound one wedge see the same fluid,
so their potentials agree at both ends of the edge. At a free rim the only wedge reaches round from one side of the face to the
other, so the jump of potential vanishes there; along a crease of three or more sheets there is one wedge, and one unknown, per
sector. The orientation of the faces need not be consistent.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class FluidSectors:
    """Unknowns of a surface: potentials of fluid sectors at vertices, one sector of each vertex being pinned to zero.

    front, back: (F, 3), unknown on the front (where the normal points) and back of each face corner, -1 if pinned; the jump of
    potential there is front minus back. count: number of unknowns. chambers: (count, C), orthonormal columns that span the jumps
    without flow: a constant potential inside each bounded part of the fluid.
    """

    front: Indices
    back: Indices
    count: int
    chambers: Array


def wedge_links(vertices: Array, faces: Indices) -> tuple[Indices, Indices]:
    """Pairs of face sides that bound one wedge of fluid at an edge, as the corners of those sides.

    Returns two (2 * 3F,) arrays of nodes, node = 2 * (3 * face + corner) + side, side 0 in front and 1 at the back.
    """
    face = np.repeat(np.arange(len(faces)), 3)
    start = np.tile([0, 1, 2], len(faces))
    ends = np.stack([faces.ravel(), faces[:, [1, 2, 0]].ravel()], axis=1)
    forward = ends[:, 0] < ends[:, 1]
    low, high = ends.min(axis=1), ends.max(axis=1)
    axis = vertices[high] - vertices[low]
    edge = low * (len(vertices) + 1) + high
    order = np.argsort(edge, kind="stable")
    first = np.flatnonzero(np.diff(edge[order], prepend=-1))
    members = np.diff(first, append=len(order))
    if members.max() > 2:
        order = np.lexsort((angle_about(axis, vertices[faces.ravel()[3 * face + (start + 2) % 3]] - vertices[low], edge), edge))
    following = np.arange(1, len(order) + 1)
    following[first + members - 1] = first  # the last face about an edge is followed by the first
    this, other = order, order[following]
    # Seen along low -> high, the front of a face that runs forward looks towards growing angles.
    this_side, other_side = np.where(forward[this], 0, 1), np.where(forward[other], 1, 0)
    links = []
    for at_low in (True, False):
        corners = [np.where(forward == at_low, start, (start + 1) % 3)[k] for k in (this, other)]
        links.append([2 * (3 * face[k] + c) + s for k, c, s in zip((this, other), corners, (this_side, other_side), strict=True)])
    return np.concatenate([links[0][0], links[1][0]]), np.concatenate([links[0][1], links[1][1]])


def angle_about(axis: Array, arm: Array, edge: Indices) -> Array:
    """Angle (N,) of each arm (N, 3) about its edge's axis (N, 3), from the first arm of the same edge."""
    axis = axis / np.linalg.norm(axis, axis=1)[:, None]
    arm = arm - np.einsum("ni,ni->n", arm, axis)[:, None] * axis
    _, first, inverse = np.unique(edge, return_index=True, return_inverse=True)
    reference = arm[first][inverse]
    angle = np.arctan2(np.einsum("ni,ni->n", np.cross(reference, arm), axis), np.einsum("ni,ni->n", reference, arm))
    return np.where(angle < -1e-12, angle + 2.0 * np.pi, angle)


def fluid_sectors(vertices: Array, faces: Indices) -> FluidSectors:
    """Number the unknowns of a surface with vertices (V, 3) and faces (F, 3)."""
    nodes = 6 * len(faces)
    this, other = wedge_links(vertices, faces)
    _, sector = connected_components(coo_matrix((np.ones(len(this)), (this, other)), (nodes, nodes)), directed=False)
    front, back = sector[0::2], sector[1::2]
    sectors = int(sector.max()) + 1
    _, around = connected_components(coo_matrix((np.ones(len(front)), (front, back)), (sectors, sectors)), directed=False)
    pinned = np.unique(around, return_index=True)[1]  # the first sector about each vertex (each sheet of it)
    unknown = np.ones(sectors, dtype=bool)
    unknown[pinned] = False
    number = np.where(unknown, np.cumsum(unknown) - 1, -1)
    count = int(unknown.sum())

    # Bounded parts of the fluid: face sides joined across wedges, one part of each piece of surface being the outer one.
    sides = 2 * len(faces)
    as_side = [2 * (k // 6) + k % 2 for k in (this, other)]
    parts, part = connected_components(coo_matrix((np.ones(len(this)), as_side), (sides, sides)), directed=False)
    sector_part = np.empty(sectors, dtype=np.int64)
    sector_part[sector] = part[2 * (np.arange(nodes) // 6) + np.arange(nodes) % 2]
    modes = (sector_part[:, None] == np.arange(parts)).astype(np.float64)
    modes = (modes - modes[pinned[around]])[unknown]
    chambers = np.zeros((count, 0))
    if modes.any():
        left, scale, _ = np.linalg.svd(modes, full_matrices=False)
        chambers = left[:, scale > 1e-9 * scale[0]]
    return FluidSectors(number[front].reshape(-1, 3), number[back].reshape(-1, 3), count, chambers)
