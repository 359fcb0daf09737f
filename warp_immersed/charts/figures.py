"""Writing figures to files."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from warp_immersed.errors import InputError


def save_figure(draw: Callable[[], Any], output: str | Path) -> Path:
    """Draw a matplotlib figure and write it to a picture.

    Raises:
        InputError: matplotlib is missing, or the picture cannot be written.
    """
    try:
        figure = draw()
    except ImportError as error:
        raise InputError("charts need matplotlib: pip install 'warp-immersed[charts]'") from error
    try:
        figure.savefig(output, dpi=130)
    except (OSError, ValueError) as error:
        raise InputError(f"{output}: cannot be written ({error}); name a .png, .pdf or .svg file") from error
    return Path(output)
