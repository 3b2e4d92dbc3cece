"""Write a batch of concealed cases.

`python -m benchmarks.concealed.generate --out build/concealed --seed 1 --cases 60`

Each case is a folder with a number for a name that holds `table.parquet` and `heldout.parquet`; the answers lie in
one file beside the folder of cases, `truth.json`, and the oracle's means in `oracle/`.
"""

import argparse
import hashlib
import json
import multiprocessing
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from benchmarks.concealed.case import Case
from benchmarks.concealed.plan import RIVALS, Order, make, orders
from benchmarks.concealed.recipe import Recipe


def write_table(path: Path, columns: dict[str, np.ndarray]) -> None:
    """Columns as a Parquet file; text columns as strings."""
    arrays = {n: pa.array(v.tolist() if v.dtype.kind == "U" else v) for n, v in columns.items()}
    pq.write_table(pa.table(arrays), path)


def write_case(folder: Path, name: str, case: Case) -> dict[str, Any]:
    """Write one case and return its truth."""
    here = folder / name
    here.mkdir(parents=True, exist_ok=True)
    write_table(here / "table.parquet", case.table)
    write_table(here / "heldout.parquet", case.heldout)
    sealed = folder / "oracle"
    sealed.mkdir(exist_ok=True)
    write_table(sealed / f"{name}.parquet", case.oracle)
    return {"name": name, **case.truth}


def write_batch(
    folder: Path,
    seed: int,
    batch: list[Order],
    *,
    quiet: bool = False,
    rivals: tuple[Recipe, ...] = RIVALS,
    workers: int = 1,
) -> str:
    """Write all cases of a batch and seal the answers; returns the truth file's sha256."""

    def one(k: int) -> dict[str, Any]:
        truth = write_case(folder, f"c{k:03d}", make(np.random.default_rng([seed, k]), batch[k], rivals))
        if not quiet:
            named = ", ".join(f"{e['nature'] or e['effect']} λ {e['lambda']:.1f}" for e in truth["effects"])
            line = f"{truth['name']}  {truth['kind']:8s} {truth['sensor']:7s} {truth['rows']:6d} rows  {named}"
            print(line, flush=True)
        return truth

    if workers > 1:
        # recipes hold functions that cannot be pickled: the children inherit them instead
        _INHERITED.append(one)
        with multiprocessing.get_context("fork").Pool(workers) as pool:
            truths = pool.map(_inherited, range(len(batch)), chunksize=1)
        _INHERITED.pop()
    else:
        truths = [one(k) for k in range(len(batch))]
    text = json.dumps({"seed": seed, "cases": truths}, indent=1, default=float)
    (folder / "truth.json").write_text(text)
    return hashlib.sha256(text.encode()).hexdigest()


_INHERITED: list[Callable[[int], dict[str, Any]]] = []


def _inherited(k: int) -> dict[str, Any]:
    return _INHERITED[-1](k)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("build/concealed"))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--workers", type=int, default=1)
    given = parser.parse_args()
    batch = orders(np.random.default_rng(given.seed), given.cases)
    print("sha256 of truth.json:", write_batch(given.out, given.seed, batch, workers=given.workers))


if __name__ == "__main__":
    main()
