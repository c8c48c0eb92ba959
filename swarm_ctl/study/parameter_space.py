"""What a study flies: lists and ranges of everything that may matter, and the cells they span.

Each list's values are combined with every other list's: one combination is a *cell*. A range is not
combined: each mission of a cell draws its own value from it. Row `k` of a study is mission `k %
missions` of cell `k // missions`.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from dataclasses import asdict, replace
from dataclasses import fields as fields_of
from pathlib import Path
from typing import Any, Final, Literal, Self

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    NonNegativeFloat,
    PositiveFloat,
    ValidationError,
    field_serializer,
    field_validator,
    model_validator,
)

from swarm_ctl.core.model.autopilots import AUTOPILOT_KINDS
from swarm_ctl.core.model.plan import Compensation, LawParameters, Response
from swarm_ctl.core.model.timeouts import NEIGHBOUR_S
from swarm_ctl.errors import InputError
from swarm_ctl.law_loader import pinned
from swarm_ctl.mission.input import yaml_file
from swarm_ctl.mission.input.document import Document
from swarm_ctl.mission.input.error_messages import show
from swarm_ctl.mission.input.near_matches import did_you_mean

ShapeKind = Literal["ring", "line", "grid", "vee", "wedge"]
SlotOrder = Literal["given", "random", "nearest"]
StartKind = Literal["random", "ring", "grid", "table2", "crossing", "antipodal"]
SafetyLevel = Literal["off", "filter", "guard", "release", "align", "exchange"]
"""Each with all before it: the collision filter, the guard of links, swirl and tangential release,
the mean-error feedback (what agents fly), slot exchange (what they fly in form steps that allow
it)."""
LEVELS: Final[tuple[SafetyLevel, ...]] = ("off", "filter", "guard", "release", "align", "exchange")
VehicleModel = Literal["ideal", "lag", "ardupilot", "px4"]
Spread = Literal["mission", "agent"]
WoodKind = Literal["none", "trunks", "gate", "trap"]

MODEL: Final = ("model_lag_s", "model_dead_time_s", "model_acceleration_mps2")
LISTS: Final = (
    *("n", "shape", "slots", "start", "compensation", "vehicle", "safety"),
    *("speed_mps", "spread", *MODEL, "wood"),
)
AGENT_RANGES: Final = (
    *("lag_s", "dead_time_s", "acceleration_mps2", "delay_s", "late_s"),
    "lag_error_s",
)
"""What the vehicles truly do, and how late an agent's states arrive."""
FIRST_RANGES: Final = (
    *("h", "kappa", "lag_s", "dead_time_s", "delay_s"),
    *("loss", "wind_mps", "area", "spacing", "silent"),
)
LATER_RANGES: Final = ("acceleration_mps2", "jitter_s", "burst_s", "silent_agents", "late_s")
"""Drawn after all else: so a new one leaves the missions of older studies as they were."""
WOOD_RANGES: Final = ("trunks", "trunk", "gap")
"""Drawn last."""
RANGES: Final = (*FIRST_RANGES, *LATER_RANGES, "lag_error_s", *WOOD_RANGES)
SIGNED: Final = ("late_s", "lag_error_s")
"""Errors, which may be negative, too."""


