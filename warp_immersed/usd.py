"""USD out: one point instancer, in the encoding that Blender, Houdini, Maya and Omniverse all read."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Kind, Sdf, Tf, Usd, UsdGeom, UsdShade, UsdUtils, Vt

from warp_immersed.ensemble import Frame
from warp_immersed.errors import InputError
from warp_immersed.export_options import ExportOptions
from warp_immersed.looks import Prototype, look_indices, looks
from warp_immersed.mesh_normals import vertex_normals
from warp_immersed.output_files import discard, partial_path, publish
from warp_immersed.usd_samples import SampleWriter, save_layer, vt_array

WORLD = Sdf.Path("/World")
CROWD = WORLD.AppendChild("Crowd")

Ids = NDArray[np.int64]


class CrowdWriter(ABC):
    """Writes frames to a USD file as they come: beside the path, renamed to it when finished. What all forms share.

    Args:
        path: a .usdc, .usda, .usd or .usdz file. prototypes, fps, manifest: as in `Recording`.
        options: as they say. ids: (n,) ascending, which bodies to write; all by default.

    Raises:
        InputError: the options cannot make this file, or the disk is full or gone.
    """

    def __init__(
        self,
        path: Path,
        prototypes: tuple[Prototype, ...],
        fps: float,
        manifest: Mapping[str, Any],
        options: ExportOptions = ExportOptions(),  # noqa: B008, it is frozen
        ids: Ids | None = None,
    ):
        self.path = path
        self.prototypes, self.fps, self.manifest, self.options = prototypes, fps, manifest, options
        self.ids = np.arange(sum(prototype.count for prototype in prototypes)) if ids is None else ids
        options.check_output(path, 0, len(self.ids))
        self._first: int | None = None
        self._last = 0
        self._partial = partial_path(path).with_suffix(".usdc") if path.suffix == ".usdz" else partial_path(path)
        self.root: Any = None
        try:
            self.root = new_layer(self._partial)
            stage = Usd.Stage.Open(self.root)
            self.describe(stage)
            world = UsdGeom.Xform.Define(stage, WORLD)
            Usd.ModelAPI(world.GetPrim()).SetKind(Kind.Tokens.assembly)
            stage.SetDefaultPrim(world.GetPrim())
            self._begin(stage)
            # from here on the layer alone is written: a stage would be told of every sample
            del stage
            save_layer(self.root, path)
        except BaseException:
            self.abort()
            raise

    @abstractmethod
    def _begin(self, stage: Usd.Stage) -> None:
        """Put what does not move into the root."""

    @abstractmethod
    def _write(self, frame: Frame) -> None:
        """Append a frame."""

    @abstractmethod
    def _end(self, first: int, last: int) -> None:
        """All frames have come, first to last: complete all but the root's time range."""

    def describe(self, stage: Usd.Stage) -> None:
        """Units, axes, rates and where the file comes from."""
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y if self.options.up_axis == "y" else UsdGeom.Tokens.z)
        UsdGeom.SetStageMetersPerUnit(stage, 1.0 if self.options.units == "m" else UsdGeom.LinearUnits.centimeters)
        stage.SetTimeCodesPerSecond(self.options.rate(self.fps))
        stage.SetFramesPerSecond(self.options.rate(self.fps))
        stage.GetRootLayer().customLayerData = {
            "warp_immersed": {name: value for name, value in self.manifest.items() if isinstance(value, (str, int, float))}
        }

    def samples(self, layer: Sdf.Layer, prim: Sdf.Path, ids: Ids) -> SampleWriter:
        """What writes the motion of these bodies to a prim of a layer."""
        radius = max(prototype.radius for prototype in self.prototypes)
        return SampleWriter(layer, prim, self.path, rows_of(ids), radius, self.options, self.fps)

    def set_time_range(self, layer: Sdf.Layer, first: int, last: int) -> None:
        """Start and end time code from the first and last frame."""
        layer.startTimeCode = self.options.time_code(first, self.fps)
        layer.endTimeCode = self.options.time_code(last, self.fps)

    def write(self, frame: Frame) -> None:
        """Append a frame.

        Raises:
            InputError: the disk is full or gone.
        """
        if self._first is None:
            self._first = frame.index
        self._last = frame.index
        self._write(frame)

    def finish(self) -> None:
        """Set the time range, save, and give the file its name.

        Raises:
            InputError: the disk is full or gone.
        """
        first = self._first or 0
        self._end(first, self._last)
        self.set_time_range(self.root, first, self._last)
        save_layer(self.root, self.path)
        self.root = None
        if self.path.suffix == ".usdz":
            package(self._partial, self.path)
            self._partial.unlink()
        publish(self.path)

    def abort(self) -> None:
        """Leave nothing behind."""
        self.root = None
        self._partial.unlink(missing_ok=True)
        discard(self.path)


