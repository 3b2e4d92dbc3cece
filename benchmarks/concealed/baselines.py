"""Three baselines on the same cases: boosted trees with the top feature, best subset with BIC, symbolic regression.

`python -m benchmarks.concealed.baselines --cases build/proof/proof-83157` after the proof has made that folder (needs
the optional extra `proof`). Each sees the table as the tool does, and is scored by the same oracle: is it silent on
null tables, is its first column a driver of the truth, does it name the effect (best subset only), and how much of
the possible improvement on unseen rows does it reach. None of them knows that rows of a step share errors.
"""

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from benchmarks.concealed.run_tool import channels_of

MOST_ROWS = 6_000


@dataclass(slots=True)
class Fit:
    """A baseline on one channel: z-values predicted for unseen rows, alarm, first column, name if it has one."""

    unseen_z: np.ndarray
    alarm: bool
    driver: str
    effect: str = ""


def load(path: Path) -> dict[str, np.ndarray]:
    """A table as columns; text becomes object arrays."""
    table = pq.read_table(path)
    return {n: table[n].to_numpy(zero_copy_only=False) for n in table.column_names}


def features(columns: dict[str, np.ndarray], like: dict[str, np.ndarray]) -> tuple[np.ndarray, list[str]]:
    """Every covariate as numbers; categories are coded by their order in the table learned from."""
    channels = channels_of(list(columns))
    skip = {*channels, *(f"{c}_std" for c in channels), "n_frames"}
    names = [n for n in like if n not in skip and not n.endswith("_repeat_std")]
    out = []
    for name in names:
        value = columns[name]
        if value.dtype.kind in "OU":
            known = {k: i for i, k in enumerate(sorted(set(like[name].astype(str))))}
            out.append(np.array([known.get(str(x), -1) for x in value], dtype=float))
        else:
            out.append(value.astype(float))
    return np.nan_to_num(np.stack(out, axis=1)), names


def standardised(columns: dict[str, np.ndarray], channel: str) -> np.ndarray:
    """Measured minus simulated in standard errors of the row's mean."""
    sigma = columns[f"sim_{channel}_std"] / np.sqrt(np.maximum(columns["n_frames"], 1))
    return (columns[channel] - columns[f"sim_{channel}"]) / sigma


def _split(count: int) -> np.ndarray:
    return np.arange(count) % 5 == 0  # rows at random places: what a user without the idea of groups would do


def _helps(z: np.ndarray, told: np.ndarray) -> bool:
    """Whether a prediction lowers the squared residual by more than two standard errors of its rows."""
    gain = z**2 - (z - told) ** 2
    return bool(gain.mean() > 2.0 * gain.std() / np.sqrt(gain.size))


def boosted(x: np.ndarray, z: np.ndarray, unseen: np.ndarray, names: list[str]) -> Fit:
    """Gradient-boosted trees; alarm when a fifth of the rows kept apart is better predicted than by nothing."""
    from sklearn.ensemble import HistGradientBoostingRegressor
    from sklearn.inspection import permutation_importance

    apart = _split(z.size)
    model = HistGradientBoostingRegressor(max_iter=120, early_stopping=False, random_state=0)
    model.fit(x[~apart], np.clip(z[~apart], -50, 50))
    alarm = _helps(z[apart], model.predict(x[apart]))
    few = np.flatnonzero(apart)[:1200]
    importance = permutation_importance(model, x[few], z[few], n_repeats=2, random_state=0).importances_mean
    return Fit(model.predict(unseen) if alarm else np.zeros(len(unseen)), alarm, names[int(np.argmax(importance))])


TERMS: tuple[tuple[str, str, str, Callable[[np.ndarray], np.ndarray]], ...] = (
    # channel, column, the effect that a user would read into it, regressor
    ("intensity_counts", "laser_temperature_c", "laser.thermal_rolloff", lambda c: c - 25.0),
    ("intensity_counts", "cycle", "laser.power_decay", lambda c: c),
    ("intensity_counts", "tof_temperature_c", "detector.gain_temperature", lambda c: c - 25.0),
    ("intensity_counts", "housing_temperature_c", "detector.dark_offset", lambda c: 2.0 ** ((c - 85.0) / 9.0)),
    ("intensity_counts", "sim_intensity_counts", "detector.compression", lambda c: c),
    ("intensity_counts", "azimuth_deg", "optics.vignetting", lambda c: c**2),
    ("intensity_counts", "elevation_deg", "optics.vignetting", lambda c: c**2),
    ("intensity_counts", "pixel_u", "readout.column_pattern", lambda c: 2.0 * (c % 2) - 1.0),
    ("intensity_counts", "reflectance", "target.reflectance_error", lambda c: (c == 0.5) * 1.0),
    ("intensity_counts", "incidence_deg", "target.non_lambertian", lambda c: np.cos(np.radians(c))),
    ("distance_m", "tof_temperature_c", "timing.temperature_offset", lambda c: c - 25.0),
    ("distance_m", "housing_temperature_c", "timing.temperature_offset", lambda c: c - 25.0),
    ("distance_m", "sim_intensity_counts", "timing.range_walk", lambda c: 1.0 / np.maximum(c, 1.0)),
    ("distance_m", "sim_distance_m", "timing.clock_scale", lambda c: c),
    ("distance_m", "pixel_v", "timing.row_skew", lambda c: c - 15.5),
    ("distance_m", "stage_angle_deg", "stage.zero_offset", lambda c: np.tan(np.radians(c))),
    ("distance_m", "azimuth_deg", "stage.eccentricity", lambda c: np.cos(np.radians(c))),
    ("distance_m", "ramp", "timing.thermal_lag", lambda c: c),
)


