"""Refusing outputs that cannot be written, before the work is done."""

import shutil
import tempfile
from pathlib import Path

from warp_immersed.errors import InputError
from warp_immersed.export_options import BYTES_PER_SAMPLE, USD_ENDINGS, ExportOptions
from warp_immersed.output_files import partial_path


def check_output(path: Path, frames: int, bodies: int, options: ExportOptions) -> None:
    """Refuse an output that cannot be written, before the work is done."""
    endings = (*USD_ENDINGS, ".h5")
    if path.suffix not in endings:
        raise InputError(f"output {str(path)!r}: found ending {path.suffix!r}, must be one of {', '.join(endings)}")
    if path.suffix != ".h5":
        options.check_output(path, frames, bodies)
    check_folder(path)
    bytes_per_sample = {".usda": 250, ".h5": 54, ".usdz": 2 * BYTES_PER_SAMPLE}.get(path.suffix, BYTES_PER_SAMPLE)
    needed = frames * bodies * bytes_per_sample
    free = shutil.disk_usage(next(parent for parent in path.absolute().parents if parent.exists())).free
    partial = partial_path(path)  # what an unfinished run left is gone on with, or goes
    free += getattr(partial.stat(), "st_blocks", 0) * 512 if partial.is_file() else 0
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
