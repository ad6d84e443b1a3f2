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

from aircl_jax.animals.features import Features, Numbers, joined, named, one_hot, somebody
from aircl_jax.animals.minimise import minimise
from aircl_jax.animals.shards import sharded, summed
from envs.animals.full.steps import COMPANY, NONE, Lack, Recordings, possible_changes
from envs.animals.rows.cells import cells_of

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
SEEN = ("situation", "field", "returning", "joining", "left")  # of the choices: what u is computed from
ORDINARY = ("place", "site", "own place", "company", "neighbours' behaviour", "other groups")  # no effect of the code left


class Weights(NamedTuple):
    """What is fitted; as ridges: the λ of each, broadcast."""

    table: Float[Any, "J C"]  # T: reward of beginning c' in situation j; row 0 is r(c')
    shared: Float[Any, " F"]  # β
    back: Float[Any, " C"]  # ρ: of going back to the activity before the present one, by the present one
    join: Float[Any, " C"]  # σ: of beginning what some neighbour shows


class Choices(NamedTuple):
    """The changes as the model sees them, and its ridges; arrays of NumPy, or of JAX in a policy.

    Changes of one animal in one recording that look the same are one row.
    """

    change: Int[Numbers, " m"]  # index into the steps of every change
    row: Int[Numbers, " m"]  # of each change
    step: Int[Numbers, " n"]  # index into the steps of one change of each row
    situation: Float[Numbers, "n J"]
    field: Float[Numbers, "n C F"]
    returning: Float[Numbers, "n C"]  # 1 at the activity before the present one
    joining: Float[Numbers, "n C"]  # 1 at what some neighbour shows
    left: Int[Numbers, " n"]
    chosen: Int[Numbers, " n"]
    possible: Bool[Numbers, "n C"]
    ridge: Weights
    situations: tuple[str, ...]  # names of T's rows
    fields: tuple[str, ...]

    @property
    def times(self) -> Float[np.ndarray, " n"]:
        """How many changes each row stands for."""
        return self.weighed(np.ones(len(self.row)))

    def weighed(self, weight: Float[np.ndarray, " m"]) -> Float[np.ndarray, " n"]:
        """Sum the weights of the changes of each row."""
        return np.bincount(self.row, weight, minlength=len(self.step))


def going_loss(weights: Weights, data: Mapping[str, Any]) -> Float[Array, ""]:
    """−Σ_n v_n log π(c'_n | x_n, change) + ½ Σ λ θ², v the weight of a row of changes."""
    penalty = sum(jnp.sum(data[f"ridge_{name}"] * part**2) for name, part in weights._asdict().items())
    return summed(_nats, weights, data["rows"]) + 0.5 * penalty


def _nats(weights: Weights, rows: Mapping[str, Any]) -> Float[Array, ""]:
    values = _utility(weights, *(rows[name] for name in SEEN))
    logits = jnp.where(rows["possible"], values, -jnp.inf)
    chosen = jnp.take_along_axis(values, rows["chosen"][:, None], axis=1)[:, 0]
    return rows["weight"] @ (jax.nn.logsumexp(logits, axis=1) - chosen)


def choices_of(recordings: Recordings, groups: Sequence[str]) -> Choices:
    """Describe the changes by the parts of GROUPS that are named and that the tables have columns for."""
    steps = recordings.steps
    change = np.flatnonzero(steps.code != steps.following)
    made = steps.take(change)
    made = made._replace(age=made.age <= YOUNG)  # all that is asked of it
    names = ("recording", "track", "code", "following", "previous", "age", "place", "site", *COMPANY)
    cells = cells_of(made.columns(names))
    here = recordings._replace(steps=steps.take(change[cells.first]))
    return alternatives(here, groups)._replace(change=change, row=cells.of, step=change[cells.first])


def alternatives(recordings: Recordings, groups: Sequence[str]) -> Choices:
    """Describe what every step could change to, whether or not it does; the steps are of NumPy or of JAX."""
    used = [name for name in groups if not set(GROUPS[name]) & set(recordings.lacks)]
    steps, size = recordings.steps, len(recordings.names)
    xp = steps.code.__array_namespace__()
    situation, fields = joined(list(_situations(recordings, used))), dict(_fields(recordings, used))
    joins, returns = ("neighbours' behaviour" in used) * 1.0, ("return" in used) * 1.0
    every = xp.arange(len(steps.code))
    return Choices(
        change=every,
        row=every,
        step=every,
        situation=situation.values,
        field=xp.stack([*fields.values()], axis=-1) if fields else xp.zeros((len(steps.code), size, 0)),
        returning=one_hot(steps.previous, size) * returns,
        joining=_by_code(recordings, somebody(recordings)) * joins,
        left=steps.code,
        chosen=steps.following,
        possible=possible_changes(recordings),
        ridge=Weights(situation.ridge[:, None], np.ones(len(fields)), np.full(size, 3.0), np.full(size, 3.0)),
        situations=situation.names,
        fields=tuple(fields),
    )


