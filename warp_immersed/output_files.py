"""Outputs grow in hidden files beside their place, and take it when they are whole."""

import os
import re
import shutil
from pathlib import Path

from warp_immersed.errors import InputError


def hidden_beside(path: Path, word: str, suffix: str | None = None) -> Path:
    """A hidden file beside `path` that belongs to it: .NAME.WORD with the same ending, or another."""
    return path.with_name(f".{path.stem}.{word}{path.suffix if suffix is None else suffix}")


def partial_path(path: Path) -> Path:
    """Where a file is written until it is whole: beside it, hidden, with the same ending."""
    return hidden_beside(path, "partial")


def parts_folder(path: Path) -> Path:
    """The folder beside a file that holds the files it refers to."""
    return path.with_name(f"{path.name}.parts")


def partial_parts(path: Path) -> Path:
    """Where that folder is until it is whole."""
    return path.with_name(f".{path.name}.partial.parts")


def start_parts(path: Path) -> Path:
    """An empty folder in which the parts of `path` are written until they are whole.

    Raises:
        InputError: where they are to go is something that is not such a folder, and will not be replaced.
    """
    parts = parts_folder(path)
    if parts.exists() and not holds_parts(parts):
        raise InputError(f"output {str(path)!r}: its parts go to {parts.name!r}, where something else is; move that away")
    folder = partial_parts(path)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    return folder


def holds_parts(folder: Path) -> bool:
    """Whether a folder holds parts of an output and nothing else."""
    names = r"(clip_\d+|Crowd_\d+|manifest)\.usd[ac]?"
    return folder.is_dir() and all(re.fullmatch(names, entry.name) for entry in folder.iterdir())


def publish(path: Path) -> None:
    """Give a whole partial file its name, and the parts it refers to; parts of an earlier file go.

    A file with parts cannot be replaced in one stroke: the old one goes first, so that a file and parts that do not belong
    together are never seen.
    """
    folder, parts = partial_parts(path), parts_folder(path)
    if folder.is_dir():
        path.unlink(missing_ok=True)
        shutil.rmtree(parts, ignore_errors=True)
        os.replace(folder, parts)
        os.replace(partial_path(path), path)
    else:
        os.replace(partial_path(path), path)
        if holds_parts(parts):
            shutil.rmtree(parts)


def discard(path: Path) -> None:
    """Remove what was written of a file that will not be whole."""
    partial_path(path).unlink(missing_ok=True)
    shutil.rmtree(partial_parts(path), ignore_errors=True)


def written_size(path: Path) -> int:
    """Bytes of an output, the parts it refers to included."""
    parts = parts_folder(path)
    files = [path, *(parts.iterdir() if parts.is_dir() else [])]
    return sum(file.stat().st_size for file in files)
