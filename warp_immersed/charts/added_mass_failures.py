"""Where the method of fundamental solutions fails: a figure and the table behind it."""

from collections.abc import Sequence
from typing import Any

from warp_immersed.charts.figures import Request, publish
from warp_immersed.fundamental_solutions import TABLE_COLUMNS, failure_table


def draw_failures(rows: Sequence[dict[str, float]]) -> Any:
    """A matplotlib figure of `failure_table`'s rows: error of the broadside added mass, and condition number, against aspect
    ratio, one line an offset of the sources, one column a number of faces."""
    from matplotlib.figure import Figure

    ratio, faces, offset, condition, error = (TABLE_COLUMNS[i] for i in (0, 1, 2, 5, 6))
    counts = sorted({row[faces] for row in rows})
    figure = Figure(figsize=(4.6 * len(counts), 6.4), layout="constrained")
    axes = figure.subplots(2, len(counts), sharex=True, squeeze=False)
    for column, count in enumerate(counts):
        for value in sorted({row[offset] for row in rows}):
            chosen = [row for row in rows if row[faces] == count and row[offset] == value]
            x = [row[ratio] for row in chosen]
            axes[0][column].loglog(x, [max(abs(row[error]), 1e-3) for row in chosen], "o-", label=f"{value:g} edges")
            axes[1][column].loglog(x, [row[condition] for row in chosen], "o-")
        axes[0][column].axhline(1.0, color="grey", linewidth=0.8, linestyle="--")
        axes[0][column].set_title(f"{count:.0f} faces")
        axes[1][column].set_xlabel("aspect ratio of the oblate spheroid")
    axes[0][0].set_ylabel("|error| of broadside added mass, % (dashed: 1 %)")
    axes[1][0].set_ylabel("condition number")
    axes[0][0].legend(title="depth of the sources", fontsize="small")
    figure.suptitle("Fundamental solutions fail on thin bodies, at any depth of the sources")
    return figure


def chart(request: Request) -> str:
    """Compute the table, draw the figure, and write both."""
    rows = failure_table(subdivisions=(2,)) if request.quick else failure_table()
    publish(request, lambda: draw_failures(rows), rows)
    thin = min(abs(row[TABLE_COLUMNS[6]]) for row in rows if row[TABLE_COLUMNS[0]] >= 50)
    return (
        f"Fundamental solutions are off by at least {thin:.0f} % broadside from aspect ratio 50 on, at any depth of the sources."
    )
