"""`Recording`: what a simulation leaves, in memory or in one HDF5 file."""

import json
import os
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warp_immersed.ensemble import Frame
from warp_immersed.errors import InputError
from warp_immersed.shape import Shape

SCHEMA = "warp-immersed recording"
SCHEMA_VERSION = 1

# name: (units, long name) of the datasets, frames first, bodies second
DATASETS = {
    "positions": ("m", "position of the centre of mass, world axes"),
    "orientations": ("1", "unit quaternion (x, y, z, w), body to world"),
    "velocities": ("m s-1", "velocity of the centre of mass, world axes"),
    "angular_velocities": ("rad s-1", "angular velocity, world axes"),
    "state": ("1", "0 waiting, 1 moving, 2 landed, 3 failed"),
}


@dataclass(frozen=True, eq=False)
class Prototype:
    """How one kind of body looks: name; count of bodies; vertices (V, 3) [m] in the principal frame; faces (F, 3); uv
    (V, 2); color, linear RGB; whether it is a sheet, seen from both sides."""

    name: str
    count: int
    vertices: NDArray[Any]
    faces: NDArray[Any]
    uv: NDArray[Any]
    color: tuple[float, float, float]
    is_sheet: bool

    @staticmethod
    def from_shape(name: str, count: int, shape: Shape) -> "Prototype":
        """The look of a shape; a mesh without texture coordinates gets its projection along z."""
        vertices = np.asarray(shape.mesh.vertices, dtype=np.float32)
        uv = getattr(shape.mesh.visual, "uv", None)
        if uv is None or len(uv) != len(vertices):
            plane = vertices[:, :2]
            uv = (plane - plane.min(axis=0)) / max(float(np.ptp(plane, axis=0).max()), 1e-12)
        return Prototype(
            name=name,
            count=count,
            vertices=vertices,
            faces=np.asarray(shape.mesh.faces, dtype=np.int32),
            uv=np.asarray(uv, dtype=np.float32),
            color=shape.color,
            is_sheet=shape.is_sheet,
        )

    @property
    def radius(self) -> float:
        """Largest distance [m] of a vertex from the centre of mass."""
        return float(np.linalg.norm(self.vertices, axis=1).max())


@dataclass(frozen=True, eq=False)
class Recording:
    """All frames of a run.

    times (F,) [s]; positions (F, N, 3) [m] of the centres of mass; orientations (F, N, 4), (x, y, z, w), body to world;
    velocities (F, N, 3) [m/s]; angular_velocities (F, N, 3) [rad/s], world axes; state (F, N) uint8: 0 waiting, 1
    moving, 2 landed, 3 failed; body_steps: substeps taken in all; prototypes: the kinds of bodies in their order;
    manifest: versions, device, seed, scene text and digest.
    """

    times: NDArray[np.float64]
    positions: NDArray[np.float32]
    orientations: NDArray[np.float32]
    velocities: NDArray[np.float32]
    angular_velocities: NDArray[np.float32]
    state: NDArray[np.uint8]
    body_steps: int
    fps: float
    prototypes: tuple[Prototype, ...]
    manifest: Mapping[str, Any]

    def frame(self, index: int) -> Frame:
        """One frame."""
        arrays = {name: getattr(self, name)[index] for name in DATASETS}
        return Frame(index=index, time=float(self.times[index]), body_steps=self.body_steps, **arrays)

    def save(self, path: str | Path) -> None:
        """Write it to an HDF5 file."""
        writer = RecordingWriter(Path(path), self.prototypes, self.fps, self.manifest)
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
            InputError: no such file, not a recording, of another schema version, or damaged.
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
                return Recording(
                    times=file["times"][:],
                    body_steps=int(file.attrs["body_steps"]),
                    fps=float(file.attrs["fps"]),
                    prototypes=tuple(read_prototype(file["prototypes"][name]) for name in file["prototypes"]),
                    manifest=json.loads(file.attrs["manifest"]),
                    **{name: file[name][:] for name in DATASETS},
                )
        except (OSError, KeyError) as error:
            raise InputError(f"recording {str(path)!r}: damaged or not an HDF5 file ({error})") from error


