"""Words about a scene and the installation, for `run` and `info`."""

import os
import platform
from importlib.metadata import version
from math import sqrt

import numpy as np

from warp_immersed.boundaries import LogInlet
from warp_immersed.device_state import Surroundings, wind_steps_per_frame
from warp_immersed.simulation import Kind, Plan
from warp_immersed.turbulence import lagrangian_time_scale
from warp_immersed.turbulence_grid import TurbulenceGrid
from warp_immersed.version import __version__


def mass_text(size: int) -> str:
    """A file size in words."""
    return f"{size / 1e6:.1f} MB" if size >= 1e5 else f"{size / 1e3:.1f} kB"


def broadside_speed(kind: Kind, gravity: float) -> float:
    """Terminal speed [m/s] of a body that falls flat without turning."""
    loads, weight = kind.model.loads, abs(kind.model.net_weight) * gravity
    low, high = 0.0, 1e3
    for _ in range(80):
        speed = (low + high) / 2.0
        low_drag = loads.drag_linear[2] * speed + loads.drag_root[2] * speed**1.5 + loads.drag_quadratic[2] * speed**2
        drag = max(low_drag, loads.drag_broadside * speed**2)
        low, high = (speed, high) if drag < weight else (low, speed)
    return low


def expected_substeps(kind: Kind, fps: float, gravity: float) -> float:
    """Substeps a frame of a body that tumbles at its broadside speed."""
    rates, speed = kind.model.rates, broadside_speed(kind, gravity)
    spin = speed / kind.shape.semi_axes[1]
    rate = max(rates.linear + rates.root * sqrt(speed) + rates.speed * speed, rates.start) + rates.spin * spin
    return max(1.0, np.ceil(rate / fps))


def kind_line(kind: Kind, surroundings: Surroundings) -> str:
    """One kind of body in a line: what it is and at which fidelity it moves."""
    chosen = f" (auto: {kind.choice.reason})" if kind.table.fidelity == "auto" else ""
    direction = "rises" if kind.model.net_weight < 0.0 else "falls"
    speed = broadside_speed(kind, float(np.linalg.norm(surroundings.gravity)))
    return (
        f"{kind.table.name}: {kind.table.count} x {kind.level}{chosen}, {1e3 * kind.shape.mass:.3g} g, "
        f"{200 * kind.shape.semi_axes[0]:.3g} x {200 * kind.shape.semi_axes[1]:.3g} cm, {direction} flat at {speed:.2f} m/s"
    )


def describe_scene(plan: Plan) -> list[str]:
    """Lines about what a scene would do."""
    scene, surroundings = plan.scene, plan.surroundings
    gravity = float(np.linalg.norm(surroundings.gravity))
    lines = [
        f"{scene.name}: {scene.duration:g} s at {scene.fps:g} fps = {scene.frame_count} frames, {scene.body_count} bodies, "
        f"seed {scene.seed}",
        f"fluid: {surroundings.fluid.density:g} kg/m^3, {surroundings.fluid.kinematic_viscosity:.3g} m^2/s",
    ]
    turbulence, flow = surroundings.turbulence, surroundings.flow
    if flow is None:
        lines.append(f"mean wind: {np.linalg.norm(surroundings.mean_wind):.3g} m/s")
    if isinstance(flow, TurbulenceGrid):
        low, high = (" ".join(f"{x:g}" for x in corner) for corner in (flow.lower, flow.upper))
        lines.append(
            f"turbulence: grid of {' x '.join(map(str, flow.cells))} cells from ({low}) to ({high}) m, "
            f"{wind_steps_per_frame(1.0 / scene.fps, surroundings)} wind updates a frame"
        )
    elif isinstance(flow, LogInlet):
        lines.append(f"turbulence: boundary layer, friction velocity {flow.friction_velocity:.3g} m/s; no grid is needed")
    elif turbulence.k > 0.0:
        lines.append(
            f"turbulence: homogeneous, {turbulence.velocity_rms:.3g} m/s rms, T_L "
            f"{lagrangian_time_scale(turbulence, surroundings.fluid):.3g} s, "
            f"{wind_steps_per_frame(1.0 / scene.fps, surroundings)} wind updates a frame; no grid is needed"
        )
    else:
        lines.append("turbulence: none")
    standing = "" if surroundings.ground_mesh is None else f" and a mesh of {len(surroundings.ground_mesh.faces)} faces"
    height = surroundings.ground_height
    lines.append("ground: none" if height is None else f"ground: y = {height:g} m{standing}")
    for kind in plan.kinds:
        added = np.diag(kind.model.inertia) * kind.shape.mass - np.array([kind.shape.mass] * 3 + list(kind.shape.inertia))
        lines += [
            kind_line(kind, surroundings),
            f"  added mass {100 * added[:3].max() / kind.shape.mass:.3g} % of its mass, "
            f"{100 * (added[3:] / kind.shape.inertia).max():.3g} % of its inertia; density over fluid's "
            f"{kind.shape.mass / kind.shape.volume / surroundings.fluid.density:.4g}",
            f"  about {expected_substeps(kind, scene.fps, gravity):.0f} substeps a frame in free fall",
        ]
    return lines + [f"note: {note}" for note in plan.notes]


def describe_installation() -> list[str]:
    """Lines about versions, devices and built-in scenes."""
    import warp as wp

    from warp_immersed.frame_stepper import available_threads
    from warp_immersed.library import SHAPES
    from warp_immersed.scene import builtin_scenes

    return [
        f"warp-immersed {__version__}, Warp {wp.__version__}, usd-core {version('usd-core')}, "
        f"Python {platform.python_version()}, {platform.system()} {platform.machine()}",
        *(f"device {d.alias}: {d.name}" for d in wp.get_devices()),
        f"threads: {available_threads()} of {os.cpu_count()} cores",
        f"kernel cache: {wp.config.kernel_cache_dir}",
        f"scenes: {', '.join(sorted(builtin_scenes()))}",
        f"shapes: {', '.join(SHAPES)}",
    ]
