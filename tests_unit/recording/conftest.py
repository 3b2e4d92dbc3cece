"""A small step: two DUTs, three angles, four frames each, with everything that a frame can hold."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from arl_fixtures.metrics.block import AngleBlock
from arl_fixtures.recording.bag_folder import BagReceipt
from arl_fixtures.recording.metadata import StepMetadata
from arl_fixtures.recording.writer import StepBagWriter

START_NS = 1_767_225_600_123_456_789
ROWS, COLUMNS = 8, 16
CAMERA = {
    "camera_matrix": [[7.3, 0.0, 7.5], [0.0, 16.0, 3.5], [0.0, 0.0, 1.0]],
    "distortion": [0.0, 0.0, 0.0, 0.0, 0.0, 0.198, 0.0, 0.0],
    "height": ROWS,
    "width": COLUMNS,
}


@pytest.fixture(scope="session")
def metadata() -> StepMetadata:
    return StepMetadata(
        campaign="Feldversuch 7",
        cycle=3,
        step=7,
        step_id="c0003-07-up+25C",
        attempt=1,
        set_temperature_c=25.0,
        ramp=1,
        started_utc_ns=START_NS - 1_000_000_000,
        duts=("SN-1", "SN_1"),
        software_version="0.1.0",
        bench_sha256="b" * 64,
        profile_sha256="c" * 64,
        limits_sha256="d" * 64,
        extra={"seed": "5"},
    )


def block(dut: str, angle_index: int, *, frames: int = 4, seed: int = 0) -> AngleBlock:
    rng = np.random.default_rng([seed, angle_index, len(dut), frames])
    shape = (frames, 2, ROWS, COLUMNS)
    distance_m = (rng.integers(0, 49 * 256, shape) / 256).astype(np.float32)
    intensity = rng.integers(0, 65536, shape).astype(np.uint16)
    lost = rng.random(shape) < 0.2
    distance_m[lost], intensity[lost] = np.nan, 0
    return AngleBlock(
        dut=dut,
        angle_index=angle_index,
        stage_angle_deg=-60.0 + 0.9 * angle_index + 1e-9,
        time_ns=START_NS + np.arange(frames, dtype=np.int64) * 40_000_001 + angle_index * 10**9,
        intensity_counts=intensity,
        distance_m=distance_m,
        row_valid=rng.random((frames, ROWS)) > 0.1,
        operating={"fpga_temperature_c": 0.1 + 0.2, "rail_1v8_v": float(rng.normal()), "tec_current_a": float("nan")},
    )


@pytest.fixture
def make_block() -> Callable[..., AngleBlock]:
    return block


@pytest.fixture(scope="session")
def blocks(metadata: StepMetadata) -> list[AngleBlock]:
    return [block(dut, angle) for angle in range(3) for dut in metadata.duts]


def record(path: Path, metadata: StepMetadata, blocks: list[AngleBlock]) -> BagReceipt:
    with StepBagWriter(path, metadata) as writer:
        for dut in metadata.duts:
            writer.camera_info(dut, **CAMERA)
        for k, each in enumerate(blocks):
            writer.temperatures(START_NS + k, {"T2": 24.9 + k, "coolant": None})
            writer.stage(START_NS + k, each.stage_angle_deg)
            writer.block(each)
        writer.telemetry(START_NS, metadata.duts[0], {"lens_heater": 0.5, "serial": "SN-1\x00\udcff", "counter": 7})
        return writer.close()


@pytest.fixture
def make_bag(tmp_path: Path, metadata: StepMetadata, blocks: list[AngleBlock]) -> Callable[[str], BagReceipt]:
    return lambda name: record(tmp_path / name, metadata, blocks)


@pytest.fixture(scope="session")
def wide_blocks(metadata: StepMetadata) -> list[AngleBlock]:
    """Blocks large enough that each fills a chunk."""
    return [block(dut, angle, frames=130) for dut in metadata.duts for angle in range(2)][:3]


@pytest.fixture(scope="session")
def wide_bag(metadata: StepMetadata, wide_blocks: list[AngleBlock]) -> Callable[[Path], BagReceipt]:
    return lambda path: record(path, metadata, wide_blocks)


@pytest.fixture(scope="session")
def small_bag(metadata: StepMetadata, blocks: list[AngleBlock], tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Bytes of a bag's file."""
    receipt = record(tmp_path_factory.mktemp("small") / "step", metadata, blocks[:2])
    return next(receipt.path.glob("*.mcap")).read_bytes()
