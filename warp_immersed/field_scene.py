"""FIELD.toml: a flow domain, what is given on its sides, and obstacles, checked and turned into a `FlowSetup`."""

import tomllib
from math import isfinite, prod
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from warp_immersed.boundaries import Boundary, Inlet, LogInlet, Outlet, Periodic, Slip, Vector, Wall
from warp_immersed.errors import InputError
from warp_immersed.flow_setup import FlowSetup
from warp_immersed.fluid import PRESETS, Fluid
from warp_immersed.obstacles import Mask, box_mask, mesh_mask

Number = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
Three = tuple[Number, Number, Number]

DEFAULT_CELLS = 400_000  # at most, where the file names no cells
CELLS_PER_OBSTACLE = 8
CELLS_ACROSS = 24


class Table(BaseModel):
    """A TOML table that takes no keys but its own."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class FluidTable(Table):
    """A fluid by its density [kg/m^3] and kinematic viscosity [m^2/s]."""

    density: Positive
    kinematic_viscosity: Positive


class DomainTable(Table):
    """The box to solve in [m], y up, and its resolution: cells (3,), or a spacing [m], or neither."""

    lower: Three
    upper: Three
    cells: tuple[int, int, int] | None = None
    spacing: Positive | None = None

    @model_validator(mode="after")
    def one_resolution(self) -> "DomainTable":
        if self.cells is not None and self.spacing is not None:
            raise ValueError("cells and spacing are both given; keep one of them")
        if any(a >= b for a, b in zip(self.lower, self.upper, strict=True)):
            raise ValueError("lower must be below upper along every axis")
        for name, n in zip("xyz", self.cells or (), strict=False):
            if n < 1 or n == 2:
                raise ValueError(f"cells along {name}: found {n}, must be 1 (left out) or at least 3")
        return self


class InletTable(Table):
    """Inflow: uniform with its turbulence, or the logarithmic profile of a neutral surface layer."""

    kind: Literal["inlet"]
    profile: Literal["uniform", "log"] = "uniform"
    velocity: Three | None = None
    intensity: Positive | None = None
    length_scale: Positive | None = None
    k: Positive | None = None
    epsilon: Positive | None = None
    reference_speed: Positive | None = None
    reference_height: Positive | None = None
    roughness: Positive | None = None
    direction: Three | None = None

    @model_validator(mode="after")
    def complete(self) -> "InletTable":
        log = {"reference_speed", "reference_height", "roughness", "direction"}
        turbulence = ({"intensity", "length_scale"}, {"k", "epsilon"})
        given = {name for name in self.model_fields_set if getattr(self, name) is not None} - {"kind", "profile"}
        if self.profile == "log" and given != log:
            raise ValueError(f"a log inlet takes {', '.join(sorted(log))}; found {', '.join(sorted(given)) or 'none'}")
        if self.profile == "uniform" and not any(given == {"velocity"} | pair for pair in turbulence):
            raise ValueError(
                "a uniform inlet takes velocity with intensity and length_scale, or with k and epsilon; "
                f"found {', '.join(sorted(given)) or 'none'}"
            )
        return self

    def boundary(self, ground: float) -> Inlet | LogInlet:
        """The inlet as the solver takes it; `ground` is where a log profile starts [m]."""
        if self.profile == "log":
            direction, speed = self.direction or (0.0, 0.0, 0.0), self.reference_speed or 0.0
            return LogInlet.from_reference(direction, speed, self.reference_height or 0.0, self.roughness or 0.0, ground)
        velocity = self.velocity or (0.0, 0.0, 0.0)
        if self.k is not None and self.epsilon is not None:
            return Inlet(velocity, self.k, self.epsilon)
        return Inlet.from_intensity(velocity, self.intensity or 0.0, self.length_scale or 0.0)


class WallTable(Table):
    """A wall: smooth, or rough with roughness length z0 [m]; velocity [m/s] along itself."""

    kind: Literal["wall"]
    roughness: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] = 0.0
    velocity: Three = (0.0, 0.0, 0.0)


class PlainTable(Table):
    """A side that needs no numbers."""

    kind: Literal["outlet", "slip", "symmetry", "periodic"]


SideTable = Annotated[InletTable | WallTable | PlainTable, Field(discriminator="kind")]


class BoundaryTable(Table):
    """What is given on the six sides of the domain."""

    x_min: SideTable
    x_max: SideTable
    y_min: SideTable
    y_max: SideTable
    z_min: SideTable = PlainTable(kind="slip")
    z_max: SideTable = PlainTable(kind="slip")


class ObstacleTable(Table):
    """A solid: a box by two corners [m], or a watertight mesh."""

    box: tuple[Three, Three] | None = None
    mesh: str | None = None

    @model_validator(mode="after")
    def one_form(self) -> "ObstacleTable":
        if (self.box is None) == (self.mesh is None):
            raise ValueError("an obstacle takes either box = [[x, y, z], [x, y, z]] or mesh = a file")
        return self


class SolverTable(Table):
    """Pseudo-time stepping: CFL number, most steps, and the change per flow-through at which to stop."""

    cfl: Annotated[float, Field(gt=0.0, le=50.0)] = 10.0
    max_steps: Annotated[int, Field(ge=1)] = 4000
    tolerance: Positive = 2e-5


class GustTable(Table):
    """A sinusoidal gust of the inflow: relative amplitude and period [s]."""

    amplitude: Annotated[float, Field(ge=0.0, lt=1.0)]
    period: Positive


class UnsteadyTable(Table):
    """A flow in time: duration and interval of the snapshots [s]."""

    duration: Positive
    interval: Positive
    gust: GustTable | None = None


class InitialTable(Table):
    """What the solve starts from."""

    velocity: Three | None = None
    k: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] | None = None
    epsilon: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] | None = None


class FieldTables(Table):
    """The whole file, as written."""

    fluid: Literal["air", "water"] | FluidTable = "air"
    model: Literal["k-epsilon", "laminar"] = "k-epsilon"
    obstacle_roughness: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] = 0.0
    domain: DomainTable
    boundary: BoundaryTable
    obstacle: tuple[ObstacleTable, ...] = ()
    solver: SolverTable = SolverTable()
    initial: InitialTable = InitialTable()
    unsteady: UnsteadyTable | None = None


class FieldScene:
    """A checked FIELD.toml.

    Attributes: tables, as written; text, the TOML; folder, which mesh names are relative to; cells (3,), given or chosen.
    """

    def __init__(self, tables: FieldTables, text: str, folder: Path, name: str) -> None:
        self.tables = tables
        self.text = text
        self.folder = folder
        self.name = name
        self.cells = choose_cells(tables)

    @staticmethod
    def load(path: str | Path) -> "FieldScene":
        """Read a file.

        Raises:
            InputError: missing, not TOML, or with a key or value that cannot be; the message names it.
        """
        source = Path(path)
        try:
            text = source.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"{source}: cannot be read ({error.__class__.__name__}); give a FIELD.toml file") from error
        return FieldScene.parse(text, source.parent, str(source))

    @staticmethod
    def parse(text: str, folder: Path = Path(), name: str = "field") -> "FieldScene":
        """Check the text of a file; `name` stands for it in messages. Raises InputError."""
        try:
            return FieldScene(FieldTables.model_validate(tomllib.loads(text)), text, folder, name)
        except tomllib.TOMLDecodeError as error:
            raise InputError(f"{name}: is not TOML: {error}") from error
        except ValidationError as error:
            raise InputError(f"{name}: {explain(error)}") from error
        except InputError as error:
            raise InputError(f"{name}: {error}") from error

    def boundaries(self) -> tuple[Boundary, ...]:
        """What is given on x_min, x_max, y_min, y_max, z_min, z_max."""
        sides = self.tables.boundary
        ground = self.tables.domain.lower[1]
        tables = (sides.x_min, sides.x_max, sides.y_min, sides.y_max, sides.z_min, sides.z_max)
        return tuple(boundary_of(table, ground) for table in tables)

    def solid(self, device: str = "cpu") -> Mask | None:
        """(nx, ny, nz) bool: cells inside obstacles; None without obstacles. Raises InputError for meshes that cannot be used."""
        domain, mask = self.tables.domain, None
        for number, obstacle in enumerate(self.tables.obstacle):
            if obstacle.box is not None:
                part = box_mask(domain.lower, domain.upper, self.cells, obstacle.box)
            else:
                assert obstacle.mesh is not None
                part = mesh_mask(domain.lower, domain.upper, self.cells, self.folder / obstacle.mesh, device)
            if not part.any():
                raise InputError(
                    f"{self.name}: obstacle[{number}]: covers no cell centre; it is outside the domain or thinner than a cell, "
                    "so move it, or refine the domain"
                )
            mask = part if mask is None else mask | part
        return mask

    def setup(self, device: str = "cpu") -> FlowSetup:
        """The flow to solve. Raises InputError, with the file's name."""
        tables = self.tables
        fluid = PRESETS[tables.fluid] if isinstance(tables.fluid, str) else Fluid(**tables.fluid.model_dump())
        try:
            return FlowSetup(
                lower=tables.domain.lower,
                upper=tables.domain.upper,
                cells=self.cells,
                sides=self.boundaries(),  # type: ignore[arg-type]
                viscosity=fluid.kinematic_viscosity,
                solid=self.solid(device),
                velocity=tables.initial.velocity,
                k=tables.initial.k,
                epsilon=tables.initial.epsilon,
                turbulent=tables.model == "k-epsilon",
                obstacle_roughness=tables.obstacle_roughness,
            )
        except InputError as error:
            text = str(error)
            raise InputError(text if text.startswith(self.name) else f"{self.name}: {text}") from error


