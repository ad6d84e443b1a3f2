"""Make the labyrinth of recorded or simulated mice: 127 nodes of a binary tree, four actions, deterministic dynamics.

The tables are `emissions.npy` [recordings, steps, 2] = (node, action) and `trans_probs.npy` [node, action, node], as
packed by BRAINML-GT/SWIRL from the recordings of Rosenberg et al. 2021.
"""

import hashlib
from functools import lru_cache
from pathlib import Path
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray
from scipy.special import logsumexp

from envs.animals.data_folder import data_folder
from envs.animals.tables import read_bytes
from envs.base import Discrete, Env, Recorded, Step, Tabular
from envs.options import LabyrinthOptions
from envs.views import Maze

Split = Literal["all", "train", "held_out"]

NUM_NODES = 127
NUM_ACTIONS = 4
HOME = 0  # the entrance from the home cage; Rosenberg et al. 2021
WATER_PORT = 116  # Rosenberg et al. 2021
FOLDS = 10
NAMES = ("emissions.npy", "trans_probs.npy")

# The simulated maze. Its actions: left child, right child, parent, stay.
SIMULATED_WATER_REWARD = 1.5  # of arriving at the water port
SIMULATED_HOME_REWARD = 1.0  # of arriving at home
SIMULATED_BAIT_REWARD = 1.5  # of arriving at the bait, behind the forbidden node
SIMULATED_STAY_REWARD = -1.0
SIMULATED_FORBIDDEN = 4  # the node that simulated mice do not enter
SIMULATED_BAIT = 79  # a leaf below it
SIMULATED_RECORDINGS, SIMULATED_STEPS = 100, 500
SIMULATED_DISCOUNT = 0.9
REFERENCE_SEED = 1

MARKS = {"home": HOME, "water port": WATER_PORT}
SIMULATED_MARKS = MARKS | {"bait": SIMULATED_BAIT, "forbidden": SIMULATED_FORBIDDEN}


class Mice(NamedTuple):
    """Recordings and dynamics. Reward and forbidden nodes are NaN for real mice, because they are unknown."""

    node: Int[np.ndarray, "R L"]
    action: Int[np.ndarray, "R L"]
    successor: Int[np.ndarray, "X A"]
    reward: Float[np.ndarray, "X A"]
    forbidden: Float[np.ndarray, " X"]
    simulated: bool


def load(options: LabyrinthOptions) -> Mice:
    """Load the recordings, or simulate them. Raises ValueError, in one line with the file, for an array of another form."""
    folder = data_folder(options.data, "labyrinth")
    files = () if folder is None else tuple(_file(folder, name) for name in NAMES)
    mice = _load(files, tuple(hashlib.sha256(b"".join(read_bytes(file))).hexdigest() for file in files))
    if not 1 <= options.horizon <= mice.node.shape[1]:
        raise ValueError(f"env.horizon={options.horizon}: recordings have {mice.node.shape[1]} steps; choose 1 to that")
    return mice


@lru_cache(maxsize=2)
def _load(files: tuple[Path, ...], digests: tuple[str, ...]) -> Mice:
    """Load by content: an edited file is read again."""
    return _read(*files) if files else _simulated(0, constrained=True)


def _read(file: Path, of_dynamics: Path) -> Mice:
    emissions, probability = _array(file), _array(of_dynamics)
    if emissions.ndim != 3 or emissions.shape[2] != 2 or emissions.dtype.kind not in "iu":
        raise ValueError(f"{file}: integers [recordings, steps, 2] are needed, not {emissions.dtype} {emissions.shape}")
    node, action = emissions[..., 0].astype(np.int64), emissions[..., 1].astype(np.int64)
    for name, values, size in (("node", node, NUM_NODES), ("action", action, NUM_ACTIONS)):
        if values.min() < 0 or values.max() >= size:
            raise ValueError(f"{file}: {name} runs from {values.min()} to {values.max()}; choose 0 to {size - 1}")
    if probability.shape != (NUM_NODES, NUM_ACTIONS, NUM_NODES) or not np.isin(probability, (0, 1)).all():
        raise ValueError(f"{of_dynamics}: zeros and ones [127, 4, 127] are needed, one 1 for each pair")
    successor = probability.argmax(axis=2)
    wrong = np.argwhere(successor[node[:, :-1], action[:, :-1]] != node[:, 1:])
    if len(wrong):
        recording, step = wrong[0]
        raise ValueError(f"{file}: recording {recording}, step {step}: the next node is not where the action leads")
    return Mice(node, action, successor, np.full(successor.shape, np.nan), np.full(NUM_NODES, np.nan), simulated=False)


