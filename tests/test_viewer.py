"""The viewer, as someone with a browser meets it."""

import shutil

import numpy as np
import pytest

import warp_immersed as wi
from tests.test_recording import SCENE
from warp_immersed.motion import motion_word
from warp_immersed.shot import open_shot


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    path = tmp_path_factory.mktemp("view") / "coins.h5"
    wi.simulate(wi.Scene.from_text(SCENE, "coins"), device="cpu").save(path)
    return path


@pytest.fixture(scope="module")
def browser():
    sync_api = pytest.importorskip("playwright.sync_api", reason="needs playwright")
    options = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
    with sync_api.sync_playwright() as playwright:
        try:
            found = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=options)
        except sync_api.Error as error:
            pytest.skip(f"no browser: {str(error).splitlines()[0]}")
        yield found
        found.close()


def test_the_browser_shows_moving_bodies_and_what_one_does(recorded, browser) -> None:
    pytest.importorskip("viser", reason="needs viser")
    from warp_immersed.viewer import Viewer

    with open_shot(recorded) as shot:
        viewer = Viewer(shot, "127.0.0.1", 8123)
        errors, pictures = [], []
        try:
            page = browser.new_page(viewport={"width": 480, "height": 320})
            page.on("pageerror", lambda error: errors.append(str(error)))
            page.goto(f"http://127.0.0.1:{viewer.port}")
            page.get_by_text("follow it").first.wait_for(timeout=60_000)
            for frame in (0, 12):
                viewer.show(frame)
                page.get_by_text(f"time {frame / 24.0:.2f} s").first.wait_for(timeout=60_000)
                pictures.append(viewer.snapshot(120, 80).astype(float))
        finally:
            viewer.close()
    assert not errors
    assert pictures[0].std() > 1.0, "there is something to see"
    assert np.abs(pictures[1] - pictures[0]).max() > 40.0, "and it moves"


def test_motion_is_put_into_a_word() -> None:
    frames = np.arange(24) / 24.0
    still, level = np.zeros((24, 3)), np.tile([1.0, -0.5, 0.0], (24, 1))
    tumble, turn = np.tile([0.0, 0.0, 12.0], (24, 1)), np.tile([0.5, 30.0, 0.0], (24, 1))
    rock = np.outer(np.sin(2.0 * np.pi * 4.0 * frames), [0.0, 0.0, 8.0])
    assert motion_word(still, still, 1.0) == "at rest"
    assert motion_word(level, tumble, 1.0) == "tumbling"
    assert motion_word(level, turn, 1.0) == "autorotating"
    assert motion_word(level, rock, 1.0) == "fluttering"
    assert motion_word(level, still, 1.0) == "gliding"
    assert motion_word(level[:, [1, 0, 2]] * [1, -1, 1], still, 1.0) == "falling steadily"


def test_following_keeps_the_description_true(recorded) -> None:
    pytest.importorskip("viser", reason="needs viser")
    from warp_immersed.viewer import Viewer

    with open_shot(recorded) as shot:
        viewer = Viewer(shot, "127.0.0.1", 8124)
        try:
            viewer.show(10)
            words = viewer.describe(31, 10)
        finally:
            viewer.close()
        poses = shot.poses(10)
    assert words.startswith("**leaf_")
    assert f"speed {np.linalg.norm(poses.velocities[31]):.2f} m/s" in words
