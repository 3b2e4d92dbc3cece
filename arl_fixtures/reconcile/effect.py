"""What an entry of the effect library is: the contract between one piece of physics and the engine.

**How to write an effect** (one file in `effects/`, or a plug-in under the entry-point group `arl.effects`):

1. Derive from `Effect`, set `id` (of `effects.md`), `stage`, `source`, and put the class, or several, at module
   level. The folder is scanned, nothing else needs an edit.
2. `variants(view)` says in which ways the effect could act in this table: one `Variant` per choice of driver
   column, DUT, surface, direction … An empty list where a needed column is missing or constant: the effect is then
   no candidate. A variant carries its `Parameter`s. A parameter with a `null` is an *amplitude*: at that value the
   effect is absent. All others are *shapes*; give each one or more `starts`, the engine screens their product and
   fits from the best. Ranges may depend on the table (a knee lies within the driver's range); wide enough for a
   surprise, narrow enough for physics.
3. `apply(variant, values, state, view)` is the forward operator. `state` maps every channel name
   (`intensity_counts`, `distance_m`, also `intensity_counts_std` …) to the corrected simulation so far, one float
   array of the view's rows. *Replace* arrays (`state[name] = …`), never write into them. The engine calls effects
   in the order of `stage`, so a later stage sees what an earlier one did (walk acts on the intensity that frost
   left). Use `state` for light that earlier stages change, `view.sim` for the untouched simulation. Move every
   channel that the physics moves (compression bends the intensity and its scatter; check `if name in state`). Keep
   NaN where it was; produce no new ones except for lost returns. Must be pure, deterministic, vectorised: it is
   called some hundred times on 10⁴-10⁵ rows. With all amplitudes at null it must leave the state unchanged.
4. `where`, `expression`, `sentence`, `next_experiment` are for the report.

**Amplitude or calibration?** Do not add free offsets, gains or reference temperatures of your own to make the
effect fit: the engine fits per-DUT and per-pixel gains and offsets beside each candidate where the data needs them.
Use a fixed reference (25 °C; the median of the driver: `view.middle(column)`, a shape parameter only if physics
needs it), so that the effect alone cannot imitate a calibration.

**Neighbours** (crosstalk, ghost, glare, mixing, frame lag, stage errors): see `View.neighbour`, `View.in_sweep`,
`View.acquired_before`, `View.step_before`, `View.frame_mean`, `effects_mirror.mirrored`; they return NaN where the
table holds no such row.

**History** (lag, frost, ageing): rows come in no promised order and the view may hold a part only. Compute on the
whole table (`view.columns`: per `dut` and `cycle`, ordered by `time_s` or `step`) and take `[view.rows]`; cache what
does not depend on parameters.

**Restriction**: do not enumerate DUTs (or cycles). The engine itself tries every effect on one DUT only. Enumerate
surfaces, columns, directions where the physics does; keep to about ten variants, each one costs.

**Size**: where hardly a part could work as a fit says, `is_far_fetched` tells; such a name must gain more.

**Free patterns** (`detector.pixel_response`): a `Parameter` with `per=("dut", "pixel_u", "pixel_v")` is a *field*:
the engine estimates one value per level (shrunk towards null) and hands `apply` an array of the view's rows under
its name.

**Jumps**: an operator that changes nothing until something flips (a sharp ray crosses an edge) sets `rough=True` on
its variants: they are found by trials of finite size (`direct`), not by derivatives. An effect that by its nature
acts on all units alike sets `shared = True`.

**Scatter**: effects on noise act on `state["X_std"]` (one frame's scatter). `bench.repeatability` is of `kind =
Kind.GROUP_SCATTER`: it moves no mean; the engine estimates the shared scatter itself, `apply` changes nothing.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum, IntEnum
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from arl_fixtures.reconcile.roles import Role

if TYPE_CHECKING:
    from arl_fixtures.reconcile.view import View

FloatArray = NDArray[np.float64]
State = dict[str, FloatArray]
Values = Mapping[str, Any]
"""Parameter name to value: a float, for a field parameter an array of the view's rows."""
Option = str | float | int | bool


