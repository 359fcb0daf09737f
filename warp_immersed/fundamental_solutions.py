"""The method of fundamental solutions for added mass, as a baseline: where it fails, and how.

Point sources stand one offset inside the centroid of each face; their strengths make the normal velocity right at the
centroids; K = -rho sum over faces of potential times normal velocity times area. Good for thick bodies whose faces are small
against their thickness, with the sources about one edge deep; wrong otherwise (see `failure_table`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warp_immersed.exact_tensors import ellipsoid_tensor

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

TABLE_COLUMNS = (
    "aspect_ratio",
    "faces",
    "offset_in_edges",
    "thickness_in_edges",
    "sources_outside",
    "condition_number",
    "error_broadside_percent",
    "error_edgewise_percent",
    "error_flap_percent",
)


@dataclass(frozen=True)
class FundamentalSolution:
    """matrix: (6, 6) for a fluid of 1 kg/m^3 about the origin, linear then angular, as the method gives it, not symmetrised;
    condition: 2-norm condition number of the system; sources: (F, 3) [m]."""

    matrix: Array
    condition: float
    sources: Array


def fundamental_solution_tensor(vertices: Array, faces: Indices, offset: float = 1.0) -> FundamentalSolution:
    """Added mass of a closed outward mesh, vertices (V, 3) [m], with sources `offset` mean edges inside its faces."""
    corners = np.asarray(vertices, dtype=np.float64)[faces]
    centroids = corners.mean(axis=1)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled = np.linalg.norm(normals, axis=1)
    normals /= doubled[:, None]
    edge = np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2).mean()
    sources = centroids - offset * edge * normals
    gap = centroids[:, None] - sources[None]
    distance = np.linalg.norm(gap, axis=2)
    velocity = -np.einsum("fsi,fi->fs", gap, normals) / distance**3  # normal derivative of 1/r
    wanted = np.concatenate([normals, np.cross(centroids, normals)], axis=1)
    left, scales, right = np.linalg.svd(velocity)
    strengths = right.T @ ((left.T @ wanted) / scales[:, None])
    potential = (strengths.T @ (1.0 / distance).T).T
    matrix = -(potential * (doubled / 2.0)[:, None]).T @ wanted
    return FundamentalSolution(matrix, float(scales[0] / scales[-1]), sources)


def failure_table(
    aspect_ratios: Sequence[float] = (1, 2, 5, 10, 50, 200, 400),
    subdivisions: Sequence[int] = (2, 3),
    offsets: Sequence[float] = (0.25, 0.5, 1.0, 2.0),
) -> list[dict[str, float]]:
    """Errors of the method on oblate spheroids of radius 1, as rows with TABLE_COLUMNS for a CSV file.

    subdivisions: of an icosahedron, 2 for 320 and 3 for 1280 faces (4 takes minutes). Meshes are scaled to the exact volume,
    so errors are those of the method. Errors are relative to Lamb's ellipsoid; flap is rotation about a diameter (nan for
    the sphere, which has none).
    """
    from trimesh.creation import icosphere

    rows = []
    for aspect_ratio in aspect_ratios:
        for subdivision in subdivisions:
            ball = icosphere(subdivision)
            scale = (4.0 / 3.0 * np.pi / ball.volume) ** (1.0 / 3.0)
            vertices = scale * np.asarray(ball.vertices) * np.array([1.0, 1.0, 1.0 / aspect_ratio])
            faces = np.asarray(ball.faces, dtype=np.int64)
            corners = vertices[faces]
            edge = np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2).mean()
            exact = np.diag(ellipsoid_tensor((1.0, 1.0, 1.0 / aspect_ratio), 1.0))
            for offset in offsets:
                found = fundamental_solution_tensor(vertices, faces, offset)
                with np.errstate(divide="ignore", invalid="ignore"):
                    error = np.where(exact > 0.0, 100.0 * (np.diag(found.matrix) / exact - 1.0), np.nan)
                outside = (found.sources / np.array([1.0, 1.0, 1.0 / aspect_ratio])) ** 2
                values = (aspect_ratio, len(faces), offset, 2.0 / aspect_ratio / edge, int((outside.sum(axis=1) > 1.0).sum()))
                errors = (error[2], error[0], error[3])
                row = dict(zip(TABLE_COLUMNS, (*values, found.condition, *errors), strict=True))
                rows.append({name: float(value) for name, value in row.items()})
    return rows
