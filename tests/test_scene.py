"""Scene files: what they may say, and errors that name file, key, what was found and what would be right."""

import numpy as np
import pytest

import warp_immersed as wi
from warp_immersed.errors import InputError
from warp_immersed.scene import Scene, builtin_scenes
from warp_immersed.simulation import plan

GOOD = """
duration = 2.0
fps = 24
seed = 3
fluid = "air"
[wind]
velocity = [0.5, 0.0, 0.0]
[turbulence]
kind = "homogeneous"
k = 0.05
epsilon = 0.02
[ground]
height = 0.0
[[bodies]]
name = "maple"
count = 40
shape = { library = "maple_leaf", length = 0.07 }
density = 700.0
thickness = 3e-4
emitter = { kind = "box", center = [0, 8, 0], size = [6, 2, 6], orientation = "random", start = 0.0, duration = 1.0 }
"""

# replaced text, replacement, what the message must say
BAD = [
    ("duration = 2.0", "duraton = 2.0", ["duraton: unknown key", "'duration'"]),
    ("duration = 2.0", "duration = -1.0", ["duration: found -1.0", "greater than 0"]),
    ("duration = 2.0", "duration = 0.001", ["makes no frame"]),
    ("duration = 2.0", "duration = inf", ["duration: found inf"]),
    ("fps = 24", "fps = '24'", ["fps: found '24'", "number"]),
    ("fps = 24", "fps = 0", ["fps: found 0"]),
    ("seed = 3", "seed = -1", ["seed: found -1"]),
    ("seed = 3", "seed = true", ["seed: found True", "integer"]),
    ('fluid = "air"', 'fluid = "oil"', ["fluid: found 'oil'", "'air' or 'water'"]),
    ('fluid = "air"', "fluid = { density = 1.2 }", ["fluid.kinematic_viscosity: missing"]),
    ('fluid = "air"', "fluid = { density = 0.0, kinematic_viscosity = 1e-5 }", ["fluid.density: found 0.0"]),
    ("velocity = [0.5, 0.0, 0.0]", "velocity = [0.5, 0.0]", ["wind.velocity[2]: missing"]),
    ("k = 0.05", "k = -0.05", ["turbulence.k: found -0.05"]),
    ('kind = "homogeneous"', 'kind = "gird"', ["turbulence.kind: found 'gird'", "'homogeneous'"]),
    ('kind = "homogeneous"\n', "", ["turbulence.kind: missing"]),
    ("height = 0.0", "hight = 0.0", ["ground.hight: unknown key", "'height'"]),
    ("count = 40", "count = 0", ["bodies[0].count: found 0"]),
    ("count = 40", "count = 1.5", ["bodies[0].count: found 1.5", "integer"]),
    ('name = "maple"', 'name = "my leaf"', ["bodies[0].name: found 'my leaf'"]),
    ('library = "maple_leaf"', 'library = "mapel_leaf"', ["bodies[0].shape", "'mapel_leaf'", "'maple_leaf'"]),
    ("length = 0.07", "lenth = 0.07", ["bodies[0].shape", "'lenth'", "'length'"]),
    ("length = 0.07", "length = -0.07", ["bodies[0].length: found -0.07"]),
    ("length = 0.07", "length = 70", ["metres"]),
    ("length = 0.07", "length = 'long'", ["bodies[0].shape", "'long'", "number"]),
    ('library = "maple_leaf", length = 0.07', 'mesh = "gone.obj"', ["bodies[0]", "gone.obj", "no such file"]),
    ('library = "maple_leaf", length = 0.07', 'library = "disk", mesh = "a.obj"', ["exactly one of"]),
    ('library = "maple_leaf", length = 0.07', "outline = [[0, 0], [1, 0]]", ["outline", "at least three"]),
    ('library = "maple_leaf", length = 0.07', "ellipsoid = [0.1, 0.1]", ["bodies[0].shape.ellipsoid[2]: missing"]),
    ('library = "maple_leaf", length = 0.07', "ellipsoid = [0.01, 0.01, 0.01]", ["thickness", "closed body"]),
    ('library = "maple_leaf", length = 0.07', 'library = "sphere"', ["thickness", "closed body"]),
    ("density = 700.0", "density = 0.7", ["bodies[0].density: found 0.7"]),
    ("density = 700.0", "density = -700.0", ["bodies[0].density: found -700.0"]),
    ("thickness = 3e-4", "thickness = 0.3", ["thickness: found 0.3", "metres"]),
    ("thickness = 3e-4", "thickness = 0", ["bodies[0].thickness: found 0"]),
    ("thickness = 3e-4", 'fidelity = "high"', ["bodies[0].fidelity: found 'high'"]),
    ('kind = "box"', 'kind = "bx"', ["bodies[0].emitter.kind: found 'bx'", "'box'"]),
    ("size = [6, 2, 6]", "size = [6, -2, 6]", ["bodies[0].emitter.size[1]: found -2"]),
    ("center = [0, 8, 0], ", "", ["bodies[0].emitter.center: missing"]),
    ("center = [0, 8, 0]", "center = [0, 1, 0]", ["bodies[0].emitter", "start in the ground", "raise"]),
    ("center = [0, 8, 0]", "center = [0, nan, 0]", ["bodies[0].emitter.center[1]: found nan"]),
    ('orientation = "random"', 'orientation = "up"', ["bodies[0].emitter.orientation: found 'up'"]),
    ('orientation = "random"', "orientation = [1, 1, 1, 1]", ["bodies[0].emitter.orientation", "length 1"]),
    ("start = 0.0", "start = -1.0", ["bodies[0].emitter.start: found -1.0"]),
    ("[wind]", "[wind", ["not valid TOML", "line 6"]),
    ("[[bodies]]", "[bodies]", ["bodies"]),
]


