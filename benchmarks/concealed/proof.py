"""The proof: make the stated sample, seal the answers, run the tool as a process, score, print.

`python -m benchmarks.concealed.proof` (or `make proof`). `--set dev` draws other cases, for work on the tool;
nothing of the tool may be tuned on the set named proof.
"""

import argparse
import json
import shutil
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.concealed.generate import write_batch
from benchmarks.concealed.plan import stated
from benchmarks.concealed.run_tool import answered, ask, read_answer
from benchmarks.concealed.score import Score, score
from benchmarks.concealed.summary import as_markdown, as_text, figures

SEEDS = {"dev": 4_017, "proof": 96_331}
INTRODUCTION = """# Proof on concealed cases

`make proof` writes the cases, seals the answers (the hash of `truth.json` is printed before the first table is read),
runs `arl reconcile` and `arl predict` as processes, and scores what they say. It asks as many of its first 40 cases
as a quarter of an hour allows, and prints how many; this page is the output of the whole sample,
`make proof CASES=80 MINUTES=600`.

How the cases are made is the subject of `benchmarks/concealed/`, which imports nothing of the package: pulses are
sampled, convolved and timed; rays are traced from displaced sensors; dies, plates and ice are marched as networks of
heat; photons are counted by rate equations; emitters age one by one. The simulation beside each measurement is the
nominal model, often refitted to the corrupted data as its user would have done.

Strength is what the oracle sees: lambda = sqrt(2 Δ log L) of the true effect against none, with the correlated noise
and after gain or offset were refitted. Faint is 4.5 to 8, moderate 8 to 20, strong above. "Unseen improvement" is
1 − Σ(corrected − true)² / Σ(simulated − true)² on whole held-out steps, angles, cycles, DUTs or distances.

"First right" asks for the id itself. A first name counts as wrong when neither it nor its `equivalent_to` holds the
truth, and the table could have told the two apart; what a table cannot tell apart is decided by the oracle.
Cases of the set `proof` were never used to tune the tool; the set `dev` was.
"""


class Clock:
    """Says whether one more case can end in time: whether one of twice the mean could. No `limit_s`: always."""

    def __init__(self, start_s: float, limit_s: float | None, now_s: Callable[[], float] = time.perf_counter) -> None:
        self._start_s, self._limit_s, self._now_s = start_s, limit_s, now_s
        self._took_s: list[float] = []

    def allows_one_more(self) -> bool:
        if self._limit_s is None:
            return True
        next_s = 2 * sum(self._took_s) / max(len(self._took_s), 1)
        return self._now_s() - self._start_s + next_s <= self._limit_s

    def took(self, seconds: float) -> None:
        self._took_s.append(seconds)


def run(folder: Path, workers: int, *, clock: Clock, rescore: bool = False) -> list[Score]:
    """Ask and score the cases of a folder in their order, as many as the clock allows; or score what was answered."""
    truths: list[dict[str, Any]] = json.loads((folder / "truth.json").read_text())["cases"]
    asked = folder / "asked"
    if rescore:
        truths = [truth for truth in truths if answered(asked / truth["name"])]
    else:
        shutil.rmtree(asked, ignore_errors=True)

    def one(truth: dict[str, Any]) -> Score | None:
        if not rescore and not clock.allows_one_more():
            return None
        out, since_s = asked / truth["name"], time.perf_counter()
        mark = score(truth, folder, read_answer(out) if rescore else ask(folder / truth["name"], out))
        clock.took(time.perf_counter() - since_s)
        said = ", ".join(mark.said) or (mark.failed.splitlines() or ["consistent"])[-1][:100]
        told = ", ".join(f"{e['effect']} λ {e['lambda']:.0f}" for e in truth["effects"]) or "nothing"
        good = mark.exact if mark.kind in ("single", "pair") else mark.named
        print(f"{mark.name} {'+' if good else '-'} {mark.cpu_seconds:5.1f} s  {told}  ->  {said}", flush=True)
        return mark

    with ThreadPoolExecutor(workers) as pool:
        return [mark for mark in pool.map(one, truths) if mark is not None]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--set", choices=sorted(SEEDS), default="proof")
    parser.add_argument("--seed", type=int, help="another draw of cases than the set's")
    parser.add_argument("--scale", type=int, default=1, help="times the stated sample")
    parser.add_argument("--cases", type=int, help="the first of the sample, which stands in an order of chance")
    parser.add_argument("--minutes", type=float, help="begin no further case that is likely to end later than this")
    parser.add_argument("--out", type=Path, default=Path("build/proof"))
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--docs", type=Path, help="write the tables as Markdown to this file")
    parser.add_argument("--rescore", action="store_true", help="score again what was answered; run nothing")
    given = parser.parse_args()
    start, seed = time.perf_counter(), SEEDS[given.set] if given.seed is None else given.seed
    folder = given.out / f"{given.set}-{seed}"
    if not given.rescore:
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        batch = stated(np.random.default_rng(seed), given.scale)[: given.cases]
        seal = write_batch(folder, seed, batch, quiet=True, workers=given.workers)
        print("sealed, sha256 of truth.json:", seal, flush=True)
    clock = Clock(start, None if given.minutes is None else 60 * given.minutes)
    scores = run(folder, given.workers, clock=clock, rescore=given.rescore)
    lines = figures(scores)
    minutes = (time.perf_counter() - start) / 60
    made = len(json.loads((folder / "truth.json").read_text())["cases"])
    print(f"\n{as_text(lines)}\n\n{len(scores)} of {made} cases in {minutes:.1f} minutes")
    (folder / "scores.json").write_text(json.dumps([asdict(s) for s in scores], indent=1, default=float))
    if given.docs:
        drawn = f"Set `{given.set}`, seed {seed}, {len(scores)} cases, {minutes:.0f} minutes."
        heading = f"{INTRODUCTION}\n## Result\n\n{drawn}"
        given.docs.write_text(as_markdown(lines, scores, heading))


if __name__ == "__main__":
    main()
