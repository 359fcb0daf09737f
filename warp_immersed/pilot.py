"""A pilot run: how a body falls in still fluid by the full model, for the levels that do not work it out themselves."""

import hashlib
import json
import os
import tempfile
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from warp_immersed.body_model import BodyModel, PointModel
from warp_immersed.device_state import Group, Surroundings
from warp_immersed.emitters import Emission, random_rotations
from warp_immersed.ensemble import Ensemble
from warp_immersed.errors import InputError
from warp_immersed.fluid import Fluid
from warp_immersed.version import __version__

BODIES = 64
FRAMES, TRANSIENT = 160, 60
# A frame is half a length of fall, or longer for bodies that take long to reach their speed.
FRAME_LENGTHS = 0.5
RELAXATIONS = 8.0


@dataclass(frozen=True)
class Fall:
    """How bodies of one kind fall in still fluid, on average: speed along gravity [m/s], sideways speed of their mean paths
    [m/s], spin [rad/s]."""

    speed: float
    sideways: float
    spin: float


def pilot_fall(model: BodyModel, fluid: Fluid, gravity: float) -> Fall:
    """The fall of 64 bodies in all attitudes, released at rest; gravity [m/s^2]. Always on the CPU: every device gets the same.

    Raises:
        InputError: the body is too small or light to be followed by the full model.
    """
    speed, length = model.point.fall_speed, model.eddy_size
    if speed <= 0.0:
        return Fall(0.0, 0.0, 0.0)
    relaxation = speed * model.point.inertia / (abs(model.net_weight) * gravity)
    frame = max(FRAME_LENGTHS * length / speed, RELAXATIONS * relaxation / TRANSIENT)
    turns = random_rotations(np.random.default_rng(0).random((BODIES, 3)))
    still = np.zeros((BODIES, 3))
    start = Emission(still, turns, still, still, np.zeros(BODIES))
    surroundings = Surroundings(fluid, gravity=(0.0, -gravity, 0.0))
    ensemble = Ensemble([Group(model, start, 0)], surroundings, 1.0 / frame, "cpu", threads=1)
    begin, spins = still, []
    try:
        for shown in ensemble.frames(FRAMES + 1):
            if shown.index == TRANSIENT:
                begin = shown.positions.astype(np.float64)
            if shown.index >= TRANSIENT:
                spins.append(np.linalg.norm(shown.angular_velocities, axis=1).mean())
            end = shown.positions
        path = (end - begin) / (frame * (FRAMES - TRANSIENT))
    finally:
        ensemble.close()
    if not np.isfinite(path).all():
        raise InputError("the full model could not follow this body, so that it cannot be calibrated as a point")
    fall = -np.sign(model.net_weight) * path[:, 1]
    sideways = float(np.sqrt((path[:, [0, 2]] ** 2).sum(axis=1).mean()))
    return Fall(float(fall.mean()), sideways, float(np.mean(spins)))


def calibrated(model: BodyModel, fall: Fall, wind: float = 0.0) -> BodyModel:
    """The model whose point falls, glides and tumbles as measured; its drag keeps its dependence on the speed.

    wind: rms of the seen fluctuation over the fall speed. It turns bodies to other headings, which a point keeps: its glide
    is less by (1 + wind)^-2, so that it spreads about as far.
    """
    point = model.point
    if fall.speed <= 0.0 or point.fall_speed <= 0.0:
        return model
    guess = point.drag[0] + point.drag[1] * fall.speed**0.5 + point.drag[2] * fall.speed
    before = point.drag[0] + point.drag[1] * point.fall_speed**0.5 + point.drag[2] * point.fall_speed
    needed = before * point.fall_speed / fall.speed
    # axes of tumbling point everywhere: of their sideways motion two thirds (in the mean square) are horizontal
    glide = fall.sideways / fall.speed * (1.5**0.5) / (1.0 + wind) ** 2
    measured = PointModel(point.inertia, point.drag * (needed / guess), fall.speed, fall.spin / fall.speed, glide)
    return replace(model, point=measured)


def cached_fall(model: BodyModel, fluid: Fluid, gravity: float, folder: Path) -> Fall:
    """`pilot_fall`, kept in a folder by everything it depends on."""
    digest = hashlib.sha256(f"{__version__} {fluid} {gravity}".encode())
    parts = [model, model.loads, model.rates, model.point, *model.plates, *(plate.loads for plate in model.plates)]
    for part in parts:
        for name, value in sorted(vars(part).items()):
            if isinstance(value, (float, np.ndarray)):
                digest.update(name.encode() + np.asarray(value, dtype=np.float64).tobytes())
    path = folder / f"{digest.hexdigest()}.json"
    try:
        return Fall(**json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        fall = pilot_fall(model, fluid, gravity)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile("w", dir=folder, suffix=".part", delete=False, encoding="utf-8") as file:
            json.dump(asdict(fall), file)
        os.replace(file.name, path)
    except OSError:
        pass  # a cache that cannot be written costs time only
    return fall
