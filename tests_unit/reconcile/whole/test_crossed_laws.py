"""What two columns do together and neither does alone: the polarisation of a coil's field behind a wave plate."""

import numpy as np
import pyarrow.parquet as pq

from arl_fixtures.reconcile.command import predict, reconcile

ROWS = 3000


def turned_light(seed, *, coil=True):
    """Light behind a polariser, a wave plate and a coil that turns its plane by Faraday's effect (Jones vectors)."""
    rng = np.random.default_rng(seed)
    plate = rng.choice(np.arange(16) * 11.25, ROWS)
    current = rng.choice([-4.0, -2.0, 0.0, 2.0, 4.0], ROWS)
    light = rng.uniform(300.0, 3000.0, ROWS)

    def seen(rotation_rad):
        plane = 2.0 * np.radians(plate) + rotation_rad  # a half-wave plate turns the plane by twice its angle
        along, across = np.cos(plane), np.sin(plane)
        return along**2 + 0.55 * across**2  # a receiver that prefers one polarisation

    turn = 0.0009 * current if coil else 0.0
    simulated = light * seen(0.0)
    scatter = np.sqrt(25.0 + 0.2 * simulated)
    return {
        "block_number": np.arange(ROWS) // 150, "waveplate_deg": plate, "coil_current_a": current,
        "humidity_pct": rng.uniform(20.0, 60.0, ROWS),
        **{f"board_{k}_temperature_c": rng.uniform(20.0, 60.0, ROWS) for k in range(16)},
        "sim_echo_counts": simulated, "sim_echo_counts_std": scatter, "n_frames": np.full(ROWS, 10),
        "echo_counts": light * seen(turn) + rng.normal(0.0, 1.0, ROWS) * scatter / np.sqrt(10.0),
    }  # fmt: skip


def test_the_product_is_found_and_foretells(tmp_path, save):
    diagnosis = reconcile(save(tmp_path / "table.parquet", turned_light(1)), tmp_path / "out")
    assert [f.effect for f in diagnosis.findings] == ["unknown"]
    assert {"waveplate_deg", "coil_current_a"} <= set(diagnosis.findings[0].drivers[:3])
    unseen = turned_light(101)
    predict(tmp_path / "out", save(tmp_path / "unseen.parquet", unseen), tmp_path / "said.parquet")
    said = pq.read_table(tmp_path / "said.parquet")["corrected_echo_counts"].to_numpy()
    noise = unseen["sim_echo_counts_std"] / np.sqrt(10.0)
    before, after = (
        float(np.mean(((x - unseen["echo_counts"]) / noise) ** 2)) for x in (unseen["sim_echo_counts"], said)
    )
    assert after - 1.0 < 0.3 * (before - 1.0)


def test_without_a_turn_nothing_is_found(tmp_path, save):
    for seed in (3, 4, 5):
        table = save(tmp_path / f"{seed}.parquet", turned_light(seed, coil=False))
        assert reconcile(table, tmp_path / str(seed)).verdict == "consistent"
