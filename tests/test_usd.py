"""USD output: the encoding that DCC tools read, checked by reading it back."""

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdShade, Vt
from scipy.spatial.transform import Rotation

import warp_immersed as wi
from tests.test_recording import SCENE
from warp_immersed.usd import UsdWriter, vt_array

CROWD = "/World/Crowd"


@pytest.fixture(scope="module")
def recording() -> wi.Recording:
    return wi.simulate(wi.Scene.from_text(SCENE, "coins"), device="cpu")


@pytest.fixture(scope="module")
def path(recording, tmp_path_factory):
    path = tmp_path_factory.mktemp("usd") / "coins.usdc"
    wi.export_usd(recording, path)
    return path


@pytest.fixture(scope="module")
def stage(path) -> Usd.Stage:
    return Usd.Stage.Open(str(path))


def test_stage_says_its_units_axes_and_rates(stage, recording) -> None:
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    assert stage.HasAuthoredMetadata("metersPerUnit")
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert stage.GetTimeCodesPerSecond() == stage.GetFramesPerSecond() == 24.0
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (1.0, 24.0)
    assert stage.GetDefaultPrim().GetPath() == "/World"
    data = stage.GetRootLayer().customLayerData["warp_immersed"]
    for key in ("version", "scene_digest", "seed", "device", "fidelity"):
        assert data[key] == recording.manifest[key]


def test_every_sample_is_what_was_recorded(stage, recording) -> None:
    crowd = UsdGeom.PointInstancer.Get(stage, CROWD)
    assert crowd.GetPositionsAttr().GetTimeSamples() == list(range(1, 25))
    for frame in range(24):
        code = frame + 1
        assert np.array_equal(crowd.GetPositionsAttr().Get(code), recording.positions[frame])
        assert np.array_equal(crowd.GetVelocitiesAttr().Get(code), recording.velocities[frame])
        degrees = np.degrees(recording.angular_velocities[frame])
        assert np.allclose(crowd.GetAngularVelocitiesAttr().Get(code), degrees, rtol=1e-6)
        half = crowd.GetOrientationsAttr().Get(code)
        assert isinstance(half, Vt.QuathArray)
        stored = np.array([[*q.GetImaginary(), q.GetReal()] for q in half])
        assert np.abs(stored - recording.orientations[frame]).max() < 5e-4
    assert not crowd.GetOrientationsfAttr().HasAuthoredValue()
    assert np.array_equal(crowd.GetIdsAttr().Get(), np.arange(50))
    looks = np.asarray(crowd.GetProtoIndicesAttr().Get())
    assert (looks[:30] == 0).all()
    assert set(looks[30:]) == {1, 2, 3, 4}, "every tint is worn"


def test_usd_places_the_bodies_where_they_are(stage, recording) -> None:
    """USD's own evaluation of an instance's transform, against the recording."""
    crowd = UsdGeom.PointInstancer.Get(stage, CROWD)
    transforms = crowd.ComputeInstanceTransformsAtTime(12, 12)
    for body in (0, 17, 49):
        expected = Rotation.from_quat(recording.orientations[11, body]).apply([0.01, 0.02, 0.03]) + recording.positions[11, body]
        assert np.allclose(Gf.Matrix4d(transforms[body]).Transform(Gf.Vec3d(0.01, 0.02, 0.03)), expected, atol=5e-5)


def test_extents_contain_every_body(stage, recording) -> None:
    crowd = UsdGeom.PointInstancer.Get(stage, CROWD)
    for code in (1, 12, 24):
        low, high = np.array(crowd.GetExtentAttr().Get(code))
        first = 0
        for prototype in recording.prototypes:
            for body in range(first, first + prototype.count):
                turned = Rotation.from_quat(recording.orientations[code - 1, body]).apply(prototype.vertices)
                points = turned + recording.positions[code - 1, body]
                assert (points >= low).all()
                assert (points <= high).all()
            first += prototype.count


def test_prototypes_are_meshes_with_materials(stage, recording) -> None:
    targets = UsdGeom.PointInstancer.Get(stage, CROWD).GetPrototypesRel().GetTargets()
    assert [t.name for t in targets] == ["coin", "leaf_0", "leaf_1", "leaf_2", "leaf_3"]
    looks = [(prototype, color) for prototype in recording.prototypes for color in prototype.colors]
    for target, (prototype, color) in zip(targets, looks, strict=True):
        prim = stage.GetPrimAtPath(target)
        mesh = UsdGeom.Mesh(prim)
        assert prim.GetTypeName() == "Mesh", "an Xform around it would become an empty on every instance in Blender"
        assert np.array_equal(mesh.GetPointsAttr().Get(), prototype.vertices)
        assert mesh.GetDoubleSidedAttr().Get() == prototype.is_sheet
        assert mesh.GetSubdivisionSchemeAttr().Get() == "none"
        assert UsdGeom.PrimvarsAPI(prim).HasPrimvar("st")
        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        surface = material.ComputeSurfaceSource()[0]
        assert surface.GetIdAttr().Get() == "UsdPreviewSurface"
        assert np.allclose(surface.GetInput("diffuseColor").Get(), color)


def test_equal_runs_give_equal_files(recording, path, tmp_path) -> None:
    other = wi.simulate(wi.Scene.from_text(SCENE, "coins"), device="cpu", threads=2)
    wi.export_usd(other, tmp_path / "coins.usdc")
    assert (tmp_path / "coins.usdc").read_bytes() == path.read_bytes()


def test_ascii_files_hold_the_same(recording, stage, tmp_path) -> None:
    wi.export_usd(recording, tmp_path / "coins.usda")
    ascii_stage = Usd.Stage.Open(str(tmp_path / "coins.usda"))
    crowd = UsdGeom.PointInstancer.Get(ascii_stage, CROWD)
    assert np.array_equal(crowd.GetPositionsAttr().Get(5), recording.positions[4])


@pytest.mark.parametrize(
    ("array_type", "values"),
    [
        (Vt.Vec3fArray, np.arange(30, dtype=np.float32).reshape(10, 3)),
        (Vt.QuathArray, np.arange(40, dtype=np.float16).reshape(10, 4)),
        (Vt.IntArray, np.arange(10, dtype=np.int32)),
        (Vt.Int64Array, np.arange(10, dtype=np.int64)),
        (Vt.Vec2fArray, np.arange(20, dtype=np.float32).reshape(10, 2)[::-1]),
    ],
)
def test_block_copy_equals_usds_own_conversion(array_type, values) -> None:
    assert vt_array(array_type, values) == array_type.FromNumpy(np.ascontiguousarray(values))


def test_abort_leaves_nothing(recording, tmp_path) -> None:
    writer = UsdWriter(tmp_path / "x.usdc", recording.prototypes, 24.0, {})
    for index in range(24):
        writer.write(recording.frame(index))
    writer.abort()
    assert not list(tmp_path.iterdir())


def test_an_existing_file_stays_until_the_new_one_is_whole(recording, tmp_path) -> None:
    target = tmp_path / "x.usdc"
    target.write_text("precious")
    writer = UsdWriter(target, recording.prototypes, 24.0, {})
    writer.write(recording.frame(0))
    assert target.read_text() == "precious"
    writer.finish()
    assert Usd.Stage.Open(str(target))


def test_other_endings_are_refused(recording, tmp_path) -> None:
    with pytest.raises(wi.InputError, match=r"found ending '\.abc'"):
        wi.export_usd(recording, tmp_path / "x.abc")
