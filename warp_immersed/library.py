"""Ready-made shapes. Lengths in metres, densities in kg/m^3; every function returns a `Shape`."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from warp_immersed import leaf_outlines
from warp_immersed.errors import InputError
from warp_immersed.mass_properties import PointMass
from warp_immersed.shape import RGB, Shape, require_positive
from warp_immersed.sheet_mesh import ellipse_mesh, outline_mesh, rectangle_mesh

Array = NDArray[np.float64]

PAPER_WHITE = (0.86, 0.85, 0.80)
# Autumn colours of leaves on the ground and in the air, linear RGB.
MAPLE_COLORS = ((0.50, 0.045, 0.015), (0.62, 0.13, 0.015), (0.70, 0.24, 0.02), (0.36, 0.03, 0.02), (0.60, 0.38, 0.04))
OAK_COLORS = ((0.27, 0.12, 0.035), (0.34, 0.17, 0.05), (0.22, 0.085, 0.03), (0.36, 0.22, 0.07))
BIRCH_COLORS = ((0.68, 0.46, 0.03), (0.74, 0.55, 0.06), (0.58, 0.36, 0.03), (0.50, 0.46, 0.07))
WILLOW_COLORS = ((0.45, 0.42, 0.10), (0.55, 0.46, 0.08), (0.32, 0.34, 0.10))
GINKGO_COLORS = ((0.78, 0.54, 0.02), (0.74, 0.60, 0.06), (0.68, 0.44, 0.02))
SAMARA_COLORS = ((0.40, 0.26, 0.10), (0.46, 0.33, 0.14), (0.33, 0.20, 0.08))


def ellipsoid(semi_axes: ArrayLike, density: float = 1000.0) -> Shape:
    """An exact ellipsoid; semi_axes (3,) in any order, shown as 1280 triangles with its axes along x >= y >= z."""
    axes = np.sort(np.asarray(semi_axes, dtype=np.float64))[::-1]
    if axes.shape != (3,) or not (np.isfinite(axes).all() and axes[2] > 0.0):
        raise InputError(f"semi_axes: found {semi_axes!r}, must be three positive lengths [m]")
    require_positive("density", density)
    surface = trimesh.creation.icosphere(subdivisions=3)
    longitude = np.arctan2(surface.vertices[:, 1], surface.vertices[:, 0]) / (2.0 * np.pi) + 0.5
    uv = np.column_stack([longitude, np.arccos(np.clip(surface.vertices[:, 2], -1.0, 1.0)) / np.pi])
    surface = trimesh.Trimesh(surface.vertices * axes, surface.faces, visual=trimesh.visual.TextureVisuals(uv=uv), process=False)
    return Shape.ellipsoid(axes, density, surface).colored((0.45, 0.10, 0.08))


def sphere(radius: float = 0.01, density: float = 1000.0) -> Shape:
    """An exact sphere."""
    require_positive("radius", radius)
    return ellipsoid((radius, radius, radius), density)


def elliptic_paper(length: float = 0.04, width: float = 0.01, thickness: float = 1e-4, density: float = 800.0) -> Shape:
    """An exact elliptic sheet with full axes length and width; the default is the paper of Xie & Miyata's slides."""
    for name, value in (("length", length), ("width", width), ("thickness", thickness), ("density", density)):
        require_positive(name, value)
    a, b = max(length, width) / 2.0, min(length, width) / 2.0
    return Shape.elliptic_sheet(a, b, thickness, density, ellipse_mesh(a, b)).colored(PAPER_WHITE)


def disk(diameter: float = 0.04, thickness: float = 1e-4, density: float = 800.0) -> Shape:
    """An exact circular sheet: a paper disk, or with other numbers a coin."""
    require_positive("diameter", diameter)
    return elliptic_paper(diameter, diameter, thickness, density)


def coin(diameter: float = 0.02125, thickness: float = 1.67e-3, density: float = 7800.0) -> Shape:
    """A coin; the default is copper-plated steel and the size of a 5 euro cent piece."""
    metal = disk(diameter, thickness, density).colored((0.93, 0.52, 0.30), (0.88, 0.44, 0.23), (0.95, 0.66, 0.36))
    return replace(metal, roughness=0.35, metallic=1.0)


