"""USD out: one point instancer, in the encoding that Blender, Houdini, Maya and Omniverse all read."""

import ctypes
import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Kind, Sdf, Tf, Usd, UsdGeom, UsdShade, Vt

from warp_immersed.ensemble import Frame
from warp_immersed.errors import InputError
from warp_immersed.mesh_normals import vertex_normals
from warp_immersed.recording import Prototype, Recording, partial_path

# Frames between saves: each appends to the file, so that memory stays bounded and a crash loses little.
FRAMES_PER_SAVE = 24
FIRST_TIME_CODE = 1
ENDINGS = (".usdc", ".usda", ".usd")

CROWD = Sdf.Path("/World/Crowd")


class UsdWriter:
    """Writes frames to a USD file as they come: beside the path, renamed to it when finished.

    Velocities are per second, angular velocities in degrees per second in the instancer's frame; time code 1 is the
    first frame. Landed bodies stay, so array lengths never change.
    """

    def __init__(self, path: Path, prototypes: tuple[Prototype, ...], fps: float, manifest: Mapping[str, Any]):
        if path.suffix not in ENDINGS:
            raise InputError(f"output {str(path)!r}: found ending {path.suffix!r}, must be one of {', '.join(ENDINGS)}")
        self.path = path
        self._partial = partial_path(path)
        self._partial.unlink(missing_ok=True)
        self._radius = max(prototype.radius for prototype in prototypes)
        self._frames = 0
        self._layer = Sdf.Layer.CreateNew(str(self._partial))
        stage = Usd.Stage.Open(self._layer)
        describe_stage(stage, fps, manifest)
        create_crowd(stage, prototypes)
        # from here on the layer alone is written: a stage would be told of every sample
        del stage
        self._samples = {
            name: self._layer.GetAttributeAtPath(CROWD.AppendProperty(name)).path
            for name in ("positions", "orientations", "velocities", "angularVelocities", "extent")
        }
        self._layer.Save()

    def write(self, frame: Frame) -> None:
        """Append a frame."""
        time_code = FIRST_TIME_CODE + self._frames
        positions = np.ascontiguousarray(frame.positions, dtype=np.float32)
        by_axis = np.ascontiguousarray(positions.T)  # numpy reduces this way ten times faster
        margin = self._radius * 1.001 + 1e-6 * np.abs(by_axis).max()
        extent = np.stack([by_axis.min(axis=1) - margin, by_axis.max(axis=1) + margin])
        for name, array_type, values in (
            ("positions", Vt.Vec3fArray, positions),
            ("orientations", Vt.QuathArray, frame.orientations.astype(np.float16)),
            ("velocities", Vt.Vec3fArray, frame.velocities),
            ("angularVelocities", Vt.Vec3fArray, np.degrees(frame.angular_velocities)),
            ("extent", Vt.Vec3fArray, extent),
        ):
            self._layer.SetTimeSample(self._samples[name], time_code, vt_array(array_type, values))
        self._frames += 1
        if self._frames % FRAMES_PER_SAVE == 0:
            self._save()

    def finish(self) -> None:
        """Set the time range, save, and give the file its name."""
        self._layer.startTimeCode = FIRST_TIME_CODE
        self._layer.endTimeCode = FIRST_TIME_CODE + self._frames - 1
        self._save()
        self._layer = None
        os.replace(self._partial, self.path)

    def abort(self) -> None:
        """Leave nothing behind."""
        self._layer = None
        self._partial.unlink(missing_ok=True)

    def _save(self) -> None:
        try:
            saved = self._layer.Save()
            reason = "not saved"
        except Tf.ErrorException as error:
            saved, reason = False, write_error(str(error))
        if not saved:
            raise InputError(f"output {str(self.path)!r}: cannot write ({reason})")


def export_usd(recording: Recording, path: str | Path) -> None:
    """Write a recording to a USD file (.usdc, .usda or .usd).

    Raises:
        InputError: another ending.
    """
    writer = UsdWriter(Path(path), recording.prototypes, recording.fps, recording.manifest)
    try:
        for index in range(len(recording.times)):
            writer.write(recording.frame(index))
        writer.finish()
    except BaseException:
        writer.abort()
        raise