class Range(BaseModel):
    """From `low` to `high`, both the same for one value."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
    low: float
    high: float

    @model_validator(mode="before")
    @classmethod
    def _from_text(cls, data: Any) -> Any:
        """`0.2` or `0:0.2`, as on the command line; or a number."""
        if not isinstance(data, str | int | float):
            return data
        low, _, high = str(data).partition(":")
        try:
            return {"low": float(low), "high": float(high or low)}
        except ValueError:
            raise ValueError(f"{data!r} is no number and no LOW:HIGH") from None

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.low > self.high:
            raise ValueError(
                f"{self.low:g}:{self.high:g} is not a range; allowed: LOW:HIGH, LOW <= HIGH"
            )
        return self

    def __str__(self) -> str:
        return f"{self.low:g}" if self.low == self.high else f"{self.low:g}:{self.high:g}"

    @property
    def middle(self) -> float:
        """Half-way."""
        return (self.low + self.high) / 2


def value(number: float) -> tuple[Range, ...]:
    """A list of one value."""
    return (Range(low=number, high=number),)


class _Common(BaseModel):
    """What is the same for all cells."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True
    )

    seed: int = Field(default=1, ge=0)
    """Seed of all random numbers."""
    missions: int = Field(default=1000, ge=1)
    """Missions for each combination."""
    law: LawParameters = LawParameters()
    """`r`, `r_out`, `r_in`, `delta_l`, `delta_a`; `own`, the name of an own law, and `parameters`,
    its numbers by name. `h` stands beside it, as a list."""
    unit_m: float = Field(default=5.0, gt=0)
    """Metres per unit."""
    tick_s: float = Field(default=0.05, gt=0)
    """Length of a tick [s]."""
    start_spacing: float = Field(default=0.0, ge=0)
    """Smallest distance between two random starts [units]; 0: twice `r_in`."""
    tolerance: float = Field(default=0.1, gt=0)
    """A formation stands while the largest |e_i - mean e| is under it for `settle_s` [units]."""
    settle_s: float = Field(default=1.0, ge=0)
    """How long the error stays under the tolerance, for a formation that stands [s]."""
    limit_s: float = Field(default=300.0, gt=0)
    """Missions that have not formed by then are ended [s]."""
    wood_side: float = Field(default=16.0, gt=0)
    """Side of a wood [units]."""

    @field_validator("law", mode="before")
    @classmethod
    def _pinned(cls, law: Any) -> Any:
        """A name, and numbers by name, become what a plan has of a law."""
        fields = asdict(law) if isinstance(law, LawParameters) else law
        if not isinstance(fields, Mapping):
            return law
        own, given = fields.get("own", ""), fields.get("parameters", {})
        if isinstance(own, str) and "@" not in own and isinstance(given or {}, Mapping):
            return {**fields, **pinned(own or "paper", given or {})}
        return law

    @field_validator("law")
    @classmethod
    def _one_h(cls, law: LawParameters) -> LawParameters:
        return replace(law, h=LawParameters().h)

    @field_serializer("law")
    def _without_h(self, law: LawParameters) -> dict[str, Any]:
        """The gain that is flown stands beside it, as a list."""
        return {name: number for name, number in asdict(law).items() if name != "h"}


class Cell(_Common):
    """One combination: all lists come down to one value, ranges may still be ranges."""

    index: int
    n: int
    shape: ShapeKind
    slots: SlotOrder
    start: StartKind
    compensation: Compensation
    vehicle: VehicleModel
    safety: SafetyLevel
    speed_mps: float
    spread: Spread
    model_lag_s: float | None
    model_dead_time_s: float | None
    model_acceleration_mps2: float | None
    h: Range
    kappa: Range
    lag_s: Range
    dead_time_s: Range
    delay_s: Range
    loss: Range
    wind_mps: Range
    area: Range
    spacing: Range
    silent: Range
    acceleration_mps2: Range
    jitter_s: Range
    burst_s: Range
    silent_agents: Range
    late_s: Range
    lag_error_s: Range
    wood: WoodKind
    trunks: Range
    trunk: Range
    gap: Range

    @property
    def model(self) -> Response:
        """What the agents believe of their vehicles: what is given, else the middle of the true
        range, or of a firmware the default of flown missions."""
        middle = Response(
            self.dead_time_s.middle, max(self.lag_s.middle, 1e-3), self.acceleration_mps2.middle
        )
        kind = AUTOPILOT_KINDS.get(self.vehicle)
        known = middle if kind is None else kind.response
        lag_s, dead_time_s, acceleration_mps2 = (getattr(self, name) for name in MODEL)
        return Response(
            known.dead_time_s if dead_time_s is None else dead_time_s,
            known.lag_s if lag_s is None else lag_s,
            known.acceleration_mps2 if acceleration_mps2 is None else acceleration_mps2,
        )

    def has(self, level: SafetyLevel) -> bool:
        """The cell flies with this safety, or with more."""
        return LEVELS.index(self.safety) >= LEVELS.index(level)


