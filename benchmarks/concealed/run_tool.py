"""The tool as its user runs it: `arl reconcile`, then `arl predict` on rows without measured columns."""

import json
import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

ENVIRONMENT = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
LIMIT_S = 600


@dataclass(frozen=True, slots=True)
class Answer:
    """What the tool said of one case; `diagnosis` is None when it failed, `error` then says how."""

    diagnosis: dict[str, Any] | None
    predicted: dict[str, np.ndarray]
    seconds: float
    cpu_seconds: float
    error: str


def channels_of(names: list[str]) -> list[str]:
    """Channels of a table by the contract's rule: X and sim_X both present."""
    return [n for n in names if not n.startswith("sim_") and f"sim_{n}" in names]


def _without_measured(source: Path, target: Path) -> None:
    table = pq.read_table(source)
    measured = channels_of(table.column_names)
    drop = [
        n for n in table.column_names if n in measured or (n.endswith("_std") and n.removesuffix("_std") in measured)
    ]
    pq.write_table(table.drop_columns(drop), target)


def _arl(*words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "arl_fixtures.cli", *words]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=LIMIT_S, env=os.environ | ENVIRONMENT, check=False
    )


def ask(case: Path, out: Path) -> Answer:
    """Run the tool on a case's table and let it predict the held-out rows."""
    out.mkdir(parents=True, exist_ok=True)
    before, start = os.times(), time.perf_counter()
    try:
        done = _arl("reconcile", str(case / "table.parquet"), "--out", str(out / "diagnosis"))
    except subprocess.TimeoutExpired:
        return Answer(None, {}, float(LIMIT_S), float(LIMIT_S), f"no answer in {LIMIT_S} s")
    seconds = time.perf_counter() - start
    after = os.times()
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    if done.returncode != 0:
        return Answer(None, {}, seconds, cpu, (done.stderr.strip() or done.stdout.strip())[-400:])
    diagnosis = json.loads((out / "diagnosis" / "diagnosis.json").read_text())
    _without_measured(case / "heldout.parquet", out / "unseen.parquet")
    file = out / "predicted.parquet"
    done = _arl("predict", str(out / "diagnosis"), str(out / "unseen.parquet"), "--out", str(file))
    if done.returncode != 0:
        return Answer(diagnosis, {}, seconds, cpu, "predict: " + done.stderr.strip()[-400:])
    table = pq.read_table(file)
    predicted = {n: table[n].to_numpy(zero_copy_only=False) for n in table.column_names if n.startswith("corrected_")}
    return Answer(diagnosis, predicted, seconds, cpu, "")
