"""USD in other forms than one file with one point instancer: the motion must be the same in all of them."""

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdShade

import warp_immersed as wi
from tests.test_recording import SCENE
from warp_immersed.export_options import MOST_XFORMS
from warp_immersed.usd_export import chosen_bodies, chosen_frames, usd_writer

CROWD = "/World/Crowd"
# on, just after, between and just before samples, around the seams of clips, before the first and after the last
TIMES = [0.0, 1.0, 1.25, 3.5, 7.0, 7.999, 8.0, 8.001, 12.75, 14.5, 15.0, 21.99, 22.0, 22.5, 23.999, 24.0, 30.0]
MOVING = ("positions", "orientations", "velocities", "angularVelocities", "extent")


@pytest.fixture(scope="module")
def recording() -> wi.Recording:
    return wi.simulate(wi.Scene.from_text(SCENE, "coins"), device="cpu")


@pytest.fixture(scope="module")
def single(recording, tmp_path_factory) -> Usd.Stage:
    path = tmp_path_factory.mktemp("single") / "coins.usdc"
    wi.export_usd(recording, path)
    return Usd.Stage.Open(str(path))


def exported(recording: wi.Recording, path: Path, *parts: Any, **options: Any) -> Usd.Stage:
    wi.export_usd(recording, path, wi.ExportOptions(**options), *parts)
    return Usd.Stage.Open(str(path))


def crowd_of(stage: Usd.Stage, path: str = CROWD) -> UsdGeom.PointInstancer:
    return UsdGeom.PointInstancer.Get(stage, path)


def plain(value: Any) -> Any:
    """A value of USD that compares, unresolved and unwrapped."""
    return np.array(value).tolist() if hasattr(value, "__len__") and not isinstance(value, str) else value


def all_attributes(stage: Usd.Stage, time: float) -> dict[str, Any]:
    return {str(a.GetPath()): plain(a.Get(time)) for prim in stage.TraverseAll() for a in prim.GetAttributes()}


def transforms(instancer: UsdGeom.PointInstancer, time: float) -> np.ndarray:
    """Where USD's own evaluation puts the instances (N, 4, 4), row vectors."""
    return np.array(instancer.ComputeInstanceTransformsAtTime(time, time)).reshape(-1, 4, 4)


# ---------------------------------------------------------------- clips


