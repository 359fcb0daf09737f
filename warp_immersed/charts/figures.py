"""What the charts share: what they are asked, and how pictures and tables get to files."""

import csv
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import Image

from warp_immersed.charts.machine import stamp
from warp_immersed.errors import InputError

Row = Mapping[str, Any]
# Called with what is being done, and the fraction of the chart that is done.
Report = Callable[[str, float], None]


@dataclass(frozen=True)
class Request:
    """What a chart is asked for: the picture's file; minutes rather than all cases; the file to draw and the snapshot of a
    flow [s], and the library shape, where it needs them; and where to say how far it is."""

    output: Path
    quick: bool = False
    source: Path | None = None
    time: float | None = None
    shape: str | None = None
    report: Report = lambda what, fraction: None


def save_figure(draw: Callable[[], Any], output: str | Path) -> Path:
    """Draw a matplotlib figure and write it to a picture, with machine, versions and date at its foot.

    Raises:
        InputError: matplotlib is missing, or the picture cannot be written.
    """
    try:
        figure = draw()
    except ImportError as error:
        raise InputError("charts need matplotlib: pip install 'warp-immersed[charts]'") from error
    figure.text(0.5, -0.002, stamp(), ha="center", va="top", fontsize=6.5, color="0.45", in_layout=False)
    path = Path(output)
    partial = path.with_name(f".{path.stem}.partial{path.suffix}")
    try:
        figure.savefig(partial, dpi=100, bbox_inches="tight", pad_inches=0.2)
        if path.suffix == ".png":  # a palette: a third of the bytes
            with Image.open(partial) as picture:
                palette = picture.convert("RGB").quantize(192)
            palette.save(partial, optimize=True)
        os.replace(partial, path)
    except (OSError, ValueError) as error:
        raise InputError(f"{output}: cannot be written ({error}); name a .png, .pdf or .svg file") from error
    finally:
        partial.unlink(missing_ok=True)
    return path


def write_table(rows: Sequence[Row], path: Path) -> Path:
    """Write rows, all with the keys of the first, to a CSV file.

    Raises:
        InputError: the file cannot be written.
    """
    partial = path.with_name(f".{path.name}.partial")
    try:
        with partial.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
            writer.writeheader()
            writer.writerows({key: rounded(value) for key, value in row.items()} for row in rows)
        os.replace(partial, path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from error
    finally:
        partial.unlink(missing_ok=True)
    return path


def rounded(value: Any) -> Any:
    """A number as text with six digits, anything else as it is."""
    return f"{value:.6g}" if isinstance(value, float) else value


def publish(request: Request, draw: Callable[[], Any], rows: Sequence[Row]) -> None:
    """Write the table beside the picture, then the picture."""
    write_table(rows, request.output.with_suffix(".csv"))
    save_figure(draw, request.output)
