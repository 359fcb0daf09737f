"""Noise and wind: what Euler-Maruyama, undamped angular noise and drag in absolute velocity do, beside the product's kernels."""

from math import ceil
from typing import Any

import numpy as np

from warp_immersed import library
from warp_immersed.charts.baselines import undamped_spin, variance_ratio
from warp_immersed.charts.bodies import model_in, run_product
from warp_immersed.charts.body_rates import started
from warp_immersed.device_state import Surroundings
from warp_immersed.fluid import AIR
from warp_immersed.turbulence import HomogeneousTurbulence, kolmogorov_constant, lagrangian_time_scale, taylor_reynolds

VARIANCE, SPIN = "variance", "spin"
BREEZE = HomogeneousTurbulence(0.05, 0.02)
GUSTS = HomogeneousTurbulence(0.3, 0.5)


def noise_rows(quick: bool) -> list[dict[str, Any]]:
    """Rows: quantity, method, at, value: variance of the seen wind over the exact one against step / T_L; root mean square spin
    [rad/s] of maple leaves in gusts against time [s]."""
    rows = []
    for step in (0.1, 0.5, 1.0, 1.9, 2.1, 5.0, 10.0):
        for form in ("Euler-Maruyama", "RK4, noise after"):
            rows.append({"quantity": VARIANCE, "method": form, "at": step, "value": variance_ratio(form, step)})
        rows.append(
            {"quantity": VARIANCE, "method": "warp_immersed", "at": step, "value": seen_variance(step, 150 if quick else 1500)}
        )
    return rows + spin_rows(60 if quick else 400)


def seen_variance(frames_in_time_scale: float, bodies: int) -> float:
    """Variance of the velocity of 0.2 mm flakes, which follow the air in milliseconds, over 2 k / 3; frames of so many T_L."""
    model = model_in(library.disk(2e-4, 2e-5, 500.0), AIR)
    time_scale = lagrangian_time_scale(BREEZE, AIR)
    fps = 1.0 / (frames_in_time_scale * time_scale)
    frames = 4 + ceil(4.0 / frames_in_time_scale)
    run = run_product([(model, started(bodies, 2))], Surroundings(AIR, turbulence=BREEZE), fps, frames / fps, 1.0 / fps)
    return float((run.velocities[2:, :, [0, 2]] ** 2).mean() / BREEZE.velocity_rms**2)


def spin_rows(bodies: int) -> list[dict[str, Any]]:
    """Spin of leaves in gusts against time, and with the printed d omega = (C0 epsilon)^(1/2) dW, its unit forgiven."""
    model = model_in(library.maple_leaf(), AIR)
    times = np.array([1.0, 2.0, 4.0, 8.0, 16.0, 32.0])
    surroundings = Surroundings(AIR, turbulence=GUSTS)
    run = run_product([(model, started(bodies, 4))], surroundings, 24.0, times[-1], 1.0 / 24.0)
    squares = (run.angular_velocities**2).sum(axis=2).mean(axis=1)
    beta = np.sqrt(kolmogorov_constant(taylor_reynolds(GUSTS, AIR)) * GUSTS.epsilon)
    rows = []
    for time, printed in zip(times, undamped_spin(times, float(beta)), strict=True):
        around = squares[round(0.75 * 24 * time) : round(24 * time) + 1]
        rows.append({"quantity": SPIN, "method": "warp_immersed", "at": float(time), "value": float(np.sqrt(around.mean()))})
        rows.append(
            {"quantity": SPIN, "method": "undamped, as printed", "at": float(time), "value": float(np.sqrt(3.0) * printed)}
        )
    return rows
