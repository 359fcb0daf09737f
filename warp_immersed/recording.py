"""`Recording`: what a simulation leaves, in memory or in one HDF5 file."""

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warp_immersed.checkpoint import Checkpoint, check_same_run, checkpoint_path
from warp_immersed.ensemble import Frame
from warp_immersed.errors import InputError
from warp_immersed.frame_file import FrameFile, create_frames, is_being_written, new_hdf5, repack
from warp_immersed.looks import Prototype
from warp_immersed.output_files import hidden_beside, partial_path, publish

SCHEMA = "warp-immersed recording"
SCHEMA_VERSION = 2

# name: (units, long name) of the datasets with a number a frame, and of those with an array: frames first, bodies second
PER_FRAME = {
    "times": ("s", "time since the start"),
    "body_steps": ("1", "substeps taken by all bodies since the start"),
}
DATASETS = {
    "positions": ("m", "position of the centre of mass, world axes"),
    "orientations": ("1", "unit quaternion (x, y, z, w), body to world"),
    "velocities": ("m s-1", "velocity of the centre of mass, world axes"),
    "angular_velocities": ("rad s-1", "angular velocity, world axes"),
    "state": ("1", "0 waiting, 1 moving, 2 landed, 3 failed"),
}
TYPES = {"times": "<f8", "body_steps": "<i8", "state": "u1"}


@dataclass(frozen=True, eq=False)
class Recording:
    """All frames of a run.

    times (F,) [s]; positions (F, N, 3) [m] of the centres of mass; orientations (F, N, 4), (x, y, z, w), body to world;
    velocities (F, N, 3) [m/s]; angular_velocities (F, N, 3) [rad/s], world axes; state (F, N) uint8: 0 waiting, 1
    moving, 2 landed, 3 failed; body_steps (F,): substeps taken by all bodies up to each frame; prototypes: the kinds of
    bodies in their order; manifest: versions, device, seed, scene text and digest.
    """

    times: NDArray[np.float64]
    positions: NDArray[np.float32]
    orientations: NDArray[np.float32]
    velocities: NDArray[np.float32]
    angular_velocities: NDArray[np.float32]
    state: NDArray[np.uint8]
    body_steps: NDArray[np.int64]
    fps: float
    prototypes: tuple[Prototype, ...]
    manifest: Mapping[str, Any]

    def frame(self, index: int) -> Frame:
        """One frame."""
        arrays = {name: getattr(self, name)[index] for name in DATASETS}
        return Frame(index=index, time=float(self.times[index]), body_steps=int(self.body_steps[index]), **arrays)

    def save(self, path: str | Path, compress: bool = False) -> None:
        """Write it to an HDF5 file.

        Raises:
            InputError: the disk is full or gone.
        """
        writer = start_recording(Path(path), self.prototypes, self.fps, self.manifest, len(self.times), compress)
        try:
            for index in range(len(self.times)):
                writer.write(self.frame(index))
            writer.finish()
        except BaseException:
            writer.abort()
            raise

    @staticmethod
    def load(path: str | Path) -> "Recording":
        """Read a recording into memory.

        Raises:
            InputError: no such file, not a recording, of another schema version, unfinished, or damaged.
        """
        with open_recording(path) as recording:
            return replace(recording, **{name: getattr(recording, name)[:] for name in DATASETS})


@contextmanager
def open_recording(path: str | Path) -> Iterator[Recording]:
    """A recording whose arrays stay in the file: what is indexed is read. For runs that are larger than memory.

    Raises:
        InputError: no such file, not a recording, of another schema version, unfinished, or damaged.
    """
    import h5py

    if not Path(path).is_file():
        raise InputError(f"recording {str(path)!r}: no such file")
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("schema") != SCHEMA:
                raise InputError(f"recording {str(path)!r}: an HDF5 file, but not a recording of warp-immersed")
            found = file.attrs["schema_version"]
            if found != SCHEMA_VERSION:
                raise InputError(f"recording {str(path)!r}: schema version {found}, this program reads {SCHEMA_VERSION}")
            per_frame = {name: file[name][:] for name in PER_FRAME}
            written = int(np.isfinite(per_frame["times"]).sum())
            if written < len(per_frame["times"]):
                raise InputError(
                    f"recording {str(path)!r}: unfinished, {written} of {len(per_frame['times'])} frames; finish it with "
                    f"warp-immersed run --resume"
                )
            yield Recording(
                fps=float(file.attrs["fps"]),
                prototypes=tuple(read_prototype(file["prototypes"][name]) for name in file["prototypes"]),
                manifest=json.loads(file.attrs["manifest"]),
                **per_frame,
                **{name: file[name] for name in DATASETS},
            )
    except (OSError, KeyError, RuntimeError) as error:
        # the system's own errors, such as a full disk met by whoever reads, have a number; HDF5's have none
        if isinstance(error, OSError) and error.errno is not None:
            raise
        raise InputError(f"recording {str(path)!r}: damaged or not an HDF5 file ({error})") from error


