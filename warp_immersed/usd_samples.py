"""Frames into a USD layer, the fast way: what moves of a crowd, in stage units, as time samples."""

import ctypes
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Tf, Vt

from warp_immersed.ensemble import Frame
from warp_immersed.errors import InputError
from warp_immersed.export_options import ExportOptions

# Between saves, each of which appends to the file, so that memory stays bounded.
FRAMES_PER_SAVE = 24
BYTES_PER_SAVE = 128_000_000

DEGREES = 180.0 / np.pi

Rows = slice | NDArray[np.int64]


class SampleWriter:
    """Writes the samples of a crowd to a prim of a layer.

    Velocities are per second, angular velocities in degrees per second in the instancer's frame. Landed bodies stay, so array
    lengths never change.

    Args:
        layer, prim: where to; the prim's spec is there.
        target: the output it belongs to, for messages.
        rows: which bodies of a frame. radius: of the largest [m]. options, fps: as in `ExportOptions`, of the simulation.
    """

    def __init__(
        self, layer: Sdf.Layer, prim: Sdf.Path, target: Path, rows: Rows, radius: float, options: ExportOptions, fps: float
    ):
        self.layer = layer
        self._target = target
        self._rows = rows
        self._radius = radius
        self._options = options
        self._fps = fps
        self._paths = declare_samples(layer, prim, options)
        self._pending = self._frames_pending = 0

    def write(self, frame: Frame) -> None:
        """Append a frame.

        Raises:
            InputError: the disk is full or gone.
        """
        time_code = self._options.time_code(frame.index, self._fps)
        for name, array in stage_arrays(frame, self._rows, self._radius, self._options).items():
            self.layer.SetTimeSample(self._paths[name], time_code, array)
            self._pending += len(array) * 12
        self._frames_pending += 1
        if self._frames_pending == FRAMES_PER_SAVE or self._pending > BYTES_PER_SAVE:
            self.save()

    def save(self) -> None:
        """Bring what has come to the file.

        Raises:
            InputError: the disk is full or gone.
        """
        save_layer(self.layer, self._target)
        self._pending = self._frames_pending = 0


def sampled_types(options: ExportOptions) -> dict[str, Sdf.ValueTypeName]:
    """The attributes of a point instancer that move, and their types."""
    types = {
        "positions": Sdf.ValueTypeNames.Point3fArray,
        "orientations": Sdf.ValueTypeNames.QuathArray,
        "extent": Sdf.ValueTypeNames.Float3Array,
    }
    if options.motion_blur:
        # both or neither: with one of them alone USD would stop interpolating the other motion
        types["velocities"] = types["angularVelocities"] = Sdf.ValueTypeNames.Vector3fArray
    return types


def declare_samples(layer: Sdf.Layer, prim: Sdf.Path, options: ExportOptions) -> dict[str, Sdf.Path]:
    """Attribute specs for what moves, without values; their paths by name."""
    spec = layer.GetPrimAtPath(prim)
    return {name: Sdf.AttributeSpec(spec, name, kind).path for name, kind in sampled_types(options).items()}


def stage_arrays(frame: Frame, rows: Rows, radius: float, options: ExportOptions) -> dict[str, Any]:
    """USD arrays of a frame, of the chosen bodies, in the stage's axes and units; radius [m] of the largest body."""
    units = options.units_per_meter
    positions = stage_vectors(frame.positions[rows], options, units)
    by_axis = np.ascontiguousarray(positions.T)  # numpy reduces this way ten times faster
    lower, upper = by_axis.min(axis=1), by_axis.max(axis=1)
    margin = units * radius * 1.001 + 1e-6 * max(np.abs(lower).max(), np.abs(upper).max())
    arrays = {
        "positions": vt_array(Vt.Vec3fArray, positions),
        "orientations": vt_array(Vt.QuathArray, stage_orientations(frame.orientations[rows], options).astype(np.float16)),
        "extent": vt_array(Vt.Vec3fArray, np.stack([lower - margin, upper + margin])),
    }
    if options.motion_blur:
        arrays["velocities"] = vt_array(Vt.Vec3fArray, stage_vectors(frame.velocities[rows], options, units))
        turning = stage_vectors(frame.angular_velocities[rows], options, DEGREES)
        arrays["angularVelocities"] = vt_array(Vt.Vec3fArray, turning)
    return arrays


def stage_vectors(vectors: NDArray[Any], options: ExportOptions, scale: float) -> NDArray[np.float32]:
    """Vectors (N, 3) of the simulation, whose y is up, in the stage's axes, times `scale`."""
    vectors = np.asarray(vectors, dtype=np.float32)
    if options.up_axis == "y":
        return vectors if scale == 1.0 else vectors * np.float32(scale)
    turned = np.empty_like(vectors)
    for axis, (source, sign) in enumerate(((0, 1.0), (2, -1.0), (1, 1.0))):
        np.multiply(vectors[:, source], np.float32(sign * scale), out=turned[:, axis])
    return turned


def stage_orientations(quaternions: NDArray[Any], options: ExportOptions) -> NDArray[np.float32]:
    """Orientations (N, 4), (x, y, z, w), body to world, with the stage's axes for the world's."""
    quaternions = np.asarray(quaternions, dtype=np.float32)
    if options.up_axis == "y":
        return quaternions
    x, y, z, w = quaternions.T  # from the left by a quarter turn about x
    return np.stack([x + w, y - z, z + y, w - x], axis=1) * np.float32(np.sqrt(0.5))


def save_layer(layer: Sdf.Layer, target: Path) -> None:
    """Save a layer of the output `target`.

    Raises:
        InputError: the disk is full or gone.
    """
    try:
        saved = layer.Save()
        reason = "not saved"
    except Tf.ErrorException as error:
        saved, reason = False, write_error(str(error))
    if not saved:
        raise InputError(f"output {str(target)!r}: cannot write ({reason})")


def write_error(text: str) -> str:
    """What the system said, out of USD's account of where it heard it."""
    said = re.search(r"Error occurred writing file: ([^']*)'", text)
    return said.group(1) if said else text.splitlines()[0]


def vt_array(array_type: Any, values: NDArray[Any]) -> Any:
    """A USD array with the values of a numpy array of its element type, copied as a block.

    USD's own conversion goes element by element with Python's lock held. The block copy relies on VtArray showing its
    memory through the buffer protocol; where it does not look as expected, USD's conversion is used.
    """
    array = array_type(len(values))
    view = np.asarray(array)
    values = np.ascontiguousarray(values, dtype=view.dtype)
    if view.shape == values.shape and view.flags.c_contiguous and view.ctypes.data:
        ctypes.memmove(view.ctypes.data, values.ctypes.data, values.nbytes)
        return array
    return array_type.FromNumpy(values)
