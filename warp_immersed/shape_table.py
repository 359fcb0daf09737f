"""The `shape` table of a scene file, and the `Shape` it stands for."""

import difflib
import inspect
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from warp_immersed import library
from warp_immersed.emitters import Number, Vector
from warp_immersed.errors import InputError
from warp_immersed.mass_properties import PointMass
from warp_immersed.shape import Shape

Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False, strict=True)]

# A body larger than this is a mistaken unit.
LARGEST_RADIUS = 10.0


class BallastTable(BaseModel):
    """A point mass [kg] at a position [m] of the mesh."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    mass: Positive
    position: Vector


class ShapeTable(BaseModel):
    """One of: library (a name of `warp_immersed.library`, with its parameters beside it), mesh (a file, with scale and
    ballast beside it), outline (corners [m] of a flat sheet), ellipsoid (semi-axes [m])."""

    model_config = ConfigDict(extra="allow", frozen=True)
    library: str | None = None
    mesh: str | None = None
    scale: Positive = 1.0
    ballast: tuple[BallastTable, ...] = ()
    outline: tuple[tuple[Number, Number], ...] | None = None
    ellipsoid: tuple[Positive, Positive, Positive] | None = None

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        sources = [name for name in ("library", "mesh", "outline", "ellipsoid") if getattr(self, name) is not None]
        if len(sources) != 1:
            found = " and ".join(sources) or "none"
            raise ValueError(f"found {found}, must have exactly one of library, mesh, outline, ellipsoid")
        if self.mesh is None and ("scale" in self.model_fields_set or "ballast" in self.model_fields_set):
            raise ValueError("scale and ballast go with mesh only")
        extra = self.model_extra or {}
        if self.library is None:
            for key in extra:
                raise ValueError(f"unknown key {key!r}{near(key, list(ShapeTable.model_fields))}")
            return self
        if self.library not in library.SHAPES:
            names = list(library.SHAPES)
            raise ValueError(f"unknown library shape {self.library!r}{near(self.library, names)}; there are {', '.join(names)}")
        known = set(parameters(self.library)) - {"density", "thickness"}
        for key, value in extra.items():
            if key in ("density", "thickness"):
                raise ValueError(f"{key} goes beside shape, not into it")
            if key not in known:
                raise ValueError(f"{self.library} has no {key!r}{near(key, list(known))}; it has {', '.join(sorted(known))}")
            numbers = value if isinstance(value, list) else [value]
            if not all(isinstance(n, (int, float, list)) and not isinstance(n, bool) for n in numbers):
                raise ValueError(f"{key}: found {value!r}, must be a number")
        return self


def near(word: str, known: list[str]) -> str:
    """ " (did you mean 'x'?)" if some known word is near, else nothing."""
    close = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    return f" (did you mean {close[0]!r}?)" if close else ""


def parameters(name: str) -> list[str]:
    """Parameter names of a library shape."""
    return list(inspect.signature(library.SHAPES[name]).parameters)


def make_shape(table: ShapeTable, density: float | None, thickness: float | None, folder: Path) -> Shape:
    """Build the shape; mesh files are looked up from `folder`.

    Raises:
        InputError: something is missing or cannot be used, in a message that starts with the key.
    """
    given: dict[str, Any] = {}
    if density is not None:
        given["density"] = density
    if thickness is not None:
        given["thickness"] = thickness
    if table.library is not None:
        if thickness is not None and "thickness" not in parameters(table.library):
            raise InputError(f"thickness: {table.library} is a closed body and takes none")
        shape = library.SHAPES[table.library](**(table.model_extra or {}), **given)
    elif density is None:
        raise InputError("density: missing [kg/m^3]")
    elif table.outline is not None:
        if thickness is None:
            raise InputError("thickness: missing [m], an outline is a sheet")
        shape = library.sheet(table.outline, **given)
    elif table.ellipsoid is not None:
        if thickness is not None:
            raise InputError("thickness: an ellipsoid is a closed body and takes none")
        shape = library.ellipsoid(table.ellipsoid, density)
    else:
        ballast = [PointMass(b.mass, b.position) for b in table.ballast]
        path = folder / Path(str(table.mesh)).expanduser()
        shape = Shape.from_mesh(path, density, thickness, ballast, table.scale)
    radius = shape.bounding_radius
    if radius > LARGEST_RADIUS:
        raise InputError(f"shape: found a body {2 * radius:.4g} m across, must be below {2 * LARGEST_RADIUS:g} m (metres!)")
    width = 2.0 * shape.semi_axes[1]
    if shape.thickness is not None and shape.thickness > width:
        raise InputError(f"thickness: found {shape.thickness:.4g} m on a sheet {width:.4g} m wide, must be less (metres!)")
    return shape