class Stage(IntEnum):
    """Where on the light's way an effect acts; effects are applied in this order."""

    LASER = 10
    BEAM = 20
    AIR = 30
    TARGET = 40
    OPTICS = 50
    DETECTOR = 60
    TIMING = 70
    READOUT = 80
    BOOKKEEPING = 90


class Kind(Enum):
    """What an effect changes: the expected values (and scatters), or only what rows of a group share by chance."""

    MEAN = "mean"
    GROUP_SCATTER = "group_scatter"


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """One parameter of a variant.

    Attributes:
        name: unit in the name is not needed, it stands in `unit`.
        unit: plain text, `1` for a pure number, e.g. `1/K`, `m`, `counts`.
        low, high: hard bounds of the fit (widest physical range, not the typical one).
        null: value at which the effect is absent; None for a shape parameter.
        typical: size of the amplitude at which the effect is well visible (finite differences start from it).
        starts: values of a shape parameter to screen; the first is its default.
        per: columns whose levels each get a value of their own (a field parameter); empty for a plain number.
        last: whether a fit finds all others first: far from them it would lead astray.
    """

    name: str
    unit: str
    low: float
    high: float
    null: float | None = None
    typical: float = math.nan
    starts: tuple[float, ...] = ()
    per: tuple[str, ...] = ()
    last: bool = False

    def __post_init__(self) -> None:
        if self.null is None and not self.starts:
            raise ValueError(f"shape parameter '{self.name}' needs starts")
        if self.null is not None and not (math.isfinite(self.typical) and self.typical != 0.0):
            raise ValueError(f"amplitude '{self.name}' needs a typical size")
        if not self.low < self.high:
            raise ValueError(f"parameter '{self.name}' has an empty range")

    @property
    def is_amplitude(self) -> bool:
        """Whether the effect vanishes at some value of this parameter."""
        return self.null is not None


@dataclass(frozen=True, slots=True, kw_only=True)
class Variant:
    """One way in which an effect may act in a given table.

    Attributes:
        effect: the effect's id.
        options: choices that `apply` needs again for prediction (driver column, DUT, surface …); plain scalars only.
        parameters: amplitudes first.
        channels: names of `state` that the variant changes (scatter channels included).
        drivers: covariate columns (or `sim_` columns) on which it depends, strongest first.
        where: region that is already known from the options, e.g. `{"surface": ["stripe_18"]}`.
        rough: whether the corrected simulation jumps with the amplitudes (a scene sampled by sharp rays); they are
            then found by finite trials instead of derivatives.
        wider: whether the effect's id stands for this only in a wider sense: of two that say the same the other comes
            first.
    """

    effect: str
    parameters: tuple[Parameter, ...]
    channels: tuple[str, ...]
    drivers: tuple[str, ...]
    options: Mapping[str, Option] = field(default_factory=dict)
    where: Mapping[str, list[str] | list[float]] = field(default_factory=dict)
    rough: bool = False
    wider: bool = False

    @property
    def label(self) -> str:
        """Id and options in one line, unique among the variants of a table."""
        if not self.options:
            return self.effect
        return f"{self.effect}[{', '.join(f'{key}={value}' for key, value in self.options.items())}]"

    def amplitudes(self) -> tuple[Parameter, ...]:
        """Parameters whose null value switches the effect off."""
        return tuple(p for p in self.parameters if p.is_amplitude)

    def shapes(self) -> tuple[Parameter, ...]:
        """Parameters that matter only while an amplitude is not null."""
        return tuple(p for p in self.parameters if not p.is_amplitude)


