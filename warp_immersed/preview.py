"""Stills, contact sheets and movies of a shot, in files."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from warp_immersed.errors import InputError
from warp_immersed.output_files import partial_path, publish
from warp_immersed.picture import Photographer
from warp_immersed.shot import Shot

Picture = NDArray[np.uint8]

GUTTER = 4  # pixels between the pictures of a contact sheet


def still_frames(shot: Shot) -> tuple[int, ...]:
    """The frames a still shows: what the view of its scene says, or the middle of the shot."""
    view = None if shot.scene is None else shot.scene.view
    if view is None or view.time is None:
        last = (shot.frames - 1) // 2
    else:
        last = min(round(view.time * shot.fps), shot.frames - 1)
    if view is None:
        return (last,)
    frames = (last - round(i * view.interval * shot.fps) for i in range(view.exposures))
    return tuple(sorted({frame for frame in frames if frame >= 0}))


def write_picture(image: Picture, path: Path, small: bool = False) -> None:
    """Write a PNG; small: with 256 colours."""
    picture = Image.fromarray(image)
    path.parent.mkdir(parents=True, exist_ok=True)
    (with_palette(picture) if small else picture).save(partial_path(path), format="PNG", optimize=True)
    publish(path)


def with_palette(picture: Image.Image) -> Image.Image:
    """The picture in 256 colours of its own. A colour counts by the root of its area: small bright bodies keep theirs."""
    levels, areas = np.unique(np.asarray(picture).reshape(-1, 3) // 4 * 4, axis=0, return_counts=True)
    counted = np.repeat(levels, np.ceil(np.sqrt(areas)).astype(int), axis=0)
    chosen = Image.fromarray(counted[None].astype(np.uint8)).quantize(256, Image.Quantize.MEDIANCUT, kmeans=2)
    return picture.quantize(palette=chosen, dither=Image.Dither.NONE)


def contact_sheet(photographer: Photographer, shot: Shot, frames: Iterable[int], columns: int) -> Picture:
    """Pictures of these frames in rows, each with its time."""
    tiles = []
    for frame in frames:
        image = Image.fromarray(photographer.take((frame,)))
        ImageDraw.Draw(image).text(
            (8, 6), f"{frame / shot.fps:.2f} s", fill=(255, 255, 255), stroke_width=2, stroke_fill=(0, 0, 0)
        )
        tiles.append(np.asarray(image))
    height, width, _ = tiles[0].shape
    rows = -(-len(tiles) // columns)
    sheet = np.full((rows * (height + GUTTER) - GUTTER, columns * (width + GUTTER) - GUTTER, 3), 255, dtype=np.uint8)
    for index, tile in enumerate(tiles):
        top, left = (index // columns) * (height + GUTTER), (index % columns) * (width + GUTTER)
        sheet[top : top + height, left : left + width] = tile
    return sheet


def write_movie(photographer: Photographer, frames: Iterable[int], size: tuple[int, int], fps: float, path: Path) -> None:
    """Write an H.264 movie of these frames; size: width and height of its pictures, even numbers.

    Raises:
        InputError: imageio-ffmpeg is not installed.
    """
    try:
        import imageio_ffmpeg
    except ImportError as error:
        raise InputError(f"preview: needs {error.name}; pip install 'warp-immersed[preview]'") from error
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = partial_path(path)
    movie = imageio_ffmpeg.write_frames(str(partial), size, fps=fps, codec="libx264", quality=7, macro_block_size=2)
    try:
        movie.send(None)
        for frame in frames:
            movie.send(photographer.take((frame,)).tobytes())
        movie.close()
        publish(path)
    except BaseException:
        movie.close()
        partial.unlink(missing_ok=True)
        raise
