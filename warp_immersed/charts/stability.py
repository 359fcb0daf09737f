"""The atlas of stability: the largest usable step of each method over density ratio, aspect ratio, spin and stiffness."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warp_immersed import library
from warp_immersed.body_model import BodyModel
from warp_immersed.charts import stability_figure
from warp_immersed.charts.baselines import AbsoluteVelocity, LaggedAddedMass, PrintedEquations
from warp_immersed.charts.bodies import model_in, run_product
from warp_immersed.charts.body_rates import BodyRates, Q, rotate, started
from warp_immersed.charts.figures import Report, Request, publish, write_table
from warp_immersed.charts.integrators import INTEGRATORS
from warp_immersed.charts.stability_noise import noise_rows
from warp_immersed.device_state import Precision, Surroundings
from warp_immersed.errors import InputError
from warp_immersed.fluid import AIR

Array = NDArray[np.float64]

OURS = "warp_immersed"
USABLE, BLOWS_UP, WRONG, DRIFTS, REFUSED = "usable", "blows up", "wrong regime", "drifts", "refused"
WIND = (3.0, 0.0, 0.0)
SAMPLES_PER_SECOND = 24
REFERENCE_FPS = 960.0  # of the product in float64; the tests hold it against DOP853
TOLERANCE = 0.25  # of mean fall and spin, beyond four standard errors


@dataclass(frozen=True)
class Setting:
    """One row of the atlas: semi-major axis [m] and spin at release [rad/s] of every body in it."""

    name: str
    size: float
    spin: float


SETTINGS = (
    Setting("4 cm, from rest", 0.02, 0.0),
    Setting("4 cm, spun at 300 rad/s", 0.02, 300.0),
    Setting("2 mm, from rest: stiff drag", 0.001, 0.0),
)


@dataclass(frozen=True)
class Cell:
    """A thin ellipsoid in air."""

    setting: Setting
    density_ratio: float
    aspect_ratio: float

    @property
    def semi_axes(self) -> tuple[float, float, float]:
        """a >= b >= c [m], c = a over the aspect ratio."""
        a = self.setting.size
        return a, a * max(0.5, self.aspect_ratio**-0.5), a / self.aspect_ratio

    @property
    def density(self) -> float:
        """Of the body [kg/m^3]."""
        return self.density_ratio * AIR.density

    def model(self) -> BodyModel:
        """Its dynamics in air."""
        return ellipsoid_model(self.semi_axes, self.density)


@cache
def ellipsoid_model(semi_axes: tuple[float, float, float], density: float) -> BodyModel:
    """The dynamics of an ellipsoid in air, worked out once."""
    return model_in(library.ellipsoid(semi_axes, density), AIR)


@dataclass(frozen=True)
class Extent:
    """How much of the atlas is drawn."""

    density_ratios: tuple[float, ...]
    aspect_ratios: tuple[float, ...]
    bodies: int
    seconds: float
    divisions: tuple[int, ...]  # of 1/24 s, into steps

    @property
    def cells(self) -> list[Cell]:
        """All cells, setting by setting."""
        return [Cell(s, d, a) for s in SETTINGS for a in self.aspect_ratios for d in self.density_ratios]


FULL = Extent((0.1, 0.5, 1.05, 2.0, 10.0, 1000.0), (2.0, 10.0, 100.0, 400.0), 8, 2.0, (1, 2, 4, 8, 16, 32, 64))
QUICK = Extent((0.1, 1.05, 10.0, 1000.0), (2.0, 20.0, 200.0), 8, 1.0, (1, 4, 16, 64))


@dataclass(frozen=True)
class Motion:
    """What a run is judged by, of each body in the second half: fall [m/s], spin [rad/s], and drift with the wind [m/s], all
    (N,); the highest speed of all times, and that of the last over that of the middle sample."""

    fall: Array
    spin: Array
    drift: Array
    speed: float
    growth: float

    @classmethod
    def of(cls, velocities: Array, spins: Array) -> "Motion":
        """From velocities and spins (T, N, 3)."""
        half = len(velocities) // 2
        speeds = np.linalg.norm(velocities, axis=2)
        late = velocities[half:]
        return cls(
            -late[..., 1].mean(axis=0), np.linalg.norm(spins[half:], axis=2).mean(axis=0), late[..., 0].mean(axis=0),
            float(speeds.max()), float(np.median(speeds[-1]) / max(np.median(speeds[half]), 1e-9)),
        )  # fmt: skip


def judge(found: Motion, expected: Motion) -> str:
    """Whether a run can be used, and if not, what is wrong with it."""
    if not np.isfinite(found.speed) or found.speed > 8.0 * expected.speed + 1.0:
        return DRIFTS if np.isfinite(found.growth) and 1.3 < found.growth < 4.0 and found.speed < 1e3 else BLOWS_UP
    floor = 0.02 * expected.speed
    for name, smallest in (("fall", floor), ("spin", 1.0), ("drift", floor)):
        mine, true = getattr(found, name), getattr(expected, name)
        error = np.sqrt((mine.var() + true.var()) / len(mine))
        if abs(mine.mean() - true.mean()) > 4.0 * error + TOLERANCE * abs(true.mean()) + smallest:
            return DRIFTS if found.growth > 1.3 else WRONG
    return USABLE


def product_motions(
    cells: Sequence[Cell], extent: Extent, fps: float, precision: Precision = "float32", wind: bool = False
) -> list[tuple[Motion, int] | None]:
    """The product's own motion in cells at `fps`, and how many bodies it lost; None where it refuses them."""
    groups = []
    for cell in cells:
        spin = cell.setting.spin
        velocity = WIND if wind else (0.0, 0.0, 0.0)
        groups.append((cell.model(), started(extent.bodies, 5, (spin, 0.1 * spin, 0.2 * spin), velocity=velocity)))
    surroundings = Surroundings(AIR, mean_wind=WIND if wind else (0.0, 0.0, 0.0))
    try:
        run = run_product(groups, surroundings, fps, extent.seconds, 1.0 / min(fps, SAMPLES_PER_SECOND), precision)
    except InputError:
        if len(cells) == 1:
            return [None]
        return [motion for cell in cells for motion in product_motions([cell], extent, fps, precision, wind)]
    v, w = run.velocities[1:], run.angular_velocities[1:]
    slices = [slice(n * extent.bodies, (n + 1) * extent.bodies) for n in range(len(cells))]
    return [(Motion.of(v[:, mine], w[:, mine]), int(run.failed[mine].sum())) for mine in slices]