class UsdWriter(CrowdWriter):
    """One file with one point instancer. Args, Raises: as `CrowdWriter`."""

    def _begin(self, stage: Usd.Stage) -> None:
        create_crowd(stage, CROWD, self.prototypes, self.ids, self.options)
        self._samples = self.samples(self.root, CROWD, self.ids)

    def _write(self, frame: Frame) -> None:
        self._samples.write(frame)

    def _end(self, first: int, last: int) -> None:
        del self._samples


def rows_of(ids: Ids) -> slice | Ids:
    """The rows of these bodies in a frame's arrays, as a slice where they are evenly spaced: that copies nothing."""
    step = int(ids[1] - ids[0]) if len(ids) > 1 else 1
    even = slice(int(ids[0]), int(ids[-1]) + 1, step)
    return even if (np.diff(ids) == step).all() else ids


def new_layer(path: Path) -> Sdf.Layer:
    """An empty layer in a new file."""
    path.unlink(missing_ok=True)
    return Sdf.Layer.CreateNew(str(path))


def package(layer: Path, target: Path) -> None:
    """Make the partial file of `target`, a .usdz, of a layer and what it refers to: uncompressed, aligned to 64 bytes.

    Raises:
        InputError: the disk is full or gone.
    """
    partial = partial_path(target)
    try:
        made = UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(layer)), str(partial), f"{target.stem}.usdc")
    except Tf.ErrorException as error:
        raise InputError(f"output {str(target)!r}: cannot write ({str(error).splitlines()[0]})") from error
    if not made:
        raise InputError(f"output {str(target)!r}: cannot write (no package was made)")


def create_crowd(
    stage: Usd.Stage, path: Sdf.Path, prototypes: tuple[Prototype, ...], ids: Ids, options: ExportOptions
) -> UsdGeom.PointInstancer:
    """The point instancer with its prototypes and everything about it that does not move."""
    instancer = UsdGeom.PointInstancer.Define(stage, path)
    UsdGeom.Scope.Define(stage, path.AppendChild("Prototypes"))
    UsdGeom.Scope.Define(stage, path.AppendChild("Looks"))
    wardrobe = looks(prototypes)
    colors = np.array([look.colors[0] for look in wardrobe], dtype=np.float32)
    indices = look_indices(prototypes)[ids]
    used, indices_of_used = np.unique(indices, return_inverse=True)
    for index in used:
        look = wardrobe[index]
        mesh_path, look_path = path.AppendPath(f"Prototypes/{look.name}"), path.AppendPath(f"Looks/{look.name}")
        create_mesh(stage, mesh_path, look_path, look, options.units_per_meter)
        instancer.GetPrototypesRel().AddTarget(mesh_path)
    instancer.CreateProtoIndicesAttr(vt_array(Vt.IntArray, indices_of_used.astype(np.int32)))
    instancer.CreateIdsAttr(vt_array(Vt.Int64Array, ids))
    instancer.CreateScalesAttr(vt_array(Vt.Vec3fArray, np.ones((len(ids), 3), dtype=np.float32)))
    display = UsdGeom.PrimvarsAPI(instancer).CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.vertex)
    display.Set(vt_array(Vt.Vec3fArray, colors[indices]))
    return instancer


def create_mesh(
    stage: Usd.Stage, mesh_path: Sdf.Path, look_path: Sdf.Path, prototype: Prototype, units_per_meter: float
) -> UsdGeom.Mesh:
    """A prototype of one colour as a mesh with its material."""
    mesh = UsdGeom.Mesh.Define(stage, mesh_path)
    vertices = prototype.vertices * np.float32(units_per_meter)
    mesh.CreatePointsAttr(vt_array(Vt.Vec3fArray, vertices))
    mesh.CreateFaceVertexCountsAttr(vt_array(Vt.IntArray, np.full(len(prototype.faces), 3, dtype=np.int32)))
    mesh.CreateFaceVertexIndicesAttr(vt_array(Vt.IntArray, prototype.faces.ravel()))
    mesh.CreateNormalsAttr(vt_array(Vt.Vec3fArray, vertex_normals(vertices, prototype.faces)))
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    mesh.CreateDoubleSidedAttr(prototype.is_sheet)
    mesh.CreateExtentAttr(vt_array(Vt.Vec3fArray, np.stack([vertices.min(axis=0), vertices.max(axis=0)])))
    primvars = UsdGeom.PrimvarsAPI(mesh)
    st = primvars.CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex)
    st.Set(vt_array(Vt.Vec2fArray, prototype.uv))
    color = Gf.Vec3f(*prototype.colors[0])
    mesh.CreateDisplayColorAttr([color])
    material = UsdShade.Material.Define(stage, look_path)
    shader = UsdShade.Shader.Define(stage, material.GetPath().AppendChild("Surface"))
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(color)
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(prototype.roughness)
    shader.CreateInput("metallic", Sdf.ValueTypeNames.Float).Set(prototype.metallic)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    return mesh
