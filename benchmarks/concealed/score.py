"""What an answer is worth against the sealed truth: names, places, drivers, parameters, and unseen rows explained."""

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from benchmarks.concealed.run_tool import Answer

LEAST_POSSIBLE = 4.0
"""Square of the effect on all unseen rows, in standard errors, below which there is no improvement to have."""
UNITS = {
    "1/K": ("1/K", 1.0),
    "%/K": ("1/K", 1e-2),
    "ppm/K": ("1/K", 1e-6),
    "1/degC": ("1/K", 1.0),
    "K^-1": ("1/K", 1.0),
    "m/K": ("m/K", 1.0),
    "mm/K": ("m/K", 1e-3),
    "um/K": ("m/K", 1e-6),
    "m/degC": ("m/K", 1.0),
    "deg": ("deg", 1.0),
    "°": ("deg", 1.0),
    "rad": ("deg", 57.29578),
    "mrad": ("deg", 0.05729578),
    "s": ("s", 1.0),
    "min": ("s", 60.0),
    "m": ("m", 1.0),
    "mm": ("m", 1e-3),
    "px": ("px", 1.0),
    "pixel": ("px", 1.0),
    "K": ("K", 1.0),
    "degC": ("K", 1.0),
    "°C": ("K", 1.0),
    "c": ("K", 1.0),
    "": ("", 1.0),
    "1": ("", 1.0),
    "dimensionless": ("", 1.0),
    "%": ("", 1e-2),
    "ppm": ("", 1e-6),
    "m/m": ("", 1.0),
}


@dataclass(slots=True)
class Score:
    """One case's marks; None where a mark does not apply."""

    name: str
    kind: str
    sensor: str
    truth: tuple[str, ...]
    band: str
    said: tuple[str, ...] = ()
    named: bool | None = None
    classed: bool | None = None
    wrong: bool | None = None
    exact: bool | None = None
    both: bool | None = None
    added: bool | None = None
    channel: bool | None = None
    driver: bool | None = None
    region: float | None = None
    explained: float | None = None
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    failed: str = ""
    answered: bool = True
    parameters: list[tuple[str, float, bool]] = field(default_factory=list)


def _names(finding: dict[str, Any]) -> set[str]:
    return {finding["effect"], *finding.get("equivalent_to", [])}


def _mask(where: dict[str, list[Any]], columns: dict[str, np.ndarray]) -> np.ndarray:
    size = len(next(iter(columns.values())))
    inside = np.ones(size, dtype=bool)
    for column, span in where.items():
        if column not in columns:
            continue
        values = columns[column]
        if values.dtype.kind in "OUSb" or any(isinstance(x, str) for x in span):
            inside &= np.isin(values.astype(str), [str(x) for x in span])
        elif len(span) == 2:
            low, high = (np.nan if x is None else float(x) for x in span)
            inside &= ~(values < low) & ~(values > high)
    return inside


def overlap(said: dict[str, list[Any]], true: dict[str, list[Any]], columns: dict[str, np.ndarray]) -> float:
    """Intersection over union of two regions, in rows of the table."""
    a, b = _mask(said, columns), _mask(true, columns)
    return float(np.sum(a & b) / max(np.sum(a | b), 1))


def unseen_explained(case: Path, oracle: Path, answer: Answer, channels: set[str]) -> float | None:
    """Share of the possible held-out improvement: 1 − Σ(said − true)² / Σ(sim − true)², in standard errors.

    None where the unseen blocks hold next to nothing of the effect, such as a defocus at the temperature of focus.
    """
    table, truth = pq.read_table(case / "heldout.parquet"), pq.read_table(oracle)
    names = table.column_names
    frames = np.maximum(table["n_frames"].to_numpy().astype(float), 1.0) if "n_frames" in names else 1.0
    left = before = 0.0
    for channel in channels & set(truth.column_names):
        if channel.endswith("_std"):
            continue
        corrected = answer.predicted.get(f"corrected_{channel}")
        if corrected is None:
            return None
        sim, real = table[f"sim_{channel}"].to_numpy(), truth[channel].to_numpy()
        sigma = table[f"sim_{channel}_std"].to_numpy() / np.sqrt(frames) if f"sim_{channel}_std" in names else 1.0
        fine = np.isfinite(real) & np.isfinite(table[channel].to_numpy()) & np.isfinite(sim)
        corrected = np.where(np.isfinite(corrected), corrected, sim)
        left += float(np.sum((((corrected - real) / sigma)[fine]) ** 2))
        before += float(np.sum((((sim - real) / sigma)[fine]) ** 2))
    return None if before < LEAST_POSSIBLE else 1.0 - left / before


