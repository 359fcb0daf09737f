"""Pictures of a shot, path-traced on the CPU by Mitsuba 3: no display, no GPU and no system library is needed."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warp_immersed.errors import InputError
from warp_immersed.framing import Camera, camera_of
from warp_immersed.shape import RGB
from warp_immersed.shot import Look, Poses, Shot, rotation_matrices

Array = NDArray[Any]

SUN_DIRECTION = np.array([-0.45, -0.78, -0.42]) / np.linalg.norm([-0.45, -0.78, -0.42])
BOUNCES = 3
# Bodies so near that they would be larger than this part of the picture are in the lens's way and left out.
LARGEST_SHOWN = 0.15
# The ground fades into the horizon from here to there, in distances from the camera to its target.
HAZE = (1.5, 25.0)


@dataclass(frozen=True)
class Air:
    """What surrounds the bodies, linear RGB radiances: sky overhead and at the horizon, irradiance of the sun; ground colour."""

    zenith: RGB
    horizon: RGB
    sun: RGB
    ground: RGB


OUTDOORS = Air(zenith=(0.26, 0.42, 0.70), horizon=(0.72, 0.79, 0.86), sun=(2.4, 2.15, 1.75), ground=(0.20, 0.19, 0.16))
UNDER_WATER = Air(zenith=(0.20, 0.55, 0.60), horizon=(0.02, 0.13, 0.18), sun=(1.1, 1.9, 1.8), ground=(0.42, 0.36, 0.26))
# Reflectance of what is built: obstacles and meshes.
PLASTER = (0.55, 0.50, 0.42)


def mitsuba() -> ModuleType:
    """The renderer, in its variant for any CPU.

    Raises:
        InputError: it is not installed.
    """
    try:
        import mitsuba as mi
    except ImportError as error:
        raise InputError(f"preview: needs {error.name or error}; pip install 'warp-immersed[preview]'") from error
    mi.set_variant("scalar_rgb")
    mi.set_log_level(mi.LogLevel.Error)
    return mi


class Photographer:
    """Takes pictures of one shot from one camera.

    Args:
        shot: what to see. width, height: of a picture in pixels. samples: light paths a pixel; noise falls with its root.

    Raises:
        InputError: Mitsuba is not installed.
    """

    def __init__(self, shot: Shot, width: int, height: int, samples: int):
        self._mi = mitsuba()
        self._shot, self._size, self._samples = shot, (width, height), samples
        self._camera = camera_of(shot, width / height)
        self._air = air_of(shot)
        self._set = self._scenery()
        self._radius = np.array([np.linalg.norm(look.vertices, axis=1).max() for look in shot.looks])[shot.look_of]

    def take(self, frames: Sequence[int]) -> NDArray[np.uint8]:
        """A picture (height, width, 3), sRGB, of a frame, or of several on one plate."""
        mi, bodies = self._mi, {}
        for frame in frames:
            bodies.update(self._bodies(frame, self._shot.poses(frame)))
        # one seed for all frames: noise that stands still disturbs less than noise that boils
        image = mi.render(mi.load_dict({**self._set, **bodies}), seed=0)
        return srgb(np.asarray(image)[..., :3])

    def _bodies(self, frame: int, poses: Poses) -> dict[str, Any]:
        """The instances that the camera may see in a frame, for Mitsuba."""
        transforms = np.tile(np.eye(4), (len(poses.positions), 1, 1))
        transforms[:, :3, :3] = rotation_matrices(poses.orientations)
        transforms[:, :3, 3] = poses.positions
        seen = np.flatnonzero(in_view(self._camera, poses.positions, self._radius, self._size[0] / self._size[1]))
        transform, looks = self._mi.ScalarTransform4f, self._shot.look_of
        return {
            f"body_{frame}_{i}": {
                "type": "instance",
                "to_world": transform(transforms[i]),
                "shapes": {"type": "ref", "id": f"look_{looks[i]}"},
            }
            for i in seen.tolist()
        }

    def _scenery(self) -> dict[str, Any]:
        """Everything but the bodies: camera, light, ground and the looks that bodies refer to."""
        mi, camera, air = self._mi, self._camera, self._air
        sensor = {
            "type": "perspective",
            "fov": camera.field_of_view,
            "fov_axis": "x",
            "near_clip": 1e-3,
            "far_clip": 1e5,
            "to_world": mi.ScalarTransform4f().look_at(camera.position.tolist(), camera.target.tolist(), [0, 1, 0]),
            "film": {
                "type": "hdrfilm",
                "width": self._size[0],
                "height": self._size[1],
                "rfilter": {"type": "gaussian"},
            },
            "sampler": {"type": "multijitter", "sample_count": self._samples},
        }
        scenery = {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": BOUNCES},
            "sensor": sensor,
            "sky": {"type": "envmap", "bitmap": mi.Bitmap(sky(air))},
            "sun": {
                "type": "directional",
                "direction": SUN_DIRECTION.tolist(),
                "irradiance": {"type": "rgb", "value": list(air.sun)},
            },
        }
        for index, look in enumerate(self._shot.looks):
            scenery[f"look_{index}"] = {"type": "shapegroup", "mesh": self._mesh(look.name, look, surface(look))}
        for name, vertices, faces, color in self._grounds():
            colors = ground_colors(vertices, color, camera, air)
            scenery[name] = self._mesh(name, replace(GROUND, vertices=vertices, faces=faces), MATTE, colors)
        return scenery

    def _grounds(self) -> list[tuple[str, Array, Array, RGB]]:
        """Meshes of the ground and their colours: its plane as far as the eye sees, and what stands on it."""
        scene, grounds = self._shot.scene, []
        if scene is not None and scene.ground is not None:
            grounds.append(("plane", *plane_mesh(self._camera, scene.ground.height), self._air.ground))
            if self._shot.ground is not None:
                natural = scene.ground.mesh is None and not scene.ground.obstacles
                vertices, faces = np.asarray(self._shot.ground.vertices), np.asarray(self._shot.ground.faces)
                grounds.append(("relief", vertices, faces, self._air.ground if natural else PLASTER))
        return grounds

    def _mesh(self, name: str, look: Look, bsdf: dict[str, Any], colors: Array | None = None) -> Any:
        """A mesh for Mitsuba, seen from both sides, with a colour a vertex where given."""
        mi = self._mi
        properties = mi.Properties()
        properties["surface"] = mi.load_dict({"type": "twosided", "surface": bsdf})
        mesh = mi.Mesh(name, len(look.vertices), len(look.faces), has_vertex_normals=False, props=properties)
        if colors is not None:
            mesh.add_attribute("vertex_color", 3, np.ascontiguousarray(colors, dtype=np.float32).ravel())
        values = mi.traverse(mesh)
        values["vertex_positions"] = np.ascontiguousarray(look.vertices, dtype=np.float32).ravel()
        values["faces"] = np.ascontiguousarray(look.faces, dtype=np.uint32).ravel()
        values.update()
        return mesh


GROUND = Look("ground", np.zeros((0, 3)), np.zeros((0, 3)), (0.0, 0.0, 0.0), 1.0, 0.0)
MATTE = {"type": "diffuse", "reflectance": {"type": "mesh_attribute", "name": "vertex_color"}}


def air_of(shot: Shot) -> Air:
    """Light and ground of a shot: those of its fluid, with what its scene says of colours."""
    scene = shot.scene
    if scene is None:
        return OUTDOORS
    air = UNDER_WATER if scene.make_fluid().density > 100.0 else OUTDOORS
    if scene.view is not None and scene.view.ground is not None:
        air = replace(air, ground=scene.view.ground)
    if scene.view is not None and scene.view.sky is not None:
        red, green, blue = scene.view.sky
        air = replace(air, horizon=scene.view.sky, zenith=(0.55 * red, 0.65 * green, 0.8 * blue))
    return air


def surface(look: Look) -> dict[str, Any]:
    """A look's material for Mitsuba, which has the model UsdPreviewSurface comes from."""
    color = {"type": "rgb", "value": [float(min(c, 1.0)) for c in look.color]}
    return {"type": "principled", "base_color": color, "roughness": look.roughness, "metallic": look.metallic, "specular": 0.4}


