"""`Shape`: a rigid body as the fluid and gravity see it, made from a triangle mesh."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import trimesh
from numpy.typing import ArrayLike, NDArray

from warp_immersed.errors import InputError, MeshRepairWarning
from warp_immersed.mass_properties import (
    MassProperties,
    PointMass,
    VolumeIntegrals,
    closed_integrals,
    mass_properties,
    sheet_integrals,
    triangle_moments,
)

Array = NDArray[np.float64]
Form = Literal["ellipsoid", "elliptic_sheet", "mesh"]
RGB = tuple[float, float, float]

LEAF_GREEN = (0.24, 0.36, 0.12)


@dataclass(frozen=True, eq=False)
class Shape:
    """A rigid body: a closed solid, or an open sheet with a thickness.

    Attributes (SI units; the principal frame has its origin at the centre of mass and its axes by ascending moment
    of inertia, so that a sheet's normal is z):
        mesh: triangles in the principal frame [m].
        form: "ellipsoid" and "elliptic_sheet" are exact, whatever the mesh; "mesh" is what its triangles say.
        semi_axes: (3,) [m], along the principal axes: those of the exact form, or of the ellipsoid of equal volume
            and second moments (closed mesh), or of the ellipse of equal area and second moments with half the mean
            thickness as its third (sheet).
        geometric_center: (3,) [m], centre of that ellipse or ellipsoid in the principal frame.
        thickness: mean thickness of a sheet [m]; None for a closed body.
        density: of the material, without ballast [kg/m^3].
        mass [kg], volume [m^3]; inertia: (3,) [kg m^2], principal moments about the centre of mass, ascending.
        center_of_mass: (3,) [m] and rotation: (3, 3), principal axes as columns, in the coordinates of the mesh given.
        center_of_buoyancy: (3,) [m], centroid of the volume in the principal frame.
        colors: linear RGB, one or several that bodies of this shape take by their number, roughness and metallic (0 to 1):
            for pictures only.
    """

    mesh: trimesh.Trimesh
    form: Form
    semi_axes: Array
    geometric_center: Array
    thickness: float | None
    density: float
    mass: float
    volume: float
    inertia: Array
    center_of_mass: Array
    rotation: Array
    center_of_buoyancy: Array
    colors: tuple[RGB, ...] = (LEAF_GREEN,)
    roughness: float = 0.7
    metallic: float = 0.0

    @property
    def is_sheet(self) -> bool:
        """Whether the body is an open sheet with a thickness."""
        return self.thickness is not None

    @property
    def bounding_radius(self) -> float:
        """Radius [m] of the sphere about the centre of mass that contains the mesh."""
        return float(np.linalg.norm(self.mesh.vertices, axis=1).max())

    def colored(self, *colors: RGB) -> "Shape":
        """The same body in other colours (linear RGB)."""
        return replace(self, colors=colors)

    @staticmethod
    def from_mesh(
        mesh: str | Path | trimesh.Trimesh,
        density: float,
        thickness: float | ArrayLike | None = None,
        ballast: Sequence[PointMass] = (),
        scale: float = 1.0,
    ) -> "Shape":
        """A body from any triangle mesh: a file that trimesh reads, or a `trimesh.Trimesh`.

        Args:
            mesh: path or mesh; lengths in metres after `scale`.
            density: of the material [kg/m^3].
            thickness: makes the mesh an open sheet [m]; one number, or one per face (F,).
            ballast: point masses carried by the body, in the coordinates of the (scaled) mesh.
            scale: multiplies the coordinates, for files in other units (0.01 for centimetres).

        Raises:
            InputError: missing or unreadable file, no faces, open mesh without thickness, closed mesh with thickness,
                inconsistent normals that cannot be repaired, or a size that is not positive.
        Warns:
            MeshRepairWarning: faces were dropped, merged or flipped.
        """
        name = mesh.name if isinstance(mesh, Path) else (Path(mesh).name if isinstance(mesh, str) else "mesh")
        require_positive("density", density)
        require_positive("scale", scale)
        try:
            faces_thickness = None if thickness is None else np.asarray(thickness, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise InputError(f"thickness: found {thickness!r}, must be positive numbers [m]") from error
        if faces_thickness is not None and not (np.isfinite(faces_thickness).all() and (faces_thickness > 0.0).all()):
            raise InputError(f"thickness: found {thickness!r}, must be positive [m]")
        given = load_mesh(mesh)
        colors = mesh_color(given)
        surface, faces_thickness = prepare_mesh(given, name, faces_thickness)
        surface.apply_scale(scale)
        if faces_thickness is None:
            integrals = closed_integrals(surface.triangles)
        else:
            integrals = sheet_integrals(surface.triangles, faces_thickness)
        body = assemble(surface, integrals, density, faces_thickness, ballast)
        return body if colors is None else body.colored(colors)

    @staticmethod
    def ellipsoid(semi_axes: ArrayLike, density: float, surface: trimesh.Trimesh) -> "Shape":
        """An exact ellipsoid with semi-axes (3,) [m], descending, shown as `surface`, whose axes are x, y, z."""
        a = np.asarray(semi_axes, dtype=np.float64)
        volume = 4.0 / 3.0 * np.pi * a.prod()
        integrals = VolumeIntegrals(volume, np.zeros(3), np.diag(volume * a**2 / 5.0))
        return replace(assemble(surface, integrals, density, None, ()), form="ellipsoid", semi_axes=a)

    @staticmethod
    def elliptic_sheet(a: float, b: float, thickness: float, density: float, surface: trimesh.Trimesh) -> "Shape":
        """An exact elliptic cylinder with semi-axes a >= b and height `thickness` [m], shown as the sheet `surface`."""
        volume = np.pi * a * b * thickness
        integrals = VolumeIntegrals(volume, np.zeros(3), volume * np.diag([a**2 / 4.0, b**2 / 4.0, thickness**2 / 12.0]))
        shape = assemble(surface, integrals, density, np.full(len(surface.faces), thickness), ())
        return replace(shape, form="elliptic_sheet", semi_axes=np.array([a, b, thickness / 2.0]))


def require_positive(name: str, value: float) -> None:
    """Raise InputError unless value is a positive finite number."""
    if not (isinstance(value, (int, float, np.floating, np.integer)) and np.isfinite(value) and value > 0.0):
        raise InputError(f"{name}: found {value!r}, must be a positive number")


def load_mesh(mesh: str | Path | trimesh.Trimesh) -> trimesh.Trimesh:
    """Read a mesh file (all its geometry as one mesh), or copy the mesh given."""
    if isinstance(mesh, trimesh.Trimesh):
        return mesh.copy()
    path = Path(mesh)
    if not path.is_file():
        raise InputError(f"mesh {str(mesh)!r}: no such file")
    try:
        loaded = trimesh.load_mesh(path)
    except Exception as error:  # trimesh readers raise whatever they stumble on
        raise InputError(f"mesh {str(mesh)!r}: cannot be read ({str(error) or repr(error)})") from error
    if not isinstance(loaded, trimesh.Trimesh):
        raise InputError(f"mesh {str(mesh)!r}: holds no triangles, only {type(loaded).__name__}")
    return loaded


def mesh_color(mesh: trimesh.Trimesh) -> RGB | None:
    """The colour a mesh file gives, linear RGB: of its material or the mean of its texture, or of its vertices or faces."""
    visual: Any = mesh.visual
    if not getattr(visual, "defined", False):
        return None
    if visual.kind in ("vertex", "face"):
        encoded = np.asarray(visual.vertex_colors if visual.kind == "vertex" else visual.face_colors)[:, :3].mean(axis=0)
    else:
        material: Any = getattr(visual, "material", None)
        image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
        if image is not None:
            encoded = np.asarray(image.convert("RGB"), dtype=np.float64).reshape(-1, 3).mean(axis=0)
        elif getattr(material, "baseColorFactor", None) is not None:  # glTF's factors are linear
            red, green, blue = (float(c) / 255.0 for c in material.main_color[:3])
            return red, green, blue
        elif "kd" in getattr(material, "kwargs", {}):  # of an .obj
            encoded = np.asarray(material.main_color[:3])
        else:
            return None
    value = np.asarray(encoded, dtype=np.float64) / 255.0
    red, green, blue = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4).tolist()
    return red, green, blue


def prepare_mesh(mesh: trimesh.Trimesh, name: str, thickness: Array | None) -> tuple[trimesh.Trimesh, Array | None]:
    """Check a mesh and repair what can be repaired; thickness comes back as one value a face, or None if closed."""
    if not len(mesh.faces):
        raise InputError(f"{name}: has no faces, must be a triangle mesh")
    if not np.isfinite(mesh.vertices).all():
        raise InputError(f"{name}: has vertices that are not finite numbers")
    if thickness is not None and thickness.ndim and thickness.shape != (len(mesh.faces),):
        raise InputError(f"thickness: found shape {thickness.shape}, must be one number or ({len(mesh.faces)},), one a face")
    mesh.merge_vertices()
    if not mesh.is_watertight and thickness is None:
        # a solid may be open along the seams of its texture only
        mesh.merge_vertices(merge_tex=True, merge_norm=True)
    good = mesh.area_faces > 1e-14 * np.ptp(mesh.vertices, axis=0).max() ** 2
    if not good.all():
        warnings.warn(f"{name}: dropped {np.count_nonzero(~good)} faces without area", MeshRepairWarning, stacklevel=4)
        mesh.update_faces(good)
        thickness = thickness[good] if thickness is not None and thickness.ndim else thickness
    if not len(mesh.faces):
        raise InputError(f"{name}: all its faces are without area")
    mesh.remove_unreferenced_vertices()
    if thickness is not None:
        if mesh.is_watertight:
            raise InputError(f"{name}: is closed, so it takes no thickness; remove the thickness, or open the mesh")
        return mesh, np.broadcast_to(thickness, (len(mesh.faces),)).copy()
    if not mesh.is_watertight:
        raise InputError(f"{name}: {open_edge_text(mesh)}")
    orient_outward(mesh, name)
    return mesh, None


def open_edge_text(mesh: trimesh.Trimesh) -> str:
    """What keeps a mesh from being closed, with an edge as an example."""
    edges, counts = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
    free = counts == 1
    odd = edges[free if free.any() else counts != 2]
    if not len(odd):
        return "is not closed; it needs a thickness [m] to be a sheet"
    ends = " to ".join("(" + ", ".join(f"{x:.4g}" for x in mesh.vertices[end]) + ")" for end in odd[0])
    if free.any():
        return f"is open (it has free edges, as {ends}), so it needs a thickness [m] to be a sheet; or close it"
    return f"{counts[counts != 2][0]} faces meet at the edge {ends}; a closed body must have exactly 2 at every edge"


def orient_outward(mesh: trimesh.Trimesh, name: str) -> None:
    """Give a watertight mesh one outward orientation, in place, and say so when it had another."""
    if not mesh.is_winding_consistent:
        trimesh.repair.fix_normals(mesh, multibody=True)
        if not mesh.is_winding_consistent:
            raise InputError(f"{name}: its faces have no consistent orientation; recalculate the normals outward")
        warnings.warn(f"{name}: flipped faces to one consistent orientation", MeshRepairWarning, stacklevel=5)
    if mesh.volume < 0.0:
        mesh.invert()
        warnings.warn(f"{name}: turned inside out, its faces pointed inward", MeshRepairWarning, stacklevel=5)
    size = np.ptp(mesh.vertices, axis=0).max()
    if mesh.volume < 1e-9 * size**3:
        raise InputError(f"{name}: encloses no volume; a sheet must be open and have a thickness")


def assemble(
    surface: trimesh.Trimesh,
    integrals: VolumeIntegrals,
    density: float,
    thickness: Array | None,
    ballast: Sequence[PointMass],
) -> Shape:
    """Put a prepared mesh and its volume integrals together into a Shape, in its principal frame."""
    body: MassProperties = mass_properties(integrals, density, ballast)
    if not (np.isfinite(body.inertia).all() and body.inertia.min() > 0.0):
        raise InputError("mesh: its moments of inertia are not positive; it is degenerate or far too small")
    to_principal = np.eye(4)
    to_principal[:3, :3] = body.rotation.T
    to_principal[:3, 3] = -body.rotation.T @ body.center_of_mass
    local = surface.copy()
    local.apply_transform(to_principal)
    buoyancy = body.rotation.T @ (integrals.centroid - body.center_of_mass)
    if thickness is None:
        center = buoyancy
        spread = np.diag(body.rotation.T @ integrals.second_moment @ body.rotation) / integrals.volume
        semi_axes = np.sqrt(5.0 * spread)
        semi_axes *= (integrals.volume / (4.0 / 3.0 * np.pi * semi_axes.prod())) ** (1.0 / 3.0)
    else:
        center, semi_axes = equal_ellipse(local.triangles)
        semi_axes[2] = integrals.volume / surface.area / 2.0
    return Shape(
        mesh=local,
        form="mesh",
        semi_axes=semi_axes,
        geometric_center=center,
        thickness=None if thickness is None else float(integrals.volume / surface.area),
        density=float(density),
        mass=body.mass,
        volume=integrals.volume,
        inertia=body.inertia,
        center_of_mass=body.center_of_mass,
        rotation=body.rotation,
        center_of_buoyancy=buoyancy,
    )


def equal_ellipse(triangles: Array) -> tuple[Array, Array]:
    """Centre (3,) and semi-axes (3,) of the ellipse of equal area and second moments, seen along z.

    triangles: (F, 3, 3) in the principal frame, whose x and y are taken as the ellipse's axes.
    """
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    facing = np.abs(normals[:, 2]) / np.linalg.norm(normals, axis=1)
    area, first, second = triangle_moments(triangles, facing)
    center = first / area
    spread = np.diag(second) / area - center**2
    ratio = np.sqrt(spread[0] / spread[1])
    return center, np.array([np.sqrt(area * ratio / np.pi), np.sqrt(area / (ratio * np.pi)), 0.0])
