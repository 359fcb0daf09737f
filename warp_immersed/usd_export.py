"""`export_usd`: a recording as USD, in the form that the options ask for."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from warp_immersed.errors import InputError
from warp_immersed.export_options import ExportOptions
from warp_immersed.looks import Prototype
from warp_immersed.recording import Recording
from warp_immersed.usd import CrowdWriter, Ids, UsdWriter
from warp_immersed.usd_clips import ClipWriter
from warp_immersed.usd_shards import ShardWriter
from warp_immersed.usd_xforms import XformWriter


def usd_writer(
    path: Path,
    prototypes: tuple[Prototype, ...],
    fps: float,
    manifest: Mapping[str, Any],
    options: ExportOptions,
    ids: Ids | None = None,
) -> CrowdWriter:
    """The writer that makes what the options ask for.

    Raises:
        InputError: the options cannot make this file.
    """
    writer: type[CrowdWriter] = UsdWriter
    if options.chunk_frames is not None:
        writer = ClipWriter
    elif options.shards is not None:
        writer = ShardWriter
    elif options.instancing == "xforms":
        writer = XformWriter
    return writer(path, prototypes, fps, manifest, options, ids)


def export_usd(
    recording: Recording,
    path: str | Path,
    options: ExportOptions | None = None,
    frames: range | None = None,
    bodies: Ids | None = None,
) -> None:
    """Write a recording to a USD file (.usdc, .usda, .usd or .usdz).

    frames: which, in steps of one; all by default. bodies: their numbers, ascending; all by default. A part keeps the time
    codes and ids that it has in the whole.

    Raises:
        InputError: another ending, or options that cannot make this file; the disk is full or gone.
    """
    options = ExportOptions() if options is None else options
    frames = range(len(recording.times)) if frames is None else frames
    count = sum(prototype.count for prototype in recording.prototypes) if bodies is None else len(bodies)
    options.check_output(Path(path), len(frames), count)
    writer = usd_writer(Path(path), recording.prototypes, recording.fps, recording.manifest, options, bodies)
    try:
        for index in frames:
            writer.write(recording.frame(index))
        writer.finish()
    except BaseException:
        writer.abort()
        raise


def chosen_frames(text: str, count: int) -> range:
    """The frames that "a:b" means out of `count`, a first and b left out, either may be missing; counted from 0.

    Raises:
        InputError: not of that form, or no frame is left.
    """
    first, colon, last = text.partition(":")
    try:
        if not colon:
            raise ValueError
        frames = range(count)[int(first) if first.strip() else None : int(last) if last.strip() else None]
    except ValueError as error:
        raise InputError(f"frames: found {text!r}, must be a:b, as in 0:48 or 100:") from error
    if not frames:
        raise InputError(f"frames: found {text!r}, chooses none of the {count} frames (0 to {count - 1})")
    return frames


def chosen_bodies(text: str, prototypes: tuple[Prototype, ...]) -> Ids:
    """The numbers of bodies that a list like "maple,0:100" means: kinds by name, ranges of numbers a:b, b left out.

    Raises:
        InputError: no such kind or range, or no body is left.
    """
    first, ranges = 0, {}
    for prototype in prototypes:
        ranges[prototype.name] = (first, first + prototype.count)
        first += prototype.count
    chosen = np.zeros(first, dtype=bool)
    for item in (part.strip() for part in text.split(",")):
        low, colon, high = item.partition(":")
        try:
            span = ranges[item] if not colon else (int(low) if low.strip() else 0, int(high) if high.strip() else first)
        except (KeyError, ValueError) as error:
            kinds = ", ".join(ranges)
            raise InputError(f"bodies: found {item!r}, must be a kind ({kinds}) or a range of numbers as in 0:100") from error
        if not 0 <= span[0] < span[1] <= first:
            raise InputError(f"bodies: found {item!r}, must be within 0:{first}")
        chosen[span[0] : span[1]] = True
    return np.flatnonzero(chosen)