@pytest.mark.parametrize(("old", "new", "said"), BAD, ids=[new.strip() or f"no {old.strip()}" for old, new, _ in BAD])
def test_bad_scenes_are_refused_in_one_line(old, new, said) -> None:
    assert old in GOOD
    with pytest.raises(InputError) as error:
        plan(Scene.from_text(GOOD.replace(old, new, 1), "autumn"))
    message = str(error.value)
    assert message.startswith("autumn.toml: ")
    assert "\n" not in message
    for words in said:
        assert words in message, message


def test_a_buoyant_body_in_the_ground_is_refused_with_the_reason() -> None:
    text = GOOD.replace('fluid = "air"', 'fluid = "water"').replace("center = [0, 8, 0]", "center = [0, 0.5, 0]")
    with pytest.raises(InputError, match=r"lighter than the fluid .* thrown out of it"):
        plan(Scene.from_text(text))


def test_a_good_scene_is_understood() -> None:
    scene = Scene.from_text(GOOD, "autumn")
    assert (scene.frame_count, scene.body_count, scene.name) == (48, 40, "autumn")
    planned = plan(scene)
    assert planned.kinds[0].shape.density == 700.0
    assert planned.kinds[0].level == "quasi_steady"
    assert planned.surroundings.mean_wind == (0.5, 0.0, 0.0)


def test_scaling_counts_changes_counts_only() -> None:
    scene = Scene.from_text(GOOD, "autumn")
    assert scene.changed(count_scale=2.5).bodies[0].count == 100
    assert scene.changed(count_scale=1e-9).bodies[0].count == 1
    assert scene.changed(seed=9).seed == 9
    assert scene.changed(seed=9).digest != scene.digest
    assert scene.changed().digest == scene.digest
    with pytest.raises(InputError, match="count scale"):
        scene.changed(count_scale=0.0)
    with pytest.raises(InputError, match="seed: found -1"):
        scene.changed(seed=-1)


