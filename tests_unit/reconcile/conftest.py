"""Small tables whose truth is made at the level of pulses and temperatures, not with the library's operators."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from arl_fixtures.reconcile import law_search, reconcile
from arl_fixtures.reconcile.catalogue import library
from arl_fixtures.reconcile.command import predict

Columns = dict[str, np.ndarray]
Change = Callable[[Columns, np.random.Generator], None]


def bench_table(
    seed: int, change: Change | None = None, *, duts: int = 2, steps: int = 14, shared: float = 1.0
) -> Columns:
    """A sweep over a tilted wall with stripes: every row one pixel at one angle of one step, 10 frames.

    `change` gets the true means under `intensity_counts` and `distance_m` and may bend them before noise is added.
    """
    rng = np.random.default_rng(seed)
    dut, step, angle, pixel = (
        a.ravel() for a in np.meshgrid(np.arange(duts), np.arange(steps), np.arange(7), np.arange(14), indexing="ij")
    )
    pixel_at = np.random.default_rng(5)
    u = pixel_at.integers(0, 128, 14)[pixel].astype(float)
    v = pixel_at.integers(0, 32, 14)[pixel].astype(float)
    azimuth, elevation = (u - 63.5) * 0.94, (v - 15.5) * 0.86
    stage = (angle - 3) * 8.1
    bearing = azimuth + stage
    stripe = np.floor((bearing + 180.0) / 7.5).astype(int) % 4
    reflectance = np.array([0.06, 0.18, 0.5, 0.8])[stripe]
    range_m = 1.1 + 0.5 * (1.0 - np.cos(np.radians(np.clip(bearing, -80, 80))))
    beam = np.exp(-((azimuth / 75.0) ** 4) - (elevation / 18.0) ** 4)
    half = (steps + 1) // 2
    ramp = np.where(step < half, 1.0, -1.0)
    set_c = np.where(
        step < half, -10.0 + 95.0 * step / max(half - 1, 1), 85.0 - 95.0 * (step - half) / max(steps - half, 1)
    )
    key = dut * steps + step
    wobble = rng.normal(0.0, 0.8, duts * steps)[key]
    sim_i = 4000.0 * reflectance * beam * (1.1 / range_m) ** 2
    sim_i = np.maximum(sim_i, 35.0)
    sigma_i = np.sqrt(36.0 + 0.25 * sim_i + (0.004 * sim_i) ** 2)
    sigma_d = np.hypot(0.004, 0.30 * sigma_i / sim_i)
    columns: Columns = {
        "dut": np.array([f"S{k}" for k in range(duts)])[dut],
        "cycle": np.ones(len(u)),
        "step": step.astype(float),
        "set_temperature_c": set_c,
        "ramp": ramp,
        "time_s": step * 900.0 + angle * 6.0,
        "stage_angle_deg": stage,
        "pixel_u": u,
        "pixel_v": v,
        "azimuth_deg": azimuth,
        "elevation_deg": elevation,
        "surface": np.array(["wall", "stripe_18", "stripe_50", "stripe_80"])[stripe],
        "true_range_m": range_m,
        "reflectance": reflectance,
        "housing_temperature_c": set_c + wobble,
        "tof_temperature_c": set_c + wobble + 9.0 + rng.normal(0.0, 0.1, len(u)),
        "n_frames": np.full(len(u), 10.0),
        "sim_intensity_counts": sim_i,
        "sim_intensity_counts_std": sigma_i,
        "sim_distance_m": range_m,
        "sim_distance_m_std": sigma_d,
        "sim_intensity_counts_repeat_std": 0.004 * sim_i,
        "sim_distance_m_repeat_std": np.full(len(u), 0.0004),
    }
    columns["intensity_counts"], columns["distance_m"] = sim_i.copy(), range_m.copy()
    if change is not None:
        change(columns, rng)
    groups = duts * steps
    columns["intensity_counts"] = columns["intensity_counts"] * (
        1.0 + shared * 0.004 * rng.normal(size=groups)[key]
    ) + sigma_i / np.sqrt(10.0) * rng.normal(size=len(u))
    columns["distance_m"] = (
        columns["distance_m"]
        + shared * 0.0004 * rng.normal(size=groups)[key]
        + sigma_d / np.sqrt(10.0) * rng.normal(size=len(u))
    )
    return columns


def threshold_walk(columns: Columns, _rng: np.random.Generator) -> None:
    """A Gaussian pulse of 2 ns crosses a fixed threshold: found on a sampled waveform, no formula of the library."""
    time_ns = np.linspace(-6.0, 0.0, 4000)
    pulse = np.exp(-0.5 * (time_ns / 0.85) ** 2)
    crossing = np.interp(25.0 / columns["intensity_counts"], pulse, time_ns)
    columns["distance_m"] = columns["distance_m"] + 0.15 * 0.05 * (crossing - crossing.min())


def read_out_parity(columns: Columns, _rng: np.random.Generator) -> None:
    """Odd image rows read more distance the colder it is: in no library."""
    cold = np.maximum(40.0 - columns["tof_temperature_c"], 0.0)
    columns["distance_m"] = columns["distance_m"] + 2e-4 * cold * np.where(columns["pixel_v"] % 2 == 1, 1.0, -0.4)


def write(path: Path, columns: Columns) -> Path:
    """Columns as Parquet."""
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(
        pa.table({n: pa.array(v.tolist() if v.dtype.kind == "U" else v) for n, v in columns.items()}), path
    )
    return path


@pytest.fixture(scope="session")
def make_table() -> Callable[..., Columns]:
    return bench_table


@pytest.fixture(scope="session")
def walk() -> Change:
    return threshold_walk


@pytest.fixture(scope="session")
def parity() -> Change:
    return read_out_parity


@pytest.fixture(scope="session")
def save() -> Callable[[Path, Columns], Path]:
    return write


@pytest.fixture
def foretell(tmp_path) -> Callable[[Columns, str], np.ndarray]:
    """What the model in `out` says of a channel on rows of which nothing is measured."""

    def told(unseen: Columns, channel: str) -> np.ndarray:
        simulated = {name: values for name, values in unseen.items() if f"sim_{name}" not in unseen}
        rows = write(tmp_path / "unseen.parquet", simulated)
        predict(tmp_path / "out", rows, tmp_path / "foretold.parquet")
        return pq.read_table(tmp_path / "foretold.parquet")[f"corrected_{channel}"].to_numpy()

    return told


@pytest.fixture
def knows_only(monkeypatch) -> Callable[..., None]:
    """Lets `reconcile` search a few effects: for tests of what becomes of a finding, whoever else might be named."""

    def know(*effects: str) -> None:
        few = {name: library()[name] for name in effects}
        monkeypatch.setattr(reconcile, "library", lambda: few)

    return know


@pytest.fixture(autouse=True)
def _no_law_is_given_up(monkeypatch):
    """What costs a user a law only is an error here."""
    monkeypatch.setattr(law_search, "_that_work", lambda _looker, _data, trials: trials)
