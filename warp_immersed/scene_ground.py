"""What a scene's bodies land on, above its ground plane."""

from pathlib import Path

import numpy as np
import trimesh

from warp_immersed.errors import InputError
from warp_immersed.height_field import hills_mesh, image_mesh
from warp_immersed.scene import GridTable, Scene
from warp_immersed.scene_flow import described_field
from warp_immersed.shape import load_mesh


def scene_ground_mesh(scene: Scene) -> trimesh.Trimesh | None:
    """What stands on the ground plane for bodies to land on, as one mesh; None if nothing does.

    Raises:
        InputError: a file cannot be used, or there are no obstacles to stand there.
    """
    if scene.ground is None:
        return None
    meshes = []
    try:
        if scene.ground.mesh is not None:
            meshes.append(load_mesh(scene.folder / Path(scene.ground.mesh).expanduser()))
        if scene.ground.hills is not None:
            hills = scene.ground.hills
            meshes.append(hills_mesh(hills.height, hills.length, hills.size, hills.center, scene.ground.height))
        if scene.ground.height_field is not None:
            field = scene.ground.height_field
            image = scene.folder / Path(field.image).expanduser()
            meshes.append(image_mesh(image, field.lowest, field.highest, field.size, field.center))
        if scene.ground.obstacles:
            flow = scene.turbulence.field if isinstance(scene.turbulence, GridTable) else None
            described = None if flow is None else described_field(scene, flow)
            if described is None:
                raise InputError("obstacles: need turbulence of kind 'grid' with its field, inline or as a .toml file")
            for obstacle in described.tables.obstacle:
                if obstacle.box is not None:
                    meshes.append(trimesh.creation.box(bounds=np.sort(np.array(obstacle.box, dtype=np.float64), axis=0)))
                else:
                    meshes.append(load_mesh(described.folder / str(obstacle.mesh)))
    except InputError as error:
        raise InputError(f"{scene.name}.toml: ground: {error}") from error
    if any(len(mesh.faces) == 0 for mesh in meshes):
        raise InputError(f"{scene.name}.toml: ground: mesh: has no faces, must be a triangle mesh")
    if not meshes:
        return None
    joined = trimesh.util.concatenate(meshes)
    assert isinstance(joined, trimesh.Trimesh)
    return joined
