"""Ground surfaces as triangle meshes over a horizontal grid: from heights, from an image, or rolling hills."""

from math import ceil
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from warp_immersed.errors import InputError

Array = NDArray[np.float64]

# Cells of the hills' grid in one of their lengths: facets then turn by less than a leaf shows.
CELLS_PER_LENGTH = 24
# More cells than this along one side are more than a ground needs, and slow to query.
MOST_CELLS = 1000


def height_field_mesh(heights: Array, center: tuple[float, float], size: tuple[float, float]) -> trimesh.Trimesh:
    """The surface y = heights (X, Z) [m] at equal steps over a rectangle of this size [m] about center (x, z); it faces up."""
    nx, nz = heights.shape
    x = center[0] + (np.arange(nx) / (nx - 1) - 0.5) * size[0]
    z = center[1] + (np.arange(nz) / (nz - 1) - 0.5) * size[1]
    grid = np.stack([np.broadcast_to(x[:, None], heights.shape), heights, np.broadcast_to(z, heights.shape)], axis=-1)
    index = np.arange(nx * nz).reshape(nx, nz)
    a, b, c, d = (corner.ravel() for corner in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    faces = np.concatenate([np.stack([a, c, b], axis=1), np.stack([a, d, c], axis=1)])
    return trimesh.Trimesh(grid.reshape(-1, 3), faces, process=False)


def hills_mesh(
    height: float, length: float, size: tuple[float, float], center: tuple[float, float], base: float
) -> trimesh.Trimesh:
    """Rolling hills that rise from y = base by at most `height` [m] and sink back to it along their edges.

    Nine plane waves with wavelengths about `length` [m], in directions and phases of the golden ratio: always the same hills.
    """
    cells = [min(MOST_CELLS, ceil(extent / length * CELLS_PER_LENGTH)) for extent in size]
    u, v = np.meshgrid(*(np.linspace(-0.5, 0.5, n + 1) for n in cells), indexing="ij")
    x, z = u * size[0], v * size[1]
    waves = np.zeros_like(x)
    golden = (np.sqrt(5.0) - 1.0) / 2.0
    for i in range(9):
        angle, phase = np.pi * golden * i, 2.0 * np.pi * golden**2 * (i + 1) ** 2
        number = 2.0 * np.pi / (length * (1.0 + 0.5 * np.cos(3.0 * i)))
        waves += np.sin(number * (x * np.cos(angle) + z * np.sin(angle)) + phase) / number
    waves = (waves - waves.min()) / max(float(np.ptp(waves)), 1e-12)
    inside = np.clip(8.0 * np.minimum(0.5 - np.abs(u), 0.5 - np.abs(v)), 0.0, 1.0)
    return height_field_mesh(base + height * waves * inside**2 * (3.0 - 2.0 * inside), center, size)


def image_mesh(
    path: Path, lowest: float, highest: float, size: tuple[float, float], center: tuple[float, float]
) -> trimesh.Trimesh:
    """The ground of a grey image, black at y = lowest and white at y = highest [m]; its top edge looks along -z.

    Raises:
        InputError: no such file, not an image, or too large.
    """
    if not path.is_file():
        raise InputError(f"height_field.image {str(path)!r}: no such file")
    try:
        with Image.open(path) as image:
            deep = image.mode.startswith("I") or image.mode == "F"
            pixels = np.asarray(image if deep else image.convert("L"), dtype=np.float64)
    except (UnidentifiedImageError, OSError) as error:
        raise InputError(f"height_field.image {str(path)!r}: cannot be read as an image ({error})") from error
    if min(pixels.shape) < 2 or max(pixels.shape) > 4 * MOST_CELLS:
        raise InputError(f"height_field.image {str(path)!r}: found {pixels.shape}, must be 2 to {4 * MOST_CELLS} pixels a side")
    white = 65535.0 if deep else 255.0
    return height_field_mesh(lowest + (highest - lowest) * pixels.T / white, center, size)
