"""Emitters: where, how oriented and when bodies are released."""

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, field_validator

from warp_immersed.counter_random import uniforms
from warp_immersed.kernels.philox import STREAM_EMITTER

Array = NDArray[np.float64]
Number = Annotated[float, Field(allow_inf_nan=False, strict=True)]
NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False, strict=True)]
Vector = tuple[Number, Number, Number]
Quaternion = tuple[Number, Number, Number, Number]


class Release(BaseModel):
    """What all emitters share.

    orientation: "random", or one quaternion (x, y, z, w) for all, body to world. velocity [m/s] and
    angular_velocity [rad/s] at release, world axes. Bodies are released at random times between start and
    start + duration [s], and wait where they are until then.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    orientation: Literal["random"] | Quaternion = "random"
    velocity: Vector = (0.0, 0.0, 0.0)
    angular_velocity: Vector = (0.0, 0.0, 0.0)
    start: NotNegative = 0.0
    duration: NotNegative = 0.0

    @field_validator("orientation")
    @classmethod
    def _unit(cls, value: str | Quaternion) -> str | Quaternion:
        if isinstance(value, str):
            return value
        norm = float(np.linalg.norm(value))
        if abs(norm - 1.0) > 1e-3:
            raise ValueError(f"a quaternion (x, y, z, w) must have length 1, this one has {norm:.4g}")
        return value


class BoxEmitter(Release):
    """Uniformly in an axis-aligned box: center [m] and full edge lengths size [m]."""

    kind: Literal["box"]
    center: Vector
    size: tuple[NotNegative, NotNegative, NotNegative]


class DiskEmitter(Release):
    """Uniformly on a flat disk: center [m], radius [m], normal (any length)."""

    kind: Literal["disk"]
    center: Vector
    radius: NotNegative
    normal: Vector = (0.0, 1.0, 0.0)

    @field_validator("normal")
    @classmethod
    def _not_zero(cls, value: Vector) -> Vector:
        if not np.linalg.norm(value) > 0.0:
            raise ValueError("must not be the zero vector")
        return value


class PointsEmitter(Release):
    """At given points [m]: body i starts at point i modulo their number."""

    kind: Literal["points"]
    points: Annotated[tuple[Vector, ...], Field(min_length=1)]


Emitter = Annotated[BoxEmitter | DiskEmitter | PointsEmitter, Field(discriminator="kind")]


@dataclass(frozen=True)
class Emission:
    """Initial states of N bodies: positions (N, 3) [m] of their centres of mass, orientations (N, 4), velocities (N, 3)
    [m/s], angular_velocities (N, 3) [rad/s], release_times (N,) [s]; world axes."""

    positions: Array
    orientations: Array
    velocities: Array
    angular_velocities: Array
    release_times: Array


def emit(emitter: BoxEmitter | DiskEmitter | PointsEmitter, count: int, seed: int, key: int) -> Emission:
    """Initial states of bodies 0 ... count - 1; a body's own does not depend on how many there are."""
    place = uniforms(count, seed, key, STREAM_EMITTER, block=0)
    turn = uniforms(count, seed, key, STREAM_EMITTER, block=1)
    if isinstance(emitter, BoxEmitter):
        positions = np.asarray(emitter.center) + (place[:, :3] - 0.5) * np.asarray(emitter.size)
    elif isinstance(emitter, DiskEmitter):
        positions = np.asarray(emitter.center) + points_on_disk(place[:, :2], emitter.radius, np.asarray(emitter.normal))
    else:
        positions = np.asarray(emitter.points)[np.arange(count) % len(emitter.points)]
    if emitter.orientation == "random":
        orientations = random_rotations(turn[:, :3])
    else:
        quaternion = np.asarray(emitter.orientation, dtype=np.float64)
        orientations = np.tile(quaternion / np.linalg.norm(quaternion), (count, 1))
    return Emission(
        positions=positions,
        orientations=orientations,
        velocities=np.tile(np.asarray(emitter.velocity, dtype=np.float64), (count, 1)),
        angular_velocities=np.tile(np.asarray(emitter.angular_velocity, dtype=np.float64), (count, 1)),
        release_times=emitter.start + emitter.duration * place[:, 3],
    )


def lowest_start(emitter: BoxEmitter | DiskEmitter | PointsEmitter) -> float:
    """Lowest height y [m] at which the emitter may put a centre of mass."""
    if isinstance(emitter, BoxEmitter):
        return emitter.center[1] - emitter.size[1] / 2.0
    if isinstance(emitter, DiskEmitter):
        normal = np.asarray(emitter.normal) / np.linalg.norm(emitter.normal)
        return float(emitter.center[1] - emitter.radius * np.hypot(normal[0], normal[2]))
    return min(point[1] for point in emitter.points)


def points_on_disk(uniform: Array, radius: float, normal: Array) -> Array:
    """Points (N, 3) uniform on a disk about the origin, from uniform variates (N, 2)."""
    normal = normal / np.linalg.norm(normal)
    first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    r, angle = radius * np.sqrt(uniform[:, 0]), 2.0 * np.pi * uniform[:, 1]
    return np.outer(r * np.cos(angle), first) + np.outer(r * np.sin(angle), second)


def random_rotations(uniform: Array) -> Array:
    """Uniformly distributed unit quaternions (N, 4) from uniform variates (N, 3) (Shoemake, Graphics Gems III, 1992)."""
    u, v, w = uniform.T
    a, b = np.sqrt(1.0 - u), np.sqrt(u)
    return np.stack(
        [a * np.sin(2 * np.pi * v), a * np.cos(2 * np.pi * v), b * np.sin(2 * np.pi * w), b * np.cos(2 * np.pi * w)], axis=1
    )
