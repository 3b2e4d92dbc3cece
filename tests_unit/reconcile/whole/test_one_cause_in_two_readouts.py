"""A bad contact warms all that stands on it: a network of heat marched in time, read in three places, told once."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from arl_fixtures.reconcile.command import predict, reconcile

DT = 5.0
CHANNELS = {f"{name}_temperature_c" for name in ("housing", "tof", "fpga")}


NODES = {"tof": (60.0, 2.0, 1.5), "fpga": (40.0, 9.0, 1.6)}
"""Heat capacity in J/K, power in W and resistance to the housing in K/W of what stands on it."""


def march(drive, contact_k_w):
    """Housing (900 J/K, 3 W of its own) on the plate, two dies on the housing; all three over time."""
    load = 3.0 + sum(power for _, power, _ in NODES.values())
    housing = drive[0] + load * contact_k_w
    dies = {name: housing + power * apart for name, (_, power, apart) in NODES.items()}
    found = {name: np.empty(drive.size) for name in ("housing", *NODES)}
    for k, plate in enumerate(drive):
        flow = {name: (dies[name] - housing) / apart for name, (_, _, apart) in NODES.items()}
        housing += DT * ((plate - housing) / contact_k_w + sum(flow.values()) + 3.0) / 900.0
        for name, (capacity, power, _) in NODES.items():
            dies[name] += DT * (power - flow[name]) / capacity
            found[name][k] = dies[name]
        found["housing"][k] = housing
    return found


@pytest.fixture(scope="module")
def plant():
    rng = np.random.default_rng(12)
    setpoints = np.repeat([20.0, 45.0, 70.0, 85.0, 50.0, 10.0, -20.0, -35.0, 0.0, 25.0], 240)
    drive = np.empty_like(setpoints)
    now = 20.0
    for k, goal in enumerate(setpoints):
        now += np.clip(goal - now, -0.2, 0.2)
        drive[k] = now
    rows = np.arange(0, drive.size, 12)
    parts = []
    for dut, real in (("a", 0.9), ("b", 0.9 * 1.05), ("c", 0.9)):
        sim, true = march(drive, 0.9), march(drive, real)
        part = {
            "dut": np.full(rows.size, dut), "step": (rows // 240).astype(float), "time_s": DT * rows,
            "plate_temperature_c": drive[rows],
        }  # fmt: skip
        for name, simulated, measured in ((name, sim[name], true[name]) for name in sim):
            channel = f"{name}_temperature_c"
            part[f"sim_{channel}"] = simulated[rows]
            part[f"sim_{channel}_std"] = np.full(rows.size, 0.1)
            part[channel] = measured[rows] + rng.normal(0.0, 0.1, rows.size)
        parts.append(part)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def test_one_bad_contact_is_one_finding_that_mends_both(plant, save, tmp_path):
    held = plant["step"] == 4.0
    reconcile(save(tmp_path / "t.parquet", {n: x[~held] for n, x in plant.items()}), tmp_path / "out")
    findings = json.loads((tmp_path / "out" / "diagnosis.json").read_text())["findings"]
    assert [f["effect"] for f in findings] == ["thermal.contact_resistance"]
    assert set(findings[0]["channels"]) == CHANNELS
    assert findings[0]["where"].pop("dut") == ["b"]
    (_, warmest), = findings[0]["where"].values()  # on ramps up the lag takes what the heat adds
    assert warmest < 45.0
    names = [p["name"] for p in findings[0]["law"]["parameters"]]
    assert len(set(names)) == len(names)
    blind = {n: x[held] for n, x in plant.items() if n not in CHANNELS}
    predict(tmp_path / "out", save(tmp_path / "u.parquet", blind), tmp_path / "p.parquet")
    for channel in findings[0]["channels"]:
        corrected = pq.read_table(tmp_path / "p.parquet")[f"corrected_{channel}"].to_numpy()
        left, before = (np.mean((plant[channel][held] - x) ** 2) for x in (corrected, plant[f"sim_{channel}"][held]))
        assert left - 0.01 < 0.1 * (before - 0.01)
