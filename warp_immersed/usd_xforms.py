"""USD with a transform a body, for tools without point instancers. Slow and large: small crowds only."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from warp_immersed.ensemble import Frame
from warp_immersed.export_options import ExportOptions
from warp_immersed.output_files import discard, partial_path, publish
from warp_immersed.recording import Prototype
from warp_immersed.usd import (
    CROWD,
    Ids,
    all_ids,
    create_mesh,
    define_world,
    describe_stage,
    new_layer,
    package,
    rows_of,
    set_time_range,
)
from warp_immersed.usd_samples import FRAMES_PER_SAVE, save_layer, stage_orientations, stage_vectors


class XformWriter:
    """Writes frames to a USD file in which each body is an instance of its prototype with a transform of its own.

    There are no velocities: renderers blur by the transforms between samples.

    Args, Raises: as `warp_immersed.usd.UsdWriter`, and InputError for more bodies than export_options.MOST_XFORMS.
    """

    def __init__(
        self,
        path: Path,
        prototypes: tuple[Prototype, ...],
        fps: float,
        manifest: Mapping[str, Any],
        options: ExportOptions,
        ids: Ids | None = None,
    ):
        self.path = path
        self._options, self._fps = options, fps
        self._range: list[int] = []
        ids = all_ids(prototypes) if ids is None else ids
        options.check_output(path, 0, len(ids))
        self._rows = rows_of(ids)
        self._partial = partial_path(path)
        if path.suffix == ".usdz":
            self._partial = self._partial.with_suffix(".usdc")
        self._layer = new_layer(self._partial)
        stage = Usd.Stage.Open(self._layer)
        describe_stage(stage, fps, manifest, options)
        define_world(stage)
        UsdGeom.Xform.Define(stage, CROWD)
        # a class is not drawn itself, and holds its material, which an instance could not reach outside
        folder = stage.CreateClassPrim(CROWD.AppendChild("Prototypes")).GetPath()
        kinds = np.repeat(np.arange(len(prototypes)), [prototype.count for prototype in prototypes])[ids]
        for index in np.unique(kinds):
            prototype = prototypes[index]
            root = UsdGeom.Xform.Define(stage, folder.AppendChild(prototype.name)).GetPath()
            create_mesh(stage, root.AppendChild("Mesh"), root.AppendChild("Look"), prototype, options.units_per_meter)
        del stage
        self._bodies = []
        with Sdf.ChangeBlock():
            for body, index in zip(ids.tolist(), kinds.tolist(), strict=True):
                name = prototypes[index].name
                self._bodies.append(create_body(self._layer, CROWD.AppendChild(f"{name}_{body}"), folder.AppendChild(name)))

    def write(self, frame: Frame) -> None:
        """Append a frame.

        Raises:
            InputError: the disk is full or gone.
        """
        self._range = [*self._range[:1], frame.index]
        time_code, layer = self._options.time_code(frame.index, self._fps), self._layer
        positions = stage_vectors(frame.positions[self._rows], self._options, self._options.units_per_meter)
        orientations = stage_orientations(frame.orientations[self._rows], self._options)
        for (translate, orient), position, (x, y, z, w) in zip(
            self._bodies, positions.tolist(), orientations.tolist(), strict=True
        ):
            layer.SetTimeSample(translate, time_code, Gf.Vec3d(position))
            layer.SetTimeSample(orient, time_code, Gf.Quatf(w, x, y, z))
        if (frame.index + 1) % FRAMES_PER_SAVE == 0:
            save_layer(layer, self.path)

    def finish(self) -> None:
        """Set the time range, save, and give the file its name.

        Raises:
            InputError: the disk is full or gone.
        """
        set_time_range(self._layer, self._range, self._options, self._fps)
        save_layer(self._layer, self.path)
        del self._layer
        if self.path.suffix == ".usdz":
            package(self._partial, self.path)
            self._partial.unlink()
        publish(self.path)

    def abort(self) -> None:
        """Leave nothing behind."""
        vars(self).pop("_layer", None)
        self._partial.unlink(missing_ok=True)
        discard(self.path)


def create_body(layer: Sdf.Layer, path: Sdf.Path, prototype: Sdf.Path) -> tuple[Sdf.Path, Sdf.Path]:
    """An instance of a prototype; the paths of its translation and orientation."""
    prim = Sdf.CreatePrimInLayer(layer, path)
    prim.specifier, prim.typeName, prim.instanceable = Sdf.SpecifierDef, "Xform", True
    prim.referenceList.Prepend(Sdf.Reference("", prototype))
    translate = Sdf.AttributeSpec(prim, "xformOp:translate", Sdf.ValueTypeNames.Double3)
    orient = Sdf.AttributeSpec(prim, "xformOp:orient", Sdf.ValueTypeNames.Quatf)
    order = Sdf.AttributeSpec(prim, "xformOpOrder", Sdf.ValueTypeNames.TokenArray, Sdf.VariabilityUniform)
    order.default = Vt.TokenArray(["xformOp:translate", "xformOp:orient"])
    return translate.path, orient.path
