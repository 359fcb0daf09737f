"""Pictures and movies from recordings and USD files, without a display."""

import numpy as np
import pytest
from PIL import Image

import warp_immersed as wi
from tests.test_recording import SCENE
from warp_immersed.errors import InputError
from warp_immersed.export_options import ExportOptions
from warp_immersed.framing import camera_of
from warp_immersed.shot import open_shot

VIEW = """
[view]
position = [0.0, 3.0, 4.0]
target = [0.0, 2.5, 0.0]
"""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    path = tmp_path_factory.mktemp("preview") / "coins.h5"
    wi.simulate(wi.Scene.from_text(SCENE, "coins"), device="cpu").save(path)
    return path


@pytest.fixture(scope="module")
def written(recorded):
    path = recorded.with_suffix(".usdc")
    wi.export_usd(wi.Recording.load(recorded), path)
    return path


def test_usd_shows_what_the_recording_shows(recorded, written) -> None:
    with open_shot(recorded) as one, open_shot(written) as other:
        assert (one.frames, one.fps, len(one.looks)) == (other.frames, other.fps, len(other.looks))
        assert np.array_equal(one.look_of, other.look_of)
        for frame in (0, 10, 23):
            a, b = one.poses(frame), other.poses(frame)
            assert np.allclose(a.positions, b.positions)
            assert np.allclose(a.velocities, b.velocities)
            assert np.allclose(a.spins, b.spins, rtol=1e-5)
            assert np.abs(a.orientations - b.orientations).max() < 5e-4
        for look, same in zip(one.looks, other.looks, strict=True):
            assert np.allclose(look.color, same.color)
            assert np.allclose(look.vertices, same.vertices)
        assert one.scene is not None
        assert other.scene is not None
        assert one.scene.digest == other.scene.digest


def test_other_axes_and_units_show_the_same(recorded, tmp_path) -> None:
    path = tmp_path / "z_up.usdc"
    wi.export_usd(wi.Recording.load(recorded), path, ExportOptions(up_axis="z", units="cm"))
    with open_shot(recorded) as one, open_shot(path) as other:
        a, b = one.poses(12), other.poses(12)
        assert np.allclose(a.positions, b.positions, atol=1e-5)
        assert np.allclose(a.velocities, b.velocities, atol=1e-5)
        assert np.allclose(one.looks[1].vertices, other.looks[1].vertices, atol=1e-7)
        same = np.abs((a.orientations * b.orientations).sum(axis=1))
        assert np.allclose(same, 1.0, atol=1e-3)


def test_a_picture_shows_the_bodies_where_the_camera_projects_them(recorded) -> None:
    pytest.importorskip("mitsuba", reason="needs mitsuba")
    from warp_immersed.picture import Photographer

    with open_shot(recorded) as shot:
        photographer = Photographer(shot, 320, 180, 8)
        image = photographer.take((12,)).astype(float)
        empty = photographer.take(()).astype(float)
        camera, poses = camera_of(shot, 320 / 180), shot.poses(12)
        again = photographer.take((12,)).astype(float)
    assert np.array_equal(image, again)
    forward = (camera.target - camera.position) / np.linalg.norm(camera.target - camera.position)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    offset = poses.positions - camera.position
    scale = 160.0 / np.tan(np.radians(camera.field_of_view / 2.0)) / (offset @ forward)
    column = np.rint(159.5 + offset @ right * scale).astype(int)
    row = np.rint(89.5 - offset @ np.cross(right, forward) * scale).astype(int)
    inside = (column > 2) & (column < 317) & (row > 2) & (row < 177)
    assert inside.sum() > 20
    changed = np.abs(image - empty).max(axis=2) > 12.0
    hits = [changed[r - 1 : r + 2, c - 1 : c + 2].any() for r, c in zip(row[inside], column[inside], strict=True)]
    assert np.mean(hits) > 0.8, "all but coins seen edge-on"
    assert changed.mean() < 0.5, "and they are not everywhere"


def test_stills_sheets_and_movies(recorded, written, tmp_path) -> None:
    pytest.importorskip("mitsuba", reason="needs mitsuba")
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="needs imageio-ffmpeg")
    from typer.testing import CliRunner

    from warp_immersed.cli import app

    small = ["--size", "64x36", "--samples", "1", "--no-progress"]
    for source, name, *more in (
        (recorded, "still.png"),
        (written, "late.png", "--frame", "20", "--small"),
        (recorded, "sheet.png", "--sheet", "5"),
        (recorded, "shot.mp4", "--every", "6"),
    ):
        result = CliRunner().invoke(app, ["preview", str(source), "-o", str(tmp_path / name), *small, *more])
        assert result.exit_code == 0, result.output
    assert Image.open(tmp_path / "still.png").size == (64, 36)
    assert Image.open(tmp_path / "late.png").mode == "P"
    assert Image.open(tmp_path / "sheet.png").size == (3 * 68 - 4, 2 * 40 - 4)
    assert imageio_ffmpeg.count_frames_and_secs(str(tmp_path / "shot.mp4"))[0] == 4
    assert len(list(tmp_path.iterdir())) == 4


def test_the_view_of_a_scene_is_where_the_camera_stands(tmp_path) -> None:
    wi.simulate(wi.Scene.from_text(SCENE + VIEW, "coins"), device="cpu").save(tmp_path / "a.h5")
    with open_shot(tmp_path / "a.h5") as shot:
        camera = camera_of(shot, 1.5)
    assert np.array_equal(camera.position, [0.0, 3.0, 4.0])
    assert np.array_equal(camera.target, [0.0, 2.5, 0.0])


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["gone.h5"], "no such file"),
        (["scene.toml"], "must be .h5 or one of"),
        (["{}", "-o", "a.jpg"], "must be .png or .mp4"),
        (["{}", "-o", "a.mp4", "--size", "65x36"], "even numbers"),
        (["{}", "-o", "a.png", "--size", "big"], "must be like 960x540"),
        (["{}", "-o", "a.png", "--frame", "99"], "has 24"),
    ],
)
def test_bad_previews_are_refused(recorded, tmp_path, monkeypatch, arguments, said) -> None:
    from typer.testing import CliRunner

    from warp_immersed.cli import app

    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene.toml").write_text(SCENE)
    result = CliRunner().invoke(app, ["preview", *(word.format(recorded) for word in arguments)])
    assert isinstance(result.exception, InputError)
    assert said in str(result.exception)
