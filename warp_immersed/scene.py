"""The scene file: its schema, and errors that name the file, the key, what was found and what would be right."""

import hashlib
import tomllib
from importlib import resources
from itertools import takewhile
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, PrivateAttr, ValidationError, model_validator

from warp_immersed.emitters import BoxEmitter, DiskEmitter, Emitter, NotNegative, Number, PointsEmitter, Vector
from warp_immersed.errors import InputError
from warp_immersed.fidelity import DEFAULT_TOLERANCE, Fidelity
from warp_immersed.field_scene import FieldTables
from warp_immersed.fluid import PRESETS, Fluid
from warp_immersed.shape_table import ShapeTable, near
from warp_immersed.turbulence import STILL, HomogeneousTurbulence

Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False, strict=True)]
Color = tuple[NotNegative, NotNegative, NotNegative]


class Table(BaseModel):
    """A table of the scene file: keys it does not know are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class FluidTable(Table):
    """A fluid by its density [kg/m^3] and kinematic viscosity [m^2/s]."""

    density: Positive
    kinematic_viscosity: Positive


class WindTable(Table):
    """Uniform mean wind [m/s]."""

    velocity: Vector


class NoTurbulence(Table):
    """Air without fluctuations."""

    kind: Literal["none"]


class HomogeneousTable(Table):
    """Homogeneous turbulence: k [m^2/s^2] and epsilon [m^2/s^3]."""

    kind: Literal["homogeneous"]
    k: NotNegative
    epsilon: NotNegative


class GridTable(Table):
    """A flow baked on a grid: a bake file (.h5), a field file (.toml) to bake, or the field itself. It brings its own wind."""

    kind: Literal["grid"]
    field: str | FieldTables


class BoundaryLayerTable(Table):
    """The neutral atmospheric surface layer over flat ground: a logarithmic wind with its turbulence, without a grid.

    reference_speed [m/s] at reference_height [m] above the ground, roughness z0 [m], direction (horizontal).
    """

    kind: Literal["boundary_layer"]
    reference_speed: Positive
    reference_height: Positive
    roughness: Positive
    direction: Vector = (1.0, 0.0, 0.0)


class HillsTable(Table):
    """Rolling hills [m] that rise from the plane: how high, their length from top to top, and the rectangle they fill."""

    height: Positive
    length: Positive
    size: tuple[Positive, Positive]
    center: tuple[Number, Number] = (0.0, 0.0)


class HeightFieldTable(Table):
    """A grey image as ground: black is y = lowest, white y = highest [m], over a rectangle of this size (x, z) [m]."""

    image: str
    lowest: Number = 0.0
    highest: Number
    size: tuple[Positive, Positive]
    center: tuple[Number, Number] = (0.0, 0.0)


class GroundTable(Table):
    """A horizontal plane at height y [m], and what stands on it: a mesh file, hills, a height field, the obstacles of the
    scene's field. layering [m]: each body's ground lies higher by its own part of this, so that flat bodies do not coincide."""

    height: Number = 0.0
    mesh: str | None = None
    hills: HillsTable | None = None
    height_field: HeightFieldTable | None = None
    obstacles: bool = False
    layering: Annotated[float, Field(ge=0.0, le=0.1, strict=True)] = 0.0


class BoundsTable(Table):
    """A box [m]: bodies that leave it stop for good where they left, and are counted."""

    lower: Vector
    upper: Vector

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not all(low < high for low, high in zip(self.lower, self.upper, strict=True)):
            raise ValueError(f"found lower {self.lower} and upper {self.upper}, lower must be below upper along every axis")
        return self


class ViewTable(Table):
    """Where pictures are taken from: position and target [m], field of view across the picture [degrees]; time
    [s] that a still shows, by default the middle; with several exposures up to then, interval [s] apart, it is a
    chronophotograph; colours of ground and sky, linear RGB. Nothing of it changes what happens."""

    position: Vector
    target: Vector
    field_of_view: Annotated[float, Field(gt=1.0, lt=170.0, strict=True)] = 35.0
    time: NotNegative | None = None
    exposures: Annotated[int, Field(ge=1, le=200, strict=True)] = 1
    interval: Positive = 0.05
    ground: Color | None = None
    sky: Color | None = None


class BodiesTable(Table):
    """One kind of body: how many, what they are and how they start.

    density [kg/m^3] and thickness [m] may be left out where a library shape has its own; color is linear RGB, and colors
    several of them, which the bodies take by their number.
    """

    name: Annotated[str, Field(min_length=1, pattern=r"^[A-Za-z_][A-Za-z0-9_]*$")]
    count: Annotated[int, Field(ge=1, le=2**31 - 1, strict=True)]
    shape: ShapeTable
    density: Annotated[float, Field(ge=5.0, le=25000.0, strict=True)] | None = None
    thickness: Positive | None = None
    color: Color | None = None
    colors: Annotated[tuple[Color, ...], Field(min_length=1, max_length=16)] | None = None
    fidelity: Fidelity = "auto"
    emitter: Emitter

    @model_validator(mode="after")
    def _one_palette(self) -> Self:
        if self.color is not None and self.colors is not None:
            raise ValueError("colors: found beside color, must be one of the two")
        return self


Turbulence = Annotated[NoTurbulence | HomogeneousTable | GridTable | BoundaryLayerTable, Field(discriminator="kind")]


class Scene(Table):
    """What to simulate. Lengths in metres, times in seconds, y up.

    duration [s] at fps makes round(duration * fps) frames, the first at time 0; seed: 32-bit key of all randomness;
    fluid: "air", "water" or a table; gravity [m/s^2]; tolerance: relative error of falls and spreads that fidelity = "auto" may
    cost.
    """

    duration: Positive
    fps: Annotated[float, Field(gt=0.0, le=10000.0, strict=True)] = 24.0
    seed: Annotated[int, Field(ge=0, le=2**32 - 1, strict=True)] = 0
    fluid: Literal["air", "water"] | FluidTable = "air"
    gravity: Vector = (0.0, -9.81, 0.0)
    tolerance: Annotated[float, Field(ge=0.0, le=1.0, strict=True)] = DEFAULT_TOLERANCE
    wind: WindTable | None = None
    turbulence: Turbulence | None = None
    ground: GroundTable | None = None
    bounds: BoundsTable | None = None
    view: ViewTable | None = None
    bodies: Annotated[tuple[BodiesTable, ...], Field(min_length=1)]
    _name: str = PrivateAttr("scene")
    _folder: Path = PrivateAttr(Path())
    _text: str = PrivateAttr("")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        names = [bodies.name for bodies in self.bodies]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"bodies: two kinds are called {name!r}; names must differ")
        if self.wind is not None and isinstance(self.turbulence, (GridTable, BoundaryLayerTable)):
            raise ValueError(f"wind: goes with uniform wind only; turbulence of kind {self.turbulence.kind!r} brings its own")
        if self.frame_count < 1:
            shortest = 1.0 / self.fps
            raise ValueError(f"duration: {self.duration} s at {self.fps} fps makes no frame; at least {shortest:.3g} s is needed")
        return self

    @classmethod
    def load(cls, name_or_path: str | Path) -> "Scene":
        """A built-in scene by its name, or a scene file by its path.

        Raises:
            InputError: no such scene, not TOML, or a value the schema refuses.
        """
        path = Path(name_or_path)
        if path.suffix != ".toml" and not path.exists():
            built_in = builtin_scenes()
            if str(name_or_path) not in built_in:
                hint = near(str(name_or_path), list(built_in))
                raise InputError(
                    f"scene {str(name_or_path)!r}: no such file or built-in scene{hint}; built in: {', '.join(sorted(built_in))}"
                )
            path = built_in[str(name_or_path)]
        try:
            text = path.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
            raise InputError(f"scene {str(name_or_path)!r}: cannot be read ({reason})") from error
        return cls.from_text(text, path.stem, path.parent)

    @classmethod
    def from_text(cls, text: str, name: str = "scene", folder: Path = Path()) -> "Scene":
        """A scene from TOML text; mesh files are looked up from `folder`.

        Raises:
            InputError: not TOML, or a value the schema refuses.
        """
        try:
            values = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise InputError(f"{name}.toml: not valid TOML: {error}") from error
        try:
            scene = cls(**values)
        except ValidationError as error:
            raise InputError(f"{name}.toml: {first_error(error)}") from error
        scene._name, scene._folder, scene._text = name, folder, text
        return scene

    def changed(self, seed: int | None = None, count_scale: float = 1.0, fidelity: Fidelity | None = None) -> "Scene":
        """The same scene with another seed, all counts scaled (at least one body a kind), or another fidelity for all.

        Raises:
            InputError: the values leave their ranges.
        """
        if not 0.0 < count_scale < float("inf"):
            raise InputError(f"count scale: found {count_scale}, must be a positive number")
        values = self.model_dump(exclude_unset=True)
        if seed is not None:
            values["seed"] = seed
        for bodies in values["bodies"]:
            bodies["count"] = max(1, round(bodies["count"] * count_scale))
            if fidelity is not None:
                bodies["fidelity"] = fidelity
        try:
            scene = Scene(**values)
        except ValidationError as error:
            raise InputError(f"{self._name}: {first_error(error)}") from error
        scene._name, scene._folder, scene._text = self._name, self._folder, self._text
        return scene

    @property
    def name(self) -> str:
        """Name of the scene file without its ending."""
        return self._name

    @property
    def folder(self) -> Path:
        """Where its mesh files are looked up."""
        return self._folder

    @property
    def text(self) -> str:
        """The TOML it was read from, empty for a scene made in Python."""
        return self._text

    @property
    def story(self) -> str:
        """What the scene is about: the comment its file starts with."""
        lines = takewhile(lambda line: line.startswith("#"), self._text.splitlines())
        return " ".join(line.removeprefix("#").strip() for line in lines)

    @property
    def frame_count(self) -> int:
        """Number of frames, the initial state included."""
        return round(self.duration * self.fps)

    @property
    def body_count(self) -> int:
        """Number of bodies of all kinds."""
        return sum(bodies.count for bodies in self.bodies)

    @property
    def digest(self) -> str:
        """SHA-256 of everything the scene says, defaults included."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()

    def make_fluid(self) -> Fluid:
        """The fluid it names."""
        if isinstance(self.fluid, str):
            return PRESETS[self.fluid]
        return Fluid(self.fluid.density, self.fluid.kinematic_viscosity)

    def make_turbulence(self) -> HomogeneousTurbulence:
        """The turbulence it describes."""
        if isinstance(self.turbulence, HomogeneousTable):
            return HomogeneousTurbulence(self.turbulence.k, self.turbulence.epsilon)
        return STILL


