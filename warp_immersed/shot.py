"""`Shot`: a recording or a USD file as pictures need it: meshes, one look a body, and frames read when asked for."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from warp_immersed.errors import InputError
from warp_immersed.looks import look_indices, looks
from warp_immersed.recording import open_recording
from warp_immersed.scene import Scene
from warp_immersed.scene_ground import scene_ground_mesh
from warp_immersed.shape import RGB

if TYPE_CHECKING:
    from pxr import Usd, UsdGeom

Array = NDArray[Any]
USD_ENDINGS = (".usdc", ".usda", ".usd", ".usdz")


@dataclass(frozen=True, eq=False)
class Look:
    """One mesh in one colour: name; vertices (V, 3) [m]; faces (F, 3); linear RGB; roughness and metallic of its surface."""

    name: str
    vertices: Array
    faces: Array
    color: RGB
    roughness: float
    metallic: float


@dataclass(frozen=True)
class Poses:
    """All bodies at one frame, y up: positions (N, 3) [m], orientations (N, 4) (x, y, z, w), velocities (N, 3) [m/s] and
    spins (N, 3) [rad/s]."""

    positions: Array
    orientations: Array
    velocities: Array
    spins: Array


@dataclass(frozen=True, eq=False)
class Shot:
    """What there is to see.

    name; fps; frames: how many; looks, and look_of (N,), which of them each body wears; poses: reads a frame; scene: the
    one it was made from, if the file says so; ground: what stands on its ground plane.
    """

    name: str
    fps: float
    frames: int
    looks: tuple[Look, ...]
    look_of: NDArray[np.int32]
    poses: Callable[[int], Poses]
    scene: Scene | None
    ground: trimesh.Trimesh | None


@contextmanager
def open_shot(path: str | Path) -> Iterator[Shot]:
    """Open a recording (.h5) or a USD file with point instancers.

    Raises:
        InputError: no such file, another kind of file, damaged, or nothing in it to show.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{str(path)!r}: no such file")
    if path.suffix == ".h5":
        with open_recording(path) as recording:
            scene, ground = scene_of(recording.manifest, path.parent)
            yield Shot(
                name=path.stem,
                fps=recording.fps,
                frames=len(recording.times),
                looks=tuple(
                    Look(one.name, one.vertices, one.faces, one.colors[0], one.roughness, one.metallic)
                    for one in looks(recording.prototypes)
                ),
                look_of=look_indices(recording.prototypes),
                poses=lambda i: Poses(
                    recording.positions[i],
                    recording.orientations[i],
                    recording.velocities[i],
                    recording.angular_velocities[i],
                ),
                scene=scene,
                ground=ground,
            )
    elif path.suffix in USD_ENDINGS:
        yield usd_shot(path)
    else:
        raise InputError(f"{str(path)!r}: found ending {path.suffix!r}, must be .h5 or one of {', '.join(USD_ENDINGS)}")


def scene_of(manifest: Mapping[str, Any], folder: Path) -> tuple[Scene | None, trimesh.Trimesh | None]:
    """The scene a file was made from and what stands on its ground; None for what it does not say or is not found."""
    text = str(manifest.get("scene_text", ""))
    if not text:
        return None, None
    try:
        scene = Scene.from_text(text, str(manifest.get("scene", "scene")), folder)
    except InputError:
        return None, None
    try:
        return scene, scene_ground_mesh(scene)
    except InputError:
        return scene, None


