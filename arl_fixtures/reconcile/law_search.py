"""Find an empirical law: from which scatters to start, when to look again, where terms hold, and whether it is one.

Which terms it has is chosen in `law_choice`.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from dataclasses import replace

import numpy as np

from arl_fixtures.reconcile.boosting import Binned, Boosted, bin_columns
from arl_fixtures.reconcile.channel_data import ChannelData
from arl_fixtures.reconcile.columns import FloatArray
from arl_fixtures.reconcile.effect import State
from arl_fixtures.reconcile.grouping import WITHIN_IMAGES
from arl_fixtures.reconcile.law import Law, LawTerm
from arl_fixtures.reconcile.law_basis import PRICE_ONE, Basis, price_of
from arl_fixtures.reconcile.law_choice import find_terms
from arl_fixtures.reconcile.law_drivers import strongest_first, told_once
from arl_fixtures.reconcile.law_fit import Chosen, confirm
from arl_fixtures.reconcile.law_harm import harmless
from arl_fixtures.reconcile.law_own_heat import of_own_heat
from arl_fixtures.reconcile.law_pool import pool_of
from arl_fixtures.reconcile.law_refined import PRICE_FACTOR, completed, factors_of, from_nil, narrowed
from arl_fixtures.reconcile.law_shape import sharpened
from arl_fixtures.reconcile.law_steps import of_few_steps, without_chance
from arl_fixtures.reconcile.law_work import ALL_ROWS, MOST_ROWS, Work
from arl_fixtures.reconcile.own_driver import says_of
from arl_fixtures.reconcile.pilot import Looker, Structure
from arl_fixtures.reconcile.roles import PER_TURN, Role
from arl_fixtures.reconcile.stated import surprise_shared

Trial = tuple[Law, Chosen]
MOST_PASSES = 3
STEP_SHARES = (0.3, 0.1)
"""Shares of the steps' scatter from which the search starts anew."""
LESS = 0.7
"""Share of the scatter before at which a further start is another one."""
START_GAIN = 3.0
"""Log-likelihood by which a further start must do better."""

LAW_GAIN = 8.0
"""Log-likelihood that a law must gain on unseen blocks where nothing else tells of a mismatch."""
LEAST_ROWS = 2.5
"""Rows, each counting by its part, from which the gain must come: any law of three factors hits two wild ones. A
false alarm came from 2.0, what a stage's error does at a few edges from 2.8, other faint laws from 5.3."""
LIKELIER, LIKELIER_SHARED, LIKELIER_BESIDE = 3.2, 0.5, 6.0
"""Marginal likelihood of a whole law, less its price, that tells of a mismatch. A law of what steps share needs next
to none: its gain is already that of a test which knows how few they are. In 107 null tables three laws had any terms,
none of them both 1.5 and `LAW_GAIN`; of 69 of others one had 2.1, one 2.6, and one of 83 columns 2.3 before these had
a price. True laws of 11 and 12 standard errors have 7 and more. Beside a name, whose shape is never right, more."""
USUAL_COLUMNS = 35
"""Columns, those worked out of others included, among which the prices of laws take theirs to be found."""
REACH = 2.0
"""How much larger than on any row at hand a product of several columns may become on others."""
LEAST_STEEP = 1e-3
"""Share of the steepest row's slope over the stage's angle from which a row tells of the angle."""
FEW_BLOCKS = 4.0
"""The least of these from which fewer blocks may say so."""
LEAST_Z, FEW_Z = 1.7, 1.5
"""Significance over blocks from which several say so; twice the likelihood where it is two blocks or three of a few
(a single one comes to 1)."""
WITHIN = 3.0
"""Likelihood, in units of the least, of a law within steps from which a single block may say so: what the rows of a
step share cannot imitate it."""


