"""USD with a transform a body, for tools without point instancers. Slow and large: small crowds only."""

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from warp_immersed.ensemble import Frame
from warp_immersed.looks import look_indices, looks
from warp_immersed.usd import CROWD, CrowdWriter, create_mesh, rows_of
from warp_immersed.usd_samples import FRAMES_PER_SAVE, save_layer, stage_orientations, stage_vectors


class XformWriter(CrowdWriter):
    """One file in which each body is an instance of its prototype with a transform of its own.

    There are no velocities: renderers blur by the transforms between samples.

    Args, Raises: as `CrowdWriter`, and InputError for more bodies than export_options.MOST_XFORMS.
    """

    def _begin(self, stage: Usd.Stage) -> None:
        UsdGeom.Xform.Define(stage, CROWD)
        # a class is not drawn itself, and holds its material, which an instance could not reach outside
        folder = stage.CreateClassPrim(CROWD.AppendChild("Prototypes")).GetPath()
        wardrobe, worn = looks(self.prototypes), look_indices(self.prototypes)[self.ids]
        for index in np.unique(worn):
            prototype = wardrobe[index]
            root = UsdGeom.Xform.Define(stage, folder.AppendChild(prototype.name)).GetPath()
            create_mesh(stage, root.AppendChild("Mesh"), root.AppendChild("Look"), prototype, self.options.units_per_meter)
        self._bodies = []
        with Sdf.ChangeBlock():
            kinds = [prototype.name for prototype in self.prototypes for _ in range(prototype.count)]
            for body, index in zip(self.ids.tolist(), worn.tolist(), strict=True):
                path, look = CROWD.AppendChild(f"{kinds[body]}_{body}"), folder.AppendChild(wardrobe[index].name)
                self._bodies.append(create_body(self.root, path, look))

    def _write(self, frame: Frame) -> None:
        time_code, layer, rows = self.options.time_code(frame.index, self.fps), self.root, rows_of(self.ids)
        positions = stage_vectors(frame.positions[rows], self.options, self.options.units_per_meter).tolist()
        orientations = stage_orientations(frame.orientations[rows], self.options).tolist()
        for (translate, orient), position, (x, y, z, w) in zip(self._bodies, positions, orientations, strict=True):
            layer.SetTimeSample(translate, time_code, Gf.Vec3d(position))
            layer.SetTimeSample(orient, time_code, Gf.Quatf(w, x, y, z))
        if (frame.index + 1) % FRAMES_PER_SAVE == 0:
            save_layer(layer, self.path)

    def _end(self, first: int, last: int) -> None:
        self._bodies.clear()


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
