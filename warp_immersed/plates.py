"""A curved or folded sheet as a few flat plates, each in the flow that it meets."""

from dataclasses import dataclass, replace

import numpy as np
import trimesh
from numpy.typing import NDArray

from warp_immersed.fluid import Fluid
from warp_immersed.force_law import LoadCoefficients, quasi_steady_coefficients
from warp_immersed.shape import Shape

Array = NDArray[np.float64]

MOST_PLATES = 4
# Normals that stray less than this from the mean (root mean square) make a flat sheet.
FLAT = np.radians(9.0)
# Faces that meet at a larger angle, or three at an edge, are a fold.
FOLD = np.radians(30.0)
# A sheet whose centre of mass lies this far from its middle, in semi-axes, turns about that end.
LOPSIDED = 0.35
# Edge-on drag of folded paper; friction alone is 0.015 at a Reynolds number of 30,000.
ATTACHED_EDGE_DRAG = 0.06
ATTACHED_MUNK_CUT = 0.4
# Lift slope 2 C_T of a wing of small aspect ratio with attached flow, near pi / 2 times an aspect ratio of 1.5.
ATTACHED_LIFT = 1.14


@dataclass(frozen=True)
class Plate:
    """One plate of a body: axes (3, 3), its axes as columns in the body's, the normal last; loads in its own axes, about the
    body's centre of mass; share (3,) of the body's added mass along the body's axes."""

    axes: Array
    loads: LoadCoefficients
    share: Array


def plates_of(shape: Shape, fluid: Fluid) -> tuple[Plate, ...]:
    """The plates of a sheet that is not flat, or that turns about one of its ends; none for others, which count as one.

    Each obeys the plate law of an equal ellipse in the velocity of its own centre, so that dihedral, keel, camber and the
    place of the centre of mass matter.
    """
    if not shape.is_sheet or shape.form != "mesh":
        return ()
    folded = folded_parts(shape.mesh)
    if abs(shape.geometric_center[0]) > LOPSIDED * shape.semi_axes[0]:
        parts = strips(shape.mesh)
    else:
        parts = flat_parts(shape.mesh, folded)
    if len(parts) < 2:
        return ()
    plates, weights = [], []
    for part in parts:
        piece = trimesh.Trimesh(shape.mesh.vertices, shape.mesh.faces[part], process=False)
        piece.remove_unreferenced_vertices()
        flat = Shape.from_mesh(piece, shape.density, shape.thickness)
        axes = flat.rotation
        loads = quasi_steady_coefficients(flat, fluid)
        if len(folded) > 1:
            loads = attached(loads, flat, fluid)
        center = loads.pressure_center + axes.T @ flat.center_of_mass
        normal = axes[:, 2] ** 2
        weights.append(shape.mesh.area_faces[part].sum() * normal)
        plates.append((axes, LoadCoefficients(**{**vars(loads), "pressure_center": center}), normal))
    total = np.maximum(np.sum(weights, axis=0), 1e-30)
    return tuple(
        Plate(axes, loads, weight / total * normal) for (axes, loads, normal), weight in zip(plates, weights, strict=True)
    )


def attached(loads: LoadCoefficients, flat: Shape, fluid: Fluid) -> LoadCoefficients:
    """The law for the wings of a folded glider, which flies edge-on for seconds where a falling disk does for an instant.

    Edge-on the flow stays attached: drag is friction and that of folds, less of the Munk moment is lost (none along a
    wing of many chords, where the centre of pressure lies at the quarter chord; all on a slender delta, where it lies at the
    centroid), and a turning wing meets the air at another angle along its length, which damps the turn by
    lift times the second moment of its area (strip theory).
    """
    a, b, _ = flat.semi_axes
    drag = loads.drag_quadratic.copy()
    lift = fluid.density * np.pi * a * b * ATTACHED_LIFT
    drag[:2] = 0.5 * fluid.density * np.pi * a * b * ATTACHED_EDGE_DRAG
    return replace(
        loads,
        drag_quadratic=drag,
        drag_oblique=0.0,
        lift=lift,
        munk_cut_edge=ATTACHED_MUNK_CUT,
        munk_cut_swing=loads.munk_cut_edge + loads.munk_cut_swing - ATTACHED_MUNK_CUT,
        damping_speed=loads.damping_speed + 0.25 * lift * np.array([b**2, a**2, 0.0]),
    )


def folded_parts(mesh: trimesh.Trimesh) -> list[NDArray[np.int64]]:
    """Faces of a sheet in the parts that its folds divide it into; in one if there are more than four."""
    smooth = mesh.face_adjacency[mesh.face_adjacency_angles < FOLD]
    parts = trimesh.graph.connected_components(smooth, nodes=np.arange(len(mesh.faces)))
    return [np.sort(part) for part in parts] if len(parts) <= MOST_PLATES else [np.arange(len(mesh.faces))]


def flat_parts(mesh: trimesh.Trimesh, folded: list[NDArray[np.int64]]) -> list[NDArray[np.int64]]:
    """The parts between folds, divided further by the direction of their normals until these stray less than `FLAT` within
    each, or there are four."""
    normals, areas = np.asarray(mesh.face_normals), np.asarray(mesh.area_faces)
    parts: list[NDArray[np.int64]] = []
    for done, part in enumerate(folded):
        for count in range(1, MOST_PLATES - len(parts) - (len(folded) - done - 1) + 1):
            labels, stray = grouped_normals(normals[part], areas[part], count)
            if stray < FLAT:
                break
        parts += [part[labels == label] for label in np.unique(labels)]
    return parts


def strips(mesh: trimesh.Trimesh) -> list[NDArray[np.int64]]:
    """Faces in four strips across the longest axis, x: the blade elements of a seed that spins about its heavy end."""
    along = mesh.triangles_center[:, 0]
    edges = np.linspace(along.min(), along.max(), MOST_PLATES + 1)[1:-1]
    labels = np.digitize(along, edges)
    return [np.flatnonzero(labels == label) for label in np.unique(labels)]


def grouped_normals(normals: Array, areas: Array, count: int) -> tuple[NDArray[np.int64], float]:
    """Groups of faces (F,) by the direction of their normals, whichever side they are seen from, and the angle [rad] by which
    these stray from the means of their groups (root mean square over the area)."""
    means = [mean_direction(normals, areas)]
    while len(means) < count:
        distance = np.min([stray_from(normals, mean) for mean in means], axis=0)
        means.append(normals[np.argmax(np.round(distance * areas, 12))])
    for _ in range(50):
        labels = np.argmin([stray_from(normals, mean) for mean in means], axis=0)
        means = [
            mean_direction(normals[labels == i], areas[labels == i]) if (labels == i).any() else mean
            for i, mean in enumerate(means)
        ]
    angles = np.min([stray_from(normals, mean) for mean in means], axis=0)
    return labels, float(np.sqrt((areas * angles**2).sum() / areas.sum()))


def mean_direction(normals: Array, areas: Array) -> Array:
    """The direction (3,) that normals (F, 3) have in common, their sign aside."""
    _, vectors = np.linalg.eigh(np.einsum("f,fi,fj->ij", areas, normals, normals))
    direction: Array = vectors[:, -1]
    return direction


def stray_from(normals: Array, direction: Array) -> Array:
    """Angles (F,) [rad] between normals (F, 3) and a direction, their sign aside."""
    angles: Array = np.arccos(np.clip(np.abs(normals @ direction), 0.0, 1.0))
    return angles