class Effect(ABC):
    """A piece of physics that a simulation may have left out. See the module's text for how to write one."""

    id: ClassVar[str]
    stage: ClassVar[Stage]
    source: ClassVar[str]
    kind: ClassVar[Kind] = Kind.MEAN
    shared: ClassVar[bool] = False
    """Whether it acts on all units alike by its nature (one stage turns every DUT): it is not tried on one alone."""
    sparse: ClassVar[bool] = False
    """Whether it takes few pixels whole: what they see is then left out while other effects are sought."""
    mixes: ClassVar[bool] = False
    """Whether it mixes a row with rows that lie next to it in the image or the sweep."""
    at_borders: ClassVar[bool] = False
    """Whether it acts where surfaces meet in a pixel, by a part of it that no column tells."""
    several: ClassVar[bool] = False
    """Whether it may act at several places, each with its own parameters: one that lies elsewhere is another one."""
    single: ClassVar[bool] = False
    """Whether a channel has one of it at most, whichever column drives it."""
    displaces: ClassVar[bool] = False
    """Whether rows show the scene from elsewhere: what they see at its edges hangs on how well these are known."""
    common: ClassVar[bool] = False
    """Whether the scatter that it adds is the same in all rows of a frame: means of few frames then scatter, too."""
    exact: ClassVar[bool] = False
    """Whether its law is a plain number or share, which leaves a real one no other shape."""
    weather: ClassVar[bool] = False
    """Whether its strength also hangs on moisture or dirt of the day, which is seldom recorded."""
    of_reading: ClassVar[bool] = False
    """Whether it is one reading's own error: what several show alike is what they measure."""
    floating: ClassVar[bool] = False
    """Whether its law is nil at an arbitrary place: a constant beside it is then no calibration."""
    essential: ClassVar[str] = ""
    """Parameter that must be told from none for the name: without it what a variant says more is another effect's."""
    shown_by: ClassVar[Role | None] = None
    """Channels that must not speak against it, where another name could be wrong of what it does on the side."""
    confusable: ClassVar[tuple[str, ...]] = ()
    """Ids that are like this one: a table must tell them apart more clearly than others (the engine tests it)."""

    @abstractmethod
    def variants(self, view: View) -> Iterable[Variant]:
        """The ways in which the effect could act in this table; none where its columns are missing."""

    def wider(self, variant: Variant, view: View) -> Iterable[Variant]:
        """Ways with more freedom than a variant has, which its name is given only where it would fall without.

        What a table tells badly would make the usual way less sure.
        """
        return ()

    def aside(self, variant: Variant, view: View) -> Iterable[Variant]:
        """The same way with what it does to other channels by the way, tried once the effect has been found by it."""
        return ()

    @abstractmethod
    def apply(self, variant: Variant, values: Values, state: State, view: View) -> None:
        """Forward operator: replace the arrays of `state` that the effect changes."""

    @abstractmethod
    def expression(self, variant: Variant) -> str:
        """The law in one line, in the names of columns and parameters."""

    @abstractmethod
    def sentence(self, variant: Variant, values: Values, view: View) -> str:
        """One plain sentence with the size of the effect: what was left out, where, how much it matters."""

    def where(self, variant: Variant, values: Values, view: View) -> dict[str, list[str] | list[float]]:
        """Region that holds the mismatch: column to `[low, high]` or to the list of categories.

        Override it where fitted parameters bound the region (below a knee, inside an ellipse). The engine adds
        bounds that it measures.
        """
        return dict(variant.where)

    def drivers(self, variant: Variant, values: Values, view: View) -> list[str]:
        """Columns on which the effect depends, strongest first.

        Override it where fitted parameters say which one is the strongest.
        """
        return list(variant.drivers)

    def unknown_history(self, variant: Variant, values: Values, view: View) -> dict[str, float]:
        """Standard errors of parameters, in their units, beside what the noise of the rows makes of them.

        Override it where a law integrates what was not recorded all the time.
        """
        return {}

    def is_far_fetched(self, variant: Variant, values: Mapping[str, float]) -> bool:
        """Whether hardly any part works like that: what explains about as much in a usual size is named instead."""
        return False

    def unsure(self, variant: Variant, view: View) -> NDArray[np.bool_] | None:
        """Rows that it may move by what the table does not tell, and `apply` leaves alone; None for none, shape (n,).

        What is left there is the effect's own affair: it must not call for another one.
        """
        return None

    def says_as_well(self, variant: Variant) -> tuple[str, ...]:
        """Ids that mean the same in the way in which a variant acts, whatever tells their laws apart."""
        return ()

    def next_experiment(self, variant: Variant) -> str:
        """The measurement that would confirm the effect or tell it from its look-alikes."""
        return ""
