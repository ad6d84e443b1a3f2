"""Fit the reward of where to go: given that an animal changes, which of the possible activities it begins.

u(x, c') = Σ_j s_j(x) T_j[c'] + Σ_k f_k(x, c') β_k + 1[c' = c_prev] ρ_c + 1[somebody shows c'] σ_c',
log π(c' | x, change) = u(x, c') − log Σ_{c'' possible} exp u(x, c'').

The situations s are 1, the place, the company. T's rows are r(c'), r(place, c'), …: rewards of beginning an activity.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from aircl_jax.animals.features import Features, joined, named, one_hot, somebody
from aircl_jax.animals.minimise import minimise
from aircl_jax.animals.steps import NONE, Lack, Recordings, Steps, possible_changes

YOUNG = 3  # rows: a change back after so short a bout is an interruption
GROUPS: dict[str, tuple[Lack, ...]] = {
    "place": ("places",),
    "site": ("sites",),
    "own place": ("places",),
    "company": ("neighbours",),
    "neighbours' behaviour": ("names",),
    "other groups": ("names", "groups"),
    "return": (),
}
"""Parts of the reward of where to go, and what of the tables each needs; r(c') is always there."""

MODEL = ("place", "own place", "company", "neighbours' behaviour", "other groups", "return")
ORDINARY = ("place", "site", "own place", "company", "neighbours' behaviour", "other groups")  # no effect of the code left


class Weights(NamedTuple):
    """What is fitted; as ridges: the λ of each, broadcast."""

    table: Float[np.ndarray, "J C"]  # T: reward of beginning c' in situation j; row 0 is r(c')
    shared: Float[np.ndarray, " F"]  # β
    back: Float[np.ndarray, " C"]  # ρ: of going back to the activity before the present one, by the present one
    join: Float[np.ndarray, " C"]  # σ: of beginning what some neighbour shows


class Choices(NamedTuple):
    """The changes as the model sees them, one a row, and its ridges."""

    step: Int[np.ndarray, " n"]  # index into the steps
    situation: Float[np.ndarray, "n J"]
    field: Float[np.ndarray, "n C F"]
    returning: Float[np.ndarray, "n C"]  # 1 at the activity before the present one
    joining: Float[np.ndarray, "n C"]  # 1 at what some neighbour shows
    left: Int[np.ndarray, " n"]
    chosen: Int[np.ndarray, " n"]
    possible: Bool[np.ndarray, "n C"]
    ridge: Weights
    situations: tuple[str, ...]  # names of T's rows
    fields: tuple[str, ...]


def going_loss(weights: Weights, data: Mapping[str, Any]) -> Float[Array, ""]:
    """−Σ_n v_n log π(c'_n | x_n, change) + ½ Σ λ θ², v the weight of a change."""
    utility = _utility(weights, data)
    logits = jnp.where(data["possible"], utility, -jnp.inf)
    chosen = jnp.take_along_axis(utility, data["chosen"][:, None], axis=1)[:, 0]
    nats = jax.nn.logsumexp(logits, axis=1) - chosen
    penalty = sum(jnp.sum(data[f"ridge_{name}"] * part**2) for name, part in weights._asdict().items())
    return data["weight"] @ nats + 0.5 * penalty


def _utility(weights: Weights, data: Mapping[str, Any]) -> Float[Array, "n C"]:
    back = data["returning"] * weights.back[data["left"]][:, None]
    return data["situation"] @ weights.table + data["field"] @ weights.shared + back + data["joining"] * weights.join


def choices_of(recordings: Recordings, groups: Sequence[str]) -> Choices:
    """Describe every change by the parts of GROUPS that are named and that the tables have columns for."""
    used = [name for name in groups if not set(GROUPS[name]) & set(recordings.lacks)]
    steps, size = recordings.steps, len(recordings.names)
    step = np.flatnonzero(steps.code != steps.following)
    here = Steps(*(column[step] for column in steps))
    situation, fields = joined(list(_situations(recordings, here, used))), dict(_fields(recordings, here, used))
    joining = np.pad(somebody(recordings)[step], ((0, 0), (0, 1))) * ("neighbours' behaviour" in used)
    return Choices(
        step=step,
        situation=situation.values,
        field=np.stack([*fields.values()], axis=-1) if fields else np.zeros((len(step), size, 0)),
        returning=one_hot(here.previous, size) * ("return" in used),
        joining=_by_code(recordings, joining),
        left=here.code,
        chosen=here.following,
        possible=possible_changes(recordings)[step],
        ridge=Weights(situation.ridge[:, None], np.ones(len(fields)), np.full(size, 3.0), np.full(size, 3.0)),
        situations=situation.names,
        fields=tuple(fields),
    )


def _situations(recordings: Recordings, here: Steps, used: Sequence[str]) -> Iterator[Features]:
    """Yield what multiplies a reward of each activity: the rows of T with their ridges."""
    yield named(np.ones((len(here.code), 1)), ["anywhere"], 0.3)
    if "place" in used:
        yield named(one_hot(here.place, len(recordings.places)), recordings.places, 3.0)
    if "site" in used:
        yield named(one_hot(here.site, len(recordings.sites)), [f"camera {name}" for name in recordings.sites], 3.0)
    if "company" in used:
        yield named(np.log1p(here.close)[:, None], ["log number close"], 3.0)
    if "other groups" in used:
        yield named((here.close_doing[:, -1:] > 0).astype(np.float64), ["one of another group close"], 1.0)


def _fields(recordings: Recordings, here: Steps, used: Sequence[str]) -> Iterator[tuple[str, Float[np.ndarray, "n C"]]]:
    """Yield what a coefficient shared by all activities multiplies."""
    if "own place" in used:
        destination = recordings.destination
        yield "moving to where it is", ((destination == here.place[:, None]) & (destination != NONE)).astype(np.float64)
    if "neighbours' behaviour" in used:
        for name, counts in (("close", here.close_doing), ("distant", here.distant_doing)):
            shown = _by_code(recordings, counts)
            yield f"log number {name} that do it", np.log1p(shown)
            yield f"any {name} one does it", (shown > 0).astype(np.float64)
    if "return" in used:
        returning = one_hot(here.previous, len(recordings.names))
        yield "back to the activity before", returning
        yield f"back within {YOUNG} rows", returning * (here.age <= YOUNG)[:, None]


def _by_code(recordings: Recordings, counts: Float[np.ndarray, "n B"]) -> Float[np.ndarray, "n C"]:
    """Give each behaviour's code what is counted of it; nobody's neighbours show a code of moving to a place."""
    shown = np.zeros((len(counts), len(recordings.names)))
    shown[:, : recordings.num_behaviours] = counts[:, :-1]
    return shown


def fit_going(choices: Choices, weight: Float[np.ndarray, " n"], start: Weights | None = None) -> Weights:
    """Find the weights of least loss."""
    size = choices.possible.shape[1]
    zero = Weights(
        np.zeros((choices.situation.shape[1], size)), np.zeros(choices.field.shape[2]), np.zeros(size), np.zeros(size)
    )
    names = ("situation", "field", "returning", "joining", "left", "chosen", "possible")
    ridge = {f"ridge_{name}": value for name, value in choices.ridge._asdict().items()}
    data = {**{name: getattr(choices, name) for name in names}, **ridge, "weight": weight}
    return Weights(*map(np.asarray, minimise(going_loss, zero if start is None else start, data)[0]))


def utility(choices: Choices, weights: Weights) -> Float[np.ndarray, "n C"]:
    """Compute u(x, c') of every change."""
    back = choices.returning * weights.back[choices.left][:, None]
    return choices.situation @ weights.table + choices.field @ weights.shared + back + choices.joining * weights.join


def log_going(choices: Choices, weights: Weights) -> Float[np.ndarray, " n"]:
    """Compute log π(c' | x, change) of every change that was made."""
    values = utility(choices, weights)
    values = np.where(choices.possible, values, -np.inf)
    top = values.max(axis=1, keepdims=True)
    total = top[:, 0] + np.log(np.exp(values - top).sum(axis=1))
    return values[np.arange(len(values)), choices.chosen] - total
