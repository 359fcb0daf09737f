"""What the command line says about a body's added mass: a table to read and a dictionary for JSON."""

from typing import Any

import numpy as np

from warp_immersed.added_mass import KirchhoffTensor
from warp_immersed.fluid import Fluid
from warp_immersed.shape import Shape

AXES = ("x", "y", "z")


def tensor_table(solution: KirchhoffTensor, shape: Shape, fluid: Fluid, name: str, own_mass: bool = True) -> str:
    """A readable table of a tensor; own_mass: also in % of the body's mass and inertia (its density was given)."""
    body = "sheet" if shape.is_sheet else "solid"
    size = " x ".join(f"{length:.4g}" for length in np.ptp(shape.mesh.vertices, axis=0))
    lines = [
        f"{name}: {body}, {len(shape.mesh.faces)} faces, {size} m along its principal axes",
        f"fluid: {fluid.density:.6g} kg/m^3",
    ]
    if own_mass:
        lines.append(f"mass {shape.mass:.4g} kg, inertia {', '.join(f'{value:.4g}' for value in shape.inertia)} kg m^2")
    mass = f"{shape.mass:.4g} kg" if own_mass else ""
    blocks = [
        ("translation [kg]", solution.matrix[:3, :3], np.full(3, shape.mass), f"of the mass, {mass}"),
        ("rotation [kg m^2]", solution.matrix[3:, 3:], shape.inertia, "of the inertia"),
    ]
    for title, block, own, of_what in blocks:
        lines += ["", f"{title:<20}{'x':>13}{'y':>13}{'z':>13}"]
        for axis, row in zip(AXES, block, strict=True):
            lines.append(f"  {axis:<18}" + "".join(entry_text(value, block) for value in row))
        if own_mass:
            share = 100.0 * np.diag(block) / own
            lines.append(f"  {'%':<18}" + "".join(f"{value:>13.4g}" for value in share) + f"   {of_what}")
    coupling = solution.matrix[:3, 3:]
    lines += ["", f"{'coupling [kg m]':<20}" + "".join(f"{'turn ' + axis:>13}" for axis in AXES)]
    scale = np.sqrt(np.abs(np.outer(np.diag(solution.matrix)[:3], np.diag(solution.matrix)[3:])).max())
    for axis, row in zip(AXES, coupling, strict=True):
        lines.append(f"  {'move ' + axis:<18}" + "".join(entry_text(value, np.array([scale])) for value in row))
    lines += ["", accuracy_text(solution)]
    return "\n".join(lines)


def entry_text(value: float, block: np.ndarray) -> str:
    """A number in 13 columns, 0 if it is nothing against its block."""
    return f"{0.0 if abs(value) < 1e-9 * np.abs(block).max() else value:>13.4g}"


def accuracy_text(solution: KirchhoffTensor) -> str:
    """How it was found, how sure it is, how long it took."""
    if not np.isfinite(solution.error_estimate):
        error = "error not estimated"
    else:
        error = f"estimated error {100.0 * solution.error_estimate:.2g} %" if solution.error_estimate else "no numerical error"
    where = ", from the cache" if solution.cached else ""
    faces = f", {solution.faces} faces" if solution.faces else ""
    return f"{solution.method}{faces}: {error}, {solution.seconds:.3g} s{where}"


def tensor_dict(solution: KirchhoffTensor, shape: Shape, fluid: Fluid, name: str, own_mass: bool = True) -> dict[str, Any]:
    """The same for JSON: plain numbers and lists in SI units."""
    result: dict[str, Any] = {
        "name": name,
        "kind": "sheet" if shape.is_sheet else "solid",
        "convention": "linear then angular [[M, D], [D^T, J]], about the centre of mass, in the principal frame, SI",
        "fluid_density": fluid.density,
        "tensor": solution.matrix.tolist(),
        "error_estimate": solution.error_estimate if np.isfinite(solution.error_estimate) else None,
        "faces": solution.faces,
        "method": solution.method,
        "seconds": solution.seconds,
        "cached": solution.cached,
        "center_of_mass": shape.center_of_mass.tolist(),
        "rotation": shape.rotation.tolist(),
        "volume": shape.volume,
    }
    if own_mass:
        result["density"], result["mass"], result["inertia"] = shape.density, shape.mass, shape.inertia.tolist()
    return result
