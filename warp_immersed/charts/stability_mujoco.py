"""MuJoCo's integrators and ellipsoid fluid model on the cells of the atlas (needs mujoco, extra `peers`)."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from mujoco import rollout

from warp_immersed.charts.body_rates import started
from warp_immersed.fluid import AIR

if TYPE_CHECKING:
    from warp_immersed.charts.stability import Cell, Extent, Motion

mujoco.set_mju_user_warning(lambda message: None)  # failures are what is looked for; without this they fill a log file

INTEGRATORS = {"Euler": "Euler", "RK4": "RK4", "implicitfast": "implicitfast"}

MODEL = """
<mujoco>
  <option timestep="{step}" integrator="{integrator}" density="{fluid}" viscosity="{viscosity}" gravity="0 -9.81 0">
    <flag contact="disable" constraint="disable"/>
  </option>
  <worldbody>
    <body gravcomp="{buoyancy}">
      <freejoint/>
      <geom type="ellipsoid" size="{a} {b} {c}" density="{density}" fluidshape="ellipsoid"/>
    </body>
  </worldbody>
</mujoco>
"""


def model_text(semi_axes: Sequence[float], density: float, step: float, integrator: str) -> str:
    """A free ellipsoid in air, its buoyancy as compensation of gravity."""
    a, b, c = semi_axes
    return MODEL.format(
        step=step, integrator=integrator, fluid=AIR.density, viscosity=AIR.dynamic_viscosity, buoyancy=AIR.density / density,
        a=a, b=b, c=c, density=density,
    )  # fmt: skip


def motions(integrator: str, cells: Sequence["Cell"], extent: "Extent", divisions: int) -> "list[Motion | None]":
    """Motions in cells at a step of 1/24 s over `divisions`; None where it fails."""
    from warp_immersed.charts.stability import SAMPLES_PER_SECOND, Motion

    found: list[Motion | None] = []
    for cell in cells:
        text = model_text(cell.semi_axes, cell.density, 1.0 / SAMPLES_PER_SECOND / divisions, INTEGRATORS[integrator])
        model = mujoco.MjModel.from_xml_string(text)
        emission = started(extent.bodies, 5)
        data = mujoco.MjData(model)
        starts = []
        for orientation in emission.orientations:
            data.qpos[3:7] = orientation[[3, 0, 1, 2]]
            state = np.zeros(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
            mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
            starts.append(state)
        frames = round(extent.seconds * SAMPLES_PER_SECOND)
        states, _ = rollout.rollout(model, data, np.array(starts), nstep=frames * divisions)
        states = states[:, divisions - 1 :: divisions]
        velocities = states[..., 8:11].transpose(1, 0, 2)
        spins = states[..., 11:14].transpose(1, 0, 2)
        clock = states[:, -1, 0]
        failed = not np.isfinite(states).all() or np.abs(clock - extent.seconds).max() > 1e-6 or np.abs(velocities).max() > 100.0
        found.append(None if failed else Motion.of(velocities, spins))
    return found
