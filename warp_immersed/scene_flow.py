"""The flow that varies in space which a scene asks for: a bake file, a field to bake, or a boundary layer."""

from collections.abc import Callable
from pathlib import Path

from warp_immersed.bake import cached_bake
from warp_immersed.boundaries import LogInlet
from warp_immersed.errors import InputError
from warp_immersed.field_scene import FieldScene, FieldTables
from warp_immersed.k_epsilon import Progress
from warp_immersed.scene import BoundaryLayerTable, GridTable, Scene
from warp_immersed.tensor_cache import cache_directory
from warp_immersed.turbulence_grid import TurbulenceGrid


def scene_flow(
    scene: Scene, device: str = "cpu", progress: Callable[[Progress], None] | None = None
) -> TurbulenceGrid | LogInlet | None:
    """The flow of a scene, or None where its wind is uniform. A field is baked once and kept in the user's cache by content.

    Raises:
        InputError: a file or value cannot be used. DivergedError: the field has no finite solution.
    """
    table = scene.turbulence
    try:
        if isinstance(table, BoundaryLayerTable):
            ground = scene.ground.height if scene.ground is not None else 0.0
            speed, height = table.reference_speed, table.reference_height
            return LogInlet.from_reference(table.direction, speed, height, table.roughness, ground)
        if isinstance(table, GridTable):
            return TurbulenceGrid.load(bake_file(scene, table.field, device, progress))
    except InputError as error:
        raise InputError(f"{scene.name}.toml: turbulence: {error}") from error
    return None


def bake_file(scene: Scene, field: str | FieldTables, device: str, progress: Callable[[Progress], None] | None) -> Path:
    """The bake file that a `field` key stands for, made if need be."""
    if isinstance(field, str):
        path = scene.folder / Path(field).expanduser()
        if path.suffix != ".toml":
            return path
        described = FieldScene.load(path)
    else:
        described = FieldScene(field, field.model_dump_json(), scene.folder, "field")
    return cached_bake(described, cache_directory() / "fields", device, progress=progress)
