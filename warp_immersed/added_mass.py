"""The Kirchhoff (added-mass) tensor of a shape in a fluid."""

import numpy as np
from numpy.typing import NDArray

from warp_immersed.exact_tensors import ellipsoid_tensor, elliptic_sheet_tensor, shifted_tensor
from warp_immersed.fluid import Fluid
from warp_immersed.shape import Shape


def kirchhoff_tensor(shape: Shape, fluid: Fluid) -> NDArray[np.float64]:
    """Added-mass tensor (6, 6) of a body, without its own mass.

    Linear then angular, [[M, D], [D^T, J]] in [kg, kg m, kg m^2], about the centre of mass in the principal frame.
    Exact for ellipsoids and elliptic sheets. Other bodies are taken as the ellipsoid of equal volume and second
    moments (closed) or the flat ellipse of equal area and second moments (sheets).
    """
    a, b, c = shape.semi_axes
    if shape.is_sheet:
        centered = elliptic_sheet_tensor(a, b, fluid.density)
    else:
        centered = ellipsoid_tensor((a, b, c), fluid.density)
    return shifted_tensor(centered, shape.geometric_center)