def test_meshes_are_looked_up_beside_the_scene(tmp_path) -> None:
    import trimesh

    trimesh.creation.box((0.1, 0.1, 0.1)).export(tmp_path / "box.stl")
    text = GOOD.replace('library = "maple_leaf", length = 0.07', 'mesh = "box.stl", scale = 0.5').replace(
        "thickness = 3e-4\n", ""
    )
    (tmp_path / "boxes.toml").write_text(text)
    planned = plan(Scene.load(tmp_path / "boxes.toml"))
    assert planned.kinds[0].shape.mass == pytest.approx(700.0 * 0.05**3)


def test_repairs_are_noted(tmp_path) -> None:
    import trimesh

    box = trimesh.creation.box((0.1, 0.1, 0.1))
    box.invert()
    box.export(tmp_path / "box.stl")
    text = GOOD.replace('library = "maple_leaf", length = 0.07', 'mesh = "box.stl"').replace("thickness = 3e-4\n", "")
    (tmp_path / "boxes.toml").write_text(text)
    assert plan(Scene.load(tmp_path / "boxes.toml")).notes == ("maple: box.stl: turned inside out, its faces pointed inward",)


@pytest.mark.parametrize("name", [name for name in builtin_scenes() if name != "autumn_street"])
def test_built_in_scenes_run(name: str) -> None:
    scene = Scene.load(name)
    assert plan(scene).notes == ()
    few = wi.simulate(scene.changed(count_scale=0.02), device="cpu")
    assert (few.state != 3).all()
    assert np.isfinite(few.positions).all()


def test_unknown_scenes_are_refused() -> None:
    with pytest.raises(InputError, match="did you mean 'falling_leaves'"):
        Scene.load("falling_leafs")
    with pytest.raises(InputError, match="cannot be read"):
        Scene.load("no/such/file.toml")


def test_falling_leaves_fall_drift_and_settle() -> None:
    """What the scene is for: leaves come down at some metres a second or less, downwind, tumbling, and end up lying."""
    scene = Scene.load("falling_leaves").changed(count_scale=0.2)
    run = wi.simulate(scene, device="cpu")
    moving = run.state == 1
    speed = -run.velocities[..., 1][moving]
    assert 0.5 < speed.mean() < 1.6
    spin = np.linalg.norm(run.angular_velocities, axis=2)[moving]
    assert 5.0 < spin.mean() < 30.0
    landed = run.state[-1] == 2
    assert landed.mean() > 0.7
    assert (run.positions[-1, landed, 0] - run.positions[0, landed, 0]).mean() > 0.5
    assert run.positions[-1, :, 1].min() > 0.0


FIELD = """
[turbulence]
kind = "grid"
[turbulence.field.domain]
lower = [-10.0, 0.0, -6.0]
upper = [14.0, 12.0, 6.0]
cells = [24, 12, 12]
[turbulence.field.boundary]
x_min = { kind = "inlet", velocity = [3, 0, 0], intensity = 0.1, length_scale = 1.0 }
x_max = { kind = "outlet" }
y_min = { kind = "wall", roughness = 0.05 }
y_max = { kind = "slip" }
[[turbulence.field.obstacle]]
box = [[-2, 0, -2], [2, 4, 2]]
"""
HOMOGENEOUS = """[turbulence]
kind = "homogeneous"
k = 0.05
epsilon = 0.02
"""
WIND = """[wind]
velocity = [0.5, 0.0, 0.0]
"""


def in_a_field(text: str = GOOD) -> str:
    return text.replace(HOMOGENEOUS, FIELD).replace(WIND, "").replace("height = 0.0", "obstacles = true")


def test_an_inline_field_is_baked_once_and_blows_the_leaves() -> None:
    scene = Scene.from_text(in_a_field().replace("center = [0, 8, 0], size = [6, 2, 6]", "center = [-6, 6, 0], size = [1, 1, 6]"))
    first = plan(scene).surroundings.flow
    again = plan(scene).surroundings.flow
    assert np.array_equal(first.velocity, again.velocity)
    assert first.velocity[..., 0].max() > 3.0, "the wind speeds up past the house"
    run = wi.simulate(scene, device="cpu")
    drift = run.positions[-1, :, 0] - run.positions[0, :, 0]
    assert 0.5 < drift.mean() < 8.0
    assert np.isfinite(run.positions).all()
    still = Scene.from_text(GOOD.replace(HOMOGENEOUS, "").replace(WIND, ""))
    assert np.abs((lambda r: r.positions[-1, :, 0] - r.positions[0, :, 0])(wi.simulate(still, device="cpu")).mean()) < 0.5


