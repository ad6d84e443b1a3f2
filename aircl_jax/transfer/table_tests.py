"""The swap tests on a grid, exactly: plan on what was learned, here and in changed worlds, and compare with the truth.

A score is (J − J_u) / (J* − J_u): 0 of the uniform policy, 1 of the plan on the true reward and constraint. Violations are
shares of episodes, less those of that plan. Cells with δ₁ below ½ are barred from the plans.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from aircl_jax.analysis import exact
from aircl_jax.analysis.changed_grids import changed_worlds, other_rewards
from aircl_jax.analysis.exact import Outcome, World
from envs.gridworld import make_gridworld
from envs.layouts import LAYOUTS
from envs.options import GridOptions

LEAST_GAIN = 0.05  # of J* − J_u that a lift must be able to earn, else it is undefined


class Learned(NamedTuple):
    """What one seed has learned of a grid; None where its method does not learn it.

    The reward is asked for in each world, since that of a step may depend on where it leads.
    """

    reward: Callable[[World], Float[np.ndarray, "X A"]] | None
    forbids: Bool[np.ndarray, " X"] | None
    policy: Float[np.ndarray, "T X A"]  # used as it is where there is no reward


class Case(NamedTuple):
    """A world with its horizon and the outcomes that scores are made from."""

    world: World
    horizon: int
    best: Outcome  # of the plan on the true reward and constraint
    uniform: Outcome

    def score(self, outcome: Outcome) -> float:
        """(J − J_u) / (J* − J_u)."""
        gain = self.best.expected_return - self.uniform.expected_return
        return (outcome.expected_return - self.uniform.expected_return) / gain

    def excess(self, outcome: Outcome) -> float:
        """The share of episodes with a violation, less that of the best plan."""
        return outcome.violating_episodes - self.best.violating_episodes


@cache
def case(options: GridOptions) -> Case:
    """Make the world of these settings and plan on its truth."""
    env = make_gridworld(options.resolved())
    if env.tabular is None:
        raise TypeError(f"{env.name} is no table")
    world = exact.world_of(env.tabular)
    best = exact.hard_plan(world.transition, world.reward, env.horizon, world.barred)
    uniform = exact.uniform_policy(env.horizon, *world.reward.shape)
    return Case(world, env.horizon, exact.evaluate(*world, best), exact.evaluate(*world, uniform))


def true_reward(world: World) -> Float[np.ndarray, "X A"]:
    """Return the world's own reward."""
    return world.reward


def plan(learned: Learned, at: Case, barred: bool = True) -> Outcome:
    """Plan on the learned reward under the learned constraint; without a reward, use the policy as it is."""
    if learned.reward is None:
        steps = np.minimum(np.arange(at.horizon), len(learned.policy) - 1)
        return exact.evaluate(*at.world, learned.policy[steps])
    blocked = exact.bar(at.world, learned.forbids, but_staying=True) if barred and learned.forbids is not None else None
    return exact.evaluate(*at.world, exact.hard_plan(at.world.transition, learned.reward(at.world), at.horizon, blocked))


def measures(options: GridOptions, learned: Learned) -> dict[str, float]:
    """Measure one seed by every swap test, NaN where its method has nothing to test."""
    base = case(options)
    same = plan(learned, base)
    elsewhere = {name: case(changed) for name, changed in changed_worlds(options).items()}
    outcomes = {name: plan(learned, at) for name, at in elsewhere.items()}
    scores = {name: at.score(outcomes[name]) for name, at in elsewhere.items()}
    return {
        "self_return": base.score(same),
        "self_violation": base.excess(same),
        "transfer_return": float(np.mean(list(scores.values()))),
        "transfer_return_worst": min(scores.values()),
        "transfer_violation": float(np.mean([at.excess(outcomes[name]) for name, at in elsewhere.items()])),
        **_constraint_transfer(options, learned),
        **_reward_transfer(options, learned),
        **_separation(options, base, learned),
        **_constraint(base, learned),
    }


