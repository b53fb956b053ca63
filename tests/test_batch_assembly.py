"""The stage that shows a batch: its drapes together, each to its end."""

import pytest
from batch_sweeps import SCENE, simulated, written
from pxr import Usd, UsdGeom

from warpcloth.batch.assembly import write_assembly

RATES = """
scene = "scene.toml"
design = "grid"
outputs = ["frames"]

[[parameter]]
path = "fps"
values = {rates}

[[parameter]]
path = "frames"
values = [6]
"""


@pytest.mark.parametrize("rates", [[12.0, 48.0], [48.0, 12.0]])
def test_drapes_of_different_rates_are_all_played_to_their_ends(tmp_path, rates):
    batch, _ = simulated(written(tmp_path, RATES.format(rates=rates), SCENE), tmp_path / "batch", worlds=1)
    stage = Usd.Stage.Open(str(write_assembly(batch)))
    codes = [
        UsdGeom.Mesh(prim).GetPointsAttr().GetTimeSamples() for prim in stage.Traverse() if prim.GetName() == "cloth"
    ]
    seconds = [(c[-1] - c[0]) / stage.GetTimeCodesPerSecond() for c in codes]
    assert seconds == [pytest.approx(6.0 / rate) for rate in rates]
    assert stage.GetEndTimeCode() == max(c[-1] for c in codes)