class RecordingWriter:
    """Writes frames to an HDF5 file as they come: beside the path, renamed to it when finished.

    `start_recording` and `resume_recording` make one. A frame that carries a snapshot of the device makes a checkpoint, from
    which a run can go on after a full disk, Ctrl-C or a kill at any moment.

    Args:
        path: an .h5 file. manifest: as in `Recording`. frames: how many the file has room for.
        compress: pack the file when it is finished. done: frames that are there already.

    Raises:
        OSError, KeyError: the partial file is not there or damaged.
    """

    def __init__(self, path: Path, manifest: Mapping[str, Any], frames: int, compress: bool, done: int = 0):
        self.path = path
        self._manifest = manifest
        self._frames = frames
        self._compress = compress
        self._done = self._kept = done
        self._file = FrameFile(partial_path(path), (*PER_FRAME, *DATASETS))

    def write(self, frame: Frame) -> None:
        """Put a frame in its place.

        Raises:
            InputError: the disk is full or gone.
        """
        try:
            self._file.write(frame.index, frame_values(frame))
            self._done = frame.index + 1
            if frame.snapshot is not None:
                self._file.sync()
                Checkpoint(frame.index, frame.body_steps, frame.snapshot, self._manifest).save(checkpoint_path(self.path))
                self._kept = self._done
        except OSError as error:
            raise self._cannot_write(error) from error

    def finish(self) -> None:
        """Give the file its name, with as many frames as came. The checkpoint of a run that was cut short stays.

        Raises:
            InputError: the disk is full or gone.
        """
        import h5py

        self._file.close()
        partial, packed = partial_path(self.path), hidden_beside(self.path, "packed")
        try:
            if self._compress or self._done < self._frames:
                with h5py.File(partial, "r") as source, new_hdf5(packed) as target:
                    target.attrs.update(source.attrs)
                    repack(source, target, (*PER_FRAME, *DATASETS), self._done, self._compress)
                    source.copy("prototypes", target)
                os.replace(packed, partial)
            publish(self.path)
        except (OSError, RuntimeError) as error:
            raise self._cannot_write(error) from error
        if self._done == self._frames:
            remove_traces(self.path)

    def abort(self) -> None:
        """Keep what a run can go on from, if there is a checkpoint; else leave nothing behind."""
        self._file.close()
        hidden_beside(self.path, "packed").unlink(missing_ok=True)
        if not self._kept:
            remove_traces(self.path)

    def _cannot_write(self, error: Exception) -> InputError:
        kept = f"; {self._kept} frames are kept, make room and go on with --resume" if self._kept else ""
        return InputError(f"output {str(self.path)!r}: cannot write ({reason_of(error)}){kept}")


def start_recording(
    path: Path, prototypes: tuple[Prototype, ...], fps: float, manifest: Mapping[str, Any], frames: int, compress: bool = False
) -> RecordingWriter:
    """A writer for a new file with room for `frames` frames; what an unfinished run left there is removed.

    Raises:
        InputError: another process writes it; the disk is full or gone.
    """
    refuse_two_writers(path)
    try:
        remove_traces(path)
        create_recording(partial_path(path), prototypes, fps, manifest, frames)
        return RecordingWriter(path, manifest, frames, compress)
    except (OSError, RuntimeError) as error:
        remove_traces(path)
        raise InputError(f"output {str(path)!r}: cannot write ({reason_of(error)})") from error


def resume_recording(
    path: Path, prototypes: tuple[Prototype, ...], fps: float, manifest: Mapping[str, Any], frames: int, compress: bool = False
) -> tuple[RecordingWriter, Checkpoint | None]:
    """A writer that goes on with an unfinished file, and where the run stood; a new file and None without a checkpoint.

    Raises:
        InputError: what is there is of another run or damaged, or another process writes it; the disk is full or gone.
    """
    refuse_two_writers(path)
    partial, mark = partial_path(path), checkpoint_path(path)
    if not mark.is_file():
        return start_recording(path, prototypes, fps, manifest, frames, compress), None
    checkpoint = Checkpoint.load(mark)
    check_same_run(path, checkpoint.manifest, manifest)
    try:
        if not partial.is_file():
            reopen(path, prototypes, fps, manifest, frames, checkpoint.frame + 1)
        return RecordingWriter(path, manifest, frames, compress, checkpoint.frame + 1), checkpoint
    except (OSError, KeyError, RuntimeError) as error:
        raise InputError(f"output {str(path)!r}: cannot go on ({reason_of(error)}); run without --resume") from error