@pytest.mark.parametrize("chunk", [1, 7, 23, 24, 100])
def test_clips_are_the_single_file_at_and_between_samples(recording, single, tmp_path, chunk) -> None:
    stage = exported(recording, tmp_path / "coins.usdc", chunk_frames=chunk)
    assert len(list((tmp_path / "coins.usdc.parts").glob("clip_*"))) == -(-24 // chunk)
    assert not stage.GetCompositionErrors()
    for name in ("startTimeCode", "endTimeCode", "timeCodesPerSecond", "framesPerSecond", "metersPerUnit", "upAxis"):
        assert stage.GetMetadata(name) == single.GetMetadata(name)
    for time in TIMES:
        assert all_attributes(stage, time) == all_attributes(single, time), time
    one, other = crowd_of(stage), crowd_of(single)
    for name in MOVING:
        samples = one.GetPrim().GetAttribute(name).GetTimeSamples()
        assert samples == other.GetPrim().GetAttribute(name).GetTimeSamples() == list(range(1, 25))
        assert one.GetPrim().GetAttribute(name).HasAuthoredValue()
    for time in TIMES[1:-1]:
        assert np.array_equal(transforms(one, time), transforms(other, time)), time


def test_clips_say_their_rate_and_lie_beside_the_root(recording, tmp_path) -> None:
    stage = exported(recording, tmp_path / "coins.usdc", chunk_frames=10, fps=48.0)
    crowd_of(stage).GetPositionsAttr().Get(30.0)
    used = [layer for layer in stage.GetUsedLayers() if not layer.anonymous]
    assert len(used) > 1
    for layer in used:
        assert layer.timeCodesPerSecond == 48.0
        assert Path(layer.realPath).is_relative_to(tmp_path)
    assets = Usd.ClipsAPI(crowd_of(stage)).GetClipAssetPaths()
    assert [asset.path for asset in assets] == [f"./coins.usdc.parts/clip_{i:04d}.usdc" for i in range(3)]


# ---------------------------------------------------------------- shards


def attributes_by_id(instancers: list[UsdGeom.PointInstancer], time: float) -> dict[str, np.ndarray]:
    """What several instancers say of each body, in the order of ids; prototypes by name."""
    names = ("positions", "orientations", "velocities", "angularVelocities", "scales", "ids", "primvars:displayColor")
    found: dict[str, list[np.ndarray]] = {name: [] for name in (*names, "prototype")}
    for instancer in instancers:
        for name in names:
            found[name].append(np.array(instancer.GetPrim().GetAttribute(name).Get(time)))
        targets = np.array([target.name for target in instancer.GetPrototypesRel().GetForwardedTargets()])
        found["prototype"].append(targets[np.array(instancer.GetProtoIndicesAttr().Get())])
    arrays = {name: np.concatenate(values) for name, values in found.items()}
    order = np.argsort(arrays["ids"], kind="stable")
    return {name: values[order] for name, values in arrays.items()}


@pytest.mark.parametrize("shards", [1, 3, 50])
def test_shards_are_the_single_file_at_and_between_samples(recording, single, tmp_path, shards) -> None:
    stage = exported(recording, tmp_path / "coins.usdc", shards=shards)
    assert not stage.GetCompositionErrors()
    instancers = [UsdGeom.PointInstancer(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.PointInstancer)]
    assert len(instancers) == shards
    for instancer in instancers:
        for name in MOVING:
            assert instancer.GetPrim().GetAttribute(name).GetTimeSamples() == list(range(1, 25))
    for time in TIMES[1:-1]:
        one, other = attributes_by_id(instancers, time), attributes_by_id([crowd_of(single)], time)
        for name, values in one.items():
            assert np.array_equal(values, other[name]), (name, time)
        low, high = np.array(crowd_of(single).GetExtentAttr().Get(time))
        parts = np.array([instancer.GetExtentAttr().Get(time) for instancer in instancers])
        if time == round(time):  # between samples the smallest of interpolated bounds is not the interpolated smallest
            assert np.allclose(parts[:, 0].min(axis=0), low, atol=1e-5)
            assert np.allclose(parts[:, 1].max(axis=0), high, atol=1e-5)
        placed = np.concatenate([transforms(instancer, time) for instancer in instancers])
        order = np.argsort(np.concatenate([instancer.GetIdsAttr().Get() for instancer in instancers]))
        assert np.array_equal(placed[order], transforms(crowd_of(single), time))
    for mesh in (UsdGeom.Mesh(prim) for prim in stage.TraverseAll() if prim.IsA(UsdGeom.Mesh)):
        assert UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()[0]
        like = UsdGeom.Mesh.Get(single, f"{CROWD}/Prototypes/{mesh.GetPrim().GetName()}")
        assert mesh.GetPointsAttr().Get() == like.GetPointsAttr().Get()


def test_a_shard_opens_by_itself(recording, tmp_path) -> None:
    exported(recording, tmp_path / "coins.usdc", shards=2, up_axis="z", units="cm")
    for name in ("Crowd_000.usdc", "Crowd_001.usdc"):
        stage = Usd.Stage.Open(str(tmp_path / "coins.usdc.parts" / name))
        assert stage.GetDefaultPrim().IsA(UsdGeom.PointInstancer)
        assert UsdGeom.GetStageUpAxis(stage) == "Z"
        assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1.0, 24.0)


# ---------------------------------------------------------------- axes, units, rates


@pytest.mark.parametrize("form", [{}, {"chunk_frames": 7}, {"shards": 2}, {"instancing": "xforms"}], ids=str)
@pytest.mark.parametrize(("up_axis", "units"), [("z", "m"), ("y", "cm"), ("z", "cm")])
def test_axes_and_units_change_the_numbers_not_the_places(recording, single, tmp_path, up_axis, units, form) -> None:
    """Every corner of every body, brought back to metres and y up, is where the plain file has it."""
    stage = exported(recording, tmp_path / "coins.usdc", up_axis=up_axis, units=units, **form)
    assert UsdGeom.GetStageUpAxis(stage) == up_axis.upper()
    assert UsdGeom.GetStageMetersPerUnit(stage) == {"m": 1.0, "cm": 0.01}[units]
    back = np.eye(3) if up_axis == "y" else np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    back *= UsdGeom.GetStageMetersPerUnit(stage)
    for time in (1.0, 12.0, 24.0):
        there = corners(stage, time) @ back
        here = corners(single, time)
        assert np.abs(there - here).max() < 2e-4, "the rounding of half-precision quaternions"
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.PointInstancer):
            crowd = UsdGeom.PointInstancer(prim)
            ids = np.array(crowd.GetIdsAttr().Get())
            velocities = np.array(crowd.GetVelocitiesAttr().Get(12)) @ back
            assert np.allclose(velocities, np.array(crowd_of(single).GetVelocitiesAttr().Get(12))[ids], rtol=1e-5, atol=1e-6)
            spins = np.array(crowd.GetAngularVelocitiesAttr().Get(12)) @ (back / UsdGeom.GetStageMetersPerUnit(stage))
            assert np.allclose(spins, np.array(crowd_of(single).GetAngularVelocitiesAttr().Get(12))[ids], rtol=1e-5, atol=1e-3)
            low, high = np.array(crowd.GetExtentAttr().Get(12))
            placed = np.array(crowd.GetPositionsAttr().Get(12))
            assert (placed > low).all()
            assert (placed < high).all()