def best_subset(columns: dict[str, np.ndarray], channel: str, unseen: dict[str, np.ndarray]) -> Fit | None:
    """Forward best subset of generic terms by BIC that counts every row as a witness."""
    z = standardised(columns, channel)
    sigma = columns[f"sim_{channel}_std"] / np.sqrt(np.maximum(columns["n_frames"], 1))
    far = unseen[f"sim_{channel}_std"] / np.sqrt(np.maximum(unseen["n_frames"], 1))
    scale, far_scale = (
        (columns[f"sim_{channel}"], unseen[f"sim_{channel}"])
        if channel == "intensity_counts"
        else (np.ones(z.size), np.ones(far.size))
    )
    terms = [t for t in TERMS if t[0] == channel and t[1] in columns and columns[t[1]].dtype.kind not in "OUb"]
    if not terms:
        return None
    fine = np.isfinite(z) & np.all([np.isfinite(columns[t[1]].astype(float)) for t in terms], axis=0)
    a = np.stack([scale / sigma] + [t[3](columns[t[1]].astype(float)) * scale / sigma for t in terms], axis=1)[fine]
    b = np.stack([far_scale / far] + [t[3](unseen[t[1]].astype(float)) * far_scale / far for t in terms], axis=1)
    target, penalty = z[fine], np.log(fine.sum())

    def criterion(chosen: list[int]) -> tuple[float, np.ndarray]:
        fit, *_ = np.linalg.lstsq(a[:, [0, *chosen]], target, rcond=None)
        return float(np.sum((target - a[:, [0, *chosen]] @ fit) ** 2) + penalty * len(chosen)), fit

    chosen: list[int] = []
    best, fit = criterion(chosen)
    while len(chosen) < 3:
        trials = [(criterion([*chosen, k])[0], k) for k in range(1, len(terms) + 1) if k not in chosen]
        value, k = min(trials)
        if value > best - 2.0:
            break
        chosen.append(k)
        best, fit = criterion(chosen)
    first = terms[chosen[0] - 1] if chosen else None
    return Fit(
        np.nan_to_num(b[:, [0, *chosen]] @ fit), bool(chosen), first[1] if first else "", first[2] if first else ""
    )


def symbolic(x: np.ndarray, z: np.ndarray, unseen: np.ndarray, names: list[str]) -> Fit:
    """A short run of pyoperon; alarm when a fifth of the rows kept apart is better predicted than by nothing."""
    from pyoperon.sklearn import SymbolicRegressor

    apart = _split(z.size)
    model = SymbolicRegressor(
        allowed_symbols="add,sub,mul,div,constant,variable",
        population_size=300,
        generations=60,
        max_length=20,
        n_threads=1,
        random_state=1,
        max_time=8,
        max_evaluations=60_000,
    )
    centre, spread = x.mean(axis=0), x.std(axis=0) + 1e-12
    model.fit((x[~apart] - centre) / spread, np.clip(z[~apart], -50, 50))
    told = np.nan_to_num(model.predict((x[apart] - centre) / spread))
    alarm = _helps(z[apart], told)
    reaction = []
    for k in range(x.shape[1]):
        mixed = (x[apart] - centre) / spread
        mixed[:, k] = mixed[::-1, k]
        reaction.append(np.mean((np.nan_to_num(model.predict(mixed)) - told) ** 2))
    z_far = np.nan_to_num(model.predict((unseen - centre) / spread)) if alarm else np.zeros(len(unseen))
    return Fit(np.clip(z_far, -200, 200), alarm, names[int(np.argmax(reaction))])


