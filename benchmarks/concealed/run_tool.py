"""The tool as its user runs it: `arl reconcile`, then `arl predict` on rows without measured columns."""

import json
import os
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

ENVIRONMENT = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
LIMIT_S = 600
CHECKOUT = Path(__file__).resolve().parents[2]


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


@dataclass(frozen=True, slots=True)
class _Done:
    status: int
    message: str
    cpu_s: float


def _arl(log: Path, *words: str) -> _Done:
    """Run this checkout's command, wherever the caller stands; CPU time is the process's own."""
    command = [sys.executable, "-m", "arl_fixtures.cli", *words]
    with log.open("w+") as stderr:
        process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=stderr, env=os.environ | ENVIRONMENT, cwd=CHECKOUT
        )
        killer = threading.Timer(LIMIT_S, process.kill)
        killer.start()
        _, status, usage = os.wait4(process.pid, 0)
        killer.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
        stderr.seek(0)
        message = stderr.read().strip()[-400:]
    if process.returncode < 0:
        message = f"killed after {LIMIT_S} s or by the machine"
    return _Done(process.returncode, message, usage.ru_utime + usage.ru_stime)


def ask(case: Path, out: Path) -> Answer:
    """Run the tool on a case's table and let it predict the held-out rows; what it said stays in `out`."""
    case, out = case.resolve(), out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    start = time.perf_counter()
    done = _arl(out / "reconcile.txt", "reconcile", str(case / "table.parquet"), "--out", str(out / "diagnosis"))
    seconds, error = time.perf_counter() - start, ""
    if done.status != 0:
        error = done.message or f"exit status {done.status}"
    else:
        _without_measured(case / "heldout.parquet", out / "unseen.parquet")
        words = (
            "predict",
            str(out / "diagnosis"),
            str(out / "unseen.parquet"),
            "--out",
            str(out / "predicted.parquet"),
        )
        later = _arl(out / "predict.txt", *words)
        error = f"predict: {later.message}" if later.status != 0 else ""
    spent = {"seconds": seconds, "cpu_seconds": done.cpu_s, "error": error}
    (out / "spent.json").write_text(json.dumps(spent))
    return read_answer(out)


def answered(out: Path) -> bool:
    """Whether `ask` ran to its end in this folder."""
    return (out / "spent.json").exists()


def read_answer(out: Path) -> Answer:
    """What an earlier `ask` left behind."""
    spent = json.loads((out / "spent.json").read_text())
    told, file = out / "diagnosis" / "diagnosis.json", out / "predicted.parquet"
    predicted = {}
    if file.exists():
        table = pq.read_table(file)
        names = [n for n in table.column_names if n.startswith("corrected_")]
        predicted = {n: table[n].to_numpy(zero_copy_only=False) for n in names}
    return Answer(json.loads(told.read_text()) if told.exists() else None, predicted, **spent)