def rectangular_paper(length: float = 0.10, width: float = 0.05, thickness: float = 1e-4, density: float = 800.0) -> Shape:
    """A flat rectangular sheet."""
    for name, value in (("length", length), ("width", width)):
        require_positive(name, value)
    return Shape.from_mesh(rectangle_mesh(length, width), density, thickness).colored(PAPER_WHITE)


def sheet(outline: ArrayLike, thickness: float = 1e-4, density: float = 800.0) -> Shape:
    """A flat sheet cut to a simple polygon, outline (P, 2)."""
    return Shape.from_mesh(outline_mesh(outline), density, thickness).colored(PAPER_WHITE)


def maple_leaf(length: float = 0.07, thickness: float = 2e-4, density: float = 500.0) -> Shape:
    """A sugar maple leaf with a blade of this length (foot to tip)."""
    return leaf(leaf_outlines.maple(), length, thickness, density, MAPLE_COLORS, trough=0.10, droop=0.12)


def oak_leaf(length: float = 0.09, thickness: float = 2e-4, density: float = 500.0) -> Shape:
    """A white oak leaf with a blade of this length."""
    return leaf(leaf_outlines.oak(), length, thickness, density, OAK_COLORS, trough=0.14, droop=0.10, petiole=0.12)


def birch_leaf(length: float = 0.05, thickness: float = 1.8e-4, density: float = 500.0) -> Shape:
    """A silver birch leaf with a blade of this length."""
    return leaf(leaf_outlines.birch(), length, thickness, density, BIRCH_COLORS, trough=0.12, droop=0.10)


def willow_leaf(length: float = 0.09, thickness: float = 1.8e-4, density: float = 500.0) -> Shape:
    """A white willow leaf with a blade of this length."""
    return leaf(leaf_outlines.willow(), length, thickness, density, WILLOW_COLORS, trough=0.25, droop=0.16, petiole=0.1)


def ginkgo_leaf(length: float = 0.05, thickness: float = 2e-4, density: float = 550.0) -> Shape:
    """A ginkgo leaf with a blade of this length."""
    return leaf(leaf_outlines.ginkgo(), length, thickness, density, GINKGO_COLORS, trough=0.06, droop=0.06, petiole=0.7)


def leaf(
    blade: Array,
    length: float,
    thickness: float,
    density: float,
    colors: tuple[RGB, ...],
    trough: float,
    droop: float,
    petiole: float = 0.45,
) -> Shape:
    """A leaf: a blade (P, 2) of unit length scaled to `length` [m], curved, on a petiole that shifts its centre of mass.

    trough: how far the edges rise above the midrib, per distance from it; droop: sag of the tip, both relative to the
    blade; petiole: its length over that of the blade, 1.4 mm thick on a blade 7 cm long and bent upward.
    """
    for name, value in (("length", length), ("thickness", thickness), ("density", density)):
        require_positive(name, value)
    half_width = 0.008
    stalk = np.array([(-half_width, -petiole), (half_width, -petiole), (half_width, -0.004)])
    outline = np.concatenate([stalk, blade, [(-half_width, -0.004)]])
    mesh = outline_mesh(outline, spacing=0.055)
    x, y = mesh.vertices[:, 0].copy(), mesh.vertices[:, 1].copy()
    along = np.clip(y, 0.0, None)
    bend = 0.25 * np.clip(-y, 0.0, None) ** 2 / max(petiole, 0.1)
    mesh.vertices[:, 2] = trough * np.sqrt(x**2 + 1e-3) - droop * along**2 + bend
    stem = mesh.triangles[:, :, 1].mean(axis=1) < 0.0
    stem &= np.abs(mesh.triangles[:, :, 0]).max(axis=1) < 1.5 * half_width
    mesh.apply_scale(length)
    return Shape.from_mesh(mesh, density, np.where(stem, max(0.02 * length, thickness), thickness)).colored(*colors)


def snowflake(diameter: float = 0.008, thickness: float = 5e-4, density: float = 60.0) -> Shape:
    """A dry flake of snow: a six-armed star of loosely packed ice, which falls flat at some 0.7 m/s."""
    for name, value in (("diameter", diameter), ("thickness", thickness), ("density", density)):
        require_positive(name, value)
    angle = np.pi / 6.0 * np.arange(12)
    radius = np.where(np.arange(12) % 2 == 0, 0.5, 0.22) * diameter
    mesh = outline_mesh(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]), spacing=0.14 * diameter)
    flake = Shape.from_mesh(mesh, density, thickness).colored((0.90, 0.93, 0.96))
    return replace(flake, roughness=0.9)


