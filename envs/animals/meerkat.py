"""Make a Markov decision process over codes from tables of meerkats' tracks, or from simulated meerkats.

The state is the present code, one-hot. The action is the code one row later, and becomes the next state. Step t of a window
has obs one_hot(c_t) and action c_{t+1}, so that a window of T steps needs T + 1 codes (`envs.animals.windows`).
"""

from collections.abc import Callable
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray

from envs.animals import simulated_meerkats
from envs.animals.data_folder import data_folder
from envs.animals.full import world
from envs.animals.herd import Herd, held_out_pair, load
from envs.animals.windows import Windows, code_rows, cut_windows
from envs.base import Discrete, Env, Recorded, Step, Tabular
from envs.options import MeerkatOptions
from envs.views import Codes, Coordinates

Split = Literal["all", "train", "held_out"]
Transition = Callable[[PRNGKeyArray, Int[Array, ""], Int[Array, ""]], tuple[Int[Array, ""], Step]]

MOST_NEIGHBOURS = 3  # larger counts are cut to this, which keeps the states of env.state=place few
BACK_OFF = 1.0  # weight of P(x'|x) beside the rows seen in (x, a), in rows
REFERENCE_SEED = 1  # seed of the simulated meerkats without their constraint


def make_meerkat(options: MeerkatOptions) -> Env:
    """Make the world of the windows. Only simulated meerkats have a true reward and cost. Raises ValueError as `load` does."""
    options = options.resolved()
    if options.state == "full":
        return world.make_full(options)
    herd = load(options)
    table = {"code": _code_table, "place": _place_table}[options.state](herd)
    step = _code_step(herd, table) if options.state == "code" else _table_step(table)

    def reset(key: PRNGKeyArray) -> tuple[Int[Array, ""], Float[Array, " O"]]:
        state = jax.random.categorical(key, jnp.log(table.start))
        return state, table.obs[state]

    return Env(
        name="meerkat",
        horizon=options.horizon,
        obs_size=table.obs.shape[1],
        action_space=Discrete(len(herd.windows.names)),
        reset=reset,
        step=step,
        constraint_input="state_action",
        has_reward=herd.truth is not None,
        tabular=table,
        recorded=Recorded(
            demonstrations=lambda: demonstrations(options, options.split),
            reference=(lambda: reference_set(options)) if herd.truth is not None else None,
            simulated=data_folder(options.data, "meerkat") is None,
            account=herd.account.lines,
            warnings=herd.account.warnings,
        ),
        view=Codes(herd.windows.names, herd.impossible) if options.state == "code" else Coordinates(),
    )


def _truth_arrays(
    truth: simulated_meerkats.Truth | None, size: int
) -> tuple[Float[np.ndarray, "C C"], Float[np.ndarray, "C C"]]:
    """Return the true reward and cost, [from code, to code], NaN where they are unknown."""
    if truth is None:
        return np.full((size, size), np.nan), np.full((size, size), np.nan)
    return truth.reward, truth.forbidden.astype(float)


def _code_table(herd: Herd) -> Tabular:
    """Build tables whose states 0 … C − 1 are the codes.

    Simulated meerkats add states C … 2C − 1: the codes after a forbidden transition. The table's `cost` thus falls one step
    after that transition, where `step` charges it at once.
    """
    reward, cost = _truth_arrays(herd.truth, len(herd.windows.names))
    size, copies = len(reward), 1 if herd.truth is None else 2
    entered = np.nan_to_num(cost).astype(int)  # by a forbidden transition
    transition = np.zeros((size, size, copies, size))
    code, action = np.indices((size, size))
    transition[code, action, entered, action] = 1.0
    start = np.zeros(copies * size)
    start[:size] = np.bincount(herd.windows.code[:, 0], minlength=size) / len(herd.windows.code)
    flagged = np.arange(copies * size) >= size
    return _tabular(
        np.tile(transition.reshape(size, size, copies * size), (copies, 1, 1)),
        np.tile(reward, (copies, 1)),
        flagged if herd.truth is not None else None,
        start,
        np.tile(np.eye(size), (copies, 1)),
    )


def _tabular(
    transition: np.ndarray, reward: np.ndarray, forbidden: np.ndarray | None, start: np.ndarray, obs: np.ndarray
) -> Tabular:
    """Convert arrays to a `Tabular`. Without a known truth nothing is forbidden and the cost is NaN."""
    nothing = np.zeros(len(start))
    cost, barred = (nothing + np.nan, nothing) if forbidden is None else (forbidden, forbidden)
    arrays = (transition, reward, cost, barred, start, obs, nothing)
    return Tabular(*(jnp.asarray(array, jnp.float32) for array in arrays))


def _code_step(herd: Herd, table: Tabular) -> Transition:
    reward, cost = (jnp.asarray(array, jnp.float32) for array in _truth_arrays(herd.truth, len(herd.windows.names)))
    size = len(reward)
    entered = jnp.nan_to_num(cost).astype(jnp.int32)

    def step(key: PRNGKeyArray, state: Int[Array, ""], action: Int[Array, ""]) -> tuple[Int[Array, ""], Step]:
        code = state % size
        successor = action + size * entered[code, action]
        return successor, Step(table.obs[successor], reward[code, action], cost[code, action], jnp.zeros(()))

    return step