def test_a_boundary_layer_needs_no_grid_and_is_faster_higher_up() -> None:
    layer = """[turbulence]
kind = "boundary_layer"
reference_speed = 5.0
reference_height = 10.0
roughness = 0.05
"""
    text = GOOD.replace(HOMOGENEOUS, layer).replace(WIND, "").replace("count = 40", "count = 400")
    low = wi.simulate(Scene.from_text(text.replace("[0, 8, 0], size = [6, 2, 6]", "[0, 3, 0], size = [6, 0.1, 6]")), device="cpu")
    high = wi.simulate(
        Scene.from_text(text.replace("[0, 8, 0], size = [6, 2, 6]", "[0, 30, 0], size = [6, 0.1, 6]")), device="cpu"
    )
    speeds = [run.velocities[-1, run.state[-1] == 1, 0].mean() for run in (low, high)]
    profile = [5.0 * np.log((h + 0.05) / 0.05) / np.log(10.05 / 0.05) for h in (2.0, 29.0)]
    assert speeds[1] > 1.2 * speeds[0]
    assert speeds[1] == pytest.approx(profile[1], rel=0.15)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("[turbulence.field.domain]", "[turbulence.field.domian]"), ["turbulence.field", "domian"]),
        (("box = [[-2, 0, -2], [2, 4, 2]]", "box = [[-20, 0, -20], [20, 40, 20]]"), ["turbulence"]),
        (('x_max = { kind = "outlet" }', 'x_max = { kind = "slip" }'), ["turbulence"]),
        (("[ground]", "[wind]\nvelocity = [1, 0, 0]\n[ground]"), ["wind", "brings its own"]),
    ],
)
def test_bad_fields_are_refused_in_one_line(change, said) -> None:
    with pytest.raises(InputError) as error:
        plan(Scene.from_text(in_a_field().replace(*change, 1), "autumn"))
    assert str(error.value).startswith("autumn.toml: ")
    for words in said:
        assert words in str(error.value), str(error.value)


def test_a_missing_bake_file_and_obstacles_without_a_field_are_refused() -> None:
    text = GOOD.replace(HOMOGENEOUS, "[turbulence]\nkind = 'grid'\nfield = 'gone.h5'\n").replace(WIND, "")
    with pytest.raises(InputError, match=r"autumn.toml: turbulence: .*gone.h5: no such file; make it with"):
        plan(Scene.from_text(text, "autumn"))
    with pytest.raises(InputError, match=r"autumn.toml: ground: obstacles: need turbulence of kind 'grid'"):
        plan(Scene.from_text(GOOD.replace("height = 0.0", "obstacles = true"), "autumn"))


@pytest.mark.slow
def test_autumn_street_eddies_behind_the_houses() -> None:
    """What the scene is for: leaves are carried past the houses, some turn back behind them, some lie on the roofs."""
    run = wi.simulate(Scene.load("autumn_street").changed(count_scale=0.2), device="cpu")
    assert (run.state != 3).all()
    behind = (run.positions[..., 0] > 9.0) & (run.positions[..., 0] < 20.0) & (run.positions[..., 1] < 6.0) & (run.state == 1)
    assert behind.any(axis=0).mean() > 0.1
    assert (run.velocities[..., 0][behind] < -0.3).mean() > 0.05, "the wake flows back"
    landed = run.state[-1] == 2
    roof = landed & (np.abs(run.positions[-1, :, 1] - 8.0) < 0.1)
    assert roof.sum() >= 5
    assert (run.positions[-1, :, 0].max()) > 25.0
