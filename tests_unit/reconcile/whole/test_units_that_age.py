"""Modules of one batch age at their own pace: each by defects that grow from its own seed."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from arl_fixtures.reconcile.command import predict, reconcile

ERROR_W = 1.5e-3


def campaign(units: int = 6, readouts: int = 14) -> dict[str, np.ndarray]:
    """Power of lasers whose absorbing defects multiply: the balance of gain and loss, solved hour by hour."""
    rng = np.random.default_rng(31)
    hours = np.linspace(0.0, 900.0, readouts)
    made: dict[str, list[float]] = {"dut": [], "operating_hours": [], "step": [], "sim": [], "seen": []}
    for unit in range(units):
        defects, seed = 0.0, rng.uniform(2e-5, 1.6e-4)
        power, nominal = [], 1.0 + 0.05 * unit
        for hour in range(901):
            if hour in np.round(hours):
                power.append(nominal * 0.30 / (0.30 + 0.9 * defects))  # slope: mirror loss over mirror and inner loss
            defects += seed * (1.0 + 0.4 * defects)
        made["dut"] += [200.0 + unit] * readouts
        made["operating_hours"] += list(np.round(hours))
        made["step"] += list(range(readouts))
        made["sim"] += [nominal] * readouts
        made["seen"] += list(np.array(power) + rng.normal(0.0, ERROR_W, readouts))
    columns = {name: np.array(values) for name, values in made.items()}
    seen, sim = columns.pop("seen"), columns.pop("sim")
    return {
        **columns, "dut": columns["dut"].astype(int), "step": columns["step"].astype(int),
        "optical_power_w": seen, "sim_optical_power_w": sim, "sim_optical_power_w_std": np.full(sim.size, ERROR_W),
    }  # fmt: skip


def test_each_module_s_own_loss_is_one_finding_and_foretells_its_next_readouts(tmp_path):
    columns = campaign()
    later = columns["step"] >= 11
    pq.write_table(pa.table({n: v[~later] for n, v in columns.items()}), tmp_path / "t.parquet")
    pq.write_table(
        pa.table({n: v[later] for n, v in columns.items() if n != "optical_power_w"}), tmp_path / "n.parquet"
    )
    found = reconcile(tmp_path / "t.parquet", tmp_path / "out").findings
    assert [f.effect for f in found] == ["laser.power_decay"]
    losses = [p.value for p in found[0].parameters if p.name.startswith("loss_")]
    assert len(losses) == 6
    assert max(losses) > 2.0 * min(losses)
    predict(tmp_path / "out", tmp_path / "n.parquet", tmp_path / "said.parquet")
    said = pq.read_table(tmp_path / "said.parquet")["corrected_optical_power_w"].to_numpy()
    off = columns["optical_power_w"][later] - said
    before = columns["optical_power_w"][later] - columns["sim_optical_power_w"][later]
    assert np.mean(off**2) < 0.02 * np.mean(before**2)
