"""The ground of a scene as a USD file of its own, to import beside the crowd."""

from pathlib import Path

import numpy as np
import trimesh
from pxr import Usd, UsdGeom

from warp_immersed.errors import InputError
from warp_immersed.looks import Prototype
from warp_immersed.output_files import partial_path, publish
from warp_immersed.scene import Scene
from warp_immersed.scene_ground import scene_ground_mesh
from warp_immersed.usd import WORLD, create_mesh

EARTH = (0.16, 0.15, 0.12)
# A bare plane is drawn this large [m].
PLANE_SIZE = 60.0


def ground_prototype(scene: Scene) -> Prototype:
    """Everything a scene's bodies may land on, as one mesh: its plane, and what stands on it.

    Raises:
        InputError: the scene has no ground, or its files cannot be used.
    """
    if scene.ground is None:
        raise InputError(f"{scene.name}.toml: ground: missing, there is nothing to write")
    standing = scene_ground_mesh(scene)
    half = np.array([PLANE_SIZE / 2.0] * 2)
    low, high = -half, half
    if standing is not None:
        low, high = np.minimum(low, standing.bounds[0, [0, 2]]), np.maximum(high, standing.bounds[1, [0, 2]])
    y = scene.ground.height
    corners = [[low[0], y, low[1]], [high[0], y, low[1]], [high[0], y, high[1]], [low[0], y, high[1]]]
    plane = trimesh.Trimesh(corners, [[0, 2, 1], [0, 3, 2]], process=False)
    mesh = plane if standing is None else trimesh.util.concatenate([plane, standing])
    assert isinstance(mesh, trimesh.Trimesh)
    vertices = np.asarray(mesh.vertices, dtype=np.float32)
    color = scene.view.ground if scene.view is not None and scene.view.ground is not None else EARTH
    return Prototype("Ground", 1, vertices, np.asarray(mesh.faces, dtype=np.int32), vertices[:, [0, 2]], (color,), 0.9, 0.0, True)


def write_ground(scene: Scene, path: Path) -> None:
    """Write the ground of a scene to a .usdc, .usda or .usd file: metres, y up, under /World like the crowd.

    Raises:
        InputError: another ending, no ground, or files that cannot be used.
    """
    if path.suffix not in (".usdc", ".usda", ".usd"):
        raise InputError(f"output {str(path)!r}: found ending {path.suffix!r}, must be .usdc, .usda or .usd")
    ground = ground_prototype(scene)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial_path(path).unlink(missing_ok=True)
    stage = Usd.Stage.CreateNew(str(partial_path(path)))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, WORLD).GetPrim())
    create_mesh(stage, WORLD.AppendChild("Ground"), WORLD.AppendPath("Looks/Ground"), ground, 1.0)
    UsdGeom.Scope.Define(stage, WORLD.AppendChild("Looks"))
    stage.GetRootLayer().Save()
    del stage
    publish(path)