def boundary_of(table: InletTable | WallTable | PlainTable, ground: float) -> Boundary:
    """One side as the solver takes it."""
    if isinstance(table, InletTable):
        return table.boundary(ground)
    if isinstance(table, WallTable):
        return Wall(roughness=table.roughness, velocity=table.velocity)
    plain: dict[str, Boundary] = {"outlet": Outlet(), "slip": Slip(), "symmetry": Slip(), "periodic": Periodic()}
    return plain[table.kind]


def choose_cells(tables: FieldTables) -> tuple[int, int, int]:
    """The cells given; or from the spacing given; or a spacing of an eighth of the smallest obstacle, in bounds."""
    domain = tables.domain
    if domain.cells is not None:
        return domain.cells
    size = [b - a for a, b in zip(domain.lower, domain.upper, strict=True)]
    spacing = domain.spacing
    if spacing is None:
        edges = [abs(b - a) for o in tables.obstacle if o.box for a, b in zip(*o.box, strict=True) if a != b]
        spacing = min([min(size) / CELLS_ACROSS, *(edge / CELLS_PER_OBSTACLE for edge in edges)])
        spacing = max(spacing, (prod(size) / DEFAULT_CELLS) ** (1.0 / 3.0))
    if not isfinite(spacing) or prod(length / spacing for length in size) > 1e12:
        raise InputError(f"domain.spacing: found {spacing!r}, is far too small for the domain; make it larger")
    a, b, c = (max(1, round(length / spacing)) for length in size)
    return a, b, c


