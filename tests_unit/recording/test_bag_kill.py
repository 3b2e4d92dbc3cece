"""A process killed while it records leaves a bag that says so and gives back what was on the disk."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from rosbags.rosbag2 import Reader

from arl_fixtures.errors import DataError
from arl_fixtures.recording.metadata import StepMetadata
from arl_fixtures.recording.reader import StepBag
from arl_fixtures.recording.recover import recover

RECORDER = """
import dataclasses, json, sys
from pathlib import Path
import numpy as np
from arl_fixtures.metrics.block import AngleBlock
from arl_fixtures.recording.metadata import StepMetadata
from arl_fixtures.recording.writer import StepBagWriter

custom = json.loads(sys.argv[2])
rng = np.random.default_rng(1)
with StepBagWriter(Path(sys.argv[1]), StepMetadata.from_custom_data(custom, "")) as bag:
    for angle in range(10_000):
        bag.block(AngleBlock(
            dut="SN-1",
            angle_index=angle,
            stage_angle_deg=float(angle),
            time_ns=np.arange(10) + 10 * angle,
            intensity_counts=rng.integers(0, 4096, (10, 2, 32, 128)).astype(np.uint16),
            distance_m=np.full((10, 2, 32, 128), np.float32(angle)),
            row_valid=np.ones((10, 32), dtype=np.bool_),
        ))
        sys.stdout.write("x")
        sys.stdout.flush()
"""


def test_a_killed_recording_is_recovered(tmp_path: Path, metadata: StepMetadata) -> None:
    child = subprocess.Popen(
        [sys.executable, "-c", RECORDER, str(tmp_path / "step"), json.dumps(metadata.to_custom_data())],
        stdout=subprocess.PIPE,
    )
    assert child.stdout is not None
    assert child.stdout.read(30) == b"x" * 30
    child.send_signal(signal.SIGKILL)
    handed_over = 30 + len(child.stdout.read())
    child.stdout.close()
    child.wait()

    assert [path.name for path in tmp_path.iterdir()] == ["step.part"]
    with pytest.raises(DataError, match=r"is no whole bag.*arl recover"):
        StepBag(tmp_path / "step.part")
    report = recover(tmp_path / "step.part")
    with Reader(report.path) as reader:
        assert reader.message_count == sum(report.messages.values())
    bag = StepBag(report.path)
    found = list(bag.blocks())
    # the queue's eight chunks, one in the worker's hands and one being filled may be lost
    assert handed_over - 10 <= len(found) <= handed_over
    assert [block.angle_index for block in found] == list(range(len(found)))
    assert all((block.distance_m == block.angle_index).all() for block in found)
