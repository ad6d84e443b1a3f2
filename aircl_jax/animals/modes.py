"""Fit hidden modes of walking by EM: each has a reward of places and habits of turning; a mode may change on arrival.

π_z(y | s) ∝ exp(r_z(y) + w_z · habits(s, y)) over the nodes y in reach of heading s; P(z' | z, node arrived at).
The reward is of the next node alone: planning ahead predicts these mice no better (docs/animals.md).
"""

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from aircl_jax.animals.maze import HABITS, Walks, Ways
from aircl_jax.animals.minimise import minimise

REWARD_RIDGE, HABIT_RIDGE, DEPTH_RIDGE = 3.0, 0.1, 1.0
SWITCH_PSEUDO = 20.0  # pseudo-arrivals by which a node's changes of mode are drawn to those of all nodes
STAY_PSEUDO, ANY_PSEUDO = 5.0, 0.5  # pseudo-steps of going on in a mode, and of any change
HINDSIGHT = 14  # steps before a visit that count as the way there, for the named start
RANDOM_BLOCK = 10  # steps of one random draw of modes
ROUGH, FINE = 1e-2, 1e-4  # precision of the fits within a round, and of the last
Start = Literal["named", "random"]


class Modes(NamedTuple):
    """What EM found; Z modes."""

    reward: Float[np.ndarray, "Z N"]
    habits: Float[np.ndarray, "Z F"]
    first: Float[np.ndarray, " Z"]
    switch: Float[np.ndarray, "N Z Z"]  # P(z' | z) on arrival at a node
    share: Float[np.ndarray, " Z"]  # of the steps
    nats: float  # per step, of the recordings fitted to


def modes_loss(weights: Mapping[str, Any], data: Mapping[str, Any]) -> Float[Array, ""]:
    """−Σ_zsy n_z(s, y) log π_z(y | s) + ½ Σ λ θ²; n are the moves of each mode as expected in the E step."""
    logits = jnp.where(data["exists"], _logits(weights, data), -jnp.inf)
    log_policy = jax.nn.log_softmax(logits, axis=-1)
    nats = -(data["moves"] * jnp.where(data["exists"], log_policy, 0.0)).sum()
    return nats + 0.5 * (REWARD_RIDGE * (weights["reward"] ** 2).sum() + (data["ridge"] * weights["habits"] ** 2).sum())


def _logits(weights: Mapping[str, Any], data: Mapping[str, Any]) -> Float[Array, "Z X V"]:
    return weights["reward"][:, data["target"]] + jnp.einsum("svf,zf->zsv", data["features"], weights["habits"])


def fit_modes(
    ways: Ways, walks: Walks, number: int, rounds: int, start: Start, seed: int = 0, aims: tuple[int, int] = (0, 0)
) -> Modes:
    """Run EM from the named start (on the way to `aims`, the water port and home, else) or from random modes."""
    generator = np.random.default_rng(seed)
    modes = _named(walks, number, aims, generator) if start == "named" else _random(walks, number, generator)
    switches = np.zeros((ways.num_nodes, number, number))
    pairs = modes[:, :-1, :, None] * modes[:, 1:, None, :]
    np.add.at(switches, walks.node[:, 1:], pairs)
    weights = {"reward": np.zeros((number, ways.num_nodes)), "habits": np.zeros((number, ways.habits.shape[-1]))}
    fitted, plain = None, len(HABITS)
    ridge = np.append(np.full(plain, HABIT_RIDGE), np.full(ways.habits.shape[-1] - plain, DEPTH_RIDGE))
    data = {"target": ways.target, "exists": ways.exists, "features": ways.habits, "ridge": ridge}
    for turn in range(1, rounds + 1):
        moves = np.zeros((*ways.target.shape, number))
        np.add.at(moves, (walks.state, walks.move), modes)
        weights, _ = minimise(
            modes_loss, weights, data | {"moves": np.moveaxis(moves, -1, 0)}, FINE if turn == rounds else ROUGH
        )
        first = (modes[:, 0].sum(axis=0) + 1) / (len(modes) + number)
        switch = _switch(switches)
        with jax.enable_x64(True):
            found = jax.device_get(_smooth(log_policy(ways, weights), first, switch, walks.state, walks.move, walks.node))
        nats, modes, switches = found
        fitted = Modes(weights["reward"], weights["habits"], first, switch, modes.mean(axis=(0, 1)), float(nats.mean()))
    if fitted is None:
        raise ValueError(f"rounds={rounds}: EM needs at least 1")
    return fitted


def _switch(counts: Float[np.ndarray, "N Z Z"]) -> Float[np.ndarray, "N Z Z"]:
    """Turn expected changes of mode at each node into probabilities, drawn to those of all nodes together."""
    everywhere = counts.sum(axis=0) + ANY_PSEUDO + STAY_PSEUDO * np.eye(counts.shape[1])
    everywhere /= everywhere.sum(axis=1, keepdims=True)
    return (counts + SWITCH_PSEUDO * everywhere) / (counts.sum(axis=2, keepdims=True) + SWITCH_PSEUDO)


