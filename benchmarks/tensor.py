"""Time against error of the added-mass solvers, ours over each other's at equal time (the `added-mass` chart draws it)."""

from collections.abc import Iterator

from benchmarks.measurement import Row
from warp_immersed.charts.added_mass import CAPYTAINE, FUNDAMENTAL, advantage, measure

ASKED = 4.0  # times capytaine's accuracy at equal time


def rows(quick: bool) -> Iterator[Row]:
    """A row a solve, then the ratios by aspect ratio."""
    found = measure(quick, lambda what, fraction: None)
    for row in found:
        yield {"what": "tensor", **row}
    for other in (CAPYTAINE, FUNDAMENTAL):
        ratios = advantage(found, other)
        if not ratios:
            yield {
                "what": "tensor ratio",
                "other": other,
                "skipped": f"{other} is not installed: pip install 'warp-immersed[peers]'",
            }
            continue
        row: Row = {"what": "tensor ratio", "other": other, "error_over_ours_at_equal_time": ratios}
        if other == CAPYTAINE:
            row |= {"asked": ASKED, "met": min(ratios.values()) >= ASKED}
        yield row
