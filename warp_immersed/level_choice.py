"""Which level of the ladder each kind of body of a scene gets, and why."""

from dataclasses import dataclass
from math import inf
from pathlib import Path

import numpy as np

from warp_immersed.body_model import BodyModel, without_lift
from warp_immersed.boundaries import VON_KARMAN, LogInlet
from warp_immersed.device_state import Surroundings
from warp_immersed.fidelity import CREEPING_REYNOLDS, Behaviour, Choice, Fidelity, choose
from warp_immersed.force_law import flatness
from warp_immersed.pilot import Fall, cached_fall, calibrated
from warp_immersed.seen_turbulence import seen_turbulence
from warp_immersed.shape import Shape
from warp_immersed.turbulence import HomogeneousTurbulence
from warp_immersed.turbulence_grid import TurbulenceGrid


@dataclass(frozen=True)
class Scale:
    """What a scene makes of its bodies: the tolerance it allows, its duration [s], and their size in most pictures [pixels]."""

    tolerance: float
    duration: float
    pixels: float = inf


def model_at_level(
    shape: Shape, model: BodyModel, surroundings: Surroundings, asked: Fidelity, scale: Scale, cache: Path
) -> tuple[BodyModel, Choice]:
    """The model of a body as its level needs it, and the level: the one asked for, or for "auto" the cheapest that will do.

    cache: folder for pilot runs.
    """
    gravity = float(np.linalg.norm(surroundings.gravity))
    body = behaviour(shape, model, surroundings, None, scale)
    needs_pilot = asked in ("drift", "point") or (asked == "auto" and not body.attitude_shows)
    if needs_pilot and body.roundness < 1.0 and body.reynolds > CREEPING_REYNOLDS and gravity > 0.0:
        fall = cached_fall(model, surroundings.fluid, gravity, cache)
        model = calibrated(model, fall, body.wind * model.point.fall_speed / max(fall.speed, 1e-12))
        body = behaviour(shape, model, surroundings, fall, scale)
    choice = choose(body, scale.tolerance) if asked == "auto" else Choice(asked, float("nan"), "asked for")
    return (without_lift(model, gravity) if choice.level == "kirchhoff" else model), choice


def behaviour(shape: Shape, model: BodyModel, surroundings: Surroundings, fall: Fall | None, scale: Scale) -> Behaviour:
    """The numbers that decide; without a pilot run plates count as gliders, unless they creep."""
    gravity = float(np.linalg.norm(surroundings.gravity))
    speed = max(model.point.fall_speed, 1e-12)
    fluid = surroundings.fluid
    seen = seen_turbulence(typical_turbulence(surroundings), fluid, model.eddy_size)
    plate = flatness(shape)
    reynolds = speed * model.eddy_size / fluid.kinematic_viscosity
    unknown = min(plate, 0.5) if reynolds > CREEPING_REYNOLDS else 0.0
    glide = unknown if fall is None else fall.sideways / speed
    return Behaviour(
        flatness=plate,
        roundness=float(shape.semi_axes.min() / shape.semi_axes.max()),
        reynolds=reynolds,
        wind=seen.velocity_rms / speed,
        # a body lags behind the air by g-times less than it falls: also where the fluid's own inertia carries it along
        stokes=speed / gravity / seen.time_scale if seen.time_scale > 0.0 and gravity > 0.0 else 0.0,
        glide=glide,
        start=speed * model.point.inertia / max(abs(model.net_weight) * gravity, 1e-12) / scale.duration,
        pixels=scale.pixels,
    )


def typical_turbulence(surroundings: Surroundings) -> HomogeneousTurbulence:
    """The turbulence of a scene in one pair of numbers: its own, or the median of a grid, or that 2 m above the ground."""
    flow = surroundings.flow
    if isinstance(flow, TurbulenceGrid):
        inside = np.broadcast_to(flow.fluid, flow.k.shape)
        return HomogeneousTurbulence(float(np.median(flow.k[inside])), float(np.median(flow.epsilon[inside])))
    if isinstance(flow, LogInlet):
        speed = flow.friction_velocity
        return HomogeneousTurbulence(speed**2 / 0.3, speed**3 / (VON_KARMAN * 2.0))
    return surroundings.turbulence
