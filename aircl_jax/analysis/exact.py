"""Plan, evaluate and compare rewards exactly, on the tables of a small world: float64 numpy, states X, actions A, steps T."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.special import logsumexp, softmax

from envs import Tabular

TIE = 1e-6  # actions within this of the best share it evenly
ROUNDING = 1e-6  # of a probability in float32
BARRED = -1e3  # stands for −∞ in a logit or a value: a choice of barred actions alone is still one


class World(NamedTuple):
    """A `Tabular` as float64 numpy, with what follows from it."""

    transition: Float[np.ndarray, "X A X"]
    reward: Float[np.ndarray, "X A"]
    start: Float[np.ndarray, " X"]
    forbidden: Bool[np.ndarray, " X"]

    @property
    def intended(self) -> Int[np.ndarray, "X A"]:
        """The likeliest successor of each action."""
        return np.asarray(self.transition.argmax(axis=-1))

    @property
    def absorbing(self) -> Bool[np.ndarray, " X"]:
        """Whether no action leads away."""
        states = np.arange(len(self.start))
        return np.asarray((self.transition[states, :, states] > 1 - ROUNDING).all(axis=-1))

    @property
    def barred(self) -> Bool[np.ndarray, "X A"]:
        """Which actions aim at what is forbidden."""
        return bar(self, self.forbidden)


class Outcome(NamedTuple):
    """What a policy comes to: E Σ_t r, and violations over s_0 … s_T, entering with the last step included."""

    expected_return: float
    violating_episodes: float  # share of episodes with any
    violating_steps: float  # share of s_1 … s_T


def world_of(table: Tabular) -> World:
    """Read a table in float32 as the decimals that it was made of, so that what ties in the world ties here."""
    transition, reward, start = (_decimals(array) for array in (table.transition, table.reward, table.start))
    return World(
        transition / transition.sum(axis=-1, keepdims=True), reward, start / start.sum(), np.asarray(table.forbidden) > 0
    )


def _decimals(array: Any) -> Float[np.ndarray, "..."]:
    """The shortest decimal that rounds to each number: 0.9925 of the float32 0.99250001."""
    return np.asarray(array).astype(str).astype(np.float64)


def bar(world: World, forbidden: Bool[np.ndarray, " X"], but_staying: bool = False) -> Bool[np.ndarray, "X A"]:
    """Mark the actions whose intended successor is one of `forbidden`; with `but_staying`, those that stay are not."""
    staying = world.intended == np.arange(len(world.start))[:, None]
    return forbidden[world.intended] & ~(staying & but_staying)


def hard_plan(
    transition: Float[np.ndarray, "X A X"],
    reward: Float[np.ndarray, "X A"],
    horizon: int,
    barred: Bool[np.ndarray, "X A"] | None = None,
) -> Float[np.ndarray, "T X A"]:
    """Plan greedily: π_t shares the best of Q_t = r + E V_{t+1} evenly, V_T = 0. Where every action is barred, all may be."""
    price = np.zeros_like(reward) if barred is None else BARRED * barred
    value, policy = np.zeros(len(reward)), np.empty((horizon, *reward.shape))
    for t in reversed(range(horizon)):
        q = reward + price + transition @ value
        value = q.max(axis=-1)
        best = q > value[:, None] - TIE
        policy[t] = best / best.sum(axis=-1, keepdims=True)
    return policy


def soft_plan(
    transition: Float[np.ndarray, "X A X"],
    reward: Float[np.ndarray, "X A"],
    horizon: int,
    barred: Bool[np.ndarray, "X A"] | None = None,
    temperature: float = 1.0,
) -> Float[np.ndarray, "T X A"]:
    """Plan softly, as `soft_value_iteration` does: π_t ∝ exp(Q_t / temperature), a barred action's logit being −1000 less."""
    price = np.zeros_like(reward) if barred is None else BARRED * barred
    return softmax(_soft_logits(transition, reward, horizon, price, temperature) + price, axis=-1)


def _soft_logits(
    transition: Float[np.ndarray, "X A X"],
    reward: Float[np.ndarray, "X A"],
    horizon: int,
    price: Float[np.ndarray, "X A"],
    temperature: float,
) -> Float[np.ndarray, "T X A"]:
    """Q_t / temperature of the plan that pays `price` for each choice from then on, of the choice at t itself not yet."""
    value, logits = np.zeros(len(reward)), np.empty((horizon, *reward.shape))
    for t in reversed(range(horizon)):
        logits[t] = (reward + transition @ value) / temperature
        value = temperature * np.asarray(logsumexp(logits[t] + price, axis=-1))
    return logits


