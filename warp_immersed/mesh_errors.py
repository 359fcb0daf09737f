"""How wrong a tensor on one given mesh may be, judged by what its flow leaves unresolved."""

import numpy as np
from numpy.typing import NDArray

from warp_immersed.panel_mesh import Surface
from warp_immersed.remesh import face_normals

Array = NDArray[np.float64]

# Error over the share of kinks: of smooth solids, and of those with sharp edges.
SMOOTH_KINKS, SHARP_KINKS = 0.08, 0.05
FLOOR = 0.3  # of the error, times the number of faces
MINOR = 0.02  # modes with less than this of the largest added mass count as if they had so much


def kink_error(surface: Surface, jumps: Array, diagonal: Array) -> float:
    """Relative error of a solid's tensor by the kinks of its jumps (F, 3, 6) across edges; diagonal: (6,) of the tensor.

    Across an edge the slope of mu should be continuous on a smooth surface, bent or not; h times the square of its jump is the
    usual measure of the error in the energy norm of the hypersingular operator (Carstensen et al., Math. Comp. 70, 2001).
    It is taken in the stretched body, where it hardly depends on flatness; the error of ellipsoids grows with the logarithm.
    """
    vertices, faces = surface.mesh.vertices, surface.mesh.faces
    corners = vertices[faces]
    sides = corners[:, [2, 0, 1]] - corners[:, [1, 2, 0]]  # opposite to each corner
    areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / 2.0
    curls = np.einsum("fki,fkc->fic", sides, jumps) / (2.0 * areas)[:, None, None]
    halves = np.sort(np.stack([faces[:, [1, 2, 0]], faces[:, [2, 0, 1]]], axis=2).reshape(-1, 2), axis=1)
    order = np.lexsort((halves[:, 1], halves[:, 0]))
    one, other = order[0::2], order[1::2]  # a closed surface: each edge twice
    lengths = np.linalg.norm(sides.reshape(-1, 3), axis=1)
    slopes = np.einsum("fki,fic->fkc", sides, curls).reshape(len(lengths), -1) / lengths[:, None]
    kinks = slopes[one] + slopes[other]  # the edge runs the other way in the other face
    patch = areas[one // 3] + areas[other // 3]
    unresolved = (kinks**2).T @ (patch * np.sqrt(patch))
    whole = (areas[:, None] * (curls**2).sum(axis=1)).sum(axis=0)
    share = unresolved / np.maximum(whole, MINOR * whole.max())
    factor = SHARP_KINKS if surface.singular.any() else SMOOTH_KINKS * (0.1 + np.log10(surface.flatness))
    return float(factor * share.max() + FLOOR / len(faces))


def rim_error(surface: Surface) -> float:
    """Relative error of a sheet on a given mesh: the depth of the faces along its rims over the mean half width of the sheet.


    On a uniform disk of radius a and edges h that is twice h / a; measured errors are 0.6 h / a (m) and 1.1 h / a (J).
    """
    mesh = surface.mesh
    halves = np.argwhere(surface.singular[surface.edges.of_face])
    a, b = (mesh.vertices[mesh.faces[halves[:, 0], (halves[:, 1] + k) % 3]] for k in (0, 1))
    lengths = np.linalg.norm(b - a, axis=1)
    areas = np.linalg.norm(face_normals(mesh.vertices, mesh.faces), axis=1) / 2.0
    depth = (2.0 * areas[halves[:, 0]]).sum() / lengths.sum()
    return float(depth * lengths.sum() / areas.sum())