def by_world(options: GridOptions, learned: Learned) -> dict[str, tuple[float, float]]:
    """{changed world: (score, extra violations)} of one seed."""
    elsewhere = {name: case(changed) for name, changed in changed_worlds(options).items()}
    outcomes = {name: plan(learned, at) for name, at in elsewhere.items()}
    return {name: (at.score(outcomes[name]), at.excess(outcomes[name])) for name, at in elsewhere.items()}


def _constraint_transfer(options: GridOptions, learned: Learned) -> dict[str, float]:
    """S2: other, known rewards under the learned constraint."""
    names = ("constraint_transfer_return", "constraint_transfer_violation")
    if learned.forbids is None:
        return dict.fromkeys(names, np.nan)
    others = [case(other) for other in other_rewards(options).values()]
    known = learned._replace(reward=true_reward)
    outcomes = [plan(known, at) for at in others]
    pairs = list(zip(others, outcomes, strict=True))
    values = (np.mean([at.score(one) for at, one in pairs]), np.mean([at.excess(one) for at, one in pairs]))
    return {name: float(value) for name, value in zip(names, values, strict=True)}


def _reward_transfer(options: GridOptions, learned: Learned) -> dict[str, float]:
    """S3: the learned reward under another, known constraint."""
    if learned.reward is None:
        return {"reward_transfer_return": np.nan}
    try:
        at = case(other_constraint(options))
    except ValueError:  # the other obstacles leave no clean path, or cover the start
        return {"reward_transfer_return": np.nan}
    policy = exact.hard_plan(at.world.transition, learned.reward(at.world), at.horizon, at.world.barred)
    return {"reward_transfer_return": at.score(exact.evaluate(*at.world, policy))}


def other_constraint(options: GridOptions) -> GridOptions:
    """The obstacles of another layout of the same size; where there is none, the own ones mirrored at the diagonal."""
    base = options.resolved()
    others = [
        layout.obstacles for layout in LAYOUTS.values() if layout.size == base.size and layout.obstacles != base.obstacles
    ]
    second = LAYOUTS["second"].obstacles
    mirrored = tuple((column, row) for row, column in base.obstacles)
    return replace(base, obstacles=second if second in others else (others or [mirrored])[0])


def _separation(options: GridOptions, base: Case, learned: Learned) -> dict[str, float]:
    """S1: the learned reward alone, and its distance from the true one."""
    if learned.reward is None:
        return dict.fromkeys(("lift", "lift_violation", "split", "reward_distance"), np.nan)
    world, reward = base.world, learned.reward(base.world)
    alone = plan(learned, base, barred=False)
    free = exact.evaluate(*world, exact.hard_plan(world.transition, world.reward, base.horizon))
    gain = free.expected_return - base.best.expected_return
    able = gain > LEAST_GAIN * (base.best.expected_return - base.uniform.expected_return)
    temperature = options.temperature
    soft = [
        exact.evaluate(*world, exact.soft_plan(world.transition, paid, base.horizon, temperature=temperature)).violating_steps
        for paid in (reward, world.reward)
    ]
    return {
        "lift": (alone.expected_return - base.best.expected_return) / gain if able else np.nan,
        "lift_violation": _ratio(alone.violating_episodes, free.violating_episodes),
        "split": _ratio(*soft),
        "reward_distance": exact.reward_distance(world, reward, world.reward, base.horizon),
    }


def _constraint(base: Case, learned: Learned) -> dict[str, float]:
    """Precision, recall and intersection over union of the forbidden cells; a sure start and absorbing cells are left out."""
    names = ("constraint_precision", "constraint_recall", "constraint_iou")
    if learned.forbids is None:
        return dict.fromkeys(names, np.nan)
    counted = ~base.world.absorbing & (base.world.start < 1)
    flagged, true = learned.forbids & counted, base.world.forbidden & counted
    both = float((flagged & true).sum())
    return {
        "constraint_precision": _ratio(both, float(flagged.sum())),
        "constraint_recall": _ratio(both, float(true.sum())),
        "constraint_iou": _ratio(both, float((flagged | true).sum())),
    }


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole > 0 else float("nan")
