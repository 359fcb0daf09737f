"""The Kirchhoff (added-mass) tensor of a shape in a fluid."""

import time
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from warp_immersed.errors import InputError
from warp_immersed.exact_tensors import ellipsoid_tensor, elliptic_sheet_tensor, shifted_tensor
from warp_immersed.fluid import Fluid
from warp_immersed.panel_refinement import MeshTensor, Progress, mesh_tensor
from warp_immersed.shape import Shape
from warp_immersed.tensor_cache import geometry_key, load_tensor, store_tensor

Array = NDArray[np.float64]
Method = Literal["auto", "panels", "given-mesh", "fundamental-solutions"]

METHODS = ("auto", "panels", "given-mesh", "fundamental-solutions")


@dataclass(frozen=True)
class KirchhoffTensor:
    """Added mass of a body, without its own mass.

    matrix: (6, 6), linear then angular, [[M, D], [D^T, J]] in [kg, kg m, kg m^2], about the centre of mass in the principal
        frame; symmetric positive semidefinite.
    error_estimate: expected largest |error_ij| / sqrt(K_ii K_jj), 0 for exact formulas; it is of the flow about the mesh
        given, not of what the mesh leaves out.
    faces: triangles solved on, in all. method: how, in words. seconds: wall time. cached: whether it came from the cache.
    """

    matrix: Array
    error_estimate: float
    faces: int
    method: str
    seconds: float
    cached: bool


def kirchhoff_tensor(
    shape: Shape,
    fluid: Fluid,
    *,
    tolerance: float = 0.01,
    method: Method = "auto",
    faces: int | None = None,
    cache: bool = True,
    device: str = "cpu",
    threads: int | None = None,
    progress: Progress | None = None,
) -> Array:
    """Added-mass tensor (6, 6) of a body, without its own mass; the matrix of `kirchhoff_solution`, which see.

    Linear then angular, [[M, D], [D^T, J]] in [kg, kg m, kg m^2], about the centre of mass in the principal frame.
    """
    return kirchhoff_solution(
        shape,
        fluid,
        tolerance=tolerance,
        method=method,
        faces=faces,
        cache=cache,
        device=device,
        threads=threads,
        progress=progress,
    ).matrix


def kirchhoff_solution(
    shape: Shape,
    fluid: Fluid,
    *,
    tolerance: float = 0.01,
    method: Method = "auto",
    faces: int | None = None,
    cache: bool = True,
    device: str = "cpu",
    threads: int | None = None,
    progress: Progress | None = None,
) -> KirchhoffTensor:
    """Added mass of a body with its estimated error.

    Args:
        tolerance: relative error wanted, between 1e-4 and 0.5.
        method: "auto" takes exact formulas for exact ellipsoids and elliptic sheets and boundary elements on meshes made for
            the purpose otherwise; "panels" takes boundary elements always; "given-mesh" does so on the shape's own triangles;
            "fundamental-solutions" is the baseline that fails on thin bodies, on the shape's own triangles.
        faces: triangles to spend in all (with "auto" and "panels"), instead of a tolerance.
        cache: look the tensor up on disk, and keep it there. The density of the fluid only scales it.
        device: of Warp, for the integrals. threads: on the CPU; all cores if None. The result is the same for any number.
        progress: called with what is being done and the fraction of it.

    Raises:
        InputError: an option out of range, or a mesh that cannot be used (see mesh_checks.clean_surface).
    """
    start = time.perf_counter()
    if method not in METHODS:
        raise InputError(f"method: found {method!r}, must be one of {', '.join(METHODS)}")
    if not 1e-4 <= tolerance <= 0.5:
        raise InputError(f"tolerance: found {tolerance!r}, must be between 0.0001 and 0.5")
    if faces is not None and faces < 20:
        raise InputError(f"faces: found {faces!r}, must be at least 20")
    if method == "auto" and shape.form != "mesh":
        matrix = exact_tensor(shape, fluid.density)
        return KirchhoffTensor(matrix, 0.0, 0, "exact formula", time.perf_counter() - start, False)
    settings = (method, tolerance, faces, shape.form, shape.volume if shape.form != "mesh" else None)
    key = geometry_key(shape.mesh.vertices, shape.mesh.faces, not shape.is_sheet, settings)
    found = load_tensor(key) if cache else None
    tensor = found or computed_tensor(shape, method, tolerance, faces, device, threads, progress)
    if cache and found is None:
        store_tensor(key, tensor)
    seconds = time.perf_counter() - start
    matrix = fluid.density * tensor.matrix
    return KirchhoffTensor(matrix, tensor.error_estimate, tensor.faces, tensor.method, seconds, found is not None)


def exact_tensor(shape: Shape, density: float) -> Array:
    """Tensor (6, 6) of an exact ellipsoid or elliptic sheet in a fluid of some density [kg/m^3]."""
    a, b, c = shape.semi_axes
    centered = elliptic_sheet_tensor(a, b, density) if shape.is_sheet else ellipsoid_tensor((a, b, c), density)
    return shifted_tensor(centered, shape.geometric_center)


def computed_tensor(
    shape: Shape,
    method: Method,
    tolerance: float,
    faces: int | None,
    device: str,
    threads: int | None,
    progress: Progress | None,
) -> MeshTensor:
    """Tensor of a shape's mesh about its centre of mass in a fluid of 1 kg/m^3."""
    if method == "fundamental-solutions":
        from warp_immersed.fundamental_solutions import fundamental_solution_tensor

        if shape.is_sheet:
            raise InputError("method: fundamental solutions need a closed body, found a sheet")
        result = fundamental_solution_tensor(shape.mesh.vertices, shape.mesh.faces)
        return MeshTensor(result.matrix, float("nan"), len(shape.mesh.faces), "fundamental solutions, one edge inside")
    return mesh_tensor(
        np.asarray(shape.mesh.vertices, dtype=np.float64),
        np.asarray(shape.mesh.faces, dtype=np.int64),
        closed=not shape.is_sheet,
        volume=shape.volume if shape.form == "ellipsoid" else None,
        tolerance=tolerance,
        face_budget=faces,
        as_given=method == "given-mesh",
        device=device,
        threads=threads,
        progress=progress,
    )