class Study(_Common):
    """A study: lists (of values or of ranges) of what is varied."""

    n: tuple[int, ...] = (6,)
    """Number of agents; `2:50` is every number from 2 to 50."""
    shape: tuple[ShapeKind, ...] = ("ring",)
    """Shape of the formation, turned at random: `ring`, `line`, `grid`, `vee`, `wedge`."""
    slots: tuple[SlotOrder, ...] = ("nearest",)
    """Which agent gets which slot: in the order of the ids (`given`), `random`, or so that the ways
    are short (`nearest`)."""
    start: tuple[StartKind, ...] = ("random",)
    """Where agents start: `random`, on a `ring` or `grid`, as in the paper's Table II (`table2`);
    `crossing`: two columns that face each other and, with the slots `given`, change sides;
    `antipodal`: a ring whose agents go to the place opposite to their own."""
    compensation: tuple[Compensation, ...] = (Compensation.STOP_POINT,)
    """What the law is fed with: stop points, or positions (`none`)."""
    vehicle: tuple[VehicleModel, ...] = ("lag",)
    """Points that fly what they are told (`ideal`), a dead time and a first-order lag with bounded
    acceleration (`lag`), or as a firmware answers (`ardupilot`, `px4`)."""
    safety: tuple[SafetyLevel, ...] = ("align",)
    """What stands between the law and the vehicles, each with all before it: `off`, `filter`,
    `guard` of links, `release` from dead-locks, `align` (what agents fly with stop points),
    `exchange` of slots."""
    speed_mps: tuple[PositiveFloat, ...] = (5.0,)
    """The agents' speed limit."""
    spread: tuple[Spread, ...] = ("mission",)
    """The agents of a mission are all alike (`mission`), or each draws its own lag, dead time,
    acceleration, delay and lateness from the range (`agent`)."""
    model_lag_s: tuple[PositiveFloat | None, ...] = (None,)
    """The lag that the agents believe their vehicles have. Without it: the middle of `lag_s`, so
    that a single true value is a perfect model; of firmwares the typical one."""
    model_dead_time_s: tuple[NonNegativeFloat | None, ...] = (None,)
    """The dead time that the agents believe. Without it: as for the lag."""
    model_acceleration_mps2: tuple[PositiveFloat | None, ...] = (None,)
    """The acceleration limit that the agents believe. Without it: as for the lag."""
    h: tuple[Range, ...] = value(0.05)
    """The law's consensus gain."""
    kappa: tuple[Range, ...] = value(20.0)
    """The law's iterations a second; at most one a tick."""
    lag_s: tuple[Range, ...] = value(0.5)
    """The true lag of the vehicles `lag`; firmwares bring their own answer."""
    dead_time_s: tuple[Range, ...] = value(0.4)
    """The true time between command and answer of the vehicles `lag`."""
    acceleration_mps2: tuple[Range, ...] = value(2.8)
    """The true acceleration limit of the vehicles `lag`."""
    late_s: tuple[Range, ...] = value(0.0)
    """So much later each vehicle answers, firmwares too, without its agent's knowledge: a slow way
    from the agent to the autopilot. Under 0: earlier, at most by the dead time."""
    delay_s: tuple[Range, ...] = value(0.0)
    """How old an agent's states are when they arrive."""
    jitter_s: tuple[Range, ...] = value(0.0)
    """Each state on each link is later by up to this, evenly distributed. One that arrives behind a
    newer one is dropped, as agents do."""
    loss: tuple[Range, ...] = value(0.0)
    """The share of states that never arrive, on each link by itself."""
    burst_s: tuple[Range, ...] = value(0.0)
    """How long a link that loses states goes on losing, on average (a Gilbert channel: all is lost
    in a burst, nothing between two); 0: each state is lost by itself."""
    wind_mps: tuple[Range, ...] = value(0.0)
    """A constant wind [m/s], from a direction drawn per mission; only firmwares feel it."""
    area: tuple[Range, ...] = value(0.0)
    """Side of the square of random starts [units]; 0: six in 10 x 10, more a little denser."""
    spacing: tuple[Range, ...] = value(2.0)
    """Distance of adjacent slots [units]; for starts on a ring or grid as well."""
    silent: tuple[Range, ...] = value(0.0)
    """The share of missions in which agents' processes die, each in the first 20 s; the vehicle
    flies its last command until its own failsafe stops it, and stays."""
    silent_agents: tuple[Range, ...] = value(1.0)
    """How many agents die in these missions; under 1, which share of them. One lives."""
    lag_error_s: tuple[Range, ...] = value(0.0)
    """So much longer than `lag_s` each lag of the vehicles `lag` is, without its agent's knowledge;
    under 0: shorter."""
    wood: tuple[WoodKind, ...] = ("none",)
    """What lies between the start and the goal: `none`, scattered `trunks`, a hedge with a `gate`,
    or a `trap`, a hedge that is open to where the agents come from. In a wood agents start in their
    shape, fly the planned way in file, and are at the goal where the shape stands behind it."""
    trunks: tuple[Range, ...] = value(28.0)
    """How many trunks a wood has."""
    trunk: tuple[Range, ...] = value(0.35)
    """Mean radius of a wood's trunks [units]; of scattered ones each is up to 0.6 of it thicker or
    thinner."""
    gap: tuple[Range, ...] = value(1.0)
    """The least distance between two scattered trunks [units], and the width of a gate."""

    @field_validator(*LISTS, *RANGES, mode="before")
    @classmethod
    def _listed(cls, given: Any) -> Any:
        """A list may be one value, or a text, as on the command line: `4,6`."""
        if isinstance(given, str):
            return given.split(",")
        return [given] if isinstance(given, int | float | Range | None) else given

    @field_validator(*(name for name in RANGES if name not in SIGNED))
    @classmethod
    def _not_negative(cls, spans: tuple[Range, ...]) -> tuple[Range, ...]:
        for span in spans:
            if span.low < 0:
                raise ValueError(f"{span} is negative; allowed: LOW:HIGH, 0 <= LOW <= HIGH")
        return spans

    @field_validator("n", mode="before")
    @classmethod
    def _spans(cls, given: Any) -> Any:
        """`2:4,9` as 2, 3, 4, 9."""
        if not isinstance(given, str):
            return given
        try:
            spans = [[int(end) for end in part.split(":")] for part in given.split(",")]
        except ValueError:
            raise ValueError(f"{given!r} is no list; allowed: 6 or 4,6,9 or 2:50") from None
        if any(len(span) > 2 or span[0] > span[-1] for span in spans):
            raise ValueError(f"{given!r} is no list; allowed: LOW:HIGH, LOW <= HIGH")
        return [k for span in spans for k in range(span[0], span[-1] + 1)]

    @field_validator(*LISTS, *RANGES)
    @classmethod
    def _not_empty(cls, values: tuple[Any, ...]) -> tuple[Any, ...]:
        if not values:
            raise ValueError("the list is empty; allowed: one value or more")
        return values

    @model_validator(mode="after")
    def _possible(self) -> Self:
        law = self.law
        checks = (
            (all(2 <= n <= 200 for n in self.n), "n: allowed: 2 to 200"),
            (0 < law.r_in < law.r_out < law.r, "law: allowed: 0 < r_in < r_out < r"),
            (law.delta_l >= 2, "law: allowed: delta_l >= 2"),
            (
                all(s.low > law.r_out for s in self.spacing),
                f"spacing: allowed: more than r_out {law.r_out:g}",
            ),
            (
                all(k.high * self.tick_s <= 1 + 1e-9 for k in self.kappa),
                "kappa: allowed: kappa * tick_s <= 1",
            ),
            (all(k.low > 0 for k in self.kappa), "kappa: allowed: more than 0"),
            (
                all(a.low > 0 for a in self.acceleration_mps2),
                "acceleration_mps2: allowed: more than 0",
            ),
            (all(loss.high < 1 for loss in self.loss), "loss: allowed: 0 to under 1"),
            (
                not any(w.high for w in self.wind_mps)
                or set(self.vehicle) <= AUTOPILOT_KINDS.keys(),
                "wind_mps: only the vehicles ardupilot and px4 feel wind",
            ),
            (all(share.high <= 1 for share in self.silent), "silent: allowed: 0 to 1"),
            (
                all(d.high + j.high <= NEIGHBOUR_S for d in self.delay_s for j in self.jitter_s),
                f"delay_s, jitter_s: allowed: up to {NEIGHBOUR_S:g} s together",
            ),
            (
                set(self.wood) == {"none"} or not set(self.safety) & {"off", "exchange"},
                "wood: allowed: with safety filter, guard, release or align",
            ),
            (all(t.low > 0.05 for t in self.trunk), "trunk: allowed: more than 0.05"),
            (all(t.low >= 1 and t.high <= 200 for t in self.trunks), "trunks: allowed: 1 to 200"),
            ("table2" not in self.start or set(self.n) == {6}, "start: table2 has six agents"),
        )
        wrong = [text for good, text in checks if not good]
        if wrong:
            raise ValueError("; ".join(wrong))
        return self

    @property
    def rows(self) -> int:
        """How many missions there are in all cells."""
        return self.missions * len(self.cells())

    @property
    def with_silent(self) -> bool:
        """Agents die in some missions."""
        return any(share.high > 0 for share in self.silent)

    @property
    def with_woods(self) -> bool:
        """Some missions fly through woods."""
        return set(self.wood) != {"none"}

    @property
    def varied(self) -> tuple[str, ...]:
        """The names of the lists with more than one entry."""
        return tuple(name for name in (*LISTS, *RANGES) if len(getattr(self, name)) > 1)

    def cells(self) -> list[Cell]:
        """Every combination, the last list varying fastest."""
        names = (*LISTS, *RANGES)
        common = {name: getattr(self, name) for name in _Common.model_fields}
        combinations = itertools.product(*(getattr(self, name) for name in names))
        return [
            Cell(index=index, **common, **dict(zip(names, values, strict=True)))
            for index, values in enumerate(combinations)
        ]


