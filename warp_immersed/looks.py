"""How bodies look: meshes to draw them with, and the tint each body wears. Materials are UsdPreviewSurface.

Blender drops the colours of instances, so a tint is a prototype of its own: a kind with T colours makes T prototypes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warp_immersed.mesh_normals import vertex_normals
from warp_immersed.shape import RGB, Shape

# Sheets thicker than this, relative to their smaller semi-axis, are drawn with their thickness: coins, not leaves.
DRAWN_THICKNESS = 0.04


@dataclass(frozen=True, eq=False)
class Prototype:
    """How one kind of body looks: name; count of bodies; vertices (V, 3) [m] in the principal frame; faces (F, 3); uv
    (V, 2); colors, linear RGB, one or several; roughness and metallic of its UsdPreviewSurface; whether it is a sheet, seen
    from both sides."""

    name: str
    count: int
    vertices: NDArray[Any]
    faces: NDArray[Any]
    uv: NDArray[Any]
    colors: tuple[RGB, ...]
    roughness: float
    metallic: float
    is_sheet: bool

    @staticmethod
    def from_shape(name: str, count: int, shape: Shape) -> "Prototype":
        """The look of a shape; a mesh without texture coordinates gets its projection along z."""
        vertices = np.asarray(shape.mesh.vertices)
        faces = np.asarray(shape.mesh.faces, dtype=np.int32)
        uv = getattr(shape.mesh.visual, "uv", None)
        if uv is None or len(uv) != len(vertices):
            plane = vertices[:, :2]
            uv = (plane - plane.min(axis=0)) / max(float(np.ptp(plane, axis=0).max()), 1e-12)
        thickness, is_sheet = shape.thickness, shape.is_sheet
        if thickness is not None and thickness > DRAWN_THICKNESS * shape.semi_axes[1]:
            vertices, faces, uv = thickened(vertices, faces, np.asarray(uv), thickness)
            is_sheet = False
        return Prototype(
            name=name,
            count=count,
            vertices=vertices.astype(np.float32),
            faces=faces,
            uv=np.asarray(uv, dtype=np.float32),
            colors=shape.colors,
            roughness=shape.roughness,
            metallic=shape.metallic,
            is_sheet=is_sheet,
        )

    @property
    def radius(self) -> float:
        """Largest distance [m] of a vertex from the centre of mass."""
        return float(np.linalg.norm(self.vertices, axis=1).max())


def looks(prototypes: Sequence[Prototype]) -> tuple[Prototype, ...]:
    """The prototypes with their several colours as one of its own each: maple_0, maple_1, ..."""
    return tuple(
        replace(prototype, name=prototype.name if len(prototype.colors) == 1 else f"{prototype.name}_{i}", colors=(color,))
        for prototype in prototypes
        for i, color in enumerate(prototype.colors)
    )


def look_indices(prototypes: Sequence[Prototype]) -> NDArray[np.int32]:
    """Which of `looks` each body (N,) wears: its own kind in one of its colours, by a hash of its number."""
    first_look, indices = 0, []
    first_body = 0
    for prototype in prototypes:
        bodies = np.arange(first_body, first_body + prototype.count, dtype=np.uint32)
        indices.append(first_look + (scrambled(bodies) % np.uint32(len(prototype.colors))).astype(np.int32))
        first_look += len(prototype.colors)
        first_body += prototype.count
    return np.concatenate(indices).astype(np.int32)


def scrambled(numbers: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Well mixed 32-bit words, one a number (the finalizer of MurmurHash3)."""
    word = numbers ^ (numbers >> np.uint32(16))
    word = word * np.uint32(0x85EBCA6B)
    word ^= word >> np.uint32(13)
    word = word * np.uint32(0xC2B2AE35)
    return word ^ (word >> np.uint32(16))


def thickened(
    vertices: NDArray[Any], faces: NDArray[Any], uv: NDArray[Any], thickness: float
) -> tuple[NDArray[Any], NDArray[np.int32], NDArray[Any]]:
    """A sheet as a closed solid: both faces, half a thickness [m] to either side, and a rim with vertices of its own."""
    offset = vertex_normals(vertices, faces) * (thickness / 2.0)
    top, bottom = vertices + offset, vertices - offset
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    pairs, counts = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    free = {tuple(pair) for pair in pairs[counts == 1].tolist()}
    rim = np.array([edge for edge in edges.tolist() if tuple(sorted(edge)) in free]).reshape(-1, 2)
    count, corner = len(vertices), 2 * len(vertices) + 4 * np.arange(len(rim))
    walls = np.stack([top[rim[:, 0]], bottom[rim[:, 0]], bottom[rim[:, 1]], top[rim[:, 1]]], axis=1).reshape(-1, 3)
    wall_faces = np.concatenate(
        [np.stack([corner, corner + 1, corner + 2], axis=1), np.stack([corner, corner + 2, corner + 3], axis=1)]
    )
    solid = np.concatenate([faces, faces[:, ::-1] + count, wall_faces])
    return (
        np.concatenate([top, bottom, walls]),
        solid.astype(np.int32),
        np.concatenate([uv, uv, np.repeat(uv[rim[:, 0]], 4, axis=0)]),
    )