def _file(folder: Path, name: str) -> Path:
    files = sorted(folder.rglob(name))
    if not files:
        raise ValueError(f"{folder}: no {name} in or below it")
    return files[0]


def _array(file: Path) -> np.ndarray:
    try:
        return np.load(file, allow_pickle=False)
    except (OSError, ValueError, EOFError):
        raise ValueError(f"{file}: no whole .npy file of numbers") from None


def _tree() -> Int[np.ndarray, "X A"]:
    """List successors in a binary tree whose node n has the children 2n + 1 and 2n + 2. A move without a target stays."""
    node = np.arange(NUM_NODES)
    child = 2 * node[:, None] + np.array([1, 2])
    child = np.where(child < NUM_NODES, child, node[:, None])
    return np.concatenate([child, np.maximum((node[:, None] - 1) // 2, 0), node[:, None]], axis=1)


def _simulated(seed: int, *, constrained: bool) -> Mice:
    """Simulate mice that follow π(a|x) ∝ exp(r(x, a) + γ V(x')) from home, never into the forbidden node if constrained."""
    successor, node = _tree(), np.arange(NUM_NODES)[:, None]
    moved = successor != node
    reward = np.where(moved, 0.0, SIMULATED_STAY_REWARD)
    aims = {WATER_PORT: SIMULATED_WATER_REWARD, HOME: SIMULATED_HOME_REWARD, SIMULATED_BAIT: SIMULATED_BAIT_REWARD}
    for aim, gain in aims.items():
        reward[moved & (successor == aim)] = gain
    forbidden = (node[:, 0] == SIMULATED_FORBIDDEN).astype(float)
    barred = (forbidden[successor] > 0) & constrained
    policy = _soft_policy(successor, np.where(barred, -np.inf, reward))
    return Mice(*_walk(policy, successor, seed), successor, reward, forbidden, simulated=True)


def _soft_policy(successor: Int[np.ndarray, "X A"], reward: Float[np.ndarray, "X A"]) -> Float[np.ndarray, "X A"]:
    value = np.zeros(NUM_NODES)
    for _ in range(200):  # 0.9^200 < 1e-9
        value = np.asarray(logsumexp(reward + SIMULATED_DISCOUNT * value[successor], axis=1))
    policy = np.exp(reward + SIMULATED_DISCOUNT * value[successor] - value[:, None])
    return policy / policy.sum(axis=1, keepdims=True)


def _walk(
    policy: Float[np.ndarray, "X A"], successor: Int[np.ndarray, "X A"], seed: int
) -> tuple[Int[np.ndarray, "R L"], Int[np.ndarray, "R L"]]:
    generator = np.random.default_rng(seed)
    cumulative = np.cumsum(policy, axis=1)
    node = np.empty((SIMULATED_RECORDINGS, SIMULATED_STEPS), dtype=np.int64)
    action = np.empty_like(node)
    now = np.full(SIMULATED_RECORDINGS, HOME)
    for step in range(SIMULATED_STEPS):
        draw = generator.random((SIMULATED_RECORDINGS, 1)) * cumulative[now, -1:]
        node[:, step], action[:, step] = now, (cumulative[now] <= draw).sum(axis=1)
        now = successor[now, action[:, step]]
    return node, action


def make_labyrinth(options: LabyrinthOptions) -> Env:
    """Make the maze as tables. Only simulated mice have a true reward and a forbidden node. ValueError as from `load`."""
    mice = load(options)
    start = np.bincount(_windows(mice.node, options)[:, 0], minlength=NUM_NODES).astype(float)
    tables = (
        np.eye(NUM_NODES)[mice.successor],
        mice.reward,
        mice.forbidden,
        np.nan_to_num(mice.forbidden),
        start / start.sum(),
        np.eye(NUM_NODES),
        np.zeros(NUM_NODES),
    )
    table = Tabular(*(jnp.asarray(array, jnp.float32) for array in tables))
    successor = jnp.asarray(mice.successor)

    def reset(key: PRNGKeyArray) -> tuple[Int[Array, ""], Float[Array, " O"]]:
        state = jax.random.categorical(key, jnp.log(table.start))
        return state, table.obs[state]

    def step(key: PRNGKeyArray, state: Int[Array, ""], action: Int[Array, ""]) -> tuple[Int[Array, ""], Step]:
        after = successor[state, action]
        return after, Step(table.obs[after], table.reward[state, action], table.cost[state], jnp.zeros(()))

    return Env(
        name="labyrinth",
        horizon=options.horizon,
        obs_size=NUM_NODES,
        action_space=Discrete(NUM_ACTIONS),
        reset=reset,
        step=step,
        has_reward=mice.simulated,
        tabular=table,
        recorded=Recorded(
            demonstrations=lambda: demonstrations(options, options.split),
            reference=(lambda: reference_set(options)) if mice.simulated else None,
            simulated=mice.simulated,
        ),
        view=Maze(layout(), mice.successor, SIMULATED_MARKS if mice.simulated else MARKS),
    )


def _windows(values: Int[np.ndarray, "R L"], options: LabyrinthOptions) -> Int[np.ndarray, "N T"]:
    """Cut recordings into windows of `horizon` steps, and drop the rest at a recording's end."""
    whole = values.shape[1] // options.horizon * options.horizon
    return values[:, :whole].reshape(-1, options.horizon)


def demonstrations(options: LabyrinthOptions, split: Split = "all") -> dict[str, np.ndarray]:
    """Return obs [N, T, O], action, mask, reward, cost [N, T] of the windows; fold k holds out recordings k, k + 10, …

    Raises ValueError for a fold that does not exist.
    """
    if not 0 <= options.fold < FOLDS:
        raise ValueError(f"env.fold={options.fold}: choose 0 to {FOLDS - 1}")
    mice = load(options)
    held_out: Bool[np.ndarray, " R"] = np.arange(len(mice.node)) % FOLDS == options.fold
    chosen = {"all": np.ones(len(held_out), bool), "train": np.logical_not(held_out), "held_out": held_out}[split]
    return _arrays(mice._replace(node=mice.node[chosen], action=mice.action[chosen]), options)


def reference_set(options: LabyrinthOptions) -> dict[str, np.ndarray]:
    """Simulate windows of mice without the constraint, with their true costs. Raises ValueError for real mice."""
    if not load(options).simulated:
        raise ValueError("env=labyrinth has a reference set only simulated: the constraint of real mice is unknown")
    return _arrays(_simulated(REFERENCE_SEED, constrained=False), options)


def _arrays(mice: Mice, options: LabyrinthOptions) -> dict[str, np.ndarray]:
    node, action = _windows(mice.node, options), _windows(mice.action, options)
    return {
        "obs": np.eye(NUM_NODES, dtype=np.float32)[node],
        "action": action.astype(np.int32),
        "mask": np.ones(node.shape, np.float32),
        "reward": mice.reward[node, action].astype(np.float32),
        "cost": mice.forbidden[node].astype(np.float32),
    }


def layout() -> Float[np.ndarray, "X 2"]:
    """Place each node of an H-tree: the entrance in the middle, arms halved every second level."""
    position = np.zeros((NUM_NODES, 2))
    for node in range(1, NUM_NODES):
        level = (node + 1).bit_length() - 1
        arm = np.array([1.0, 0.0] if level % 2 else [0.0, 1.0]) * 0.5 ** ((level - 1) // 2)
        position[node] = position[(node - 1) // 2] + (arm if node % 2 == 0 else -arm)
    return position