class StudyFile(Study):
    """What a file in `studies/` may say."""

    about: str = ""
    by: tuple[str, ...] = ()
    """The lists that the table's rows are made by; all that vary, where there are none."""

    @field_validator("by", mode="before")
    @classmethod
    def _names(cls, given: Any) -> Any:
        return given.split(",") if isinstance(given, str) else given

    @property
    def study(self) -> Study:
        """What is flown."""
        return Study.model_validate(self.model_dump(exclude={"about", "by"}))


def study_file(path: Path | None, given: Mapping[str, Any]) -> StudyFile:
    """The study of a file, if there is one, with the fields `given` instead of its own. InputError
    has every mistake with its line."""
    document = Document("study", {}) if path is None else yaml_file.read(path, what="study")
    if not isinstance(document.data, dict) or document.problems:
        raise InputError("\n".join(map(str, document.problems)) or f"{path}: has no fields")
    fields = {**document.data, **given}
    fields["law"] = {**_law(document.data), **_law(given)}
    try:
        return StudyFile.model_validate(fields)
    except ValidationError as error:
        said = list[str]()
        order: dict[tuple[int | str, ...], int] = {(name,): k for k, name in enumerate(fields)}
        errors = error.errors(include_url=False)
        for found in sorted(errors, key=lambda each: order.get(each["loc"][:1], 0)):
            loc = tuple(part for part in found["loc"] if isinstance(part, str))
            own = path is None or not loc or loc[0] in given
            where = [] if own else [document.where(loc)]
            field = [".".join(loc)] if loc else []
            said.append(": ".join([*where, *field, _wrong(found)]))
        raise InputError("\n".join(dict.fromkeys(said))) from None


def _wrong(found: Mapping[str, Any]) -> str:
    """What is wrong, and what is allowed."""
    value, text = found["input"], found["msg"].removeprefix("Value error, ")
    if found["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
        in_law = [field.name for field in fields_of(LawParameters) if field.name != "h"]
        names = in_law if len(found["loc"]) > 1 else sorted(StudyFile.model_fields)
        near = did_you_mean(str(found["loc"][-1]), names)
        return f"unknown field{near}; allowed: {', '.join(names)}"
    if found["type"] in ("literal_error", "enum"):
        names = re.findall("'([^']+)'", found["ctx"]["expected"])
        near = did_you_mean(str(value), names)
        return f"{show(value)} is not allowed{near}; allowed: {', '.join(names)}"
    return f"{show(value)} {text.removeprefix('Input ')}" if text.startswith("Input ") else text


def _law(fields: Mapping[str, Any]) -> Mapping[str, Any]:
    law: Mapping[str, Any] = fields.get("law", {})
    return law