def _place_states(windows: Windows) -> Int[np.ndarray, "N L"]:
    """Number the states x = (place, close neighbours, distant neighbours), both counts cut at MOST_NEIGHBOURS."""
    levels = MOST_NEIGHBOURS + 1
    close, distant = (np.minimum(count, MOST_NEIGHBOURS) for count in (windows.close, windows.distant))
    return (windows.place * levels + close) * levels + distant


def _place_obs(windows: Windows) -> Float[np.ndarray, "X O"]:
    """Return each state's one-hot place, then both counts as shares of MOST_NEIGHBOURS."""
    levels = MOST_NEIGHBOURS + 1
    place, rest = np.divmod(np.arange(len(windows.places) * levels**2), levels**2)
    counts = np.stack(np.divmod(rest, levels), axis=1) / MOST_NEIGHBOURS
    return np.concatenate([np.eye(len(windows.places))[place], counts], axis=1)


def _place_table(herd: Herd) -> Tabular:
    """Build tables over places and neighbours, with P(x'|x, a) by frequency, backed off to P(x'|x).

    The action is the present code. The state follows Gendron et al. 2024. There is no true reward, because the simulated
    meerkats' reward is one of codes.
    """
    windows = herd.windows
    if not windows.places:
        raise ValueError("env.state=place needs a mapping with a place; choose code")
    state, obs = _place_states(windows), _place_obs(windows)
    size, actions = len(obs), len(windows.names)
    counts = np.zeros((size, actions, size))
    np.add.at(counts, (state[:, :-1].ravel(), windows.code[:, :-1].ravel(), state[:, 1:].ravel()), 1.0)
    of_state = counts.sum(axis=1) + np.eye(size)
    prior = BACK_OFF * of_state / of_state.sum(axis=1, keepdims=True)
    transition = (counts + prior[:, None]) / (counts.sum(axis=2, keepdims=True) + BACK_OFF)
    start = np.bincount(state[:, 0], minlength=size) / len(state)
    return _tabular(transition, np.full((size, actions), np.nan), None, start, obs)


def _table_step(table: Tabular) -> Transition:
    log_transition = jnp.log(table.transition)

    def step(key: PRNGKeyArray, state: Int[Array, ""], action: Int[Array, ""]) -> tuple[Int[Array, ""], Step]:
        successor = jax.random.categorical(key, log_transition[state, action])
        return successor, Step(table.obs[successor], table.reward[state, action], table.cost[state], jnp.zeros(()))

    return step


def demonstrations(options: MeerkatOptions, split: Split = "all") -> dict[str, np.ndarray]:
    """Return obs [N, T, O], action, mask, reward, cost [N, T] of all windows, or of those outside or inside the fold.

    Raises ValueError for a fold that does not exist.
    """
    options = options.resolved()
    if options.state == "full":
        return world.demonstrations(options, split)
    herd = load(options)
    number = len(herd.windows.code)
    held_out = np.isin(herd.windows.recording, held_out_recordings(options)) if split != "all" else np.ones(number, bool)
    return _arrays(herd.windows, herd.truth, options.state, np.flatnonzero(held_out != (split == "train")))


def held_out_recordings(options: MeerkatOptions) -> tuple[str, ...]:
    """List the two recordings of the fold. Raises ValueError for a fold that does not exist."""
    windows = load(options).windows
    return held_out_pair(dict(zip(windows.recording.tolist(), windows.site.tolist(), strict=True)), options.fold)


def reference_set(options: MeerkatOptions) -> dict[str, np.ndarray]:
    """Simulate windows of meerkats without their constraint, with true costs, to score a recovered feasibility.

    Raises ValueError where the truth is unknown: for real animals, another coding or another state.
    """
    truth = load(options).truth
    if truth is None:
        raise ValueError("env=meerkat has a reference set only simulated, with env.coding=bout and env.state=code")
    tracks = simulated_meerkats.simulated_tracks(REFERENCE_SEED, constrained=False)
    windows = cut_windows(code_rows(tracks, simulated_meerkats.MAPPING), tracks, options.horizon)
    return _arrays(windows, truth, "code", np.arange(len(windows.code)))


def _arrays(
    windows: Windows, truth: simulated_meerkats.Truth | None, state: str, rows: Int[np.ndarray, " M"]
) -> dict[str, np.ndarray]:
    code = windows.code[rows]
    now, after = code[:, :-1], code[:, 1:]
    if state == "place":
        obs, action = _place_obs(windows)[_place_states(windows)[rows, :-1]], now
    else:
        obs, action = np.eye(len(windows.names))[now], after
    reward, cost = _truth_arrays(truth, len(windows.names))
    return {
        "obs": obs.astype(np.float32),
        "action": action.astype(np.int32),
        "mask": np.ones(now.shape, np.float32),
        "reward": reward[now, after].astype(np.float32),
        "cost": cost[now, after].astype(np.float32),
    }
