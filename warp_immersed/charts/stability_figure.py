"""The picture of the atlas."""

from collections.abc import Sequence
from typing import Any

import numpy as np

# from the worst class to the best: the largest usable step [ms] from which on it holds
CLASSES = (
    (0.0, "#c0392b", "none"),
    (0.3, "#e67e22", "< 1 ms"),
    (1.0, "#f1c40f", "1 to 5 ms"),
    (5.0, "#b7d66b", "5 to 40 ms"),
    (41.0, "#2e8b57", "1/24 s or more"),
)
MARKS = {"blows up": "x", "wrong regime": "~", "drifts": "\u2192", "refused": "\u2013", "": ""}


def draw(rows: Sequence[dict[str, Any]], noise: Sequence[dict[str, Any]]) -> Any:
    """A matplotlib figure: a map for each method and setting, and two panels on noise."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    methods = list(dict.fromkeys(row["method"] for row in rows))
    methods = [methods[-1], *methods[:-1]]
    settings = list(dict.fromkeys(row["setting"] for row in rows))
    figure: Any = Figure(figsize=(1.28 * len(methods) + 1.2, 8.6), layout="constrained")
    maps, panels = figure.subfigures(2, 1, height_ratios=(2.3, 1.0))
    axes = maps.subplots(len(settings), len(methods), squeeze=False)
    for i, setting in enumerate(settings):
        for j, method in enumerate(methods):
            mine = [row for row in rows if row["method"] == method and row["setting"] == setting]
            draw_map(axes[i][j], mine)
            if i == 0:
                axes[i][j].set_title(
                    method.replace(" ", "\n", 1).replace(", ", ",\n"), fontsize=8.5, fontweight="bold" if j == 0 else None
                )
            if j == 0:
                axes[i][j].set_ylabel(f"{setting.replace(', ', chr(10)).replace(': ', chr(10))}\n\nthickness 1 :", fontsize=8)
            else:
                axes[i][j].set_yticks([])
            if not mine:
                axes[i][j].axis("off")
    keys = [Patch(color=color, label=text) for _, color, text in CLASSES]
    maps.legend(
        handles=keys, loc="outside lower center", ncols=len(keys), fontsize=8.5, frameon=False,
        title="largest usable step; beyond it:  x blows up   ~ wrong regime   \u2192 drifts   \u2013 refused (grey)",
        title_fontsize=8.5,
    )  # fmt: skip
    axes[-1][len(methods) // 2].set_xlabel("density of the body over that of the fluid", fontsize=9)
    figure.suptitle(
        "warp_immersed is right at film frame rates wherever fixed steps, lagged added mass and the printed equations fail"
    )
    draw_noise(panels, noise)
    return figure


def draw_map(axis: Any, rows: Sequence[dict[str, Any]]) -> None:
    """One map: density ratio across, aspect ratio up."""
    from matplotlib.colors import BoundaryNorm, ListedColormap

    if not rows:
        return
    across, up = sorted({row["density_ratio"] for row in rows}), sorted({row["aspect_ratio"] for row in rows})
    values = np.zeros((len(up), len(across)))
    for row in rows:
        x, y = across.index(row["density_ratio"]), up.index(row["aspect_ratio"])
        values[y, x] = row["largest_step_ms"]
        if row["beyond"] == "refused" and row["largest_step_ms"] == 0.0:
            values[y, x] = np.nan
        axis.text(x, y, MARKS[row["beyond"]], ha="center", va="center", fontsize=8, color="black")
    bounds = [-1.0, *(start for start, _, _ in CLASSES[1:]), 1e6]
    colors = ListedColormap([color for _, color, _ in CLASSES]).with_extremes(bad="0.75")
    axis.imshow(values, origin="lower", aspect="auto", cmap=colors, norm=BoundaryNorm(bounds, colors.N))
    axis.set_xticks(range(len(across)), [f"{value:g}" for value in across], fontsize=6, rotation=90)
    axis.set_yticks(range(len(up)), [f"{value:g}" for value in up], fontsize=7)
    axis.tick_params(length=0)


def draw_noise(panel: Any, rows: Sequence[dict[str, Any]]) -> None:
    """Variance of the seen wind against the step, and spin in gusts against time."""
    left, right = panel.subplots(1, 2)
    colors = {
        "warp_immersed": "#d62728",
        "Euler-Maruyama": "#4e79a7",
        "RK4, noise after": "#9c755f",
        "undamped, as printed": "#4e79a7",
    }
    for axis, quantity in ((left, "variance"), (right, "spin")):
        for method in dict.fromkeys(row["method"] for row in rows if row["quantity"] == quantity):
            points = np.array(
                [(row["at"], row["value"]) for row in rows if (row["quantity"], row["method"]) == (quantity, method)]
            )
            finite = np.isfinite(points[:, 1])
            ours = method == "warp_immersed"
            axis.loglog(*points[finite].T, "o-", color=colors[method], label=method, linewidth=2.4 if ours else 1.2, markersize=4)
            broken = points[~finite]
            axis.plot(broken[:, 0], np.full(len(broken), 12.0), "x", color=colors[method])
    left.axhline(1.0, color="0.6", linewidth=0.8, linestyle="--")
    left.set(ylim=(0.5, 25.0), xlabel="step over the time scale of the turbulence", ylabel="variance / exact")
    left.set_title("Noise: only the exact process keeps its strength (x: unbounded)", fontsize=9.5)
    right.set(xlabel="time, s", ylabel="rms spin, rad/s")
    right.set_title("Angular noise as printed grows for ever; in warp_immersed the loads damp it", fontsize=9.5)
    for axis in (left, right):
        axis.legend(fontsize=8)
        axis.grid(alpha=0.25)
