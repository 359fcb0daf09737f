"""Time against error of added-mass solvers on oblate spheroids: ours, fundamental solutions, and capytaine if installed.

Run with one thread of BLAS (OMP_NUM_THREADS=1). Times are CPU time of the best of three runs. Prints a table; writes
CSV to the file given.
"""

import csv
import sys
import time
from collections.abc import Callable

import numpy as np
from trimesh.creation import icosphere

from warp_immersed.exact_tensors import ellipsoid_tensor
from warp_immersed.fundamental_solutions import TABLE_COLUMNS, failure_table, fundamental_solution_tensor
from warp_immersed.panel_solver import surface_tensor

Array = np.ndarray


def capytaine_tensor(vertices: Array, faces: Array) -> Array:
    """Added mass in an unbounded fluid by capytaine's constant panels (infinite frequency, no free surface)."""
    import capytaine as cpt

    mesh = cpt.Mesh(vertices=vertices, faces=np.column_stack([faces, faces[:, :1]]))
    body = cpt.FloatingBody(mesh=mesh, dofs=cpt.rigid_body_dofs(rotation_center=np.zeros(3)))
    solver = cpt.BEMSolver(method="direct")
    matrix = np.zeros((6, 6))
    for j, dof in enumerate(body.dofs):
        problem = cpt.RadiationProblem(body=body, radiating_dof=dof, free_surface=np.inf, omega=np.inf, rho=1.0)
        matrix[:, j] = list(solver.solve(problem, keep_details=False).added_masses.values())
    return matrix


def timed(solve: Callable[[], Array]) -> tuple[Array, float]:
    """Result and CPU milliseconds of the best of three runs."""
    times = []
    for _ in range(3):
        start = time.process_time()
        result = solve()
        times.append(time.process_time() - start)
    return result, 1e3 * min(times)


def main() -> None:
    """Print the table and write the CSV files."""
    methods: dict[str, Callable[[Array, Array], Array]] = {
        "panels": lambda v, f: surface_tensor(v, f, closed=True, threads=1).matrix,
        "fundamental solutions": lambda v, f: fundamental_solution_tensor(v, f).matrix,
    }
    try:
        import capytaine  # noqa: F401

        methods["capytaine"] = capytaine_tensor
    except ImportError:
        print("capytaine is not installed: left out")
    rows = []
    for subdivision in (2, 3):
        ball = icosphere(subdivision)
        scale = (4.0 / 3.0 * np.pi / ball.volume) ** (1.0 / 3.0)
        for aspect_ratio in (1, 5, 50, 400):
            axes = np.array([1.0, 1.0, 1.0 / aspect_ratio])
            exact = np.diag(ellipsoid_tensor(axes, 1.0))
            for name, solve in methods.items():
                vertices, faces = scale * np.asarray(ball.vertices) * axes, np.asarray(ball.faces, dtype=np.int64)
                matrix, milliseconds = timed(lambda v=vertices, f=faces, s=solve: s(v, f))  # type: ignore[misc]
                errors = [100.0 * (matrix[i, i] / exact[i] - 1.0) if exact[i] > 0.0 else float("nan") for i in (2, 0, 3)]
                rows.append([name, len(faces), aspect_ratio, *errors, milliseconds])
    header = ["method", "faces", "aspect_ratio", "broadside_percent", "edgewise_percent", "flap_percent", "cpu_ms"]
    print(f"{header[0]:<22}" + "".join(f"{column:>19}" for column in header[1:]))
    for row in rows:
        print(f"{row[0]:<22}" + "".join(f"{value:>19.4g}" for value in row[1:]))
    if len(sys.argv) > 1:
        with open(sys.argv[1], "w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([header, *rows])
    if len(sys.argv) > 2:
        with open(sys.argv[2], "w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, TABLE_COLUMNS)
            writer.writeheader()
            writer.writerows(failure_table())


if __name__ == "__main__":
    main()
