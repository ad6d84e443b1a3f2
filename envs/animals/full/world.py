"""Make a world of activities at places from whole segments of recordings: what an animal sees, and where its moves lead.

The action is the code one row later. What an animal does not decide, its neighbours, is replayed from the recordings; its
age, its tempo and the activity before follow from what it does, and leaving "moving to PLACE" brings it to PLACE.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from envs.animals import simulated_meerkats
from envs.animals.data_folder import data_folder
from envs.animals.full.observation import coordinates, observe
from envs.animals.full.reading import read_with_account
from envs.animals.full.steps import NONE, Recordings, Steps, recordings_of
from envs.animals.full.tempo import CHANGES, expected_rates, seen_and_expected
from envs.animals.herd import held_out_pair
from envs.animals.windows import code_rows
from envs.base import Discrete, Env, Recorded, Step
from envs.options import MeerkatOptions
from envs.views import Activities

OWN = ("code", "place", "age", "unseen", "previous")  # of a step: what an animal itself brings about
REFERENCE_SEED = 1  # seed of the simulated meerkats without their constraint


class Animal(NamedTuple):
    """The state of an animal, and the row of the recordings whose neighbours it sees."""

    row: Int[Array, ""]
    code: Int[Array, ""]
    place: Int[Array, ""]
    age: Int[Array, ""]
    unseen: Bool[Array, ""]
    previous: Int[Array, ""]
    seen: Float[Array, ""]  # changes so far
    expected: Float[Array, ""]  # changes that its activities so far let one expect


def make_full(options: MeerkatOptions) -> Env:
    """Make the world of these recordings. Raises ValueError as `read_recordings` does, and for settings that do not fit."""
    recordings, account = _read(options)
    truth = _truth(options)
    trained = _of_split(recordings, options, options.split)
    reset, step = _dynamics(recordings, trained, options.horizon, truth)
    names = coordinates(recordings)
    return Env(
        name="meerkat",
        horizon=options.horizon,
        obs_size=len(names),
        action_space=Discrete(len(recordings.names)),
        reset=reset,
        step=step,
        constraint_input="state_action",
        has_reward=truth is not None,
        recorded=Recorded(
            demonstrations=lambda: demonstrations(options, options.split),
            reference=(lambda: reference_set(options)) if truth is not None else None,
            simulated=data_folder(options.data, "meerkat") is None,
            account=account,
            groups=lambda: _pieces(recordings, trained, options.horizon).recording,
        ),
        view=Activities(names, recordings),
    )


def demonstrations(options: MeerkatOptions, split: str = "all") -> dict[str, np.ndarray]:
    """Return obs [N, T, O], action, mask, reward and cost [N, T] of every step of every segment, T at most in a row."""
    recordings, _ = _read(options)
    trained = _of_split(recordings, options, "train" if options.split == "train" else "all")
    return _arrays(recordings, _of_split(recordings, options, split), trained, options.horizon, _truth(options))


def reference_set(options: MeerkatOptions) -> dict[str, np.ndarray]:
    """Simulate meerkats without their constraint, with true costs, to score a recovered feasibility."""
    tracks = simulated_meerkats.simulated_tracks(REFERENCE_SEED, constrained=False)
    mapping = simulated_meerkats.MAPPING
    free = recordings_of(code_rows(tracks, mapping), mapping, horizon=options.horizon, simulated=True)
    every = np.ones(len(free.recordings), dtype=bool)
    return _arrays(free, every, every, options.horizon, _truth(options))


def _read(options: MeerkatOptions) -> tuple[Recordings, tuple[str, ...]]:
    if options.pups:
        raise ValueError("env.pups=true: env.state=full sees pups as neighbours of the others; choose false, or another state")
    return read_with_account(options.data, options.mapping, options.coding, options.horizon)


def _truth(options: MeerkatOptions) -> simulated_meerkats.Truth | None:
    known = data_folder(options.data, "meerkat") is None and options.coding == "bout"
    return simulated_meerkats.truth() if known else None


def _of_split(recordings: Recordings, options: MeerkatOptions, split: str) -> Bool[np.ndarray, " R"]:
    """Mark the recordings of a split."""
    number = len(recordings.recordings)
    if split == "all":
        return np.ones(number, dtype=bool)
    steps = recordings.steps
    sites = dict(zip(steps.recording.tolist(), steps.site.tolist(), strict=True))
    named = {name: recordings.sites[sites[index]] for index, name in enumerate(recordings.recordings)}
    held_out = np.isin(recordings.recordings, held_out_pair(named, options.fold))
    return held_out if split == "held_out" else ~held_out


class _Pieces(NamedTuple):
    """Segments cut into pieces of at most `horizon` steps."""

    row: Int[np.ndarray, "N T"]  # of the steps; where masked, the last one
    mask: Float[np.ndarray, "N T"]
    recording: Int[np.ndarray, " N"]


def _pieces(recordings: Recordings, chosen: Bool[np.ndarray, " R"], horizon: int) -> _Pieces:
    steps = recordings.steps
    rows = np.flatnonzero(chosen[steps.recording])
    begins = np.append(True, np.diff(steps.segment[rows]) != 0)
    within = np.arange(len(rows)) - np.maximum.accumulate(np.where(begins, np.arange(len(rows)), 0))
    first = np.flatnonzero(within % horizon == 0)
    last = np.append(first[1:], len(rows)) - 1
    row = np.minimum(first[:, None] + np.arange(horizon), last[:, None])
    mask = first[:, None] + np.arange(horizon) <= last[:, None]
    return _Pieces(rows[row], mask * 1.0, steps.recording[rows[first]])


def _arrays(
    recordings: Recordings,
    chosen: Bool[np.ndarray, " R"],
    trained: Bool[np.ndarray, " R"],
    horizon: int,
    truth: simulated_meerkats.Truth | None,
) -> dict[str, np.ndarray]:
    pieces, steps = _pieces(recordings, chosen, horizon), recordings.steps
    seen, expected = seen_and_expected(recordings, expected_rates(recordings, trained))
    obs = observe(recordings, np.log((seen + CHANGES) / (expected + CHANGES))).astype(np.float32)
    now, after = steps.code[pieces.row], steps.following[pieces.row]
    undefined = np.full(now.shape, np.nan)
    return {
        "obs": obs[pieces.row] * pieces.mask[..., None].astype(np.float32),
        "action": (after * pieces.mask).astype(np.int32),
        "mask": pieces.mask.astype(np.float32),
        "reward": undefined if truth is None else truth.reward[now, after],
        "cost": undefined if truth is None else truth.forbidden[now, after].astype(float),
    }


def _dynamics(
    recordings: Recordings, trained: Bool[np.ndarray, " R"], horizon: int, truth: simulated_meerkats.Truth | None
) -> tuple[Callable[[PRNGKeyArray], tuple[Animal, Array]], Callable[[PRNGKeyArray, Animal, Array], tuple[Animal, Step]]]:
    """Make `reset`, which begins where a recorded piece of full length does, and `step`."""
    rates = expected_rates(recordings, trained)
    counts = seen_and_expected(recordings, rates)
    pieces = _pieces(recordings, trained, horizon)
    whole = pieces.mask.all(axis=1)
    starts = jnp.asarray(pieces.row[whole if whole.any() else slice(None), 0])
    steps = recordings.steps
    same = np.append(steps.segment[1:] == steps.segment[:-1], False)
    successor = jnp.asarray(np.arange(len(same)) + same)  # a segment's last row is seen on
    kinds = {"f": jnp.float32, "i": jnp.int32}
    recorded = Steps(*(jnp.asarray(column, kinds.get(column.dtype.kind)) for column in steps))
    before, rate = [jnp.asarray(count, jnp.float32) for count in counts], jnp.asarray(rates, jnp.float32)
    destination = jnp.asarray(recordings.destination)
    shape = (len(recordings.names),) * 2
    unknown = np.full(shape, np.nan)
    reward, cost = (
        jnp.asarray(table, jnp.float32)
        for table in ((unknown, unknown) if truth is None else (truth.reward, truth.forbidden.astype(float)))
    )

    def seen_by(animal: Animal) -> Array:
        here = Steps(*(column[animal.row][None] for column in recorded))._replace(
            **{name: getattr(animal, name)[None] for name in OWN}
        )
        tempo = jnp.log((animal.seen + CHANGES) / (animal.expected + CHANGES))
        return observe(recordings._replace(steps=here), tempo[None])[0]

    def reset(key: PRNGKeyArray) -> tuple[Animal, Array]:
        row = starts[jax.random.randint(key, (), 0, len(starts))]
        code, place, age, unseen, previous = (getattr(recorded, name)[row] for name in OWN)
        animal = Animal(row, code, place, age, unseen, previous, seen=before[0][row], expected=before[1][row])
        return animal, seen_by(animal)

    def step(key: PRNGKeyArray, state: Animal, action: Int[Array, ""]) -> tuple[Animal, Step]:
        action = action.astype(state.code.dtype)
        leaves = action != state.code
        arrives = leaves & (destination[state.code] != NONE)
        after = Animal(
            row=successor[state.row],
            code=action,
            place=jnp.where(arrives, destination[state.code], state.place),
            age=jnp.where(leaves, 1, state.age + 1),
            unseen=state.unseen & ~leaves,
            previous=jnp.where(leaves, state.code, state.previous),
            seen=state.seen + leaves,
            expected=state.expected + rate[recorded.recording[state.row], state.code],
        )
        return after, Step(seen_by(after), reward[state.code, action], cost[state.code, action], jnp.zeros(()))

    return reset, step
