"""The affine map that makes a long, flat or thin body about as long as wide as deep, in which meshes for it are made.

Flow varies slowly along the long axes of a body, and round a thin rim it varies as fast as the rim is thin. Faces that are well
shaped in the stretched body are therefore the right ones for the body itself: the image of a good mesh of a sphere is a good
mesh of a thin lens, and the image of rings on a disk a good mesh of a long ellipse.
"""

import numpy as np
from numpy.typing import NDArray

from warp_immersed.mass_properties import closed_integrals

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

STRETCH_LIMIT = 1000.0


def equalizing_stretch(vertices: Array, faces: Indices, closed: bool) -> Array:
    """Symmetric map (3, 3) for row vectors that equalises the extents of a surface, whose size becomes one.

    vertices: (V, 3) about the middle; faces: (F, 3). All three axes of a solid become equal, by the moments of its volume; a
    sheet, whose depth is its camber, is only made shorter until it is as long as wide.
    """
    values, axes = np.linalg.eigh(volume_spread(vertices[faces]) if closed else area_spread(vertices[faces]))
    extents = np.sqrt(np.maximum(values, 0.0))  # ascending
    if closed:
        factors = extents[2] / np.maximum(extents, extents[2] / STRETCH_LIMIT)
    else:
        factors = np.array([1.0, 1.0, extents[1] / extents[2] if extents[1] > extents[2] / STRETCH_LIMIT else 1.0])
    stretch = (axes * factors) @ axes.T
    return stretch / np.abs(vertices @ stretch).max()


def volume_spread(corners: Array) -> Array:
    """Covariance (3, 3) of the points inside closed triangles (F, 3, 3)."""
    integrals = closed_integrals(corners)
    return integrals.second_moment / integrals.volume


def area_spread(corners: Array) -> Array:
    """Covariance (3, 3) of the points on triangles (F, 3, 3)."""
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    weights = areas / areas.sum()
    arms = corners - np.einsum("f,fki->i", weights, corners) / 3.0
    total = arms.sum(axis=1)
    return (np.einsum("f,fki,fkj->ij", weights, arms, arms) + np.einsum("f,fi,fj->ij", weights, total, total)) / 12.0
