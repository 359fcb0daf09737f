import numpy as np
import pytest
import trimesh

from warp_immersed.boundaries import Inlet, LogInlet, Outlet, Slip, Wall
from warp_immersed.errors import InputError
from warp_immersed.field_scene import FieldScene
from warp_immersed.obstacles import mesh_mask

STREET = """
fluid = "air"
[domain]
lower = [-4.0, 0.0, 0.0]
upper = [12.0, 6.0, 8.0]
cells = [16, 6, 8]
[boundary]
x_min = { kind = "inlet", profile = "log", reference_speed = 5.0, reference_height = 10, direction = [1, 0, 0], roughness = 0.05 }
x_max = { kind = "outlet" }
y_min = { kind = "wall", roughness = 0.05 }
y_max = { kind = "slip" }
z_min = { kind = "symmetry" }
z_max = { kind = "slip" }
[[obstacle]]
box = [[0, 0, 0], [2, 2, 3]]
"""
UNIFORM = '{ kind = "inlet", velocity = [1, 0, 0], intensity = 0.05, length_scale = 0.14 }'


def test_a_field_becomes_a_flow():
    setup = FieldScene.parse(STREET).setup()
    assert setup.cells == (16, 6, 8)
    assert setup.spacing == (1.0, 1.0, 1.0)
    inlet = setup.sides[0]
    assert isinstance(inlet, LogInlet)
    assert inlet.speed(10.0) == pytest.approx(5.0)
    assert [type(side) for side in setup.sides[1:]] == [Outlet, Wall, Slip, Slip, Slip]
    assert setup.sides[2].roughness == 0.05
    assert setup.solid.sum() == 2 * 2 * 3
    assert setup.solid[4:6, :2, :3].all()
    assert setup.viscosity == pytest.approx(1.516e-5)


def test_a_uniform_inlet_has_the_usual_k_and_epsilon():
    inlet = FieldScene.parse(STREET.replace(STREET.split("x_min = ")[1].split("\n")[0], UNIFORM)).setup().sides[0]
    assert isinstance(inlet, Inlet)
    assert inlet.k == pytest.approx(0.00375)
    assert inlet.epsilon == pytest.approx(0.00026952605)