def log_policy(ways: Ways, weights: Mapping[str, Any]) -> Float[np.ndarray, "Z X V"]:
    """Compute log π_z(y | s) of every mode, heading and option; −inf where there is no option."""
    data = {"target": ways.target, "features": ways.habits}
    with jax.enable_x64(True):
        logits = _logits(jax.tree.map(jnp.asarray, weights), jax.tree.map(jnp.asarray, data))
        return np.asarray(jax.nn.log_softmax(jnp.where(ways.exists, logits, -jnp.inf), axis=-1))


def predict(ways: Ways, walks: Walks, modes: Modes) -> Float[np.ndarray, "R T"]:
    """Compute the log-probability of every move given the moves before it; the mode is inferred from these."""
    policy = log_policy(ways, {"reward": modes.reward, "habits": modes.habits})
    with jax.enable_x64(True):
        return np.asarray(_filter(policy, modes.first, modes.switch, walks.state, walks.move, walks.node)[0])


@jax.jit
def _filter(
    policy: Float[Array, "Z X V"],
    first: Float[Array, " Z"],
    switch: Float[Array, "N Z Z"],
    state: Int[Array, "R T"],
    move: Int[Array, "R T"],
    node: Int[Array, "R T"],
) -> tuple[Float[Array, "R T"], Float[Array, "R T Z"], Float[Array, "R T Z"]]:
    """Run the forward pass: log P(move_t | before), P(mode_t | moves up to t), and each step's likelihood by mode, scaled."""
    likelihood = jnp.exp(jnp.moveaxis(policy[:, state, move], 0, -1))

    def step(before: Float[Array, "R Z"], now: tuple[Array, Array]) -> tuple[Array, tuple[Array, Array]]:
        joint = before * now[0]
        total = joint.sum(axis=-1)
        after = joint / total[:, None]
        return jnp.einsum("rz,rzy->ry", after, switch[now[1]]), (jnp.log(total), after)

    begin = jnp.broadcast_to(first, (len(state), len(first)))
    following = jnp.concatenate([node[:, 1:], node[:, -1:]], axis=1)  # the mode may change on arrival at the next node
    _, (nats, filtered) = jax.lax.scan(step, begin, (likelihood.swapaxes(0, 1), following.T))
    return nats.T, filtered.swapaxes(0, 1), likelihood


@jax.jit
def _smooth(
    policy: Float[Array, "Z X V"],
    first: Float[Array, " Z"],
    switch: Float[Array, "N Z Z"],
    state: Int[Array, "R T"],
    move: Int[Array, "R T"],
    node: Int[Array, "R T"],
) -> tuple[Float[Array, "R T"], Float[Array, "R T Z"], Float[Array, "N Z Z"]]:
    """Run forward and backward passes: log P(move_t | before), P(mode_t | all moves), changes of mode by node arrived at."""
    nats, filtered, likelihood = _filter(policy, first, switch, state, move, node)
    scaled = likelihood / jnp.exp(nats)[:, :, None]

    def step(after: Float[Array, "R Z"], now: tuple[Array, ...]) -> tuple[Array, tuple[Array, Array]]:
        before, weight, arrived = now  # P(mode_{t−1} | moves up to t − 1), scaled likelihood at t, node at t
        onward = switch[arrived] * (weight * after)[:, None, :]
        pair = before[:, :, None] * onward
        return onward.sum(axis=-1), (onward.sum(axis=-1), pair)

    moved = (filtered[:, :-1], scaled[:, 1:])
    begin = jnp.ones_like(filtered[:, 0])
    inputs = (*(part.swapaxes(0, 1) for part in moved), node[:, 1:].T)
    _, (later, pairs) = jax.lax.scan(step, begin, inputs, reverse=True)
    whole = filtered[:, :-1] * later.swapaxes(0, 1)
    modes = jnp.concatenate([whole, filtered[:, -1:]], axis=1)
    switches = jnp.zeros_like(switch).at[node[:, 1:].T].add(pairs)
    return nats, modes / modes.sum(axis=-1, keepdims=True), switches


def _random(walks: Walks, number: int, generator: np.random.Generator) -> Float[np.ndarray, "R T Z"]:
    recordings, steps = walks.state.shape
    draws = generator.dirichlet(np.full(number, 0.3), size=(recordings, steps // RANDOM_BLOCK + 1))
    return draws.repeat(RANDOM_BLOCK, axis=1)[:, :steps]


def _named(walks: Walks, number: int, aims: tuple[int, int], generator: np.random.Generator) -> Float[np.ndarray, "R T Z"]:
    """Begin with a mode on the way to each aim, by hindsight, and the rest of the steps among the other modes at random."""
    recordings, steps = walks.node.shape
    towards = np.full((recordings, steps, 3), 0.12)
    for mode, aim in enumerate(aims):
        ahead = np.full(recordings, np.inf)
        for step in range(steps - 1, -1, -1):
            towards[:, step, mode] += 2.0 * (ahead - step <= HINDSIGHT)
            ahead = np.where(walks.node[:, step] == aim, step, ahead)
    towards[:, :, 2] += towards.max(axis=-1) < 1
    towards /= towards.sum(axis=-1, keepdims=True)
    rest = _random(walks, number - 2, generator)
    return np.concatenate([towards[:, :, :2], towards[:, :, 2:] * rest], axis=-1)