def corners(stage: Usd.Stage, time: float) -> np.ndarray:
    """Vertices of the meshes of all bodies (all of them, 3) in the stage's units, bodies in order."""
    points: dict[int, np.ndarray] = {}
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.PointInstancer):
            instancer = UsdGeom.PointInstancer(prim)
            meshes = [UsdGeom.Mesh.Get(stage, p) for p in instancer.GetPrototypesRel().GetForwardedTargets()]
            vertices = [np.array(mesh.GetPointsAttr().Get(), dtype=float) for mesh in meshes]
            placed = transforms(instancer, time)
            for body, matrix, index in zip(
                instancer.GetIdsAttr().Get(), placed, instancer.GetProtoIndicesAttr().Get(), strict=True
            ):
                points[body] = vertices[index] @ matrix[:3, :3] + matrix[3, :3]
        elif prim.IsInstance():
            matrix = np.array(UsdGeom.Xformable(prim).ComputeLocalToWorldTransform(time))
            mesh = UsdGeom.Mesh(prim.GetPrototype().GetChild("Mesh"))
            vertices = np.array(mesh.GetPointsAttr().Get(), dtype=float)
            points[int(prim.GetName().rsplit("_", 1)[1])] = vertices @ matrix[:3, :3] + matrix[3, :3]
    return np.concatenate([points[body] for body in sorted(points)])


@pytest.mark.parametrize("form", [{}, {"chunk_frames": 5}, {"shards": 2}, {"instancing": "xforms"}], ids=str)
def test_another_rate_keeps_the_speed(recording, single, tmp_path, form) -> None:
    stage = exported(recording, tmp_path / "coins.usdc", fps=30.0, start_frame=1001, **form)
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == 30.0
    expected = 1001.0 + np.arange(24) * 30.0 / 24.0
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (expected[0], expected[-1])
    name = "xformOp:translate" if "instancing" in form else "positions"
    moving = [prim.GetAttribute(name) for prim in stage.Traverse() if prim.HasAttribute(name)]
    assert moving
    for attribute in moving:
        assert np.allclose(attribute.GetTimeSamples(), expected, rtol=0, atol=1e-9)
    for frame in (0, 11, 23):
        assert np.abs(corners(stage, expected[frame]) - corners(single, 1.0 + frame)).max() < 1e-4
    if "instancing" not in form:  # between samples USD goes by the velocities, which count seconds
        assert np.abs(corners(stage, expected[7] + 0.5 * 1.25) - corners(single, 8.5)).max() < 1e-4


@pytest.mark.parametrize("form", [{}, {"chunk_frames": 5}, {"shards": 2}], ids=str)
def test_velocities_can_be_left_out(recording, single, tmp_path, form) -> None:
    stage = exported(recording, tmp_path / "coins.usdc", motion_blur=False, **form)
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.PointInstancer):
            assert not prim.GetAttribute("velocities").HasAuthoredValue()
            assert not prim.GetAttribute("angularVelocities").HasAuthoredValue()
    assert np.abs(corners(stage, 12.0) - corners(single, 12.0)).max() == 0.0
    halfway = (corners(single, 12.0) + corners(single, 13.0)) / 2.0
    assert np.abs(corners(stage, 12.5) - halfway).max() < 0.02, "USD interpolates between the samples instead"


# ---------------------------------------------------------------- transforms


