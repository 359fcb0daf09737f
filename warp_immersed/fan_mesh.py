"""The coarsest mesh of a surface: each patch a fan of triangles from its middle to a few pieces of its border.

Cut evenly and crowded towards the rims, a fan gives the rings that suit a disk, an ellipse, a leaf or a plate best: all layers
of faces run along the rim, and two cuts of one fan are similar, as Richardson's extrapolation supposes.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from warp_immersed.feature_curves import at_arc
from warp_immersed.panel_mesh import Surface, bridges, folded_faces_of
from warp_immersed.remesh import PatchMesh, face_normals, mesh_edges

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

TURN = np.radians(66.0)  # of a piece of border: six round a circle
WIDEST = np.radians(155.0)  # angle at the middle that a triangle may have
PIECE_LIMIT = 80
STRAIGHT = np.radians(5.0)  # a stretch that turns by less in all is cut by its length alone


@dataclass
class Stretch:
    """Part of a curve between two stops: its curve, arc lengths at points along it (K,), turning up to each (K,), the original
    vertices at its ends, and the number of pieces it is cut into."""

    curve: int
    arcs: Array
    turning: Array
    ends: tuple[int, int]
    pieces: int

    def cuts(self) -> Array:
        """Arc lengths (pieces + 1,) of its nodes, evenly spread over length and turning."""
        length = self.arcs[-1] - self.arcs[0]
        measure = (self.arcs - self.arcs[0]) / length
        if self.turning[-1] > STRAIGHT:
            measure = (measure + self.turning / self.turning[-1]) / 2.0
        return np.interp(np.arange(self.pieces + 1) / self.pieces, measure, self.arcs)


def fan_mesh(surface: Surface) -> PatchMesh | None:
    """A fan on each patch of a surface; None if a patch has not one simple border that is seen whole from its middle."""
    curves = surface.curves
    borders = patch_borders(surface)
    if borders is None:
        return None
    stretches = [stretch for curve in range(len(curves.points)) for stretch in curve_stretches(surface, curve)]
    middles = patch_middles(surface)
    for _ in range(8):
        if sum(stretch.pieces for stretch in stretches) > PIECE_LIMIT:
            return None
        fan, wide = assembled(surface, stretches, borders, middles)
        if fan is None:
            return None
        if not wide:
            spoiled = len(folded_faces_of(surface, fan)) or bridges(surface, fan, mesh_edges(fan)).any()
            return None if spoiled else fan
        for stretch in wide:
            stretch.pieces += 1
    return None


def patch_borders(surface: Surface) -> list[list[tuple[int, bool]]] | None:
    """For each curve the patches it borders, and whether their faces run along it; None if one lies on both its sides."""
    mesh, borders = surface.mesh, []
    for curve, chain in enumerate(surface.curves.chains):
        rows, corners = np.nonzero(surface.edges.of_face == first_edge(surface, curve))
        patches = mesh.patch[rows]
        if len(np.unique(patches)) < len(patches):
            return None
        forward = mesh.faces[rows, corners] == chain[0]
        borders.append(list(zip(patches.tolist(), forward.tolist(), strict=True)))
    return borders if borders else None


def curve_stretches(surface: Surface, curve: int) -> list[Stretch]:
    """A curve cut at its ends and corners, each part with the fewest pieces that its turning allows."""
    curves, fixed = surface.curves, surface.mesh.fixed
    chain, arcs, points = curves.chains[curve], curves.arcs[curve], curves.points[curve]
    steps = np.diff(points, axis=0)
    following = np.roll(steps, -1, axis=0)
    turn = np.arctan2(np.linalg.norm(np.cross(steps, following), axis=1), np.einsum("si,si->s", steps, following))
    count = len(steps)
    if curves.loop[curve]:
        stops = np.flatnonzero(fixed[chain[:-1]])
        if not len(stops):  # start where the loop is farthest from its middle, wherever the first vertex is
            stops = np.array([np.argmax(np.linalg.norm(points[:-1] - points[:-1].mean(axis=0), axis=1))])
        bounds = [*stops.tolist(), int(stops[0]) + count]
    else:
        bounds = [0, *(np.flatnonzero(fixed[chain[1:-1]]) + 1).tolist(), count]
    on_rim = surface.singular[first_edge(surface, curve)]
    stretches = []
    for first, last in pairwise(bounds):
        k = np.arange(first, last + 1)
        along = arcs[k % count] + (k // count) * arcs[-1]
        at_points = turn[(k[:-1] - 1) % count].copy()  # at the start of each segment
        at_points[0] = 0.0
        after = np.append(turn[k[:-2] % count], 0.0) if len(k) > 2 else np.zeros(1)
        turning = np.concatenate([[0.0], np.cumsum((at_points + after) / 2.0)])
        ends = (int(chain[first % count]), int(chain[last % count if curves.loop[curve] else last]))
        pieces = max(1, int(np.ceil(turning[-1] / TURN - 0.05)), 3 if ends[0] == ends[1] else 1, 1 if on_rim else 2)
        stretches.append(Stretch(curve, along, turning, ends, pieces))
    return stretches


def first_edge(surface: Surface, curve: int) -> int:
    """Number of the edge that a curve begins with."""
    edges, count = surface.edges, len(surface.mesh.vertices) + 1
    low, high = sorted(surface.curves.chains[curve][:2].tolist())
    return int(np.searchsorted(edges.ends[:, 0] * count + edges.ends[:, 1], low * count + high))


def patch_middles(surface: Surface) -> Array:
    """Points (P, 3) of the surface nearest to the centroids of its patches."""
    mesh = surface.mesh
    weights = np.linalg.norm(face_normals(mesh.vertices, mesh.faces), axis=1)
    centers = mesh.vertices[mesh.faces].mean(axis=1)
    sums = np.stack([np.bincount(mesh.patch, weights * centers[:, axis]) for axis in range(3)], axis=1)
    middles = sums / np.bincount(mesh.patch, weights)[:, None]
    return surface.put_back(middles, np.arange(len(middles)))


def assembled(
    surface: Surface, stretches: list[Stretch], borders: list[list[tuple[int, bool]]], middles: Array
) -> tuple[PatchMesh | None, list[Stretch]]:
    """The fans, or None if the pieces about a patch are not one loop; and the stretches that want more pieces."""
    points: list[Array] = []
    number: dict[int, int] = {}

    def node(point: Array, original: int | None) -> int:
        if original is not None and original in number:
            return number[original]
        if original is not None:
            number[original] = len(points)
        points.append(point)
        return len(points) - 1

    sides: list[list[tuple[int, int, Stretch]]] = [[] for _ in middles]
    for stretch in stretches:
        where = at_arc(surface.curves, stretch.curve, stretch.cuts())
        nodes = [node(surface.mesh.vertices[stretch.ends[0]], stretch.ends[0])]
        nodes += [node(point, None) for point in where[1:-1]]
        nodes.append(node(surface.mesh.vertices[stretch.ends[1]], stretch.ends[1]))
        for patch, forward in borders[stretch.curve]:
            for a, b in pairwise(nodes):
                sides[patch].append((a, b, stretch) if forward else (b, a, stretch))
    faces, labels = [], []
    wide: list[Stretch] = []
    vertices = np.array(points)
    for patch, pieces in enumerate(sides):
        after = {a: b for a, b, _ in pieces}
        walk = [pieces[0][0]] if pieces else []
        while walk and after.get(walk[-1]) is not None and len(walk) <= len(pieces):
            walk.append(after[walk[-1]])
        if len(after) != len(pieces) or len(walk) != len(pieces) + 1 or walk[-1] != walk[0] or len(set(walk)) != len(pieces):
            return None, []
        for a, b, stretch in pieces:
            one, other = vertices[a] - middles[patch], vertices[b] - middles[patch]
            angle = np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other)
            if (angle > WIDEST or len(pieces) < 3) and all(stretch is not known for known in wide):
                wide.append(stretch)
            faces.append((a, b, len(points) + patch))
            labels.append(patch)
    fan = PatchMesh(
        np.vstack([vertices, middles]),
        np.array(faces, dtype=np.int64),
        np.array(labels, dtype=np.int64),
        np.zeros(len(points) + len(middles), dtype=bool),
    )
    return fan, wide