class RecordingWriter:
    """Writes frames to an HDF5 file as they come: beside the path, renamed to it when finished."""

    def __init__(self, path: Path, prototypes: tuple[Prototype, ...], fps: float, manifest: Mapping[str, Any]):
        import h5py

        self.path = path
        self._partial = partial_path(path)
        self._frames = 0
        self._body_steps = 0
        bodies = sum(prototype.count for prototype in prototypes)
        shapes = {"positions": (bodies, 3), "orientations": (bodies, 4), "state": (bodies,)}
        # without a chunk cache every write goes to the disk at once, and says so if it cannot
        self._file = h5py.File(self._partial, "w", libver="latest", track_order=True, rdcc_nbytes=0)
        self._file.attrs.update({"schema": SCHEMA, "schema_version": SCHEMA_VERSION, "fps": fps, "body_steps": 0})
        self._file.attrs["manifest"] = json.dumps(manifest)
        self._datasets = {"times": self._file.create_dataset("times", (0,), np.float64, maxshape=(None,), chunks=(1024,))}
        self._datasets["times"].attrs.update({"units": "s", "long_name": "time since the start"})
        for name, (units, long_name) in DATASETS.items():
            shape = shapes.get(name, (bodies, 3))
            dtype = np.uint8 if name == "state" else np.float32
            dataset = self._file.create_dataset(name, (0, *shape), dtype, maxshape=(None, *shape), chunks=(1, *shape))
            dataset.attrs.update({"units": units, "long_name": long_name})
            self._datasets[name] = dataset
        group = self._file.create_group("prototypes", track_order=True)
        for prototype in prototypes:
            write_prototype(group.create_group(prototype.name), prototype)

    def write(self, frame: Frame) -> None:
        """Append a frame.

        Raises:
            InputError: the disk is full or gone.
        """
        try:
            for name, dataset in self._datasets.items():
                dataset.resize(self._frames + 1, axis=0)
                dataset[self._frames] = frame.time if name == "times" else getattr(frame, name)
        except (OSError, RuntimeError) as error:
            raise self._cannot_write(error) from error
        self._frames += 1
        self._body_steps = frame.body_steps

    def finish(self) -> None:
        """Close the file and give it its name.

        Raises:
            InputError: the disk is full or gone.
        """
        try:
            self._file.attrs["body_steps"] = self._body_steps
            self._file.close()
            os.replace(self._partial, self.path)
        except (OSError, RuntimeError) as error:
            raise self._cannot_write(error) from error

    def abort(self) -> None:
        """Leave nothing behind."""
        # HDF5 tries once more to write what it could not, and complains from its destructors
        complain, sys.unraisablehook = sys.unraisablehook, lambda _: None
        try:
            self._datasets.clear()
            self._file.close()
        except (OSError, RuntimeError):
            pass
        finally:
            self._partial.unlink(missing_ok=True)
            sys.unraisablehook = complain

    def _cannot_write(self, error: Exception) -> InputError:
        said = re.search(r"error message = '([^']*)'", str(error))
        return InputError(f"output {str(self.path)!r}: cannot write ({said.group(1) if said else error})")


def partial_path(path: Path) -> Path:
    """Where a file is written until it is whole: beside it, hidden, with the same ending."""
    return path.with_name(f".{path.stem}.partial{path.suffix}")


def write_prototype(group: Any, prototype: Prototype) -> None:
    """Put a prototype into an HDF5 group."""
    group.attrs.update({"count": prototype.count, "color": prototype.color, "is_sheet": prototype.is_sheet})
    for name, units in (("vertices", "m"), ("faces", "1"), ("uv", "1")):
        group.create_dataset(name, data=getattr(prototype, name)).attrs["units"] = units


def read_prototype(group: Any) -> Prototype:
    """Read a prototype from an HDF5 group."""
    red, green, blue = (float(c) for c in group.attrs["color"])
    return Prototype(
        name=group.name.rsplit("/", 1)[-1],
        count=int(group.attrs["count"]),
        vertices=group["vertices"][:],
        faces=group["faces"][:],
        uv=group["uv"][:],
        color=(red, green, blue),
        is_sheet=bool(group.attrs["is_sheet"]),
    )
