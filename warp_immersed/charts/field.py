"""A picture of a baked flow: speed with streamlines, k and epsilon, obstacles shaded."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from warp_immersed.charts.figures import Request, save_figure
from warp_immersed.errors import InputError
from warp_immersed.turbulence_grid import TurbulenceGrid

Array = NDArray[np.float32]


def draw_field(grid: TurbulenceGrid, time: float | None = None) -> Any:
    """A matplotlib figure of slices through a baked flow.

    Upright slices (x, y) lie at the middle of the obstacles, or of the domain; the one from above (x, z) at half their
    height. Colours end at the 99.5th percentile, so that a single cell does not hide the rest.

    Args:
        time: which snapshot of a flow in time to show [s]; None for the last.
    """
    from matplotlib.figure import Figure

    velocity, k, epsilon = snapshot(grid, time)
    j, layer = slice_indices(grid)
    deep = grid.cells[2] > 1
    upright = (grid.lower[0], grid.upper[0], grid.lower[1], grid.upper[1])
    above = (grid.lower[0], grid.upper[0], grid.lower[2], grid.upper[2])
    panels: list[tuple[Any, ...]] = [
        ("speed [m/s]", velocity[:, :, layer][..., [0, 1]], None, grid.fluid[:, :, layer], upright, "y [m]")
    ]
    if deep:
        panels.append(("speed from above [m/s]", velocity[:, j][..., [0, 2]], None, grid.fluid[:, j], above, "z [m]"))
    panels.append(("k [m²/s²]", None, k[:, :, layer], grid.fluid[:, :, layer], upright, "y [m]"))
    logarithm = np.log10(epsilon[:, :, layer] + 1e-12)
    panels.append(("log₁₀ epsilon [m²/s³]", None, logarithm, grid.fluid[:, :, layer], upright, "y [m]"))
    heights = [9.0 * (box[3] - box[2]) / (box[1] - box[0]) for *_, box, _ in panels]
    figure = Figure(figsize=(10.5, min(sum(heights) + 0.9 * len(panels), 24.0)), layout="constrained")
    axes = figure.subplots(len(panels), 1, squeeze=False, gridspec_kw={"height_ratios": heights})[:, 0]
    for axis, (title, flow, values, fluid, box, label) in zip(axes, panels, strict=True):
        shown = np.linalg.norm(flow, axis=-1) if flow is not None else values
        draw_slice(axis, shown, fluid, box)
        if flow is not None:
            draw_streamlines(axis, flow, fluid, box)
        axis.set(title=title, xlabel="x [m]", ylabel=label)
    return figure


def chart(request: Request) -> str:
    """Draw a bake file to a picture.

    Raises:
        InputError: no bake file is given, it cannot be read, matplotlib is missing, or the picture cannot be written.
    """
    if request.source is None:
        raise InputError("chart field: missing the bake file (.h5) to draw")
    grid = TurbulenceGrid.load(request.source)
    save_figure(lambda: draw_field(grid, request.time), request.output)
    velocity, k, _ = snapshot(grid, request.time)
    fastest, rms = np.linalg.norm(velocity[grid.fluid], axis=-1).max(), np.sqrt(2.0 / 3.0 * k[grid.fluid].max())
    return f"The wind reaches {fastest:.3g} m/s, its gusts {rms:.3g} m/s rms a component."


def snapshot(grid: TurbulenceGrid, time: float | None) -> tuple[Array, Array, Array]:
    """velocity, k, epsilon at the snapshot nearest to a time."""
    if grid.time is None:
        return grid.velocity, grid.k, grid.epsilon
    index = len(grid.time) - 1 if time is None else int(np.abs(grid.time - time).argmin())
    return grid.velocity[index], grid.k[index], grid.epsilon[index]


def slice_indices(grid: TurbulenceGrid) -> tuple[int, int]:
    """Index along y of the slice seen from above, and along z of the upright slices."""
    solid = np.argwhere(~grid.fluid)
    if not len(solid):
        return grid.cells[1] // 4, grid.cells[2] // 2
    low, high = solid.min(axis=0), solid.max(axis=0)
    touches = low[2] == 0 and high[2] < grid.cells[2] - 1  # obstacle on a plane of symmetry: cut along the plane
    return int((low[1] + high[1]) // 2), 0 if touches else int((low[2] + high[2]) // 2)


def draw_slice(axis: Any, values: Array, fluid: NDArray[np.bool_], box: tuple[float, ...]) -> None:
    """Colours of one slice (nx, m) with the obstacles in grey, and a colour bar."""
    top, bottom = np.percentile(values[fluid], [99.5, 0.5])
    colors = np.ma.masked_array(values, ~fluid)
    image = axis.imshow(colors.T, origin="lower", extent=box, cmap="viridis", vmin=min(bottom, top), vmax=top, aspect="equal")
    axis.set_facecolor("0.55")
    axis.figure.colorbar(image, ax=axis, pad=0.01)


def draw_streamlines(axis: Any, flow: Array, fluid: NDArray[np.bool_], box: tuple[float, ...]) -> None:
    """Streamlines of a slice, flow (nx, m, 2)."""
    nx, m = fluid.shape
    x = box[0] + (np.arange(nx) + 0.5) * (box[1] - box[0]) / nx
    y = box[2] + (np.arange(m) + 0.5) * (box[3] - box[2]) / m
    u, v = (np.ma.masked_array(flow[..., c], ~fluid).T for c in (0, 1))
    density = (1.6, max(0.4, 1.6 * (box[3] - box[2]) / (box[1] - box[0])))
    axis.streamplot(x, y, u, v, color="white", linewidth=0.5, arrowsize=0.6, density=density)
    axis.set(xlim=box[:2], ylim=box[2:])