def samara(length: float = 0.04, thickness: float = 1e-4, density: float = 700.0) -> Shape:
    """One maple key: a nut at one end of a wing of this whole length, with a stiff leading edge."""
    for name, value in (("length", length), ("thickness", thickness), ("density", density)):
        require_positive(name, value)
    lead = [(0.0, 0.07), (0.08, 0.12), (0.2, 0.115), (0.4, 0.10), (0.65, 0.09), (0.85, 0.05), (0.96, -0.02)]
    trail = [(1.0, -0.10), (0.96, -0.19), (0.84, -0.25), (0.66, -0.25), (0.48, -0.19), (0.32, -0.09), (0.2, -0.04)]
    nut = [(0.1, -0.06), (0.03, -0.03)]
    mesh = outline_mesh(np.array(lead + trail + nut), spacing=0.045)
    center = mesh.triangles.mean(axis=1)
    is_nut = center[:, 0] < 0.2
    front = np.interp(center[:, 0], *np.array(lead).T) - center[:, 1] < 0.05
    x, y = mesh.vertices[:, 0].copy(), mesh.vertices[:, 1].copy()
    mesh.vertices[:, 2] = 0.02 * np.sin(np.pi * x) + 0.10 * y**2
    mesh.apply_scale(length)
    face_thickness = np.where(is_nut, 0.06 * length, np.where(front, 4.0 * thickness, thickness))
    return Shape.from_mesh(mesh, density, face_thickness).colored(*SAMARA_COLORS)


def paper_airplane(
    length: float = 0.28, span: float = 0.20, thickness: float = 1e-4, density: float = 800.0, nose_weight: float = 0.16
) -> Shape:
    """A dart folded from one sheet: two wings and a keel that meet at a crease, its layers thickest along it.

    nose_weight: mass of a clip on its nose over that of the paper, which trims it: 1 g on the default glides, none stalls, more
    dives.
    """
    if not (isinstance(nose_weight, (int, float)) and np.isfinite(nose_weight) and nose_weight >= 0.0):
        raise InputError(f"nose_weight: found {nose_weight!r}, must be a number >= 0")
    for name, value in (("length", length), ("span", span), ("thickness", thickness), ("density", density)):
        require_positive(name, value)
    nose, tail = np.array([0.5 * length, 0.0, 0.0]), np.array([-0.5 * length, 0.0, 0.0])
    left, right = tail + [0.0, span / 2.0, 0.04 * span], tail + [0.0, -span / 2.0, 0.04 * span]
    keel = tail + [0.0, 0.0, -0.22 * span]
    corners = np.array([nose, tail, left, right, keel])
    mesh = trimesh.Trimesh(corners, [(0, 2, 1), (0, 1, 3), (0, 1, 4)], process=False)
    for _ in range(4):
        mesh = mesh.subdivide()
    x, y, z = mesh.vertices.T
    across = y - z
    uv = np.column_stack([x + 0.5 * length, across - across.min()]) / max(length, np.ptp(across))
    mesh = trimesh.Trimesh(mesh.vertices, mesh.faces, visual=trimesh.visual.TextureVisuals(uv=uv), process=False)
    center = mesh.triangles.mean(axis=1)
    layers = np.where(np.abs(center[:, 1]) < 1e-9, 4.0, np.where(np.abs(center[:, 1]) < span / 8.0, 3.0, 1.0))
    paper = density * thickness * float((layers * mesh.area_faces).sum())
    clip = [PointMass(nose_weight * paper, (0.46 * length, 0.0, -0.01 * span))] if nose_weight > 0.0 else []
    return Shape.from_mesh(mesh, density, thickness * layers, clip).colored(PAPER_WHITE)


SHAPES: dict[str, Callable[..., Shape]] = {
    function.__name__: function
    for function in (
        sphere,
        ellipsoid,
        disk,
        coin,
        elliptic_paper,
        rectangular_paper,
        sheet,
        maple_leaf,
        oak_leaf,
        birch_leaf,
        willow_leaf,
        ginkgo_leaf,
        snowflake,
        samara,
        paper_airplane,
    )
}
