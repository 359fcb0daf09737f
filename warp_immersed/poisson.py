"""The multigrid hierarchy of the pressure equation: built once on the host, solved by kernels.multigrid."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warp_immersed.kernels import grid as device_grid
from warp_immersed.kernels import multigrid
from warp_immersed.launch_plan import FIRST_PLANE, LaunchPlan

Array = NDArray[np.float64]

COARSEST_SWEEPS = 8


@dataclass(frozen=True)
class Faces:
    """Open fraction of the faces across each axis, (n + 1 along it), and of those at outlets."""

    open: tuple[Array, Array, Array]
    outlet: tuple[Array, Array, Array]


@dataclass(frozen=True)
class Level:
    """One grid of the hierarchy on the device: its equation, unknown x and right-hand side b; factor: finer cells an axis."""

    grid: Any
    factor: tuple[int, int, int]
    stencil: wp.array
    x: wp.array
    b: wp.array


def fine_faces(codes: NDArray[np.int32]) -> Faces:
    """Open faces and outlets from the code words of the cells (nx, ny, nz)."""
    opened, outlets = [], []
    solid = (codes >> 24) & 1 == 1
    for axis in range(3):
        ahead = np.where(solid, 1, (codes >> (4 * (2 * axis + 1))) & 15)
        first = np.where(solid, 1, (codes >> (4 * (2 * axis))) & 15).take([0], axis)
        kinds = np.concatenate([first, ahead], axis)
        opened.append((kinds == 0).astype(float))
        outlets.append((kinds == 4).astype(float))
        if codes.shape[axis] == 1:
            opened[-1][:] = 0.0
    return Faces((opened[0], opened[1], opened[2]), (outlets[0], outlets[1], outlets[2]))


def merge_faces(faces: Array, axis: int, factor: tuple[int, int, int]) -> Array:
    """Fractions on the faces of cells `factor` times as large: every factor-th plane, averaged over the face."""
    n = faces.shape[axis] - 1
    planes = np.minimum(np.arange(0, n + factor[axis], factor[axis]), n)
    out = faces.take(np.unique(planes), axis)
    for other in range(3):
        if other != axis and factor[other] == 2:
            if out.shape[other] % 2:
                pad = [(0, 0)] * 3
                pad[other] = (0, 1)
                out = np.pad(out, pad)
            shape = (*out.shape[:other], out.shape[other] // 2, 2, *out.shape[other + 1 :])
            out = out.reshape(shape).mean(other + 1)
    return out


def level_stencil(faces: Faces, spacing: Array) -> NDArray[np.float32]:
    """(nx, ny, nz, 8) equation of every cell."""
    parts, outs = [], []
    for axis in range(3):
        n = faces.open[axis].shape[axis] - 1
        for planes in (np.arange(n), np.arange(1, n + 1)):
            parts.append(faces.open[axis].take(planes, axis) / spacing[axis] ** 2)
            outs.append(2.0 * faces.outlet[axis].take(planes, axis) / spacing[axis] ** 2)
    diagonal = sum(parts) + sum(outs)
    inverse = np.divide(1.0, diagonal, out=np.zeros_like(diagonal), where=diagonal > 0.0)
    return np.stack([*parts, inverse, diagonal], axis=-1).astype(np.float32)


def build_levels(codes: NDArray[np.int32], wraps: tuple[int, int, int], spacing: Array, device: wp.Device) -> list[Level]:
    """The hierarchy, finest first: axes are halved until few cells are left, the finely spaced ones first."""
    faces = fine_faces(codes)
    spacing = np.array(spacing, dtype=float)
    factor = (1, 1, 1)
    levels = []
    while True:
        shape = tuple(faces.open[axis].shape[axis] - 1 for axis in range(3))
        grid = device_grid.Grid()
        grid.cells, grid.wraps = wp.vec3i(*shape), wp.vec3i(*wraps)
        stencil = wp.array(level_stencil(faces, spacing), dtype=device_grid.Stencil, device=device)
        x, b = (wp.zeros(shape, dtype=float, device=device) for _ in range(2))
        levels.append(Level(grid, factor, stencil, x, b))
        can = [n > 2 and not (wrap and n % 4) for n, wrap in zip(shape, wraps, strict=True)]
        if not any(can):
            return levels
        finest = min(spacing[axis] for axis in range(3) if can[axis])
        factor = tuple(2 if can[axis] and spacing[axis] < 1.9 * finest else 1 for axis in range(3))  # type: ignore[assignment]
        faces = Faces(
            tuple(merge_faces(faces.open[axis], axis, factor) for axis in range(3)),  # type: ignore[arg-type]
            tuple(merge_faces(faces.outlet[axis], axis, factor) for axis in range(3)),  # type: ignore[arg-type]
        )
        spacing = spacing * np.array(factor)


def half_dim(shape: tuple[int, ...]) -> tuple[int, int, int]:
    """Launch size of a red-black half sweep: the last axis halved, or y where z is one cell."""
    nx, ny, nz = shape
    return (nx, ny, (nz + 1) // 2) if nz > 1 else (nx, (ny + 1) // 2, 1)


def add_smoothing(plan: LaunchPlan, level: Level, sweeps: int) -> None:
    """Append red-black sweeps of one level."""
    for _ in range(sweeps):
        for color in (0, 1):
            inputs = [level.grid, FIRST_PLANE, color, level.stencil, level.b, level.x]
            plan.add(multigrid.smooth, half_dim(level.x.shape), inputs)


def add_v_cycle(plan: LaunchPlan, levels: list[Level], sweeps: int = 2) -> None:
    """Append one V(sweeps, sweeps) cycle from zero on levels[0]."""
    for depth, level in enumerate(levels):
        plan.add(multigrid.start_smoothing, level.x.shape, [FIRST_PLANE, level.stencil, level.b, level.x])
        last = depth == len(levels) - 1
        add_smoothing(plan, level, COARSEST_SWEEPS if last else sweeps)
        if not last:
            coarse = levels[depth + 1]
            factor = wp.vec3i(*coarse.factor)
            inputs = [level.grid, FIRST_PLANE, factor, level.stencil, level.b, level.x, coarse.b]
            plan.add(multigrid.restrict_residual, coarse.x.shape, inputs)
    for depth in range(len(levels) - 2, -1, -1):
        level, coarse = levels[depth], levels[depth + 1]
        factor = wp.vec3i(*coarse.factor)
        inputs = [coarse.grid, FIRST_PLANE, factor, level.stencil, coarse.stencil, coarse.x, level.x]
        plan.add(multigrid.prolong, level.x.shape, inputs)
        add_smoothing(plan, level, sweeps)