def explain(error: ValidationError) -> str:
    """The first complaint of pydantic in one line: key, what was found, what would be right."""
    first: Any = error.errors()[0]
    names = [str(part) if not isinstance(part, int) else f"[{part}]" for part in first["loc"]]
    tags = {"inlet", "wall", "outlet", "slip", "symmetry", "periodic", "FluidTable", "literal['air','water']"}
    key = ".".join(name for name in names if name not in tags).replace(".[", "[") or "file"
    found = first.get("input")
    message = first["msg"].removeprefix("Value error, ")
    if first["type"] == "extra_forbidden":
        return f"{key}: is not a known key; remove it or correct its name"
    if first["type"] == "missing":
        return f"{key}: is missing; give it"
    if first["type"].startswith("union_tag"):
        key += ".kind"
        kinds = "inlet, wall, outlet, slip, symmetry or periodic"
        return f"{key}: found {found.get('kind') if isinstance(found, dict) else found!r}, must be {kinds}"
    shown = repr(found) if not isinstance(found, dict | BaseModel) else "this table"
    return f"{key}: found {shown[:60]}, {message[0].lower()}{message[1:]}"


def far_boundary(boundaries: tuple[Boundary, ...], fallback: Vector | None = None) -> Inlet | LogInlet:
    """What bodies meet away from the grid: the first inlet, or the initial velocity, or still air."""
    for side in boundaries:
        if isinstance(side, Inlet | LogInlet):
            return side
    return Inlet(fallback or (0.0, 0.0, 0.0), 0.0, 0.0)
