"""What a USD export can be asked for."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from warp_immersed.errors import InputError

UpAxis = Literal["y", "z"]
Units = Literal["m", "cm"]
Instancing = Literal["points", "xforms"]

USD_ENDINGS = (".usdc", ".usda", ".usd", ".usdz")
# A prim a body and two attributes a prim: more than this take minutes to write, and as long to open.
MOST_XFORMS = 2000
# What a zip archive without its 64-bit extension holds, which .usdz does not allow.
LARGEST_PACKAGE = 2**32 - 1
BYTES_PER_SAMPLE = 45


@dataclass(frozen=True)
class ExportOptions:
    """How a USD file describes a run. The motion is the same with all of them.

    Attributes:
        up_axis: "y" or "z". Z-up turns the world by a quarter about x: (x, y, z) becomes (x, -z, y).
        units: "m" or "cm", of positions, velocities, meshes and extents.
        fps: time codes per second, which do not change the speed: frame i of a simulation at f frames per second is at time
            code start_frame + i fps / f. None: f, so that every frame is a whole time code.
        start_frame: time code of the first frame of the simulation.
        motion_blur: write velocities and angular velocities, which renderers blur by.
        chunk_frames: spread the frames over value clips of so many frames each, in a folder beside the file.
        shards: spread the bodies over so many point instancers, in a folder beside the file.
        instancing: "points", one point instancer, or "xforms", a transform a body for tools without instancers, small crowds
            only.

    Raises:
        InputError: a value out of range, or options that exclude each other.
    """

    up_axis: UpAxis = "y"
    units: Units = "m"
    fps: float | None = None
    start_frame: int = 1
    motion_blur: bool = True
    chunk_frames: int | None = None
    shards: int | None = None
    instancing: Instancing = "points"

    def __post_init__(self) -> None:
        for name, value, allowed in (
            ("up axis", self.up_axis, ("y", "z")),
            ("units", self.units, ("m", "cm")),
            ("instancing", self.instancing, ("points", "xforms")),
        ):
            if value not in allowed:
                raise InputError(f"{name}: found {value!r}, must be {' or '.join(allowed)}")
        if self.fps is not None and not 0.0 < self.fps < 1e6:
            raise InputError(f"fps: found {self.fps}, must be a positive number")
        for name, count in (("chunk frames", self.chunk_frames), ("shards", self.shards)):
            if count is not None and count < 1:
                raise InputError(f"{name}: found {count}, must be at least 1")
        spread = [name for name, value in (("chunk frames", self.chunk_frames), ("shards", self.shards)) if value is not None]
        if self.instancing == "xforms":
            spread.append("instancing xforms")
        if len(spread) > 1:
            raise InputError(f"{' and '.join(spread)}: exclude each other, choose one")

    @property
    def units_per_meter(self) -> float:
        """Stage units in a metre."""
        return 1.0 if self.units == "m" else 100.0

    def rate(self, simulated: float) -> float:
        """Time codes per second of a run at `simulated` frames per second."""
        return simulated if self.fps is None else self.fps

    def time_code(self, frame: int, simulated: float) -> float:
        """Time code of a frame of a run at `simulated` frames per second."""
        return self.start_frame + frame * self.rate(simulated) / simulated

    def check_output(self, path: Path, frames: int, bodies: int) -> None:
        """Refuse a USD file that these options cannot make.

        Raises:
            InputError: another ending, too many bodies, or a package that would be too large.
        """
        if path.suffix not in USD_ENDINGS:
            raise InputError(f"output {str(path)!r}: found ending {path.suffix!r}, must be one of {', '.join(USD_ENDINGS)}")
        if self.shards is not None and self.shards > bodies:
            raise InputError(f"shards: found {self.shards}, must be at most the {bodies} bodies there are")
        if self.instancing == "xforms" and bodies > MOST_XFORMS:
            raise InputError(
                f"instancing: xforms are for at most {MOST_XFORMS} bodies, here are {bodies}; use points, or choose fewer bodies"
            )
        if path.suffix == ".usdz":
            if self.chunk_frames is not None or self.shards is not None:
                raise InputError(f"output {str(path)!r}: a .usdz is one file; clips and shards need .usdc")
            size = frames * bodies * BYTES_PER_SAMPLE
            if size > LARGEST_PACKAGE:
                raise InputError(f"output {str(path)!r}: about {size / 1e9:.1f} GB, a .usdz holds at most 4.3 GB; use .usdc")
