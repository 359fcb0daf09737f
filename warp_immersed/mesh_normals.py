"""Vertex normals of triangle meshes of any size."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


def vertex_normals(vertices: NDArray[Any], faces: NDArray[Any]) -> NDArray[np.float64]:
    """Area-weighted unit normals (V, 3) of a mesh with vertices (V, 3) and faces (F, 3); z where there is no face."""
    size = max(float(np.ptp(vertices, axis=0).max()), 1e-300)
    corners = vertices[faces].astype(np.float64) / size
    face_normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros((len(vertices), 3))
    for corner in range(3):
        np.add.at(normals, faces[:, corner], face_normals)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(lengths > 0.0, normals / np.maximum(lengths, 1e-300), [0.0, 0.0, 1.0])
