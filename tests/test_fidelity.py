"""The ladder of levels: what is chosen, and that what a level promises it keeps."""

import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.bodies import GRAVITY, ideal_body, model_in, no_loads, random_orientations, started, trajectory
from tests.test_cli import ROOT
from warp_immersed import library
from warp_immersed.body_model import without_lift
from warp_immersed.device_state import Group, Surroundings
from warp_immersed.fidelity import LEVELS, Behaviour, choose
from warp_immersed.fluid import AIR, WATER
from warp_immersed.kernels.rigid_body import LANDED, MOVING
from warp_immersed.level_choice import Scale, behaviour, model_at_level
from warp_immersed.pilot import calibrated, pilot_fall
from warp_immersed.turbulence import HomogeneousTurbulence

share = st.floats(0.0, 1.0, allow_subnormal=False)
positive = st.floats(0.0, 1e6)
behaviours = st.builds(
    Behaviour, flatness=share, roundness=share, reynolds=positive, wind=positive, stokes=positive | st.just(np.inf), glide=share,
    start=positive, pixels=positive | st.just(np.inf),
)  # fmt: skip


def rank(level) -> int:
    return LEVELS.index(level)


@given(behaviours, st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_a_larger_tolerance_never_asks_for_more(body, one, other) -> None:
    low, high = sorted((one, other))
    assert rank(choose(body, high).level) <= rank(choose(body, low).level)


@given(behaviours, st.floats(0.0, 1.0))
def test_a_choice_keeps_its_tolerance_and_says_why(body, tolerance) -> None:
    choice = choose(body, tolerance)
    assert 0.0 <= choice.error <= tolerance
    assert choice.reason


@given(behaviours)
def test_without_tolerance_only_what_is_exact_is_chosen(body) -> None:
    level = choose(body, 0.0).level
    if body.flatness > 0.0:
        assert level == "quasi_steady"
    if level in ("drift", "point"):
        assert body.roundness == 1.0
    if level == "drift":
        assert body.wind * body.stokes == 0.0
        assert body.start == 0.0


@given(behaviours, st.floats(0.0, 1.0))
def test_a_body_whose_attitude_shows_keeps_it(body, tolerance) -> None:
    level = choose(replace(body, roundness=0.5, pixels=np.inf), tolerance).level
    assert level in ("kirchhoff", "quasi_steady")


def chosen(shape, fluid, tmp_path, turbulence=None, **scale):
    surroundings = Surroundings(fluid, turbulence=turbulence or HomogeneousTurbulence(0.0, 0.0))
    scale = Scale(**{"tolerance": 0.2, "duration": 10.0, **scale})
    return model_at_level(shape, model_in(shape, fluid), surroundings, "auto", scale, tmp_path)


def test_levels_of_everyday_bodies(tmp_path) -> None:
    assert chosen(library.sphere(0.003, 900.0), AIR, tmp_path)[1].level in ("drift", "point")
    assert chosen(library.sphere(0.003, 1200.0), WATER, tmp_path)[1].level in ("drift", "point")
    assert chosen(library.sphere(0.003, 900.0), AIR, tmp_path, tolerance=0.0)[1].level == "point"
    assert chosen(library.maple_leaf(), AIR, tmp_path)[1].level == "quasi_steady"
    assert chosen(library.disk(), AIR, tmp_path)[1].level == "quasi_steady"
    flake, choice = chosen(library.disk(1e-3, 5e-5, 300.0), AIR, tmp_path)
    assert choice.level == "kirchhoff"
    assert flake.loads.lift == 0.0
    assert chosen(library.disk(1e-3, 5e-5, 300.0), AIR, tmp_path, pixels=1.0)[1].level == "drift"


RODS = [library.ellipsoid((0.04, 0.01, 0.01), 1500.0), library.ellipsoid((0.02, 0.018, 0.018), 1500.0)]


@pytest.mark.parametrize("shape", RODS, ids=["rod", "egg"])
def test_bodies_of_revolution_are_no_spheres(shape, tmp_path) -> None:
    """They have no lift, but which side they show decides how fast they fall: as points they are calibrated too."""
    model, choice = chosen(shape, WATER, tmp_path, pixels=1.0)
    assert choice.level in ("drift", "point")
    assert chosen(shape, WATER, tmp_path, pixels=1.0, tolerance=0.0)[1].level == "kirchhoff"
    assert descent(model, WATER, choice.level) == pytest.approx(descent(model_in(shape, WATER), WATER, "quasi_steady"), rel=0.05)


def descent(model, fluid, level, count=100) -> float:
    """Mean speed of fall in still fluid over 60 lengths of fall, after 40."""
    speed = model.point.fall_speed
    fps = 2.0 * speed / model.eddy_size
    start = started(orientations=random_orientations(count, 11), count=count)
    run = trajectory([Group(model, start, 1, level)], None, Surroundings(fluid), fps, 201)
    assert (run["state"][-1] == MOVING).all()
    heights = run["positions"][:, :, 1].mean(axis=1)
    return float(heights[80] - heights[200]) / (120.0 / fps)


FALLERS = {
    "leaf": (library.maple_leaf(), AIR),
    "paper": (library.disk(0.04, 1e-4, 800.0), AIR),
    "coin": (library.disk(0.02, 1.5e-3, 8000.0), WATER),
}


@pytest.mark.parametrize("name", FALLERS)
def test_calibrated_points_fall_as_fast_as_the_full_model(name) -> None:
    """Within 5 % in still fluid, from other attitudes than those they were calibrated with."""
    shape, fluid = FALLERS[name]
    model = model_in(shape, fluid)
    points = calibrated(model, pilot_fall(model, fluid, GRAVITY))
    full = descent(model, fluid, "quasi_steady")
    for level in ("drift", "point"):
        assert descent(points, fluid, level) == pytest.approx(full, rel=0.05)


@pytest.mark.parametrize("fps", [12.0, 24.0, 120.0])
@pytest.mark.parametrize(
    ("shape", "fluid"),
    [(library.sphere(0.003, 1200.0), WATER), (library.sphere(0.003, 90.0), WATER), (library.sphere(0.002), AIR)],
    ids=["water", "bubble", "air"],
)
def test_spheres_as_points_take_the_paths_of_the_full_model(shape, fluid, fps) -> None:
    """Within 1 % of the way, from their release on, thrown or dropped, in a wind that fluctuates."""
    count, frames = 40, round(1.5 * fps) + 1
    model = model_in(shape, fluid)
    speed = model.point.fall_speed
    throw = np.random.default_rng(2).normal(0.0, speed, (count, 3))
    throw[::2] = 0.0
    surroundings = Surroundings(fluid, turbulence=HomogeneousTurbulence(0.1 * speed**2, 0.1 * speed**2))
    runs = []
    for level in ("quasi_steady", "point"):
        runs.append(trajectory([Group(model, started(velocities=throw, count=count), 1, level)], None, surroundings, fps, frames))
    steps = np.linalg.norm(np.diff(runs[0]["positions"], axis=0), axis=2)
    way = np.cumsum(steps, axis=0)
    apart = np.linalg.norm(runs[0]["positions"] - runs[1]["positions"], axis=2)[1:]
    second = round(0.25 * fps) - 1
    assert (apart[second:] < 0.01 * way[second:]).all()


@pytest.mark.parametrize("fps", [12.0, 24.0, 60.0, 240.0])
def test_point_in_linear_drag_is_exact_at_any_frame_rate(fps) -> None:
    rate, wind, start = 5.0, np.array([1.0, 0.5, -2.0]), np.array([3.0, 4.0, 0.0])
    body = ideal_body(pull=GRAVITY, loads=no_loads(drag_linear=np.full(3, rate)))
    surroundings = Surroundings(AIR, mean_wind=tuple(wind))
    frames = round(1.0 * fps) + 1
    run = trajectory([Group(body, started(velocities=start), 1, "point")], None, surroundings, fps, frames)
    t = np.arange(frames)[:, None] / fps
    last = wind + [0.0, -GRAVITY / rate, 0.0]
    decay = np.exp(-rate * t)
    assert np.abs(run["velocities"][:, 0] - (last + (start - last) * decay)).max() < 1e-5
    assert np.abs(run["positions"][:, 0] - (last * t + (start - last) * (1.0 - decay) / rate)).max() < 1e-5


def test_point_without_drag_falls_freely() -> None:
    body = ideal_body(pull=GRAVITY)
    run = trajectory([Group(body, started(velocities=(1.0, 0.0, 0.0)), 1, "point")], None, Surroundings(AIR), 24.0, 25)
    t = np.arange(25) / 24.0
    assert np.abs(run["positions"][:, 0, 1] + 0.5 * GRAVITY * t**2).max() < 1e-5
    assert np.abs(run["positions"][:, 0, 0] - t).max() < 1e-5


def test_drift_is_exact() -> None:
    """It moves at once with the wind and at its terminal speed, heavy or light, whatever the gravity's direction."""
    for density, gravity in ((2000.0, (0.0, -9.81, 0.0)), (500.0, (0.0, -9.81, 0.0)), (2000.0, (3.0, -9.0, 1.0))):
        model = model_in(library.sphere(0.005, density), WATER)
        surroundings = Surroundings(WATER, gravity=gravity, mean_wind=(0.3, 0.1, -0.2))
        run = trajectory([Group(model, started(), 1, "drift")], None, surroundings, 24.0, 25)
        down = np.array(gravity) / np.linalg.norm(gravity)
        velocity = np.array([0.3, 0.1, -0.2]) + np.sign(density - 1000.0) * model.point.fall_speed * down
        assert np.abs(run["positions"][:, 0] - np.arange(25)[:, None] / 24.0 * velocity).max() < 1e-6
        assert np.abs(run["velocities"][1:, 0] - velocity).max() < 1e-6


@pytest.mark.parametrize("level", ["drift", "point"])
def test_a_point_released_between_frames_starts_on_time(level) -> None:
    """As if the frame had begun there."""
    model = model_in(library.sphere(0.003, 1200.0), WATER)
    release = np.array([0.0, 1.3 / 24.0, 2.0 / 24.0])
    start = started(positions=(0.0, 10.0, 0.0), release_times=release, count=3)
    run = trajectory([Group(model, start, 1, level)], None, Surroundings(WATER), 24.0, 25)
    fine = trajectory([Group(model, started(positions=(0.0, 10.0, 0.0)), 1, level)], None, Surroundings(WATER), 2400.0, 2401)
    for body in range(3):
        since = np.arange(25) / 24.0 - release[body]
        expected = np.interp(np.maximum(since, 0.0), np.arange(2401) / 2400.0, fine["positions"][:, 0, 1])
        assert np.abs(run["positions"][:, body, 1] - expected).max() < 1e-3


def test_tiny_flakes_with_stiff_drag_are_right_at_film_rates() -> None:
    """0.1 mm across at 12 fps: drag acts hundreds of times within a frame."""
    model = model_in(library.disk(1e-4, 1e-5, 500.0), AIR)
    points = calibrated(model, pilot_fall(model, AIR, GRAVITY))
    assert points.point.drag[0] / 12.0 > 20.0
    surroundings = Surroundings(AIR, mean_wind=(2.0, 0.0, 0.0))
    start = started(orientations=random_orientations(50, 3), velocities=(0.0, 5.0, 0.0), count=50)
    run = trajectory([Group(points, start, 1, "point")], None, surroundings, 12.0, 25)
    assert run["velocities"][5:].mean(axis=(0, 1)) == pytest.approx([2.0, -points.point.fall_speed, 0.0], abs=0.01)
    assert np.abs(run["positions"][-1, :, 0] - 4.0).max() < 0.02
    assert np.abs(run["positions"][-1, :, 1] + 2.0 * points.point.fall_speed).max() < 0.05


@pytest.mark.parametrize(
    "shape", [library.disk(), library.birch_leaf(), library.sphere(0.01, 500.0)], ids=["disk", "leaf", "sphere"]
)
def test_points_land_and_rest_like_the_others(shape) -> None:
    """All at rest, lowest point on the ground, lying as bodies of the full model lie."""
    model = model_in(shape, AIR)
    points = calibrated(model, pilot_fall(model, AIR, GRAVITY))
    start = started(positions=(0.0, 0.5, 0.0), orientations=random_orientations(60, 5), count=60)
    heights = []
    for level in ("quasi_steady", "drift", "point"):
        surroundings = Surroundings(AIR, ground_height=0.1)
        run = trajectory([Group(points, start, 1, level)], None, surroundings, 24.0, 120)
        assert (run["state"][-1] == LANDED).all()
        assert not run["velocities"][-1].any()
        assert np.array_equal(run["positions"][-1], run["positions"][-2])
        heights.append(np.sort(run["positions"][-1, :, 1]))
        assert run["positions"][:, :, 1].min() > 0.1 - 1e-4
    # faces that bodies come to lie on differ little in height
    assert heights[1].mean() == pytest.approx(heights[0].mean(), abs=2e-3)
    assert heights[2].mean() == pytest.approx(heights[0].mean(), abs=2e-3)


@pytest.mark.parametrize("level", ["drift", "point"])
def test_bubbles_keep_off_the_ground_and_their_speed(level) -> None:
    """Gusts push them down onto it; they neither sink into it nor learn to rise faster."""
    model = model_in(library.sphere(0.003, 90.0), WATER)
    speed = model.point.fall_speed
    turbulence = HomogeneousTurbulence(6.0 * speed**2, 6.0 * speed**2 * 20.0)
    start = started(positions=(0.0, 0.01, 0.0), count=500)
    runs = []
    for height in (0.0, None):
        surroundings = Surroundings(WATER, turbulence=turbulence, ground_height=height)
        runs.append(trajectory([Group(model, start, 1, level)], None, surroundings, 60.0, 241))
    grounded = runs[0]
    assert (grounded["state"][-1] == MOVING).all()
    assert grounded["positions"][:, :, 1].min() > 0.0
    rises = [run["velocities"][-60:, :, 1].mean(axis=0) for run in runs]
    error = np.hypot(*(rise.std() / np.sqrt(500) for rise in rises))
    assert abs(rises[0].mean() - rises[1].mean()) < 4.0 * error
    assert 0.1 * speed < rises[0].mean() < 1.1 * speed


WINDY = Surroundings(AIR, mean_wind=(0.5, 0.0, 0.0), turbulence=HomogeneousTurbulence(0.05, 0.02), ground_height=0.0)


def crowd(level, count, key) -> Group:
    model = model_in(library.birch_leaf(), AIR)
    model = (
        without_lift(model, GRAVITY)
        if level == "kirchhoff"
        else replace(model, point=replace(model.point, tumbling=5.0, glide=0.3))
    )
    random = np.random.default_rng(7)
    place = random.uniform((-2.0, 1.0, -2.0), (2.0, 3.0, 2.0), (5000, 3))[:count]
    start = started(
        place, random_orientations(5000, 8)[:count], release_times=random.uniform(0.0, 1.0, 5000)[:count], count=count
    )
    return Group(model, start, key, level)


@pytest.mark.parametrize("level", LEVELS)
def test_paths_depend_on_neither_threads_nor_company(level) -> None:
    """The same bytes alone, in a crowd, on more threads, and beside all other levels in one scene."""
    others = [crowd(other, 300, 20 + i) for i, other in enumerate(LEVELS) if other != level]

    def run(groups, threads):
        return trajectory(groups, None, WINDY, 24.0, 50, seed=5, threads=threads)

    alone = run([crowd(level, 60, 9)], 1)
    for company, first in (([crowd(level, 1500, 9)], 0), ([others[0], crowd(level, 60, 9), *others[1:]], 300)):
        for threads in (1, 3):
            together = run(company, threads)
            for name in ("positions", "orientations", "velocities", "angular_velocities", "state"):
                assert together[name][:, first : first + 60].tobytes() == alone[name].tobytes()
    assert alone["state"][-1].max() == LANDED


def test_lower_levels_take_fewer_substeps() -> None:
    steps = [trajectory([crowd(level, 200, 9)], None, WINDY, 24.0, 25)["body_steps"][-1] for level in LEVELS]
    assert steps[0] <= steps[1] <= steps[2] <= steps[3]
    assert steps[1] < steps[2]


def test_tumbling_of_points_is_that_measured() -> None:
    """The spin per speed, about an axis of its own, at any speed; and the first spin gives way to it."""
    model = model_in(library.disk(), AIR)
    fall = pilot_fall(model, AIR, GRAVITY)
    points = calibrated(model, fall)
    start = started(orientations=random_orientations(100, 1), angular_velocities=(0.0, 0.0, 200.0), count=100)
    for level in ("drift", "point"):
        run = trajectory([Group(points, start, 1, level)], None, Surroundings(AIR), 60.0, 241)
        spin = np.linalg.norm(run["angular_velocities"][-1], axis=1)
        assert spin == pytest.approx(np.full(100, fall.spin), rel=0.02)
        assert np.abs(np.linalg.norm(run["orientations"][-1], axis=1) - 1.0).max() < 1e-5


def test_behaviour_of_weightless_bodies_is_finite() -> None:
    body = behaviour(library.sphere(0.01, 1000.0), ideal_body(net_weight=0.0), Surroundings(WATER), None, Scale(0.2, 10.0))
    assert all(np.isfinite(value) for name, value in vars(body).items() if name != "pixels")


@settings(deadline=None, max_examples=50)
@given(st.floats(0.0, 1.0))
def test_errors_grow_with_the_wind(wind) -> None:
    from warp_immersed.fidelity import drift_error, point_error

    calm = Behaviour(0.9, 0.1, 500.0, wind, 0.5, 0.1, 0.01)
    windy = replace(calm, wind=wind + 0.1)
    assert point_error(windy) >= point_error(calm)
    assert drift_error(windy) >= drift_error(calm)


SCENE = """
duration = 2.0
[[bodies]]
name = "hail"
count = 5
shape = { library = "sphere" }
emitter = { kind = "box", center = [0, 3, 0], size = [1, 1, 1] }
[[bodies]]
name = "coin"
count = 5
shape = { library = "disk" }
emitter = { kind = "box", center = [0, 3, 0], size = [1, 1, 1] }
[[bodies]]
name = "marked"
count = 5
fidelity = "kirchhoff"
shape = { library = "disk" }
emitter = { kind = "box", center = [0, 3, 0], size = [1, 1, 1] }
"""


@pytest.mark.parametrize("command", [["info"], ["run", "-o", "a.h5"]], ids=["info", "run"])
def test_the_command_line_names_levels_and_reasons(command, tmp_path) -> None:
    (tmp_path / "mixed.toml").write_text(SCENE)
    result = subprocess.run(
        [sys.executable, "-m", "warp_immersed.cli", command[0], "mixed.toml", *command[1:]],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    lines = {line.split(":")[0].strip(): line for line in result.stdout.splitlines()}
    assert "(auto: round" in lines["hail"]
    assert "quasi_steady (auto: without lift its fall could be 75 % off)" in lines["coin"]
    assert "kirchhoff, " in lines["marked"]


def test_dust_too_small_for_the_full_model_falls_as_a_point(tmp_path) -> None:
    """Grains of half a micrometre ask for far too many substeps: points must not need the full model to be calibrated. In
    creeping flow a spheroid of 2 : 1 in all attitudes falls 1.044 times slower than the sphere of its volume (Perrin 1934)."""
    shape = library.ellipsoid((4e-7, 2e-7, 2e-7), 1500.0)
    model = model_in(shape, AIR)
    radius = (4e-7 * 2e-7 * 2e-7) ** (1.0 / 3.0)
    stokes = shape.mass * GRAVITY * model.net_weight / (6.0 * np.pi * AIR.dynamic_viscosity * radius)
    assert model.rates.linear / 24.0 > 10_000.0, "substeps a frame of the full model"
    for asked in ("drift", "point"):
        moved, choice = model_at_level(shape, model, Surroundings(AIR), asked, Scale(0.2, 1.0), tmp_path)
        assert choice.level == asked
        assert descent(moved, AIR, asked) == pytest.approx(stokes / 1.044, rel=0.03)
    assert not list(tmp_path.iterdir()), "no pilot run"