def builtin_scenes() -> dict[str, Path]:
    """Names and files of the scenes that come with the package."""
    folder = resources.files("warp_immersed.scenes")
    return {Path(str(entry)).stem: Path(str(entry)) for entry in folder.iterdir() if entry.name.endswith(".toml")}


def all_keys() -> list[str]:
    """Every key that some table of the scene file knows."""
    tables: list[type[BaseModel]] = [
        Scene, FluidTable, WindTable, HomogeneousTable, GridTable, BoundaryLayerTable, GroundTable, HillsTable,
        HeightFieldTable, BoundsTable, ViewTable, BodiesTable, ShapeTable, BoxEmitter, DiskEmitter, PointsEmitter,
    ]  # fmt: skip
    return sorted({key for table in tables for key in table.model_fields})


def first_error(error: ValidationError) -> str:
    """The most telling of pydantic's errors in one line: key, what was found, what would be right."""
    # a misspelt key also shows as a missing one; of a union's alternatives the one that got furthest was meant
    detail: Any = max(error.errors(), key=lambda e: (e["type"] == "extra_forbidden", len(e["loc"])))
    tags = {"box", "disk", "points", "none", "homogeneous", "grid", "boundary_layer"}
    path = ""
    for part in detail["loc"]:
        if isinstance(part, int):
            path += f"[{part}]"
        elif part not in tags and part.isidentifier() and part[0].islower():
            path += f".{part}" if path else part
    message = detail["msg"].removeprefix("Value error, ").removeprefix("Input ")
    if detail["type"] == "extra_forbidden":
        key = str(detail["loc"][-1])
        return f"{path}: unknown key" + (" in this table" if key in all_keys() else near(key, all_keys()))
    if detail["type"] == "missing":
        return f"{path}: missing"
    if detail["type"] == "union_tag_not_found":
        return f"{path}.kind: missing"
    if detail["type"] == "union_tag_invalid":
        return f"{path}.kind: found {detail['ctx']['tag']!r}, should be one of {detail['ctx']['expected_tags']}"
    if detail["type"] == "value_error":
        return f"{path}: {message}" if path else message
    shown = repr(detail["input"])
    return f"{path}: found {shown if len(shown) < 80 else shown[:77] + '...'}, {message}"