def refuse_two_writers(path: Path) -> None:
    """Refuse an output that a running process is writing.

    Raises:
        InputError: there is one.
    """
    if is_being_written(partial_path(path)):
        raise InputError(f"output {str(path)!r}: another process is writing it; wait for it, or end it")


def is_finished(path: Path, manifest: Mapping[str, Any], frames: int) -> bool:
    """Whether a recording is there, with all its frames, and none is being made in its place.

    Raises:
        InputError: it is of another run, or damaged.
    """
    if not path.is_file() or partial_path(path).is_file():
        return False
    with open_recording(path) as recording:
        check_same_run(path, recording.manifest, manifest)
        return len(recording.times) == frames


def reopen(
    path: Path, prototypes: tuple[Prototype, ...], fps: float, manifest: Mapping[str, Any], frames: int, done: int
) -> None:
    """Make a partial file again of the whole one that Ctrl-C left, with its first `done` frames and room for all."""
    copy = hidden_beside(path, "packed")
    create_recording(copy, prototypes, fps, manifest, frames)
    file = FrameFile(copy, (*PER_FRAME, *DATASETS))
    with open_recording(path) as recording:
        for index in range(done):
            file.write(index, frame_values(recording.frame(index)))
    file.sync()
    file.close()
    os.replace(copy, partial_path(path))


def create_recording(path: Path, prototypes: tuple[Prototype, ...], fps: float, manifest: Mapping[str, Any], frames: int) -> None:
    """An HDF5 file with everything but the frames; the times of those that have not come are NaN."""
    bodies = sum(prototype.count for prototype in prototypes)
    widths = {"orientations": (4,), "state": ()}
    with new_hdf5(path) as file:
        file.attrs.update({"schema": SCHEMA, "schema_version": SCHEMA_VERSION, "fps": fps, "manifest": json.dumps(manifest)})
        for name, (units, long_name) in (PER_FRAME | DATASETS).items():
            shape = (frames,) if name in PER_FRAME else (frames, bodies, *widths.get(name, (3,)))
            dataset = create_frames(file, name, shape, TYPES.get(name, "<f4"))
            dataset.attrs.update({"units": units, "long_name": long_name})
        file["times"][:] = np.nan
        file["body_steps"][:] = 0
        group = file.create_group("prototypes", track_order=True)
        for prototype in prototypes:
            write_prototype(group.create_group(prototype.name), prototype)


def frame_values(frame: Frame) -> dict[str, Any]:
    """A frame by the names of the datasets; its time last, for that marks it as written."""
    return {**{name: getattr(frame, name) for name in DATASETS}, "body_steps": frame.body_steps, "times": frame.time}


def remove_traces(path: Path) -> None:
    """Remove the checkpoint, first, and the partial files of an output."""
    mark = checkpoint_path(path)
    for trace in (mark, mark.with_name(mark.name + ".part"), hidden_beside(path, "packed"), partial_path(path)):
        trace.unlink(missing_ok=True)


def reason_of(error: Exception) -> str:
    """What the system said, without the file's name."""
    return error.strerror if isinstance(error, OSError) and error.strerror else str(error)


def write_prototype(group: Any, prototype: Prototype) -> None:
    """Put a prototype into an HDF5 group."""
    group.attrs.update({name: getattr(prototype, name) for name in ("count", "colors", "roughness", "metallic", "is_sheet")})
    for name, units in (("vertices", "m"), ("faces", "1"), ("uv", "1")):
        group.create_dataset(name, data=getattr(prototype, name)).attrs["units"] = units


def read_prototype(group: Any) -> Prototype:
    """Read a prototype from an HDF5 group."""
    return Prototype(
        name=group.name.rsplit("/", 1)[-1],
        count=int(group.attrs["count"]),
        vertices=group["vertices"][:],
        faces=group["faces"][:],
        uv=group["uv"][:],
        colors=tuple((float(r), float(g), float(b)) for r, g, b in group.attrs["colors"]),
        roughness=float(group.attrs["roughness"]),
        metallic=float(group.attrs["metallic"]),
        is_sheet=bool(group.attrs["is_sheet"]),
    )