def judge(method: str, folder: Path, truth: dict[str, Any]) -> dict[str, Any]:
    """One baseline on one case: alarm, driver, name, unseen improvement."""
    table, unseen = load(folder / truth["name"] / "table.parquet"), load(folder / truth["name"] / "heldout.parquet")
    oracle = load(folder / "oracle" / f"{truth['name']}.parquet")
    told = truth["effects"]
    hit = {c for e in told for c in e["channels"] if e["kind"] == "mean"}
    fits: dict[str, Fit] = {}
    left = before = 0.0
    for channel in (c for c in oracle if not c.endswith("_std")):
        z = standardised(table, channel)
        fine = np.flatnonzero(np.isfinite(z))
        fine = np.random.default_rng(0).permutation(fine)[:MOST_ROWS]
        x, names = features(table, table)
        far, _ = features(unseen, table)
        if method == "best subset":
            fit = best_subset(table, channel, unseen)
            if fit is None:
                continue
        else:
            fit = (boosted if method == "boosted trees" else symbolic)(x[fine], z[fine], far, names)
        fits[channel] = fit
        if channel in hit:
            sigma = unseen[f"sim_{channel}_std"] / np.sqrt(np.maximum(unseen["n_frames"], 1))
            shift = (oracle[channel] - unseen[f"sim_{channel}"]) / sigma
            seen = np.isfinite(shift) & np.isfinite(unseen[channel])
            left += float(np.sum((fit.unseen_z - shift)[seen] ** 2))
            before += float(np.sum(shift[seen] ** 2))
    loud = {c: f for c, f in fits.items() if f.alarm}
    own = [f for c, f in loud.items() if c in hit]
    drivers = {d for e in told for d in e["drivers"]}
    names_effects = method == "best subset" and truth["kind"] == "single"
    return {
        "name": truth["name"],
        "kind": truth["kind"],
        "alarm": bool(loud),
        "driver": bool(own and own[0].driver in drivers) if told and drivers and hit else None,
        "named": bool(own and own[0].effect == told[0]["effect"]) if names_effects and hit else None,
        "wrong": bool(own and own[0].effect not in {e["effect"] for e in told}) if names_effects and hit else None,
        "explained": 1 - left / before if before > 0 else None,
    }


def _share(values: list[Any]) -> str:
    marks = [v for v in values if v is not None]
    return f"{100 * np.mean(marks):.0f} % ({len(marks)})" if marks else "–"


def summary(rows: list[dict[str, Any]]) -> list[tuple[str, str]]:
    """The comparable figures of one method."""

    def of(kind: str, key: str) -> list[Any]:
        return [r[key] for r in rows if r["kind"] == kind and r.get(key) is not None]

    def middle(values: list[Any]) -> str:
        return f"{np.median(values):.2f} ({len(values)})" if values else "–"

    return [
        ("silent on null", _share([not a for a in of("null", "alarm")])),
        ("first column is a driver", _share(of("single", "driver"))),
        ("named", _share(of("single", "named"))),
        ("wrong name", _share(of("single", "wrong"))),
        ("unseen improvement, library", middle(of("single", "explained"))),
        ("unseen improvement, unknown", middle(of("unknown", "explained"))),
    ]


def of_tool(folder: Path) -> list[dict[str, Any]]:
    """The tool's marks on the same cases, in the baselines' terms."""
    scores = json.loads((folder / "scores.json").read_text())
    return [s | {"alarm": bool(s["said"])} for s in scores]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=Path, default=Path("build/proof/proof-83157"))
    parser.add_argument("--methods", nargs="+", default=["boosted trees", "best subset", "symbolic"])
    parser.add_argument("--docs", type=Path, help="append the tables as Markdown to this file")
    given = parser.parse_args()
    truths = json.loads((given.cases / "truth.json").read_text())["cases"]
    results: dict[str, list[dict[str, Any]]] = {}
    if (given.cases / "scores.json").exists():
        results["this tool"] = of_tool(given.cases)
    for method in given.methods:
        start = time.process_time()
        results[method] = [judge(method, given.cases, truth) for truth in truths]
        print(f"{method}: {(time.process_time() - start) / len(truths):.1f} s per case", flush=True)
    (given.cases / "baselines.json").write_text(json.dumps(results, default=float))
    tables = {method: dict(summary(rows)) for method, rows in results.items()}
    measures = [name for name, _ in summary([])]
    lines = ["| measure | " + " | ".join(tables) + " |", "| --- |" + " --- |" * len(tables)]
    lines += ["| " + " | ".join([m, *(t[m] for t in tables.values())]) + " |" for m in measures]
    lines += ["", *_beaten(results)]
    print("\n".join(lines))
    if given.docs:
        before = given.docs.read_text() if given.docs.exists() else ""
        given.docs.write_text(before + "\n## Baselines on the same cases\n\n" + "\n".join(lines) + "\n")


def _beaten(results: dict[str, list[dict[str, Any]]]) -> list[str]:
    """Cases on which a baseline predicts unseen rows better than the tool by more than five per cent."""
    ours = {r["name"]: r for r in results.get("this tool", [])}
    lines = []
    for method, rows in results.items():
        if method == "this tool" or not ours:
            continue
        better = [
            r["name"]
            for r in rows
            if r["explained"] is not None
            and r["name"] in ours
            and r["explained"] > (ours[r["name"]]["explained"] or 0.0) + 0.05
        ]
        lines.append(
            f"{method} predicts unseen rows better than the tool in {len(better)} cases: {', '.join(better)}."
        )
    return lines


if __name__ == "__main__":
    main()