def is_law(chosen: Chosen, *, beside: bool = False) -> bool:
    """Whether a law by itself is evidence of a mismatch; `beside`: of one that a name in the channel leaves."""
    if not chosen.terms or chosen.held < LAW_GAIN * chosen.scatter or chosen.rows < LEAST_ROWS:
        return False
    usual = LIKELIER_SHARED if chosen.shared else LIKELIER
    least = LIKELIER_BESIDE if beside else usual
    few = max(least, FEW_BLOCKS)
    if not chosen.shared and chosen.likelier > WITHIN * few:
        return True
    if chosen.z > LEAST_Z:
        return chosen.likelier > least
    return chosen.z > FEW_Z and chosen.likelier > 2.0 * few


def search_law(looker: Looker, data: ChannelData, state: State, leading: Sequence[str]) -> tuple[Law, Chosen]:
    """Law of a channel's residual; empty where nothing predicts unseen blocks.

    What steps seem to share by chance may be the law itself, and would hide it: the search starts from several
    scatters of the steps, and the law with which the residual is likeliest stands, its scatters then at their best.
    """
    leading = [n for n in leading if n in looker.features]
    before = data.fit_scatter(data.residual(state))[0]
    law, chosen = law_of(Chosen(), data), Chosen()
    shared = surprise_shared(looker.problem.view, data.channel, data.use)
    for tau in _starts(looker, data):
        for trial, found in _that_work(looker, data, _from_start(looker, data, state, leading, tau)):
            if not found.terms:
                continue
            _measure(trial, found, data, state, looker, before, shared)
            stands, stood = is_law(found), is_law(chosen)  # what only fits gives way to what foretells
            least = chosen.likelier + START_GAIN if chosen.terms and stands == stood else 0.0
            if found.likelier > least and stands >= stood:
                law, chosen = trial, found
            if stands:
                break  # what it says needs not be said more simply
    law.drivers = _strongest_first(looker, data, state, law, chosen)
    return law, chosen


def _that_work(looker: Looker, data: ChannelData, trials: Iterator[Trial]) -> Iterator[Trial]:
    """Trials up to one that cannot be reckoned: it costs what it would have found, not the answer."""
    try:
        yield from trials
    except (ArithmeticError, LookupError, ValueError) as error:  # of numpy's, LinAlgError is a ValueError
        looker.failed[f"law of {data.channel.name}"] = f"a search was given up: {type(error).__name__}: {error}"


def _measure(
    law: Law, found: Chosen, data: ChannelData, state: State, looker: Looker, before: float, shared: float
) -> None:
    """Say what a law gains over a likelihood before it, with all scatters at their best."""
    corrected = state[data.channel.name] + law.correction(looker.features, state[data.channel.name])
    after, _ = data.fit_scatter(data.measured - data.expect * corrected[data.use])
    gain = after - before
    if found.shared:
        gain = of_few_steps(gain, sum(len(v) for v in found.values), data.level("step"))
    cost = found.cost() + _crowd(found, data, looker)
    found.plain, found.likelier = gain - cost, (gain / found.scatter - cost) / shared


def _crowd(found: Chosen, data: ChannelData, looker: Looker) -> float:
    """What a law's columns cost beyond their price, as they are the luckiest of more than usual."""
    said = {name for term in found.terms for name in _told_columns(term.basis, data)}
    return len(said) * float(np.log(max(len(looker.features) / USUAL_COLUMNS, 1.0)))


def gain_of_others(looker: Looker, data: ChannelData, state: State, law: Chosen, own: Container[str]) -> float | None:
    """What those terms of a law gain, less their price, that say nothing of what drives a name, fitted beside it.

    Args:
        looker: of the problem; data: the channel; state: corrected by the name.
        law: found in the name's place; own: what drives the name (`told_by`).

    Returns:
        None where all terms say of the name's drivers, or none.
    """
    others = [t.basis for t in law.terms if not any(says_of(c, own) for c in _told_columns(t.basis, data))]
    if not others or len(others) == len(law.terms):
        return None
    before, best = data.fit_scatter(data.residual(state))[0], 0.0
    for tau in _starts(looker, data):
        work = Work(data, state, looker.features, tau, ALL_ROWS)
        trial, found = settled(work, data, state, looker, others)
        if found.terms:
            _measure(trial, found, data, state, looker, before, 1.0)
            best = max(best, found.plain)
    return best


