"""Time against error of added-mass solvers: ours, the method of fundamental solutions, and capytaine if it is installed."""

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from trimesh.creation import icosphere

from warp_immersed.charts.figures import Report, Request, publish
from warp_immersed.exact_tensors import ellipsoid_tensor
from warp_immersed.fundamental_solutions import fundamental_solution_tensor
from warp_immersed.panel_solver import surface_tensor

Array = NDArray[np.float64]
Solve = Callable[[Array, NDArray[np.int64]], Array]

OURS, FUNDAMENTAL, CAPYTAINE = "warp_immersed", "fundamental solutions", "capytaine"
COLORS = {OURS: "#d62728", FUNDAMENTAL: "#9c755f", CAPYTAINE: "#4e79a7"}
ASPECT_RATIOS = (1, 5, 50, 400)


def capytaine_tensor(vertices: Array, faces: NDArray[np.int64]) -> Array:
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


def solvers() -> dict[str, Solve]:
    """Every solver there is; capytaine where it is installed (extra `peers`)."""
    methods: dict[str, Solve] = {
        OURS: lambda v, f: surface_tensor(v, f, closed=True, threads=1).matrix,
        FUNDAMENTAL: lambda v, f: fundamental_solution_tensor(v, f).matrix,
    }
    try:
        import capytaine  # noqa: F401

        methods[CAPYTAINE] = capytaine_tensor
    except ImportError:
        pass
    return methods


def measure(quick: bool, report: Report) -> list[dict[str, Any]]:
    """Rows: method, aspect ratio of an oblate spheroid, faces, errors broadside, edgewise and about a diameter [%], the largest
    of them, and CPU milliseconds of the best of three runs. Meshes have the exact volume."""
    rows = []
    meshes = [icosphere(n) for n in ((1, 2) if quick else (1, 2, 3))]
    for n, ratio in enumerate(ASPECT_RATIOS):
        axes = np.array([1.0, 1.0, 1.0 / ratio])
        exact = np.diag(ellipsoid_tensor(axes, 1.0))
        for name, solve in solvers().items():
            report(f"{name}, aspect ratio {ratio}", n / len(ASPECT_RATIOS))
            for ball in meshes:
                scale = (4.0 / 3.0 * np.pi / ball.volume) ** (1.0 / 3.0)
                vertices, faces = scale * np.asarray(ball.vertices) * axes, np.asarray(ball.faces, dtype=np.int64)
                matrix, milliseconds = timed(lambda v=vertices, f=faces, s=solve: s(v, f))  # type: ignore[misc]
                errors = [100.0 * (matrix[i, i] / exact[i] - 1.0) if exact[i] > 1e-9 else 0.0 for i in (2, 0, 3)]
                rows.append({
                    "method": name, "aspect_ratio": ratio, "faces": len(faces), "broadside_percent": errors[0],
                    "edgewise_percent": errors[1], "flap_percent": errors[2], "worst_percent": max(abs(e) for e in errors),
                    "cpu_ms": milliseconds,
                })  # fmt: skip
    return rows


def timed(solve: Callable[[], Array]) -> tuple[Array, float]:
    """Result and CPU milliseconds of the best of three runs."""
    times = []
    for _ in range(3):
        start = time.process_time()
        result = solve()
        times.append(time.process_time() - start)
    return result, 1e3 * min(times)


def advantage(rows: Sequence[dict[str, Any]], other: str) -> dict[int, float]:
    """By aspect ratio: the other's error over ours at equal time, the smallest over the times at which both have results; ours
    is interpolated in the logarithms of time and error, and held beyond its finest mesh."""
    found = {}
    for ratio in ASPECT_RATIOS:
        ours = curve(rows, OURS, ratio)
        theirs = curve(rows, other, ratio)
        if len(theirs):
            mine = np.exp(np.interp(np.log(theirs[:, 0]), np.log(ours[:, 0]), np.log(ours[:, 1])))
            within = theirs[:, 0] >= ours[0, 0]
            found[ratio] = float((theirs[within, 1] / mine[within]).min()) if within.any() else float("nan")
    return found


def curve(rows: Sequence[dict[str, Any]], method: str, ratio: int) -> Array:
    """Time [ms] and worst error [%] of a method, finer and finer meshes, (meshes, 2)."""
    chosen = [row for row in rows if row["method"] == method and row["aspect_ratio"] == ratio]
    return np.array([(row["cpu_ms"], row["worst_percent"]) for row in chosen])


def draw(rows: Sequence[dict[str, Any]]) -> Any:
    """A matplotlib figure: error against time, a panel an aspect ratio, a line a method."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.0, 3.9), layout="constrained")
    axes = figure.subplots(1, len(ASPECT_RATIOS), sharey=True)
    for axis, ratio in zip(axes, ASPECT_RATIOS, strict=True):
        for method, color in COLORS.items():
            points = curve(rows, method, ratio)
            if len(points):
                axis.loglog(*points.T, "o-", color=color, label=method, linewidth=2.4 if method == OURS else 1.2)
                for row in rows:
                    if row["method"] == method and row["aspect_ratio"] == ratio and method == OURS:
                        at = (row["cpu_ms"], row["worst_percent"])
                        axis.annotate(
                            f"{row['faces']} faces", at, xytext=(4, 4), textcoords="offset points", fontsize=7, color=color
                        )
        axis.axhline(1.0, color="grey", linewidth=0.8, linestyle="--")
        axis.set_title("sphere" if ratio == 1 else f"oblate, {ratio} : 1", fontsize=10)
        axis.set_xlabel("CPU time, ms")
        axis.grid(alpha=0.25)
    axes[0].set_ylabel("worst error of the tensor, % (dashed: 1 %)")
    axes[0].legend(fontsize=8.5)
    figure.suptitle("Added mass: thin bodies are no harder for warp_immersed (red); fundamental solutions lose them")
    return figure


def chart(request: Request) -> str:
    """Solve the spheroids by every method, draw the figure, and write both."""
    rows = measure(request.quick, request.report)
    publish(request, lambda: draw(rows), rows)
    finest = max(row["faces"] for row in rows)
    ours = max(row["worst_percent"] for row in rows if row["method"] == OURS and row["faces"] == finest)
    ratios = advantage(rows, CAPYTAINE)
    beside = f"; at equal time capytaine's error is at least {min(ratios.values()):.1f} times larger" if ratios else ""
    return f"With {finest} faces the worst error of the tensor is {ours:.2g} % from sphere to 400 : 1{beside}."