def test_transforms_place_the_bodies_where_the_instancer_does(recording, single, tmp_path) -> None:
    stage = exported(recording, tmp_path / "coins.usdc", instancing="xforms")
    assert not stage.GetCompositionErrors()
    bodies = [prim for prim in stage.Traverse() if prim.IsInstance()]
    assert [prim.GetName() for prim in bodies] == [f"coin_{i}" for i in range(30)] + [f"leaf_{i}" for i in range(30, 50)]
    drawn = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Gprim)]
    assert not drawn, "prototypes are not drawn themselves"
    assert len(stage.GetPrototypes()) == 1 + 4, "a coin, and a leaf in four tints"
    for prototype in stage.GetPrototypes():
        mesh = prototype.GetChild("Mesh")
        assert UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()[0].ComputeSurfaceSource()[0]
    for time in (1.0, 9.0, 24.0):
        assert np.abs(corners(stage, time) - corners(single, time)).max() < 1e-4


def test_transforms_are_for_small_crowds(recording, tmp_path) -> None:
    crowd = tuple(wi.recording.Prototype(**{**vars(p), "count": MOST_XFORMS}) for p in recording.prototypes)
    with pytest.raises(
        wi.InputError, match=rf"instancing: xforms are for at most {MOST_XFORMS} bodies, here are {2 * MOST_XFORMS}"
    ):
        usd_writer(tmp_path / "x.usdc", crowd, 24.0, {}, wi.ExportOptions(instancing="xforms"))
    assert not list(tmp_path.iterdir())


# ---------------------------------------------------------------- packages


@pytest.mark.parametrize("instancing", ["points", "xforms"])
def test_a_package_obeys_its_specification(recording, single, tmp_path, instancing) -> None:
    """Uncompressed, unencrypted, every file aligned to 64 bytes, the stage first."""
    stage = exported(recording, tmp_path / "coins.usdz", instancing=instancing)
    with zipfile.ZipFile(tmp_path / "coins.usdz") as package, (tmp_path / "coins.usdz").open("rb") as raw:
        assert [info.filename for info in package.infolist()] == ["coins.usdc"]
        for info in package.infolist():
            assert info.compress_type == zipfile.ZIP_STORED
            assert not info.flag_bits & 1
            raw.seek(info.header_offset + 26)
            name, extra = np.frombuffer(raw.read(4), "<u2")
            assert (info.header_offset + 30 + int(name) + int(extra)) % 64 == 0
        assert package.testzip() is None
    assert np.abs(corners(stage, 12.0) - corners(single, 12.0)).max() < 1e-4
    assert [p.name for p in tmp_path.iterdir()] == ["coins.usdz"]


def test_a_package_is_one_file_of_bounded_size(recording, tmp_path) -> None:
    for options in ({"chunk_frames": 5}, {"shards": 2}):
        with pytest.raises(wi.InputError, match=r"a \.usdz is one file"):
            wi.export_usd(recording, tmp_path / "coins.usdz", wi.ExportOptions(**options))
    with pytest.raises(wi.InputError, match=r"holds at most 4\.3 GB; use \.usdc"):
        wi.ExportOptions().check_output(Path("x.usdz"), 1000, 100_000)


# ---------------------------------------------------------------- parts of a run


def test_a_part_keeps_its_time_codes_and_ids(recording, single, tmp_path) -> None:
    bodies = chosen_bodies("leaf, 3:5", recording.prototypes)
    stage = exported(recording, tmp_path / "part.usdc", chosen_frames("10:15", 24), bodies)
    part, whole = crowd_of(stage), crowd_of(single)
    assert part.GetPositionsAttr().GetTimeSamples() == [11.0, 12.0, 13.0, 14.0, 15.0]
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (11.0, 15.0)
    assert list(part.GetIdsAttr().Get()) == [3, 4, *range(30, 50)]
    one, other = attributes_by_id([part], 13.0), attributes_by_id([whole], 13.0)
    for name, values in one.items():
        assert np.array_equal(values, other[name][bodies]), name


def test_prototypes_without_bodies_are_left_out(recording, tmp_path) -> None:
    stage = exported(recording, tmp_path / "part.usdc", None, chosen_bodies("leaf", recording.prototypes))
    assert [target.name for target in crowd_of(stage).GetPrototypesRel().GetTargets()] == [f"leaf_{i}" for i in range(4)]
    assert set(crowd_of(stage).GetProtoIndicesAttr().Get()) == {0, 1, 2, 3}


def test_a_recording_on_disk_is_exported_as_one_in_memory(recording, tmp_path) -> None:
    recording.save(tmp_path / "coins.h5", compress=True)
    with wi.open_recording(tmp_path / "coins.h5") as opened:
        wi.export_usd(opened, tmp_path / "a.usdc")
    wi.export_usd(recording, tmp_path / "b.usdc")
    assert (tmp_path / "a.usdc").read_bytes() == (tmp_path / "b.usdc").read_bytes()