def _told_columns(basis: Basis, data: ChannelData) -> list[str]:
    """Columns of a basis, but for the channel's own signal where it only turns a share into an amount."""
    axes = [axis for product in (basis.axes, *basis.waves) for axis in product]
    own = f"sim_{data.channel.name}"
    return [name for a in axes for name in a.columns if a.kind != "inverse" or name != own]


def _starts(looker: Looker, data: ChannelData) -> list[dict[str, float]]:
    """Scatters to start from: pixels, angles and images share nothing, steps ever less where they seem to share much.

    The search relies on unseen steps alone (on what images share, too, where blocks are parts of images); its next
    pass works with the scatters that the law before leaves.
    """
    within_images = looker.problem.groups.block_name in WITHIN_IMAGES
    tau = {**data.tau, "pixel": 0.0, "angle": 0.0, "frame": data.tau.get("frame", 0.0) if within_images else 0.0}
    level = data.level("step")
    starts = [tau]
    if level is not None:
        alone = max(data.alone(level), level.floor)
        for share in STEP_SHARES:
            least = max(share * tau.get("step", 0.0), alone)  # a gauge study's scatter is what steps share
            if least < LESS * starts[-1].get("step", 0.0):
                starts.append({**tau, "step": least})
    return starts


def _from_start(
    looker: Looker, data: ChannelData, state: State, leading: Sequence[str],
    tau: dict[str, float],
) -> Iterator[Trial]:  # fmt: skip
    """What is found with these scatters, and a single term of several factors without one of them."""
    law, chosen = law_of(Chosen(), data), Chosen()
    features = told_once(looker.features)
    leading = leading if "step" in features else ["time_s" if n == "step" else n for n in leading]
    for _ in range(MOST_PASSES):
        work = whole = Work(data, state, features, tau)
        if len(data.use) > MOST_ROWS:
            whole = Work(data, state, features, tau, ALL_ROWS)
        known = [n for n in leading if n in work.features]  # a column may be empty where this channel has rows
        found = find_terms(work, pool_of(work, looker, known), whole)
        found = from_nil(whole, narrowed(whole, found, factors_of(work, looker, known)))
        found = of_own_heat(whole, completed(whole, sharpened(whole, found)))
        if found.held < 1.05 * chosen.held or not found.terms:
            break
        law, chosen = law_of(found, data), found
        corrected = state[data.channel.name] + law.correction(looker.features, state[data.channel.name])
        before, (_, tau) = tau, data.fit_scatter(data.measured - data.expect * corrected[data.use])
        if all(max(tau[v.name], v.floor) == max(before.get(v.name, 0.0), v.floor) for v in data.levels):
            break  # the next pass would find the same
    if not chosen.terms:
        return
    work, first = Work(data, state, looker.features, tau, ALL_ROWS), chosen.terms[0].basis
    yield settled(work, data, state, looker, [t.basis for t in chosen.terms])
    for axis in first.axes if len(chosen.terms) == 1 < len(first.axes) else ():
        if not axis.is_open and axis.kind != "one":
            axes = tuple(a for a in first.axes if a is not axis)
            columns = tuple(name for a in axes for name in a.columns)
            price = max(first.price - PRICE_FACTOR, PRICE_ONE + price_of(columns))
            yield settled(work, data, state, looker, [replace(first, axes=axes, price=price)])


def settled(
    work: Work, data: ChannelData, state: State, looker: Looker, bases: Sequence[Basis]
) -> tuple[Law, Chosen]:
    """A law of these terms on all rows at work, without those that harm or that chance alone explains."""
    sim = state[data.channel.name]
    residual = data.residual(state)

    def changed(terms: Chosen) -> FloatArray:
        return data.expect * law_of(terms, data).correction(looker.features, sim)[data.use]

    final = harmless(work, confirm(work, bases), data, residual, changed)
    final = without_chance(work, final, data, residual, changed)
    final.shared = all(work.shares(t.basis) for t in final.terms)
    law = law_of(final, data)
    for term in law.terms:
        if len({axis.column for axis in term.axes}) > 1:
            term.reach = REACH * float(np.max(np.abs(term.product(work.features, len(work.pick)))))
    return law, final