Stepper = Callable[[BodyRates, Sequence[Cell]], Callable[[BodyRates, Array, float], Array]]


def solid_inertia(rates: BodyRates, cells: Sequence[Cell]) -> Array:
    """(N, 6, 6) without the fluid, per unit mass, body by body."""
    per = len(rates.inertia) // len(cells)
    rows = []
    for cell in cells:
        a, b, c = np.square(cell.semi_axes)
        rows.append(np.diag([1.0, 1.0, 1.0, (b + c) / 5.0, (a + c) / 5.0, (a + b) / 5.0]))
    return np.repeat(np.array(rows), per, axis=0)


def net_weights(rates: BodyRates, cells: Sequence[Cell]) -> Array:
    """(N,) what gravity keeps after buoyancy."""
    return np.repeat([1.0 - 1.0 / cell.density_ratio for cell in cells], len(rates.inertia) // len(cells))


def baselines() -> dict[str, Stepper]:
    """Every method that steps states, made for the bodies it is to step."""
    methods: dict[str, Stepper] = {
        name: lambda rates, cells, chosen=step: chosen  # type: ignore[misc]
        for name, (step, _) in INTEGRATORS.items()
    }
    methods["lagged added mass"] = lambda rates, cells: LaggedAddedMass(rates, solid_inertia(rates, cells))
    methods["slides as printed"] = lambda rates, cells: PrintedEquations(rates, net_weights(rates, cells))
    methods["absolute velocity, 3 m/s wind"] = lambda rates, cells: AbsoluteVelocity(rates, WIND)
    return methods


def measure(extent: Extent, report: Report) -> list[dict[str, Any]]:
    """Rows: method, setting, density ratio, aspect ratio, largest usable step [ms] (0: none), what happens beyond it."""
    cells = extent.cells
    references: dict[tuple[Cell, bool], Motion] = {}
    for n, wind in enumerate((False, True)):
        report("reference: float64, frames of 1/960 s", 0.2 * n)
        for cell, found in zip(cells, product_motions(cells, extent, REFERENCE_FPS, "float64", wind), strict=True):
            if found is None:
                raise ArithmeticError(f"no reference for {cell}")
            references[cell, wind] = found[0]
    rows = []
    methods = baselines()
    for n, (name, stepper) in enumerate(methods.items()):
        report(name, 0.4 + 0.4 * n / len(methods))
        windy = "wind" in name
        rows += march(name, stepper, cells, extent, {cell: references[cell, windy] for cell in cells}, windy)
    report("MuJoCo, if installed", 0.8)
    rows += mujoco_rows(cells, extent)
    report(OURS, 0.9)
    return rows + our_rows(cells, extent, references)


def our_rows(cells: Sequence[Cell], extent: Extent, references: dict[tuple[Cell, bool], Motion]) -> list[dict[str, Any]]:
    """The product: the longest frame at which it is right in still air and in wind."""
    largest = dict.fromkeys(cells, 0.0)
    beyond = dict.fromkeys(cells, "")
    for fps in (24.0, 12.0):
        left = [cell for cell in cells if not beyond[cell]]
        for wind in (False, True):
            for cell, found in zip(left, product_motions(left, extent, fps, wind=wind), strict=True):
                verdict = REFUSED if found is None else BLOWS_UP if found[1] else judge(found[0], references[cell, wind])
                if verdict != USABLE:
                    beyond[cell] = verdict
        largest.update({cell: 1e3 / fps for cell in left if not beyond[cell]})
    return [row_of(OURS, cell, largest[cell], beyond[cell]) for cell in cells]


def march(
    name: str, stepper: Stepper, cells: Sequence[Cell], extent: Extent, references: dict[Cell, Motion], windy: bool
) -> list[dict[str, Any]]:
    """Shorten the step until every cell is usable, or no shorter step is to be tried."""
    left = list(cells)
    found: dict[Cell, float] = {}
    beyond: dict[Cell, str] = dict.fromkeys(cells, "")
    for divisions in extent.divisions:
        for cell, motion in zip(left, baseline_motions(stepper, left, extent, divisions, windy), strict=True):
            verdict = judge(motion, references[cell])
            if verdict == USABLE:
                found[cell] = 1e3 / SAMPLES_PER_SECOND / divisions
            else:
                beyond[cell] = verdict
        left = [cell for cell in left if cell not in found]
        if not left:
            break
    return [row_of(name, cell, found.get(cell, 0.0), beyond[cell]) for cell in cells]


def baseline_motions(stepper: Stepper, cells: Sequence[Cell], extent: Extent, divisions: int, windy: bool) -> list[Motion]:
    """Motions in cells at a step of 1/24 s over `divisions`."""
    per, h = extent.bodies, 1.0 / SAMPLES_PER_SECOND / divisions
    rates = BodyRates([cell.model() for cell in cells], np.repeat(np.arange(len(cells)), per))
    starts = []
    for cell in cells:
        spin = cell.setting.spin
        starts.append(started(per, 5, (spin, 0.1 * spin, 0.2 * spin), velocity=WIND if windy else (0.0, 0.0, 0.0)))
    y = np.concatenate(
        [BodyRates([c.model()], np.zeros(per, dtype=np.int64)).state(s) for c, s in zip(cells, starts, strict=True)]
    )
    step = stepper(rates, cells)
    velocities, spins = [], []
    with np.errstate(all="ignore"):
        for n in range(1, round(extent.seconds * SAMPLES_PER_SECOND) * divisions + 1):
            y = step(rates, y, h)
            if n % divisions == 0:
                moving = np.einsum("nij,nj->ni", rates.inverse, y[:, :6])
                velocities.append(rotate(y[:, Q], moving[:, :3]))
                spins.append(moving[:, 3:])
        v, w = np.array(velocities), np.array(spins)
        groups = [slice(n * per, (n + 1) * per) for n in range(len(cells))]
        return [Motion.of(v[:, group], w[:, group]) for group in groups]


def mujoco_rows(cells: Sequence[Cell], extent: Extent) -> list[dict[str, Any]]:
    """MuJoCo's integrators with its own ellipsoid fluid model; none where it is not installed."""
    try:
        from warp_immersed.charts.stability_mujoco import INTEGRATORS as THEIRS
        from warp_immersed.charts.stability_mujoco import motions
    except ImportError:
        return []
    rows = []
    still = [cell for cell in cells if cell.setting is SETTINGS[0]]
    finest = motions("RK4", still, extent, 2 * extent.divisions[-1])
    for name in THEIRS:
        runs = {divisions: motions(name, still, extent, divisions) for divisions in extent.divisions}
        for n, cell in enumerate(still):
            largest, beyond = 0.0, ""
            for divisions in reversed(extent.divisions):
                verdict = mujoco_verdict(runs[divisions][n], finest[n])
                if verdict != USABLE:
                    beyond = verdict
                    break
                largest = 1e3 / SAMPLES_PER_SECOND / divisions
            rows.append(row_of(f"MuJoCo {name}", cell, largest, beyond))
    return rows


def mujoco_verdict(found: Motion | None, finest: Motion | None) -> str:
    """A run of MuJoCo against its own RK4 at a fine step, where that holds."""
    if found is None:
        return BLOWS_UP
    return USABLE if finest is None else judge(found, finest)


def row_of(method: str, cell: Cell, largest: float, beyond: str) -> dict[str, Any]:
    """One row of the table."""
    return {
        "method": method, "setting": cell.setting.name, "density_ratio": cell.density_ratio, "aspect_ratio": cell.aspect_ratio,
        "largest_step_ms": largest, "beyond": beyond,
    }  # fmt: skip


def chart(request: Request) -> str:
    """Draw the atlas; its cells go to NAME.csv, the noise and wind panels to NAME-noise.csv."""
    rows = measure(QUICK if request.quick else FULL, request.report)
    noise = noise_rows(request.quick)
    write_table(noise, request.output.with_name(f"{request.output.stem}-noise.csv"))
    publish(request, lambda: stability_figure.draw(rows, noise), rows)
    ours = [row for row in rows if row["method"] == OURS]
    right = sum(row["largest_step_ms"] >= 1e3 / 24.0 - 1e-6 for row in ours)
    refused = sum(row["largest_step_ms"] == 0.0 and row["beyond"] == REFUSED for row in ours)
    others = [row for row in rows if row["method"] != OURS]
    unusable = sum(row["largest_step_ms"] == 0.0 for row in others)
    return (
        f"warp_immersed is right at 24 fps in {right} of {len(ours)} cases, wrong in {len(ours) - right - refused}, and refuses "
        f"{refused}; the other methods have no usable step in {unusable} of {len(others)}."
    )
