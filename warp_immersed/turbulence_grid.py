"""`TurbulenceGrid`: a baked mean flow with its k and epsilon, in memory, in HDF5 and on the device."""

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warp_immersed.boundaries import Inlet, LogInlet, Vector
from warp_immersed.errors import InputError
from warp_immersed.kernels import grid as device_grid
from warp_immersed.kernels import sampling

Array = NDArray[np.float32]

SCHEMA = "warp_immersed turbulence grid"
SCHEMA_VERSION = 1
UNITS = {"velocity": "m/s", "k": "m^2/s^2", "epsilon": "m^2/s^3", "fluid": "1", "time": "s"}
STILL = Inlet((0.0, 0.0, 0.0), 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class TurbulenceGrid:
    """A mean flow at the centres of equal cells, y up.

    Attributes:
        lower (3,): lower corner of the domain [m]. spacing (3,): cell size [m].
        velocity: (nx, ny, nz, 3) [m/s]; k: (nx, ny, nz) [m^2/s^2]; epsilon: (nx, ny, nz) [m^2/s^3], zero in solid cells.
            With `time`, each has a leading axis of snapshots.
        fluid: (nx, ny, nz) bool, cells outside obstacles.
        time: (nt,) [s], evenly spaced; None for a steady flow.
        far: what is met away from the grid. fade: over which distance outside it [m]; None for a quarter of the domain's
            shortest side.
        scene: the TOML text the flow was baked from. provenance: versions, device, convergence and the like.
        history: (checks, 5): step and the changes and divergence of `k_epsilon.Progress`.
    """

    lower: Vector
    spacing: Vector
    velocity: Array
    k: Array
    epsilon: Array
    fluid: NDArray[np.bool_]
    time: NDArray[np.float64] | None = None
    far: Inlet | LogInlet = STILL
    fade: float | None = None
    scene: str = ""
    provenance: Mapping[str, Any] = field(default_factory=dict)
    history: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        check_grid(self)

    @property
    def cells(self) -> tuple[int, int, int]:
        """Cells along x, y, z."""
        a, b, c = self.fluid.shape
        return a, b, c

    @property
    def upper(self) -> Vector:
        """Upper corner of the domain (3,) [m]."""
        a, b, c = (low + n * h for low, n, h in zip(self.lower, self.cells, self.spacing, strict=True))
        return a, b, c

    @property
    def chi(self) -> Array:
        """epsilon / k [1/s], zero in solid cells."""
        return np.divide(self.epsilon, self.k, out=np.zeros_like(self.k), where=self.k > 0.0)

    def on_device(self, device: Any = "cpu") -> Any:
        """The flow as `kernels.sampling.FlowField`, for kernels on `device`."""
        steps = 1 if self.time is None else len(self.time)
        states = np.zeros((steps, *self.cells, 8), dtype=np.float32)
        states[..., :3], states[..., 3], states[..., 4], states[..., 5] = self.velocity, self.k, self.epsilon, 1.0
        states[:, ~self.fluid] = 0.0
        result = far_field(self.far, device)
        result.states = wp.array(states.reshape(steps, -1, 8), dtype=sampling.CellState, device=device)
        result.steps = steps
        result.cells = wp.vec3i(*self.cells)
        result.origin = wp.vec3(*(low + 0.5 * h for low, h in zip(self.lower, self.spacing, strict=True)))
        result.inverse = wp.vec3(*(1.0 / h for h in self.spacing))
        if self.time is not None:
            result.start = float(self.time[0])
            result.rate = float((len(self.time) - 1) / (self.time[-1] - self.time[0]))
        sides = [n * h for n, h in zip(self.cells, self.spacing, strict=True) if n > 1]
        result.fade = self.fade if self.fade is not None else 0.25 * min(sides)
        return result

    def save(self, path: str | Path) -> None:
        """Write the grid as HDF5; a file of that name is replaced only once the new one is complete.

        /velocity, /k, /epsilon, /fluid (and /time) are what `load` reads; /VTKHDF holds the same for ParaView.

        Raises:
            InputError: the file cannot be written.
        """
        target = Path(path)
        part = target.with_name(target.name + ".part")
        try:
            with h5py.File(part, "w") as file:
                write_grid(file, self)
            os.replace(part, target)
        except OSError as error:
            part.unlink(missing_ok=True)
            raise InputError(f"{target}: cannot be written ({error}); name a file in a folder you may write to") from error

    @staticmethod
    def load(path: str | Path) -> "TurbulenceGrid":
        """Read a bake file.

        Raises:
            InputError: missing, truncated, not a bake, of another schema version, or with values that are not finite.
        """
        source = Path(path)
        if not source.is_file():
            raise InputError(f"{source}: no such file; make it with `warp-immersed bake FIELD.toml -o {source.name}`")
        try:
            with h5py.File(source, "r") as file:
                return read_grid(file)
        except InputError as error:
            raise InputError(f"{source}: {error}") from error
        except (OSError, KeyError, RuntimeError, ValueError, TypeError) as error:
            text = str(error).splitlines()[0]
            raise InputError(f"{source}: is truncated or not a bake file ({text}); bake it again") from error

    def sample(self, positions: ArrayLike, time: float = 0.0, device: str = "cpu") -> tuple[Array, Array, Array]:
        """velocity (N, 3) [m/s], k (N,), epsilon (N,) at positions (N, 3) [m], by the code that bodies use."""
        return sample_field(self.on_device(device), positions, time, device)


def far_field(boundary: Inlet | LogInlet, device: Any = "cpu") -> Any:
    """A `FlowField` without a grid: the uniform flow or the logarithmic wind of an inlet everywhere."""
    result = sampling.FlowField()
    far = device_grid.Side()
    if isinstance(boundary, Inlet):
        far.velocity, far.k, far.epsilon = wp.vec3(*boundary.velocity), boundary.k, boundary.epsilon
    else:
        far.velocity, far.friction_velocity = wp.vec3(*boundary.direction), boundary.friction_velocity
        far.roughness, far.ground = boundary.roughness, boundary.ground
    result.far = far
    result.states = wp.zeros((1, 1), dtype=sampling.CellState, device=device)
    result.fade = 1.0
    return result


def sample_field(flow: Any, positions: ArrayLike, time: float = 0.0, device: str = "cpu") -> tuple[Array, Array, Array]:
    """velocity (N, 3) [m/s], k (N,), epsilon (N,) of a `FlowField` at positions (N, 3) [m]."""
    points = wp.array(np.asarray(positions, dtype=np.float32).reshape(-1, 3), dtype=wp.vec3, device=device)
    velocity = wp.zeros(len(points), dtype=wp.vec3, device=device)
    turbulence = wp.zeros(len(points), dtype=wp.vec2, device=device)
    wp.launch(sampling.sample_points, len(points), [flow, float(time), points], [velocity, turbulence], device=device)
    kept = turbulence.numpy().copy()
    return velocity.numpy().copy(), kept[:, 0], kept[:, 1]


def check_grid(grid: TurbulenceGrid) -> None:
    """Raise InputError unless shapes agree and every value can be used."""
    shape = grid.fluid.shape
    if len(shape) != 3:
        raise InputError(f"fluid: found shape {shape}, must be (nx, ny, nz)")
    if not (np.isfinite(grid.lower).all() and np.isfinite(grid.spacing).all() and min(grid.spacing) > 0.0):
        raise InputError(f"lower {grid.lower}, spacing {grid.spacing}: must be finite, spacing positive")
    lead: tuple[int, ...] = ()
    if grid.time is not None:
        lead = (len(grid.time),)
        steps = np.diff(grid.time)
        if len(grid.time) < 2 or not (steps > 0.0).all() or np.ptp(steps) > 1e-3 * steps.mean():
            raise InputError("time: must be at least two evenly spaced, increasing times")
    for name, value, expected in (
        ("velocity", grid.velocity, (*lead, *shape, 3)),
        ("k", grid.k, (*lead, *shape)),
        ("epsilon", grid.epsilon, (*lead, *shape)),
    ):
        if value.shape != expected:
            raise InputError(f"{name}: found shape {value.shape}, must be {expected}")
        bad = ~np.isfinite(value)
        if bad.any():
            where = tuple(int(i) for i in np.argwhere(bad)[0])
            raise InputError(f"{name}: is not finite at {where}; bake the field again")
    if grid.k.min(initial=0.0) < 0.0 or grid.epsilon.min(initial=0.0) < 0.0:
        raise InputError("k, epsilon: found negative values, must not be negative; bake the field again")


def write_grid(file: h5py.File, grid: TurbulenceGrid) -> None:
    """Fill an open HDF5 file."""
    file.attrs["schema"] = SCHEMA
    file.attrs["schema_version"] = SCHEMA_VERSION
    file.attrs["axes"] = "x, y, z; y up; cell centres"
    file.attrs["lower"], file.attrs["spacing"], file.attrs["length_units"] = grid.lower, grid.spacing, "m"
    file.attrs["origin"] = [low + 0.5 * h for low, h in zip(grid.lower, grid.spacing, strict=True)]
    file.attrs["scene"] = grid.scene
    file.attrs["far"] = json.dumps({"kind": "uniform" if isinstance(grid.far, Inlet) else "log", **asdict(grid.far)})
    if grid.fade is not None:
        file.attrs["fade"] = grid.fade
    file.attrs["provenance"] = json.dumps(dict(grid.provenance))
    arrays: dict[str, NDArray[Any]] = {"velocity": grid.velocity, "k": grid.k, "epsilon": grid.epsilon}
    arrays = {name: value.astype(np.float32) for name, value in arrays.items()}
    arrays["fluid"] = grid.fluid.astype(np.uint8)
    for name, value in arrays.items():
        file.create_dataset(name, data=value, chunks=True, compression="gzip", shuffle=True).attrs["units"] = UNITS[name]
    if grid.time is not None:
        file.create_dataset("time", data=grid.time).attrs["units"] = UNITS["time"]
    if grid.history is not None:
        rows = file.create_dataset("history", data=grid.history)
        rows.attrs["columns"] = "step, velocity_change, k_change, epsilon_change, divergence"
    write_image_data(file, grid)


def write_image_data(file: h5py.File, grid: TurbulenceGrid) -> None:
    """Add the (last) flow as VTKHDF image data, which ParaView and VTK read; their arrays run z, y, x."""
    group = file.create_group("VTKHDF")
    group.attrs["Version"] = (1, 0)
    group.attrs.create("Type", b"ImageData", dtype=h5py.string_dtype("ascii", len(b"ImageData")))
    nx, ny, nz = grid.cells
    group.attrs["WholeExtent"] = np.array([0, nx, 0, ny, 0, nz], dtype=np.int64)
    group.attrs["Origin"], group.attrs["Spacing"] = np.array(grid.lower, float), np.array(grid.spacing, float)
    group.attrs["Direction"] = np.eye(3).ravel()
    cells = group.create_group("CellData")
    last = () if grid.time is None else (-1,)
    arrays: dict[str, NDArray[Any]] = {"velocity": grid.velocity[last], "k": grid.k[last], "epsilon": grid.epsilon[last]}
    arrays["fluid"] = grid.fluid.astype(np.uint8)
    for name, value in arrays.items():
        order = (2, 1, 0, 3)[: value.ndim]
        cells.create_dataset(name, data=value.transpose(order), chunks=True, compression="gzip", shuffle=True)


def read_grid(file: h5py.File) -> TurbulenceGrid:
    """The grid of an open HDF5 file."""
    if file.attrs.get("schema") != SCHEMA:
        raise InputError(f"is not a bake file: schema is {file.attrs.get('schema')!r}, must be {SCHEMA!r}")
    version = int(file.attrs["schema_version"])
    if version != SCHEMA_VERSION:
        raise InputError(f"schema version {version}, this program reads {SCHEMA_VERSION}; bake the field again")
    far = json.loads(file.attrs["far"])
    kind = far.pop("kind")
    far = {name: tuple(value) if isinstance(value, list) else value for name, value in far.items()}
    boundary: Inlet | LogInlet = Inlet(**far) if kind == "uniform" else LogInlet(**far)
    lower, spacing = (tuple(float(x) for x in file.attrs[name]) for name in ("lower", "spacing"))
    return TurbulenceGrid(
        lower=lower,  # type: ignore[arg-type]
        spacing=spacing,  # type: ignore[arg-type]
        velocity=file["velocity"][()],
        k=file["k"][()],
        epsilon=file["epsilon"][()],
        fluid=file["fluid"][()].astype(bool),
        time=file["time"][()] if "time" in file else None,
        far=boundary,
        fade=float(file.attrs["fade"]) if "fade" in file.attrs else None,
        scene=str(file.attrs["scene"]),
        provenance=json.loads(file.attrs["provenance"]),
        history=file["history"][()] if "history" in file else None,
    )