def _situations(recordings: Recordings, used: Sequence[str]) -> Iterator[Features]:
    """Yield what multiplies a reward of each activity: the rows of T with their ridges."""
    steps = recordings.steps
    xp = steps.code.__array_namespace__()
    yield named(xp.ones((len(steps.code), 1)), ["anywhere"], 0.3)
    if "place" in used:
        yield named(one_hot(steps.place, len(recordings.places)), recordings.places, 3.0)
    if "site" in used:
        yield named(one_hot(steps.site, len(recordings.sites)), [f"camera {name}" for name in recordings.sites], 3.0)
    if "company" in used:
        yield named(xp.log1p(steps.close * 1.0)[:, None], ["log number close"], 3.0)
    if "other groups" in used:
        yield named((steps.close_doing[:, -1:] > 0) * 1.0, ["one of another group close"], 1.0)


def _fields(recordings: Recordings, used: Sequence[str]) -> Iterator[tuple[str, Float[Numbers, "n C"]]]:
    """Yield what a coefficient shared by all activities multiplies."""
    steps = recordings.steps
    xp = steps.code.__array_namespace__()
    if "own place" in used:
        destination = recordings.destination
        yield "moving to where it is", ((destination == steps.place[:, None]) & (destination != NONE)) * 1.0
    if "neighbours' behaviour" in used:
        for name, counts in (("close", steps.close_doing), ("distant", steps.distant_doing)):
            shown = _by_code(recordings, counts[:, :-1] * 1.0)
            yield f"log number {name} that do it", xp.log1p(shown)
            yield f"any {name} one does it", (shown > 0) * 1.0
    if "return" in used:
        returning = one_hot(steps.previous, len(recordings.names))
        yield "back to the activity before", returning
        yield f"back within {YOUNG} rows", returning * (steps.age <= YOUNG)[:, None]


def _by_code(recordings: Recordings, counts: Float[Numbers, "n B"]) -> Float[Numbers, "n C"]:
    """Give each behaviour's code what is counted of it; nobody's neighbours show a code of moving to a place."""
    moves = len(recordings.names) - recordings.num_behaviours
    xp = counts.__array_namespace__()
    return xp.concat([counts, xp.zeros((len(counts), moves))], axis=1)


def fit_going(choices: Choices, weight: Float[np.ndarray, " n"], start: Weights | None = None) -> Weights:
    """Find the weights of least loss; `weight` is of the rows."""
    size = choices.possible.shape[1]
    zero = Weights(
        np.zeros((choices.situation.shape[1], size)), np.zeros(choices.field.shape[2]), np.zeros(size), np.zeros(size)
    )
    names = (*SEEN, "chosen", "possible")
    ridge = {f"ridge_{name}": value for name, value in choices.ridge._asdict().items()}
    data = {"rows": sharded({name: getattr(choices, name) for name in names}, weight), **ridge}
    return Weights(*map(np.asarray, minimise(going_loss, zero if start is None else start, data)[0]))


def utility(choices: Choices, weights: Weights) -> Float[Numbers, "n C"]:
    """Compute u(x, c') of every row."""
    return _utility(weights, *(getattr(choices, name) for name in SEEN))


def _utility(weights: Weights, situation: Any, field: Any, returning: Any, joining: Any, left: Any) -> Any:
    back = returning * weights.back[left][:, None]
    return situation @ weights.table + field @ weights.shared + back + joining * weights.join


def log_going(choices: Choices, weights: Weights, offset: Float[np.ndarray, "C C"] | float = 0.0) -> Float[np.ndarray, " n"]:
    """Compute log π(c' | x, change) of every row of changes that were made; `offset` is added to u by pair of codes."""
    by_pair = np.broadcast_to(offset, choices.possible.shape[1:] * 2)
    values = utility(choices, weights) + by_pair[choices.left]
    values = np.where(choices.possible, values, -np.inf)
    top = values.max(axis=1, keepdims=True)
    total = top[:, 0] + np.log(np.exp(values - top).sum(axis=1))
    return values[np.arange(len(values)), choices.chosen] - total