def write_error(text: str) -> str:
    """What the system said, out of USD's account of where it heard it."""
    said = re.search(r"Error occurred writing file: ([^']*)'", text)
    return said.group(1) if said else text.splitlines()[0]


def vt_array(array_type: Any, values: NDArray[Any]) -> Any:
    """A USD array with the values of a numpy array of its element type, copied as a block.

    USD's own conversion goes element by element with Python's lock held. The block copy relies on VtArray showing its
    memory through the buffer protocol; where it does not look as expected, USD's conversion is used.
    """
    array = array_type(len(values))
    view = np.asarray(array)
    values = np.ascontiguousarray(values, dtype=view.dtype)
    if view.shape == values.shape and view.flags.c_contiguous and view.ctypes.data:
        ctypes.memmove(view.ctypes.data, values.ctypes.data, values.nbytes)
        return array
    return array_type.FromNumpy(values)


def describe_stage(stage: Usd.Stage, fps: float, manifest: Mapping[str, Any]) -> None:
    """Units, axes, rates, the root prim and where the file comes from."""
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(fps)
    stage.SetFramesPerSecond(fps)
    stage.SetStartTimeCode(FIRST_TIME_CODE)
    stage.SetEndTimeCode(FIRST_TIME_CODE)
    stage.GetRootLayer().customLayerData = {
        "warp_immersed": {name: value for name, value in manifest.items() if isinstance(value, (str, int, float))}
    }
    world = UsdGeom.Xform.Define(stage, "/World")
    Usd.ModelAPI(world.GetPrim()).SetKind(Kind.Tokens.assembly)
    stage.SetDefaultPrim(world.GetPrim())


def create_crowd(stage: Usd.Stage, prototypes: tuple[Prototype, ...]) -> None:
    """The point instancer with its prototypes and everything about it that does not move."""
    instancer = UsdGeom.PointInstancer.Define(stage, CROWD)
    UsdGeom.Scope.Define(stage, CROWD.AppendChild("Prototypes"))
    UsdGeom.Scope.Define(stage, CROWD.AppendChild("Looks"))
    for prototype in prototypes:
        mesh = create_mesh(stage, prototype)
        instancer.GetPrototypesRel().AddTarget(mesh.GetPath())
    counts = [prototype.count for prototype in prototypes]
    bodies = sum(counts)
    colors = np.repeat(np.array([prototype.color for prototype in prototypes], dtype=np.float32), counts, axis=0)
    instancer.CreateProtoIndicesAttr(vt_array(Vt.IntArray, np.repeat(np.arange(len(counts), dtype=np.int32), counts)))
    instancer.CreateIdsAttr(vt_array(Vt.Int64Array, np.arange(bodies, dtype=np.int64)))
    instancer.CreateScalesAttr(vt_array(Vt.Vec3fArray, np.ones((bodies, 3), dtype=np.float32)))
    display = UsdGeom.PrimvarsAPI(instancer).CreatePrimvar("displayColor", Sdf.ValueTypeNames.Color3fArray, UsdGeom.Tokens.vertex)
    display.Set(vt_array(Vt.Vec3fArray, colors))
    instancer.CreatePositionsAttr()
    instancer.CreateOrientationsAttr()
    instancer.CreateVelocitiesAttr()
    instancer.CreateAngularVelocitiesAttr()
    instancer.CreateExtentAttr()


def create_mesh(stage: Usd.Stage, prototype: Prototype) -> UsdGeom.Mesh:
    """A prototype as a mesh with its material."""
    mesh = UsdGeom.Mesh.Define(stage, CROWD.AppendPath(f"Prototypes/{prototype.name}"))
    vertices = prototype.vertices
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
    color = Gf.Vec3f(*prototype.color)
    mesh.CreateDisplayColorAttr([color])
    material = UsdShade.Material.Define(stage, CROWD.AppendPath(f"Looks/{prototype.name}"))
    shader = UsdShade.Shader.Define(stage, material.GetPath().AppendChild("Surface"))
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(color)
    shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(0.7)
    material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
    return mesh