def sky(air: Air) -> NDArray[np.float32]:
    """An environment map (64, 128, 3): zenith on top, the horizon across, and the ground's reflection below."""
    height = np.cos((np.arange(64) + 0.5) / 64.0 * np.pi)[:, None]
    up = np.clip(height, 0.0, 1.0) ** 0.6
    column = np.array(air.horizon) * (1.0 - up) + np.array(air.zenith) * up
    column = np.where(height < -0.05, 0.4 * np.array(air.horizon), column)
    return np.ascontiguousarray(np.broadcast_to(column[:, None], (64, 128, 3)), dtype=np.float32)


def plane_mesh(camera: Camera, height: float) -> tuple[Array, NDArray[np.int64]]:
    """A disk (vertices, faces) at y = height about what the camera looks at, in rings that widen to the horizon."""
    reach = max(float(np.linalg.norm(camera.position - camera.target)), 1e-3)
    radius = np.concatenate([[0.0], np.geomspace(0.05, 400.0, 60)]) * reach
    angle = np.linspace(0.0, 2.0 * np.pi, 97)
    x = camera.target[0] + np.outer(radius, np.cos(angle))
    z = camera.target[2] + np.outer(radius, np.sin(angle))
    vertices = np.stack([x, np.full_like(x, height), z], axis=-1)
    index = np.arange(x.size).reshape(x.shape)
    a, b, c, d = (corner.ravel() for corner in (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]))
    return vertices.reshape(-1, 3), np.concatenate([np.stack([a, c, b], axis=1), np.stack([a, d, c], axis=1)])


