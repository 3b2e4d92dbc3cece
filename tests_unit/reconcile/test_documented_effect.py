"""The effect in docs/write_an_effect.md works as it stands there."""

import re
from pathlib import Path

import numpy as np
import pyarrow as pa

from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.effect import Effect
from arl_fixtures.reconcile.reconcile import diagnose
from arl_fixtures.reconcile.table import columns_of

DOCUMENT = Path(__file__).parents[2] / "docs" / "write_an_effect.md"


def documented() -> Effect:
    code = re.search(r"```python\n(.*?)```", DOCUMENT.read_text(encoding="utf-8"), re.DOTALL)
    assert code is not None
    scope: dict[str, object] = {}
    exec(code.group(1), scope)
    made = scope["MirrorDroop"]
    assert isinstance(made, type)
    assert len([line for line in code.group(1).splitlines() if line.strip()]) <= 36
    return made()


def test_the_documented_effect_is_found_beside_the_whole_library():
    rng = np.random.default_rng(1)
    step, pixel = (a.ravel() for a in np.meshgrid(np.arange(30), np.arange(40), indexing="ij"))
    current = rng.uniform(0.2, 2.0, 30)[step]
    simulated = 500.0 + 40.0 * pixel
    noise = 0.01 * simulated
    measured = simulated * (1.0 - 0.03 * current**2) + noise * rng.normal(size=len(step)) / np.sqrt(10.0)
    table = pa.table({
        "step": step, "pixel_u": pixel, "drive_a": current, "n_frames": np.full(len(step), 10),
        "intensity_counts": measured, "sim_intensity_counts": simulated, "sim_intensity_counts_std": noise,
        "sim_intensity_counts_repeat_std": 0.001 * simulated,
    })  # fmt: skip
    effects = [*library().values(), documented()]
    diagnosis, _, _ = diagnose(columns_of(table), effects=effects)
    assert [f.effect for f in diagnosis.findings] == ["acme.mirror_droop"]
    droop = diagnosis.findings[0].parameters[0]
    assert droop.low < 0.03 < droop.high
    assert droop.high - droop.low < 0.006
