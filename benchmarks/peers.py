"""The same thin ellipsoids in air in other engines, side by side in one run (extra `peers`).

Full added mass, plate law and noise here; MuJoCo's ellipsoid fluid model there (no added inertia, no noise); Newton has no fluid.
"""

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import warp as wp

from benchmarks.measurement import THIN_DENSITY, THIN_ELLIPSOID, Row, frames_done, paired_ratio, rates, thin_ellipsoids

STEP = 1e-3  # s, of the other engines
ASKED = {"mujoco": 10.0, "mujoco_warp": 15.0}


def rows(quick: bool) -> Iterator[Row]:
    """Body-steps per CPU second, one thread each, at N = 1,000 and 10,000; and ratios of ours over theirs, taken in turn, with
    frames of 1/24 s as the product runs and with frames of 1 ms, the step of the others."""
    seconds = 2.0 if quick else 6.0
    for count in (1000,) if quick else (1000, 10_000):
        ensembles = {"24 fps": thin_ellipsoids(count, 24.0), "1 ms frames": thin_ellipsoids(count, 1000.0)}
        ours = {
            "24 fps": frames_done(ensembles["24 fps"], max(3, 10_000 // count)),
            "1 ms frames": frames_done(ensembles["1 ms frames"], max(20, 100_000 // count)),
        }
        for name, block in ours.items():
            yield {"what": "peers", "engine": f"warp_immersed, {name}", "bodies": count, **rates(block, seconds)}
        for engine, make in ENGINES.items():
            try:
                theirs = make(count)
                yield {"what": "peers", "engine": engine, "bodies": count, **rates(theirs, seconds)}
                ratios = {name: round(paired_ratio(block, theirs, seconds), 1) for name, block in ours.items()}
            except ImportError as error:
                yield {"what": "peers", "engine": engine, "skipped": f"{error}: pip install 'warp-immersed[peers]'"}
                continue
            except Exception as error:  # a peer's own trouble must not end the run
                yield {"what": "peers", "engine": engine, "failed": f"{type(error).__name__}: {error}"}
                continue
            row: Row = {"what": "ratio", "engine": engine, "bodies": count, "ours_over_theirs": ratios}
            if engine in ASKED:
                row |= {"asked": ASKED[engine], "met": ratios["24 fps"] >= ASKED[engine]}
            yield row
        for ensemble in ensembles.values():
            ensemble.close()


def mujoco_model() -> Any:
    """A thin ellipsoid with MuJoCo's fluid model, implicitfast."""
    import mujoco

    from warp_immersed.charts.stability_mujoco import model_text

    return mujoco.MjModel.from_xml_string(model_text(THIN_ELLIPSOID, THIN_DENSITY, STEP, "implicitfast"))


def mujoco_c(count: int) -> Callable[[], float]:
    """MuJoCo C: many independent simulations in one call of rollout, on one thread."""
    import mujoco
    from mujoco import rollout

    model = mujoco_model()
    data = mujoco.MjData(model)
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    states = np.zeros((count, size))
    random = np.random.default_rng(1)
    for row in states:
        quaternion = random.standard_normal(4)
        data.qpos[3:7] = quaternion / np.linalg.norm(quaternion)
        mujoco.mj_getState(model, data, row, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    steps = max(10, 100_000 // count)

    def block() -> float:
        nonlocal states
        found, _ = rollout.rollout(model, data, states, nstep=steps)
        states = np.ascontiguousarray(found[:, -1])
        return float(steps * count)

    block()
    return block


def mujoco_warp(count: int) -> Callable[[], float]:
    """mujoco_warp on the CPU: one world a body."""
    import mujoco
    import mujoco_warp as mjw

    model = mujoco_model()
    with wp.ScopedDevice("cpu"):
        worlds = mjw.put_model(model)
        data = mjw.put_data(model, mujoco.MjData(model), nworld=count)

    def block() -> float:
        with wp.ScopedDevice("cpu"):
            for _ in range(20):
                mjw.step(worlds, data)
        return 20.0 * count

    block()
    return block


def newton(count: int) -> Callable[[], float]:
    """Newton, semi-implicit: free rigid bodies, no fluid at all."""
    import newton

    builder = newton.ModelBuilder()
    for n in range(count):
        builder.add_body(
            xform=wp.transform((0.1 * n, 10.0, 0.0), wp.quat_identity()), mass=1e-3, inertia=wp.mat33(np.eye(3) * 1e-7)
        )
    model = builder.finalize(device="cpu")
    solver = newton.solvers.SolverSemiImplicit(model)
    states = [model.state(), model.state()]
    control = model.control()

    def block() -> float:
        for _ in range(100):
            states[0].clear_forces()
            solver.step(states[0], states[1], control, None, STEP)
            states.reverse()
        return 100.0 * count

    block()
    return block


ENGINES: dict[str, Callable[[int], Callable[[], float]]] = {
    "mujoco": mujoco_c,
    "mujoco_warp": mujoco_warp,
    "newton, no fluid": newton,
}