def uniform_policy(horizon: int, states: int, actions: int) -> Float[np.ndarray, "T X A"]:
    return np.full((horizon, states, actions), 1.0 / actions)


def occupancy(
    transition: Float[np.ndarray, "X A X"], start: Float[np.ndarray, " X"], policy: Float[np.ndarray, "T X A"]
) -> Float[np.ndarray, "T1 X"]:
    """P(s_t = x) of s_0 … s_T."""
    rows = [start]
    for step in policy:
        rows.append(np.einsum("x,xa,xay->y", rows[-1], step, transition))
    return np.array(rows)


def evaluate(
    transition: Float[np.ndarray, "X A X"],
    reward: Float[np.ndarray, "X A"],
    start: Float[np.ndarray, " X"],
    forbidden: Bool[np.ndarray, " X"],
    policy: Float[np.ndarray, "T X A"],
) -> Outcome:
    """Evaluate a policy of T steps exactly: expected return, and shares of episodes and of steps with a violation."""
    visits = occupancy(transition, start, policy)
    clean = start * ~forbidden
    for step in policy:
        clean = np.einsum("x,xa,xay->y", clean, step, transition) * ~forbidden
    earned = float(np.einsum("tx,txa,xa->", visits[:-1], policy, reward))
    return Outcome(earned, float(1.0 - clean.sum()), float((visits[1:] @ forbidden).mean()))


def uniform_advantage(
    transition: Float[np.ndarray, "X A X"], reward: Float[np.ndarray, "X A"], horizon: int
) -> Float[np.ndarray, "T X A"]:
    """Q_t − V_t of the uniform policy with V_T = 0.

    It is the same for two rewards iff they differ by a shaping whose potential, of state and step, is 0 at T.
    """
    value, advantage = np.zeros(len(reward)), np.empty((horizon, *reward.shape))
    for t in reversed(range(horizon)):
        q = reward + transition @ value
        value = q.mean(axis=-1)
        advantage[t] = q - value[:, None]
    return advantage


def reachable(world: World, horizon: int) -> Bool[np.ndarray, "T X"]:
    """States that intended moves through what is allowed lead to, by step."""
    rows = [world.start > 0]
    for _ in range(horizon - 1):
        following = np.zeros(len(world.start), bool)
        following[world.intended[rows[-1]]] = True
        rows.append(following & ~world.forbidden)
    return np.array(rows)


def reward_distance(world: World, f: Float[np.ndarray, "X A"], r: Float[np.ndarray, "X A"], horizon: int) -> float:
    """√((1 − ρ) / 2), ρ the cosine of both rewards' `uniform_advantage`: 0 the same up to shaping and scale, .71 unrelated.

    Over states that are clean, reachable at that step and not absorbing, and over actions that aim at what is allowed,
    centred on those. A constant has no advantage and is unrelated to all.
    """
    counted = (reachable(world, horizon) & ~world.absorbing & ~world.forbidden)[..., None] & ~world.barred
    number = np.maximum(counted.sum(axis=-1, keepdims=True), 1)

    def canonical(reward: Float[np.ndarray, "X A"]) -> Float[np.ndarray, "T X A"]:
        advantage = uniform_advantage(world.transition, reward, horizon) * counted
        return (advantage - advantage.sum(axis=-1, keepdims=True) / number) * counted

    one, other = canonical(f), canonical(r)
    length = np.sqrt((one**2).sum() * (other**2).sum())
    cosine = (one * other).sum() / length if length > ROUNDING**2 else 0.0
    return float(np.sqrt(max(0.0, (1.0 - cosine) / 2.0)))


def true_temptation(
    world: World, horizon: int, states: Int[np.ndarray, "N T"], temperature: float = 1.0
) -> Float[np.ndarray, " X"]:
    """M_c = Σ over demonstrated (s_t, t) of Σ_{a enters c} π̃_c(a|s_t): how often c would be entered, were c alone ordinary.

    π̃_c is the constrained soft plan but for the bar of c at this one choice: what follows it is the plan's own again.
    Entering is from another state. Of an allowed c it is how often the expert enters.
    """
    size = len(world.start)
    staying = world.intended == np.arange(size)[:, None]
    shown = np.zeros((horizon, size))
    np.add.at(shown, (np.broadcast_to(np.arange(states.shape[1]), states.shape), states), 1.0)
    price = BARRED * world.barred
    logits = _soft_logits(world.transition, world.reward, horizon, price, temperature)
    tempted = np.empty(size)
    for c in range(size):
        into = world.intended == c
        policy = softmax(logits + np.where(into, 0.0, price), axis=-1)
        tempted[c] = np.einsum("tx,txa,xa->", shown, policy, into & ~staying)
    return tempted