def test_choices_are_read_as_written(recording) -> None:
    assert chosen_frames("2:5", 24) == range(2, 5)
    assert chosen_frames(":5", 24) == range(5)
    assert chosen_frames("20:", 24) == range(20, 24)
    assert chosen_frames("-4:", 24) == range(20, 24)
    assert chosen_bodies("coin", recording.prototypes).tolist() == list(range(30))
    assert chosen_bodies("48:,:2", recording.prototypes).tolist() == [0, 1, 48, 49]
    for text in ("5", "a:b", "5:2", "100:", ""):
        with pytest.raises(wi.InputError, match="frames: found"):
            chosen_frames(text, 24)
    for text in ("cion", "0:51", "7:3", "x:y", ""):
        with pytest.raises(wi.InputError, match="bodies: found"):
            chosen_bodies(text, recording.prototypes)


# ---------------------------------------------------------------- files


FORMS = [{"chunk_frames": 7}, {"shards": 3}, {"instancing": "xforms"}]


@pytest.mark.parametrize("form", FORMS, ids=str)
def test_equal_runs_give_equal_files(recording, tmp_path, form) -> None:
    contents = []
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        exported(recording, tmp_path / name / "coins.usdc", **form)
        files = sorted(path for path in (tmp_path / name).rglob("*") if path.is_file())
        contents.append([(path.relative_to(tmp_path / name), path.read_bytes()) for path in files])
    assert contents[0] == contents[1]


@pytest.mark.parametrize("form", FORMS, ids=str)
def test_abort_leaves_nothing_and_what_was_there_stays(recording, tmp_path, form) -> None:
    target = tmp_path / "coins.usdc"
    target.write_text("precious")
    writer = usd_writer(target, recording.prototypes, 24.0, {}, wi.ExportOptions(**form))
    for index in range(20):
        writer.write(recording.frame(index))
    assert target.read_text() == "precious"
    writer.abort()
    assert [p.name for p in tmp_path.iterdir()] == ["coins.usdc"]
    assert target.read_text() == "precious"


def test_parts_follow_their_file(recording, tmp_path) -> None:
    target, parts = tmp_path / "coins.usdc", tmp_path / "coins.usdc.parts"
    exported(recording, target, shards=5)
    assert len(list(parts.iterdir())) == 5
    exported(recording, target, chunk_frames=12)
    assert sorted(p.name for p in parts.iterdir()) == ["clip_0000.usdc", "clip_0001.usdc", "manifest.usdc"]
    exported(recording, target)
    assert [p.name for p in tmp_path.iterdir()] == ["coins.usdc"]
    parts.mkdir()
    (parts / "holiday.jpg").write_text("")
    with pytest.raises(wi.InputError, match=r"its parts go to 'coins\.usdc\.parts', where something else is"):
        exported(recording, target, shards=5)
    exported(recording, target)
    assert (parts / "holiday.jpg").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"up_axis": "x"}, "up axis: found 'x', must be y or z"),
        ({"units": "inch"}, "units: found 'inch', must be m or cm"),
        ({"instancing": "none"}, "instancing: found 'none'"),
        ({"fps": 0.0}, "fps: found 0.0"),
        ({"chunk_frames": 0}, "chunk frames: found 0, must be at least 1"),
        ({"shards": -1}, "shards: found -1, must be at least 1"),
        ({"shards": 2, "chunk_frames": 5}, "chunk frames and shards: exclude each other"),
        ({"shards": 2, "instancing": "xforms"}, "shards and instancing xforms: exclude each other"),
    ],
)
def test_impossible_options_are_refused(options, message) -> None:
    with pytest.raises(wi.InputError, match=message):
        wi.ExportOptions(**options)


def test_more_shards_than_bodies_are_refused(recording, tmp_path) -> None:
    with pytest.raises(wi.InputError, match="shards: found 51, must be at most the 50 bodies there are"):
        wi.export_usd(recording, tmp_path / "x.usdc", wi.ExportOptions(shards=51))
    assert not list(tmp_path.iterdir())


def test_no_layer_refers_to_an_absolute_path(recording, tmp_path) -> None:
    for form in FORMS[:2]:
        exported(recording, tmp_path / "coins.usda", **form)
        for path in tmp_path.rglob("*.usda"):
            text = path.read_text()
            assert str(tmp_path) not in text
            assert Sdf.Layer.FindOrOpen(str(path))