def _parameters(told: dict[str, Any], finding: dict[str, Any]) -> list[tuple[str, float, bool]]:
    """(what, relative error, covered) of each true parameter that the finding states."""
    marks = []
    for true in told["parameters"]:
        dimension, _ = UNITS[true["unit"]]
        stated = []
        for given in finding["law"]["parameters"]:
            unit = UNITS.get(given["unit"].strip())
            if unit is not None and unit[0] == dimension:
                stated.append((given, unit[1]))
        matching = [s for s in stated if re.search(true["pattern"], s[0]["name"], re.IGNORECASE)]
        if not matching and len(stated) == 1:
            matching = stated
        if not matching:
            continue
        given, factor = matching[0]
        value, (low, high) = given["value"] * factor, (x * factor for x in given["ci95"])
        error = abs(value - true["value"]) / abs(true["value"])
        marks.append((f"{told['effect']} {given['name']}", error, min(low, high) <= true["value"] <= max(low, high)))
    return marks


def score(truth: dict[str, Any], folder: Path, answer: Answer) -> Score:
    """Marks of one case."""
    told = truth["effects"]
    mark = Score(
        name=truth["name"],
        kind=truth["kind"],
        sensor=truth["sensor"],
        truth=tuple(e["effect"] for e in told),
        band=told[-1]["band"] if told else "",
        seconds=answer.seconds,
        cpu_seconds=answer.cpu_seconds,
        failed=answer.error,
    )
    if answer.diagnosis is None:  # no answer is a wrong one in every count, but no wrong name
        mark.answered = mark.named = mark.wrong = False
        if told:
            mark.classed = mark.exact = mark.both = mark.channel = False
        return mark
    findings = answer.diagnosis["findings"]
    mark.said = tuple(f["effect"] for f in findings)
    library = [f for f in findings if f["effect"] != "unknown"]
    if truth["kind"] == "null":
        mark.wrong, mark.named = bool(library), answer.diagnosis["verdict"] == "consistent" and not findings
        return mark
    first = findings[0] if findings else None
    channels = {c for e in told for c in e["channels"]}
    reported = {c for f in findings for c in f["channels"]}
    mark.channel = bool(reported & channels)
    drivers = {d.removeprefix("sim_") for e in told for d in e["drivers"]}  # of a signal, measured or simulated
    if drivers:
        mark.driver = bool(first and first["drivers"] and first["drivers"][0].removeprefix("sim_") in drivers)
    mark.explained = unseen_explained(
        folder / truth["name"],
        folder / "oracle" / f"{truth['name']}.parquet",
        answer,
        {c for e in told if e["kind"] == "mean" for c in e["channels"]},
    )
    if truth["kind"] == "unknown":
        mark.named, mark.wrong = mark.said == ("unknown",), bool(library)
        return mark
    _mark_names(mark, told, findings)
    if truth["kind"] == "single" and first is not None and told[0]["effect"] in _names(first):
        if told[0]["effect"] == first["effect"]:  # a look-alike's parameters are others
            mark.parameters = _parameters(told[0], first)
        if told[0]["where"]:
            table = pq.read_table(folder / truth["name"] / "table.parquet", columns=None)
            columns = {
                n: table[n].to_numpy(zero_copy_only=False)
                for n in {*told[0]["where"], *first["where"]}
                if n in table.column_names
            }
            if columns:
                mark.region = overlap(first["where"], told[0]["where"], columns)
    return mark


def _mark_names(mark: Score, told: list[dict[str, Any]], findings: list[dict[str, Any]]) -> None:
    """Naming marks of cases with effects of the library."""
    first = findings[0] if findings else None
    ids = [e["effect"] for e in told]
    accepted = set(ids) | {x for e in told for x in e["equivalents"]}
    mark.named = bool(first) and first is not None and first["effect"] in ids
    mark.classed = first is not None and bool(_names(first) & set(ids))
    # naming what this design cannot tell apart is no error, but no point either
    mark.wrong = first is not None and first["effect"] != "unknown" and not (_names(first) & accepted)
    left, extra = list(told), 0
    for finding in findings:
        hit = next((e for e in left if e["effect"] in _names(finding)), None)
        if hit is None:
            hit = next((e for e in left if _names(finding) & set(e["equivalents"])), None)
        if hit is None:
            extra += 1
        else:
            left.remove(hit)
    mark.both, mark.added = not left, extra > 0
    mark.exact = not left and extra == 0