def usd_shot(path: Path) -> Shot:
    """The point instancers of a USD file, in metres with y up."""
    from pxr import Tf, Usd, UsdGeom

    try:
        stage = Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        raise InputError(f"{str(path)!r}: cannot be read as USD ({str(error).splitlines()[0]})") from error
    instancers = [UsdGeom.PointInstancer(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.PointInstancer)]
    if not instancers:
        raise InputError(f"{str(path)!r}: holds no point instancer, so there is nothing to show")
    meters = UsdGeom.GetStageMetersPerUnit(stage)
    upright = np.eye(3) if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.y else np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0.0]])
    turn = quaternion_of(upright)
    paths = [instancer.GetPath() for instancer in instancers]
    found: list[Look] = []
    look_of = []
    for instancer in instancers:
        first = len(found)
        targets = instancer.GetPrototypesRel().GetForwardedTargets()
        found += [usd_look(stage, target, meters) for target in targets]
        look_of.append(first + np.asarray(instancer.GetProtoIndicesAttr().Get(Usd.TimeCode.EarliestTime()), dtype=np.int32))
    start, end = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    per_frame = stage.GetTimeCodesPerSecond() / (stage.GetFramesPerSecond() or stage.GetTimeCodesPerSecond())

    def poses(index: int) -> Poses:
        # by path: the prims live as long as the stage, which this keeps
        parts = [instancer_poses(UsdGeom.PointInstancer.Get(stage, path), start + index * per_frame) for path in paths]
        positions, orientations, velocities, spins = (np.concatenate(part) for part in zip(*parts, strict=True))
        return Poses(
            positions @ upright.T * meters,
            product(turn, orientations),
            velocities @ upright.T * meters,
            np.radians(spins) @ upright.T,
        )

    manifest = stage.GetRootLayer().customLayerData.get("warp_immersed", {})
    scene, ground = scene_of(manifest, path.parent)
    return Shot(
        name=path.stem,
        fps=stage.GetFramesPerSecond(),
        frames=round((end - start) / per_frame) + 1,
        looks=tuple(found),
        look_of=np.concatenate(look_of),
        poses=poses,
        scene=scene,
        ground=ground,
    )


def usd_look(stage: "Usd.Stage", path: Any, meters: float) -> Look:
    """A prototype mesh with the diffuse colour of its UsdPreviewSurface."""
    from pxr import UsdGeom, UsdShade

    mesh = UsdGeom.Mesh(stage.GetPrimAtPath(path))
    points, indices = mesh.GetPointsAttr().Get(), mesh.GetFaceVertexIndicesAttr().Get()
    counts = mesh.GetFaceVertexCountsAttr().Get()
    if not points or not indices or set(counts) != {3}:
        raise InputError(f"prototype {path}: is not a mesh of triangles")
    color, values = (0.5, 0.5, 0.5), {"roughness": 0.7, "metallic": 0.0}
    material, _ = UsdShade.MaterialBindingAPI(mesh.GetPrim()).ComputeBoundMaterial()
    surface = material.ComputeSurfaceSource()[0] if material else None
    if surface:
        diffuse = surface.GetInput("diffuseColor").Get()
        color = tuple(diffuse) if diffuse is not None else color
        for name in values:
            written = surface.GetInput(name)
            values[name] = float(written.Get()) if written and written.Get() is not None else values[name]
    red, green, blue = (float(c) for c in color)
    vertices, faces = np.asarray(points) * meters, np.asarray(indices).reshape(-1, 3)
    return Look(path.name, vertices, faces, (red, green, blue), **values)


def instancer_poses(instancer: "UsdGeom.PointInstancer", code: float) -> tuple[Array, Array, Array, Array]:
    """Positions, orientations (x, y, z, w), velocities and spins [degrees/s] of an instancer at a time code, in stage units."""
    positions = np.asarray(instancer.GetPositionsAttr().Get(code), dtype=np.float64)
    written = instancer.GetOrientationsAttr().Get(code)
    orientations = np.asarray(written, dtype=np.float64).reshape(-1, 4)  # USD keeps the imaginary part first
    rates = [
        np.zeros_like(positions) if value is None else np.asarray(value, dtype=np.float64)
        for value in (instancer.GetVelocitiesAttr().Get(code), instancer.GetAngularVelocitiesAttr().Get(code))
    ]
    return positions, orientations, rates[0], rates[1]


def quaternion_of(rotation: Array) -> Array:
    """Unit quaternion (4,), (x, y, z, w), of a rotation matrix."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_matrix(rotation).as_quat()


def product(q: Array, p: Array) -> Array:
    """Quaternion products q p of one q (4,) with many p (N, 4), (x, y, z, w)."""
    v, w = q[:3], q[3]
    u, s = p[:, :3], p[:, 3:]
    return np.concatenate([w * u + s * v + np.cross(v, u), w * s - (u @ v)[:, None]], axis=1)


def rotation_matrices(q: Array) -> Array:
    """Rotation matrices (N, 3, 3) of quaternions (N, 4), (x, y, z, w), of any length."""
    x, y, z, w = (q / np.maximum(np.linalg.norm(q, axis=1, keepdims=True), 1e-12)).astype(np.float64).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)