def test_spacing_gives_the_cells_and_the_default_follows_the_obstacle():
    assert FieldScene.parse(STREET.replace("cells = [16, 6, 8]", "spacing = 0.5")).cells == (32, 12, 16)
    cells = FieldScene.parse(STREET.replace("cells = [16, 6, 8]", "")).cells
    assert cells == (64, 24, 32)  # an eighth of the smallest obstacle edge (2 m)
    huge = STREET.replace("cells = [16, 6, 8]", "").replace("[2, 2, 3]", "[0.02, 2, 3]")
    assert np.prod(FieldScene.parse(huge).cells) < 450_000


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("[domain]", "[domain", "not TOML"),
        ('fluid = "air"', 'fluid = "honey"', "fluid"),
        ('fluid = "air"', 'fluids = "air"', "fluids: is not a known key"),
        ("lower = [-4.0, 0.0, 0.0]", "", "domain.lower: is missing"),
        ("lower = [-4.0, 0.0, 0.0]", "lower = [-4.0, 0.0]", "domain.lower"),
        ("lower = [-4.0, 0.0, 0.0]", "lower = [14.0, 0.0, 0.0]", "lower must be below upper"),
        ("cells = [16, 6, 8]", "cells = [16, 6, 8]\nspacing = 1.0", "keep one of them"),
        ("cells = [16, 6, 8]", "cells = [16, 2, 8]", "cells along y: found 2"),
        ("cells = [16, 6, 8]", "cells = [0, 6, 8]", "cells along x: found 0"),
        ("cells = [16, 6, 8]", "spacing = 1e-9", "domain.spacing: found 1e-09"),
        ("cells = [16, 6, 8]", "spacing = -1.0", "domain.spacing: found -1.0"),
        ('kind = "outlet"', 'kind = "outlett"', "boundary.x_max.kind: found 'outlett', must be inlet, wall"),
        ('x_max = { kind = "outlet" }', "", "boundary.x_max: is missing"),
        ('kind = "outlet"', 'kind = "slip"', "no side is an outlet"),
        ("reference_speed = 5.0, ", "", "a log inlet takes"),
        ("reference_speed = 5.0", "reference_speed = nan", "reference_speed"),
        ("direction = [1, 0, 0]", "direction = [-1, 0, 0]", "points out of the domain"),
        ("direction = [1, 0, 0]", "direction = [1, 1, 0]", "must be horizontal"),
        ("direction = [1, 0, 0]", "direction = [0, 0, 1]", "runs along the side"),
        ('y_max = { kind = "slip" }', 'y_max = { kind = "periodic" }', "needs y_min periodic too"),
        ("roughness = 0.05 }\ny_max", "roughness = -0.05 }\ny_max", "boundary.y_min.roughness: found -0.05"),
        ("box = [[0, 0, 0], [2, 2, 3]]", "", "an obstacle takes either"),
        ("box = [[0, 0, 0], [2, 2, 3]]", "box = [[90, 0, 0], [92, 2, 3]]", "covers no cell centre"),
        ("box = [[0, 0, 0], [2, 2, 3]]", "box = [[-9, -9, -9], [99, 99, 99]]", "fills the whole domain"),
        ("box = [[0, 0, 0], [2, 2, 3]]", "box = [[0, 0, 0], [2, 6, 8]]", "closes the way from x_min"),
        ("box = [[0, 0, 0], [2, 2, 3]]", 'mesh = "none.obj"', "no such file"),
    ],
)
def test_bad_input_is_named_in_one_line(old, new, says):
    assert old in STREET
    with pytest.raises(InputError, match=says.replace("[", r"\[")) as caught:
        FieldScene.parse(STREET.replace(old, new, 1), name="street.toml").setup()
    message = str(caught.value)
    assert message.startswith("street.toml: ")
    assert "\n" not in message


def test_a_sealed_hollow_is_filled():
    shell = "\n".join(
        f"[[obstacle]]\nbox = {box}"
        for box in ("[[0, 0, 0], [5, 1, 5]]", "[[0, 4, 0], [5, 5, 5]]", "[[0, 0, 0], [1, 5, 5]]", "[[4, 0, 0], [5, 5, 5]]",
                    "[[0, 0, 0], [5, 5, 1]]", "[[0, 0, 4], [5, 5, 5]]")
    )  # fmt: skip
    setup = FieldScene.parse(STREET.split("[[obstacle]]")[0] + shell).setup()
    assert setup.solid.sum() == setup.solid[4:9, :5, :5].sum() == 125


def test_missing_and_binary_files_are_input_errors(tmp_path):
    with pytest.raises(InputError, match=r"none\.toml"):
        FieldScene.load(tmp_path / "none.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"binary\.toml"):
        FieldScene.load(tmp_path / "binary.toml")


def test_a_mesh_becomes_the_cells_inside_it():
    ball = trimesh.creation.icosphere(subdivisions=4, radius=1.0)
    cells = (24, 24, 24)
    mask = mesh_mask((-1.5, -1.5, -1.5), (1.5, 1.5, 1.5), cells, ball)
    axis = -1.5 + (np.arange(24) + 0.5) * 0.125
    r = np.sqrt(axis[:, None, None] ** 2 + axis[None, :, None] ** 2 + axis[None, None, :] ** 2)
    assert mask[r < 0.995].all()
    assert not mask[r > 1.0].any()
    inside_out = ball.copy()
    inside_out.invert()
    np.testing.assert_array_equal(mesh_mask((-1.5, -1.5, -1.5), (1.5, 1.5, 1.5), cells, inside_out), mask)


def test_an_open_mesh_is_refused(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=1)
    ball.update_faces(np.arange(len(ball.faces)) > 3)
    ball.export(tmp_path / "open.obj")
    text = STREET.replace("box = [[0, 0, 0], [2, 2, 3]]", 'mesh = "open.obj"')
    with pytest.raises(InputError, match="not watertight"):
        FieldScene.parse(text, tmp_path).setup()
