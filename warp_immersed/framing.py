"""Where a picture is taken from: the scene's own camera, or one that frames the bodies."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warp_immersed.shot import Shot

Array = NDArray[np.float64]

FIELD_OF_VIEW = 35.0  # degrees, across
# Of the bodies this part fills the picture; stragglers may leave it.
FRAMED = (0.03, 0.97)
# A body should look at least this large, or the camera goes into the crowd.
SMALLEST_BODY = 1.0 / 80.0  # of the picture's width


@dataclass(frozen=True)
class Camera:
    """position and target (3,) [m]; field_of_view across the picture [degrees]."""

    position: Array
    target: Array
    field_of_view: float


def camera_of(shot: Shot, aspect: float) -> Camera:
    """The camera of a shot's scene, or one that shows where its bodies are over the whole shot; aspect: width / height."""
    if shot.scene is not None and shot.scene.view is not None:
        view = shot.scene.view
        return Camera(np.array(view.position), np.array(view.target), view.field_of_view)
    samples = np.concatenate([shot.poses(i).positions for i in np.unique(np.linspace(0, shot.frames - 1, 7).round().astype(int))])
    low, high = np.quantile(samples[np.isfinite(samples).all(axis=1)], FRAMED, axis=0)
    radius = max(float(np.linalg.norm(look.vertices, axis=1).max()) for look in shot.looks)
    center, half = (low + high) / 2.0, (high - low) / 2.0 + radius
    tangent = np.tan(np.radians(FIELD_OF_VIEW / 2.0))
    distance = max(half[0], half[1] * aspect) / tangent + half[2]
    closest = 2.0 * radius / SMALLEST_BODY / (2.0 * tangent) + 0.4 * half[2]
    distance = min(distance, max(closest, 6.0 * radius))
    away = np.array([0.35, 0.16, 1.0])
    position = center + distance * away / np.linalg.norm(away)
    if shot.scene is not None and shot.scene.ground is not None:
        position[1] = max(position[1], shot.scene.ground.height + 0.06 * distance)
    return Camera(position, center, FIELD_OF_VIEW)
