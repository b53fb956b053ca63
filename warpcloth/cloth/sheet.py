"""Elastic tensors of sheets made of central forces."""

import numpy as np


def sheet_tensor(stretch: tuple[float, float], shear: float) -> tuple[float, float]:
    """Components C_xx, C_yy [N/m] of a sheet with Young's moduli ``stretch`` [N/m], C_xxyy = C_xyxy = ``shear``.

    Central forces have C_xxyy = C_xyxy (Cauchy's relation), so Y_x = C_xx − G²/C_yy and Y_y = C_yy − G²/C_xx.
    """
    share = 0.5 + 0.5 * np.sqrt(1.0 + 4.0 * shear * shear / (stretch[0] * stretch[1]))
    return stretch[0] * share, stretch[1] * share