def law_of(chosen: Chosen, data: ChannelData) -> Law:
    """The law that chosen terms make, the one that changes most first."""
    power = [float(np.sum((v @ t.vectors) ** 2)) for t, v in zip(chosen.terms, chosen.values, strict=True)]
    terms: list[LawTerm] = []
    drivers: list[str] = []
    for k in np.argsort([-p for p in power], kind="stable"):
        item, values, errors = chosen.terms[k], chosen.values[k], chosen.errors[k]
        if item.basis.prior is None and not item.basis.waves:  # the chosen are the lucky ones
            values = values * np.maximum(1.0 - (errors / np.where(values == 0, 1.0, values)) ** 2, 0.0)
        share = float(np.sqrt(np.mean(errors**2) / max(float(np.mean(values**2)), 1e-300)))
        for axes, value in item.basis.closed(values):
            single = item.basis.prior is None
            terms.append(LawTerm(axes=axes, value=value, error=float(errors[0]) if single else min(share, 10.0)))
        drivers += [c for c in item.basis.columns if c not in drivers]
    relative = data.channel.role in {Role.INTENSITY, Role.SCATTER}
    ratio = max(len(data.use) / ALL_ROWS, 1.0)
    return Law(
        channel=data.channel.name, relative=relative, terms=terms, drivers=drivers, law_gain=chosen.held * ratio,
        gain=chosen.held * ratio, confirmed=float(np.clip(chosen.held / max(chosen.inside, 1e-9), 0.0, 1.0)),
    )  # fmt: skip


def _strongest_first(looker: Looker, data: ChannelData, state: State, law: Law, chosen: Chosen) -> list[str]:
    """Columns of a law by what it would lose without them; those that only turn shares into amounts last."""
    axes = [axis for term in chosen.terms for axis in term.basis.axes]
    first = [
        n for n in law.drivers
        if any(n in axis.columns and axis.kind != "inverse" for axis in axes) and not n.startswith(PER_TURN)
    ]  # fmt: skip
    features = {name: looker.features[name][data.use] for name in first}
    sim = state[data.channel.name][data.use] if law.relative else 1.0
    change = law.correction(looker.features, np.ones(looker.problem.view.n))[data.use]
    weight = (data.root_weight * data.expect * sim) ** 2
    for name in (n for n in law.drivers if n.startswith(PER_TURN)):  # how steep the scene is drives nothing
        slope = looker.features[name][data.use]
        known = np.abs(slope) > LEAST_STEEP * float(np.max(np.abs(slope)))
        change, weight = np.where(known, change / np.where(known, slope, 1.0), 0.0), weight * slope**2
    return strongest_first(first, features, change, weight) + [n for n in law.drivers if n not in first]


def add_trees(law: Law, looker: Looker, data: ChannelData, state: State, structure: Structure) -> None:
    """Keep boosted trees beside the law where unseen blocks gain clearly."""
    after = dict(state)
    after[law.channel] = state[law.channel] + law.correction(looker.features, state[law.channel])
    rest = looker.look(data, after)
    if not (rest.z > 3.0 and rest.gain > 0.1 * max(structure.gain, 1.0) and rest.gain > 12.0):
        return
    rows = looker.rows_of(data)
    target, weight = looker.target_of(data, after, rows)
    order = sorted(rest.ceiling.importance.items(), key=lambda kv: -kv[1])
    names = tuple(n for n, share in order if share > 0.02)[:8]
    binned: Binned = bin_columns({n: looker.features[n][data.use[rows]] for n in names})
    model = Boosted()
    model.fit(binned.codes, target, weight, trees=40)
    law.trees, law.binned_names, law.edges, law.rate = model.trees, binned.names, binned.edges, model.rate
    law.gain += rest.gain
    law.drivers = law.drivers or list(names[:3])