def ground_colors(vertices: Array, color: RGB, camera: Camera, air: Air) -> Array:
    """Reflectances (V, 3) of a ground of this colour that fade into the colour of the horizon far away, with faint patches."""
    reach = float(np.linalg.norm(camera.position - camera.target))
    distance = np.linalg.norm(vertices - camera.position, axis=1) / max(reach, 1e-3)
    step = np.clip(np.log(np.maximum(distance, 1e-3) / HAZE[0]) / np.log(HAZE[1] / HAZE[0]), 0.0, 1.0)[:, None]
    haze = step**2 * (3.0 - 2.0 * step)
    x, z = vertices[:, 0] / reach * 9.0, vertices[:, 2] / reach * 9.0
    patches = 1.0 + 0.07 * (np.sin(x + 1.3 * np.sin(0.7 * z)) * np.sin(1.1 * z + 1.7 * np.sin(0.6 * x)))[:, None]
    light = np.array(air.sun) * -SUN_DIRECTION[1] + np.pi * (0.5 * np.array(air.zenith) + 0.5 * np.array(air.horizon))
    far = np.clip(np.pi * np.array(air.horizon) / light, 0.0, 0.98)
    return np.clip(np.array(color) * patches * (1.0 - haze) + far * haze, 0.0, 1.0)


def in_view(camera: Camera, positions: Array, radius: Array, aspect: float) -> NDArray[np.bool_]:
    """Which bodies (N,) of these radii [m] a camera sees, with those whose shadow it may see."""
    forward = camera.target - camera.position
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right = right / max(float(np.linalg.norm(right)), 1e-12)
    offset = np.nan_to_num(positions, nan=-1e30) - camera.position
    depth = offset @ forward
    across = np.tan(np.radians(camera.field_of_view / 2.0)) * 1.15
    margin = 3.0 * radius
    near = radius / (LARGEST_SHOWN * np.tan(np.radians(camera.field_of_view / 2.0)))
    inside = (depth > near) & (np.abs(offset @ right) < across * np.maximum(depth, 0.0) + margin)
    return inside & (np.abs(offset @ np.cross(right, forward)) < across / aspect * np.maximum(depth, 0.0) + margin)


def srgb(linear: Array) -> NDArray[np.uint8]:
    """8-bit sRGB of linear RGB, its brightest parts rolled off instead of cut."""
    value = np.clip(np.asarray(linear, dtype=np.float64), 0.0, None)
    value = np.where(value > 0.75, 0.75 + 0.25 * (1.0 - np.exp(-(value - 0.75) / 0.25)), value)
    encoded = np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1.0 / 2.4) - 0.055)
    return (np.clip(encoded, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
