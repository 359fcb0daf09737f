"""The curves a remeshed surface must keep: free rims, lines where sheets meet, sharp edges."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

CORNER = np.radians(50.0)  # a curve that turns by more within CORNER_WINDOW has a corner there
CORNER_WINDOW = 0.02  # of the surface's size
SMOOTH = np.radians(22.0)  # a curve that turns by less at each point is taken for the samples of a smooth one


@dataclass(frozen=True)
class FeatureCurves:
    """Curves between junctions, or closed loops: cubics through their points where these turn gently, else straight.

    chains: one (N,) array of vertex indices a curve, a loop repeating its first; points: (N, 3); arcs: (N,) lengths along the
    points; loop: which are loops.
    leaving, arriving: (N, 3), derivatives with arc length after and before each point. bulge: (C,) how far each curve leaves
    its straight segments.
    starts, ends: (S, 3) all their segments, with the curve (S,) and the arc length at the start (S,) of each.
    """

    chains: list[Indices]
    points: list[Array]
    arcs: list[Array]
    loop: list[bool]
    leaving: list[Array]
    arriving: list[Array]
    bulge: Array
    starts: Array
    ends: Array
    curve: Indices
    arc: Array


def trace_curves(vertices: Array, segments: Indices, kinds: Indices) -> list[Indices]:
    """Chain segments (S, 2) of equal kind (S,) into curves of vertex indices; loops repeat their first vertex.

    Curves break at vertices where other than two segments meet, or two of different kinds.
    """
    count = len(vertices)
    degree = np.bincount(segments.ravel(), minlength=count)
    by_kind = np.zeros(count, dtype=np.int64)
    lowest = np.full(count, np.iinfo(np.int64).max)
    np.maximum.at(by_kind, segments.ravel(), np.repeat(kinds, 2))
    np.minimum.at(lowest, segments.ravel(), np.repeat(kinds, 2))
    breaks = (degree != 2) | (by_kind != lowest)
    touching: dict[int, list[int]] = {}
    for i, (a, b) in enumerate(segments.tolist()):
        touching.setdefault(a, []).append(i)
        touching.setdefault(b, []).append(i)
    used = np.zeros(len(segments), dtype=bool)
    pairs = segments.tolist()
    seeds = [i for v in np.flatnonzero(breaks & (degree > 0)).tolist() for i in touching[v]] + list(range(len(pairs)))
    heads = [v for v in np.flatnonzero(breaks & (degree > 0)).tolist() for _ in touching[v]] + [p[0] for p in pairs]
    curves = []
    for seed, head in zip(seeds, heads, strict=True):
        if used[seed]:
            continue
        chain, i = [head], seed
        while True:
            used[i] = True
            a, b = pairs[i]
            chain.append(b if a == chain[-1] else a)
            if breaks[chain[-1]] or chain[-1] == head:
                break
            i = next(j for j in touching[chain[-1]] if j != i)
        curves.append(np.array(chain))
    return curves


def feature_curves(vertices: Array, chains: list[Indices]) -> FeatureCurves:
    """Measure curves given as chains of vertex indices."""
    points = [vertices[chain] for chain in chains]
    arcs = [np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))]) for p in points]
    loop = [bool(chain[0] == chain[-1]) for chain in chains]
    slopes = [curve_slopes(*curve) for curve in zip(points, arcs, loop, strict=True)]
    # A cubic leaves its chord at the middle by an eighth of the difference of its end slopes times its length.
    bulge = [
        np.linalg.norm((np.diff(a) / 8.0)[:, None] * (leaving[:-1] - arriving[1:]), axis=1).max()
        for a, (leaving, arriving) in zip(arcs, slopes, strict=True)
    ]
    none = np.zeros((0, 3))
    return FeatureCurves(
        chains,
        points,
        arcs,
        loop,
        [leaving for leaving, _ in slopes],
        [arriving for _, arriving in slopes],
        np.array(bulge),
        np.concatenate([none, *(p[:-1] for p in points)]),
        np.concatenate([none, *(p[1:] for p in points)]),
        np.repeat(np.arange(len(points)), [len(p) - 1 for p in points]).astype(np.int64),
        np.concatenate([np.zeros(0), *(a[:-1] for a in arcs)]),
    )


def curve_slopes(points: Array, arcs: Array, loop: bool) -> tuple[Array, Array]:
    """Derivatives (N, 3) after and before each point of a cubic through points (N, 3) at arc lengths (N,).

    Those of the parabola through a point and its neighbours where the curve turns by less than SMOOTH; at other points and
    ends the cubic leaves without bending, and between two such points it is straight.
    """
    steps = np.diff(arcs)
    chords = np.diff(points, axis=0) / steps[:, None]
    before, after = np.roll(chords, 1, axis=0), chords  # at the start of each segment
    h0, h1 = np.roll(steps, 1)[:, None], steps[:, None]
    cosine = np.einsum("si,si->s", before, after)
    gentle = np.append(cosine > np.cos(SMOOTH), False)
    gentle[-1] = gentle[0]
    if not loop:
        gentle[[0, -1]] = False
    slope = (h1 * before + h0 * after) / (h0 + h1)
    slope = np.vstack([slope, slope[:1]])
    leaving, arriving = slope.copy(), slope.copy()
    straight = ~gentle[:-1]
    leaving[:-1][straight] = np.where(gentle[1:, None], 1.5 * chords - 0.5 * slope[1:], chords)[straight]
    straight = ~gentle[1:]
    arriving[1:][straight] = np.where(gentle[:-1, None], 1.5 * chords - 0.5 * slope[:-1], chords)[straight]
    return leaving, arriving


def at_arc(curves: FeatureCurves, curve: int, arc: Array) -> Array:
    """Points (N, 3) at arc lengths (N,) of one curve; loops wrap round."""
    lengths, points = curves.arcs[curve], curves.points[curve]
    arc = np.mod(arc, lengths[-1]) if curves.loop[curve] else np.clip(arc, 0.0, lengths[-1])
    i = np.clip(np.searchsorted(lengths, arc, side="right") - 1, 0, len(lengths) - 2)
    step = (lengths[i + 1] - lengths[i])[:, None]
    t = (arc - lengths[i])[:, None] / step
    chord = points[i + 1] - points[i]
    bend = (1.0 - t) * (step * curves.leaving[curve][i] - chord) - t * (step * curves.arriving[curve][i + 1] - chord)
    return points[i] + t * chord + t * (1.0 - t) * bend


def nearest_on_curves(curves: FeatureCurves, points: Array) -> tuple[Array, Array]:
    """Points (N, 3) of the curves over the nearest points of their segments; distance (N, C) to the segments of each curve."""
    nearest, distances = np.empty_like(points), np.empty((len(points), len(curves.points)))
    along = curves.ends - curves.starts
    squares = np.einsum("si,si->s", along, along)
    bounds = np.searchsorted(curves.curve, np.arange(len(curves.points)))
    for first in range(0, len(points), 256):
        rows = slice(first, first + 256)
        offset = points[rows, None] - curves.starts[None]
        t = np.clip(np.einsum("nsi,si->ns", offset, along) / squares, 0.0, 1.0)
        offset -= t[:, :, None] * along
        gaps = np.einsum("nsi,nsi->ns", offset, offset)
        best = np.argmin(gaps, axis=1)
        part = t[np.arange(len(best)), best]
        owner, arc = curves.curve[best], curves.arc[best] + part * np.sqrt(squares[best])
        for curve in np.unique(owner).tolist():
            mine = owner == curve
            nearest[first : first + 256][mine] = at_arc(curves, curve, arc[mine])
        distances[rows] = np.sqrt(np.minimum.reduceat(gaps, bounds, axis=1))
    return nearest, distances


def arc_of(curves: FeatureCurves, curve: int, point: Array) -> float:
    """Arc length at which a curve is nearest to a point (3,)."""
    points, arcs = curves.points[curve], curves.arcs[curve]
    along = np.diff(points, axis=0)
    t = np.clip(np.einsum("si,si->s", point - points[:-1], along) / np.einsum("si,si->s", along, along), 0.0, 1.0)
    gaps = np.linalg.norm(point - points[:-1] - t[:, None] * along, axis=1)
    best = int(np.argmin(gaps))
    return float(arcs[best] + t[best] * (arcs[best + 1] - arcs[best]))


def arc_between(curves: FeatureCurves, a: Array, b: Array, tolerance: float) -> tuple[int, float, float] | None:
    """The curve that joins two points on it (3,) and the arc lengths at both, the shorter way; None if no curve does."""
    _, distances = nearest_on_curves(curves, np.stack([a, b]))
    best: tuple[int, float, float] | None = None
    for curve in np.flatnonzero((distances < tolerance + 1.5 * curves.bulge).all(axis=0)).tolist():
        length = curves.arcs[curve][-1]
        start, end = arc_of(curves, curve, a), arc_of(curves, curve, b)
        if curves.loop[curve]:
            end = start + (end - start + length / 2.0) % length - length / 2.0
        if best is None or abs(end - start) < abs(best[2] - best[1]):
            best = (curve, start, end)
    return best


def corner_vertices(curves: FeatureCurves, size: float) -> Indices:
    """Vertices where a curve has a corner: it turns by more than CORNER, and most within a window; ends do not count."""
    corners = []
    window = CORNER_WINDOW * size
    for index, (arc, chain) in enumerate(zip(curves.arcs, curves.chains, strict=True)):
        here = at_arc(curves, index, arc)
        into, out = here - at_arc(curves, index, arc - window), at_arc(curves, index, arc + window) - here
        turning = np.arctan2(np.linalg.norm(np.cross(into, out), axis=1), np.einsum("ni,ni->n", into, out))
        if not curves.loop[index]:
            turning[[0, -1]] = 0.0
        for i in np.argsort(-turning, kind="stable").tolist():
            if turning[i] < CORNER:
                continue  # too gentle, or within the window of a sharper one
            gap = np.abs(arc - arc[i])
            if curves.loop[index]:
                gap = np.minimum(gap, arc[-1] - gap)
            turning[gap < window] = 0.0
            corners.append(chain[i])
    return np.unique(np.array(corners, dtype=np.int64))
