"""Outlines of leaf blades: (P, 2), of unit length from the foot of the blade at (0, 0) to its tip at (0, 1)."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Right half of a sugar maple blade (Acer saccharum), foot to tip: five lobes with a few teeth.
MAPLE_HALF = [
    (0.035, 0.0), (0.12, -0.055), (0.24, -0.05), (0.33, -0.11), (0.46, -0.095), (0.40, -0.03), (0.43, 0.04), (0.33, 0.10),
    (0.47, 0.145), (0.56, 0.20), (0.60, 0.30), (0.68, 0.32), (0.82, 0.47), (0.68, 0.46), (0.60, 0.49), (0.58, 0.56),
    (0.47, 0.51), (0.35, 0.46), (0.245, 0.42), (0.27, 0.55), (0.345, 0.60), (0.30, 0.645), (0.315, 0.73), (0.20, 0.75),
    (0.13, 0.80), (0.085, 0.89), (0.0, 1.0),
]  # fmt: skip


def mirrored(half: Array) -> Array:
    """A whole outline from its right half (P, 2), whose last point lies on the axis."""
    left = half[:-1][::-1] * [-1.0, 1.0]
    return np.concatenate([half, left])


def from_half_width(half_width: Array) -> Array:
    """An outline from half-widths (n,) at equal steps along the midrib, from the foot (excluded) to the tip (included)."""
    y = np.arange(1, len(half_width) + 1) / len(half_width)
    half = np.column_stack([half_width, y])
    half[-1] = (0.0, 1.0)
    return mirrored(np.concatenate([[(half_width[0] * 0.5, 0.0)], half]))


def maple() -> Array:
    """Sugar maple: palmate, five pointed lobes."""
    return mirrored(np.array(MAPLE_HALF))


def oak() -> Array:
    """White oak: widest beyond the middle, four rounded lobes a side."""
    t = np.arange(1, 41) / 40.0
    envelope = 0.34 * np.sin(np.pi * t**1.35) ** 0.7 + 0.03 * (1.0 - t)
    lobes = 1.0 - 0.58 * (0.5 + 0.5 * np.cos(2.0 * np.pi * 4.0 * t**1.1)) ** 1.3 * np.clip(4.0 * (1.0 - t), 0.0, 1.0)
    return from_half_width(envelope * lobes)


def birch() -> Array:
    """Silver birch: triangular-ovate with a drawn-out tip and a doubly toothed edge."""
    t = np.arange(1, 37) / 36.0
    body = 0.375 * np.clip(t / 0.24, 0.0, 1.0) ** 0.55 * (1.0 - np.clip((t - 0.2) / 0.8, 0.0, 1.0) ** 1.15) ** 1.05
    teeth = np.where(np.arange(36) % 2 == 0, 0.022, -0.008) + np.where(np.arange(36) % 6 == 0, 0.018, 0.0)
    return from_half_width(np.maximum(body + teeth * np.clip(5.0 * (1.0 - t), 0.0, 1.0) * np.clip(6.0 * t, 0.0, 1.0), 0.006))


def willow() -> Array:
    """White willow: narrow, pointed at both ends."""
    t = np.arange(1, 31) / 30.0
    return from_half_width(np.maximum(0.088 * np.sin(np.pi * t**0.85) ** 0.9, 0.004))


def ginkgo() -> Array:
    """Ginkgo: a fan with a notch in the middle."""
    angle = np.linspace(0.06, 1.0, 22) * np.radians(68.0)
    radius = 0.93 + 0.05 * np.cos(9.0 * angle) - 0.18 * np.exp(-((angle / 0.05) ** 2))
    rim = np.column_stack([radius * np.sin(angle), radius * np.cos(angle)])[::-1]
    edge = np.column_stack([[0.03, 0.16, 0.42], [0.0, 0.10, 0.20]])
    outline = mirrored(np.concatenate([edge, rim, [(0.0, 0.74)]]))
    return outline / outline[:, 1].max()
