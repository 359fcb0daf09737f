"""Frames in an HDF5 file that a killed process leaves readable.

The room for all frames is allocated when the file is made, one chunk a frame, and HDF5 then closes it. Frames go to their
places in the file by plain writes, so that no metadata of HDF5 are ever half-written: what a kill takes is the frame that
was being written. It is also the fastest way, one copy from the arrays to the system.
"""

import os
import zlib
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

COMPRESSION_LEVEL = 4
CHUNKS_AT_ONCE = 64


class PatientFile:
    """A file for HDF5 to write to that keeps the first error to itself: HDF5 does not survive a full disk, it tries again
    from its destructors until the process dies."""

    def __init__(self, path: Path):
        self._file = path.open("w+b", buffering=0)
        self.error: OSError | None = None

    def write(self, data: Any) -> int:
        """Write all of it, or nothing any more after an error."""
        left = memoryview(data)
        try:
            while left and self.error is None:
                left = left[self._file.write(left) :]
        except OSError as error:
            self.error = error
        return len(data)

    def truncate(self, size: int | None = None) -> int:
        """Set the file's length."""
        try:
            return self._file.truncate(size)
        except OSError as error:
            self.error = self.error or error
            return size or 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


@contextmanager
def new_hdf5(path: Path) -> Iterator[Any]:
    """An HDF5 file to be filled, in the oldest format that has what is used, so that readers need not be new.

    Raises:
        OSError: the disk is full or gone.
    """
    import h5py

    file = PatientFile(path)
    try:
        with h5py.File(file, "w", libver=("v108", "v110"), track_order=True) as hdf5:
            yield hdf5
    except Exception as error:
        raise (file.error or error) from None
    finally:
        file.close()
    if file.error is not None:
        raise file.error


def allocated(chunks: tuple[int, ...] | None) -> Any:
    """HDF5's properties of a dataset whose room is taken at once and left as it is."""
    import h5py

    properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    if chunks is not None:
        properties.set_chunk(chunks)
    properties.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    properties.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    return properties


def create_frames(file: Any, name: str, shape: tuple[int, ...], dtype: str) -> Any:
    """A dataset (F, ...) in an open HDF5 file: by frame, a chunk each, if a frame is an array; else in one piece."""
    return file.create_dataset(name, shape, dtype, dcpl=allocated((1, *shape[1:]) if len(shape) > 1 else None))


class FrameFile:
    """Writes frames to their places in a closed HDF5 file whose datasets `create_frames` made.

    Args:
        path: the file. names: its datasets.

    Raises:
        OSError, KeyError: not an HDF5 file, truncated, or without these datasets.
    """

    def __init__(self, path: Path, names: tuple[str, ...]):
        import h5py

        self._places: dict[str, NDArray[np.int64]] = {}
        self._types: dict[str, tuple[np.dtype[Any], tuple[int, ...]]] = {}
        with h5py.File(path, "r") as file:
            for name in names:
                self._places[name] = frame_offsets(file[name])
                self._types[name] = (file[name].dtype, file[name].shape[1:])
        self._file = path.open("r+b", buffering=0)
        locked(self._file)

    def write(self, index: int, values: Mapping[str, Any]) -> None:
        """Put a frame into its place.

        Raises:
            OSError: the disk is full or gone.
        """
        for name, value in values.items():
            dtype, shape = self._types[name]
            array = np.asarray(value, dtype, order="C")
            if array.shape != shape:
                raise ValueError(f"{name}: a frame of shape {array.shape} for {shape}")
            self._file.seek(int(self._places[name][index]))
            left = memoryview(array.reshape(-1).view(np.uint8))  # type: ignore[arg-type]
            while left:
                left = left[self._file.write(left) :]

    def sync(self) -> None:
        """Wait until the disk has it all."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Let the file go."""
        self._file.close()


def locked(file: Any) -> bool:
    """Take an open file for this process, until it closes it or ends; False if another has it. Only POSIX knows such locks."""
    try:
        import fcntl
    except ImportError:
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return True  # a file system without locks
    return True


def is_being_written(path: Path) -> bool:
    """Whether a process has this file open as a `FrameFile`."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return not locked(file)


def frame_offsets(dataset: Any) -> NDArray[np.int64]:
    """Where each frame (F,) of a dataset from `create_frames` begins in its file [bytes]."""
    frames, size = len(dataset), dataset.dtype.itemsize
    if dataset.chunks is None:
        return np.arange(frames, dtype=np.int64) * size + dataset.id.get_offset()
    offsets = np.zeros(frames, dtype=np.int64)
    for index in range(frames):
        where = (index, *[0] * (dataset.ndim - 1))
        offsets[index] = dataset.id.get_chunk_info_by_coord(where).byte_offset
    return offsets


def repack(source: Any, target: Any, names: tuple[str, ...], frames: int, compress: bool) -> None:
    """Copy the first frames of datasets between two open HDF5 files, compressed (shuffled and deflated) if asked for."""
    workers = os.cpu_count() or 1
    with ThreadPoolExecutor(workers) as pool:
        for name in names:
            old = source[name]
            chunks = old.chunks if old.chunks is not None else (frames,)
            options = {"compression": "gzip", "compression_opts": COMPRESSION_LEVEL, "shuffle": True} if compress else {}
            new = target.create_dataset(name, (frames, *old.shape[1:]), old.dtype, chunks=chunks, **options)
            new.attrs.update(old.attrs)
            if old.chunks is None:
                new[:] = old[:frames]
                continue
            for first in range(0, frames, CHUNKS_AT_ONCE):
                indices = range(first, min(first + CHUNKS_AT_ONCE, frames))
                packed = (
                    pool.map(deflated, (old[index] for index in indices)) if compress else (old[i].tobytes() for i in indices)
                )
                for index, chunk in zip(indices, packed, strict=True):
                    new.id.write_direct_chunk((index, *[0] * (old.ndim - 1)), chunk)


def deflated(values: NDArray[Any]) -> bytes:
    """An array as HDF5's shuffle and deflate filters store it; without Python's lock."""
    bytes_apart = values.reshape(-1, 1).view(np.uint8).T
    return zlib.compress(bytes_apart.tobytes(), COMPRESSION_LEVEL)
