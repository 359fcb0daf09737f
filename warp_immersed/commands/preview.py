"""`warp-immersed preview`."""

import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated

import typer

from warp_immersed.commands.output import check_folder
from warp_immersed.errors import InputError


def preview(
    source: Annotated[Path, typer.Argument(help="A recording (.h5) or a USD file.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="A .png (picture) or .mp4 (movie). [default: SOURCE.png]")
    ] = None,
    frame: Annotated[int | None, typer.Option(min=0, help="Which frame a picture shows, from 0. [default: the scene's]")] = None,
    sheet: Annotated[int | None, typer.Option(min=1, max=100, help="A contact sheet of this many frames.")] = None,
    size: Annotated[str, typer.Option(help="Width x height of a picture, pixels.")] = "960x540",
    samples: Annotated[int | None, typer.Option(min=1, help="Light paths a pixel. [default: 64, in movies 16]")] = None,
    every: Annotated[int, typer.Option(min=1, help="In movies: take every n-th frame, and play it as slowly.")] = 1,
    small: Annotated[bool, typer.Option(help="Write a picture with 256 colours: a small file.")] = False,
    progress: Annotated[bool, typer.Option(help="Show a progress bar.")] = True,
) -> None:
    """Take a picture, a contact sheet or a movie (needs the extra: pip install warp-immersed[preview])."""
    from warp_immersed.preview import contact_sheet, still_frames, write_movie, write_picture

    path = output or source.with_suffix(".png")
    if path.suffix not in (".png", ".mp4"):
        raise InputError(f"output {str(path)!r}: found ending {path.suffix!r}, must be .png or .mp4")
    if path.suffix == ".mp4" and (sheet is not None or frame is not None):
        raise InputError(f"output {str(path)!r}: frame and sheet go with a .png")
    width, height = picture_size(size, path.suffix == ".mp4")
    check_folder(path)
    from warp_immersed.picture import Photographer
    from warp_immersed.shot import open_shot

    with open_shot(source) as shot:
        if frame is not None and frame >= shot.frames:
            raise InputError(f"frame: found {frame}, {source.name} has {shot.frames}, from 0")
        photographer = Photographer(shot, width, height, samples or (16 if path.suffix == ".mp4" else 64))
        if path.suffix == ".mp4":
            write_movie(photographer, bar(range(0, shot.frames, every), progress), (width, height), shot.fps / every, path)
        elif sheet is not None:
            frames = [round((shot.frames - 1) * i / max(sheet - 1, 1)) for i in range(sheet)]
            write_picture(
                contact_sheet(photographer, shot, bar(frames, progress), -(-sheet // round(sheet**0.5))),
                path,
                small,
            )
        else:
            write_picture(photographer.take(still_frames(shot) if frame is None else (frame,)), path, small)
    typer.echo(str(path))


def bar(frames: Sequence[int], shown: bool) -> Iterable[int]:
    """The frames, with a progress bar on a terminal as they are taken."""
    from rich.console import Console
    from rich.progress import track

    console = Console(file=sys.stderr)
    return track(frames, "frames", console=console, transient=True, disable=not (shown and console.is_terminal))


def picture_size(text: str, even: bool) -> tuple[int, int]:
    """Width and height from "960x540"; movies take even numbers only.

    Raises:
        InputError: not two numbers in range.
    """
    try:
        width, height = (int(part) for part in text.lower().split("x"))
    except ValueError as error:
        raise InputError(f"size: found {text!r}, must be like 960x540") from error
    if not (16 <= width <= 16384 and 16 <= height <= 16384):
        raise InputError(f"size: found {text!r}, must be between 16 and 16384 pixels each way")
    if even and (width % 2 or height % 2):
        raise InputError(f"size: found {text!r}, a movie needs even numbers")
    return width, height
