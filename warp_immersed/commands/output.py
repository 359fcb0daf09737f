"""Refusing outputs that cannot be written, before the work is done."""

import shutil
import tempfile
from pathlib import Path

from warp_immersed.errors import InputError


def check_output(path: Path, frames: int, bodies: int) -> None:
    """Refuse an output that cannot be written, before the work is done."""
    endings = (".usdc", ".usda", ".usd", ".h5")
    if path.suffix not in endings:
        raise InputError(f"output {str(path)!r}: found ending {path.suffix!r}, must be one of {', '.join(endings)}")
    check_folder(path)
    needed = frames * bodies * (250 if path.suffix == ".usda" else 54 if path.suffix == ".h5" else 45)
    free = shutil.disk_usage(next(parent for parent in path.absolute().parents if parent.exists())).free
    if needed > free:
        raise InputError(f"output {str(path)!r}: needs about {needed / 1e6:.0f} MB, the disk has {free / 1e6:.0f} MB left")


def check_folder(path: Path) -> None:
    """Refuse a file whose folder cannot be written to, or made."""
    folder = next(parent for parent in path.absolute().parents if parent.exists())
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise InputError(f"output {str(path)!r}: cannot be written ({error.strerror})") from error
    if path.is_dir():
        raise InputError(f"output {str(path)!r}: is a folder, must be a file")
