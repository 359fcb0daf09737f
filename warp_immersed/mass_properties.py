"""Volume integrals of bodies: mass, centre of mass, inertia, principal frame."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Eigenvalues of the inertia closer than this (relative to the largest) count as equal: a disk or a sphere
# made of triangles should keep the axes it was drawn with, not those of its rounding errors.
DEGENERATE = 1e-5


@dataclass(frozen=True)
class VolumeIntegrals:
    """Zeroth, first and second moments of a body's volume in the coordinates of its mesh.

    volume [m^3]; centroid (3,) [m]; second_moment (3, 3) [m^5] is the integral of (p - centroid)(p - centroid)^T dV.
    """

    volume: float
    centroid: Array
    second_moment: Array


@dataclass(frozen=True)
class PointMass:
    """Ballast: a mass [kg] without volume at a position [m] in the coordinates of the mesh."""

    mass: float
    position: tuple[float, float, float]


@dataclass(frozen=True)
class MassProperties:
    """mass [kg]; center_of_mass (3,) [m] and rotation (3, 3), whose columns are the principal axes, in the coordinates
    of the mesh; inertia (3,) [kg m^2], principal moments about the centre of mass, ascending."""

    mass: float
    center_of_mass: Array
    rotation: Array
    inertia: Array


def triangle_moments(triangles: Array, weights: Array) -> tuple[Array, Array, Array]:
    """Zeroth, first and second moments of surface density `weights` (F,) over flat triangles (F, 3, 3).

    Exact for linear triangles: int p p^T dA = A/12 (sum_i p_i p_i^T + (sum_i p_i)(sum_i p_i)^T).
    Returns the total (), first moment (3,) and second moment (3, 3), about the origin.
    """
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    masses = weights * np.linalg.norm(normals, axis=1) / 2.0
    sums = triangles.sum(axis=1)
    first = masses @ sums / 3.0
    second = np.einsum("f,fki,fkj->ij", masses, triangles, triangles) + np.einsum("f,fi,fj->ij", masses, sums, sums)
    return masses.sum(), first, second / 12.0


def sheet_integrals(triangles: Array, thickness: Array) -> VolumeIntegrals:
    """Moments of a thin sheet: triangles (F, 3, 3) [m], each extruded by its thickness (F,) [m] along its normal."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    doubled_areas = np.linalg.norm(normals, axis=1)
    normals = normals / doubled_areas[:, None]
    volume, first, second = triangle_moments(triangles, thickness)
    across = np.einsum("f,fi,fj->ij", doubled_areas / 2.0 * thickness**3 / 12.0, normals, normals)
    centroid = first / volume
    return VolumeIntegrals(float(volume), centroid, second + across - volume * np.outer(centroid, centroid))


def closed_integrals(triangles: Array) -> VolumeIntegrals:
    """Moments of the solid enclosed by outward-facing triangles (F, 3, 3) [m]."""
    origin = triangles.reshape(-1, 3).mean(axis=0)
    size = np.abs(triangles - origin).max()  # trimesh compares volumes with an absolute tolerance: hand it unit size
    solid = trimesh.triangles.mass_properties((triangles - origin) / size, density=1.0)
    inertia = np.asarray(solid.inertia, dtype=np.float64)
    second = np.trace(inertia) / 2.0 * np.eye(3) - inertia
    return VolumeIntegrals(float(solid.volume * size**3), origin + size * np.asarray(solid.center_mass), second * size**5)


def principal_frame(inertia: Array) -> tuple[Array, Array]:
    """Principal moments (3,), ascending, and the right-handed rotation (3, 3) whose columns are their axes.

    Where moments coincide the axes are free; those nearest to the given coordinate axes are taken.
    """
    moments, axes = np.linalg.eigh((inertia + inertia.T) / 2.0)
    start = 0
    while start < 3:
        stop = start + 1
        while stop < 3 and moments[stop] - moments[start] < DEGENERATE * moments[2]:
            stop += 1
        if stop - start > 1:
            space = axes[:, start:stop]
            projector = space @ space.T
            order = np.sort(np.argsort(-np.diag(projector), kind="stable")[: stop - start])
            axes[:, start:stop] = np.linalg.qr(projector[:, order])[0]
        start = stop
    for column in (0, 2):
        axes[:, column] *= np.sign(axes[np.argmax(np.abs(axes[:, column]).round(9)), column])
    axes[:, 1] = np.cross(axes[:, 2], axes[:, 0])
    return moments, axes


def mass_properties(integrals: VolumeIntegrals, density: float, ballast: Sequence[PointMass] = ()) -> MassProperties:
    """Mass properties of a body of uniform density [kg/m^3] carrying point masses."""
    masses = np.array([density * integrals.volume, *(b.mass for b in ballast)])
    positions = np.array([integrals.centroid, *(b.position for b in ballast)])
    mass = masses.sum()
    center = masses @ positions / mass
    arms = positions - center
    second = density * integrals.second_moment + np.einsum("b,bi,bj->ij", masses, arms, arms)
    moments, axes = principal_frame(np.trace(second) * np.eye(3) - second)
    return MassProperties(float(mass), center, axes, moments)
