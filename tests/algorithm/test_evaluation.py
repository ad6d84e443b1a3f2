"""Every number of an evaluation, worked out again episode by episode and step by step, on scripted episodes."""

from dataclasses import replace
from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.algorithm import evaluation, scoring
from aircl_jax.algorithm.sampler import SAMPLERS
from aircl_jax.algorithm.trainer import observation_stats
from aircl_jax.model.networks import Networks
from aircl_jax.reports.summary import MEANINGS
from aircl_jax.settings.train_config import Coefficients
from aircl_jax.types import Params, Scores, Thresholds, TrainState, Trajectory
from tests.worlds import TINY, UNOPTIMISED, naive, random_trajectories, sigmoid, table_of, tiny_grid, tiny_networks

NUMBER = 8
TEMPERATURE = 0.5
COEFFICIENTS = Coefficients(threshold=0.7, sharpness=1.5)
LOG_STEP, LOG_SEQUENCE = -0.9, 0.4  # calibrated thresholds, which are neither each other's nor log 0.7
FLOOR = np.exp(-10.0)  # of each factor of the corrected δ̄
WHOLE = 20.0  # the grid's return on the way to its goal
SEEDS = {"aircl_corrected": 4, "aircl_sa": 2, "gacl": 4, "bc": 1}  # of weights with which no share is 0 or 1


def worst_first(log_delta, number, key):
    """A sampler that needs no luck: the less feasible half, each episode twice."""
    return jnp.argsort(log_delta)[jnp.arange(number) // 2]


def reaching(trajectories: Trajectory, number: int) -> Trajectory:
    """The first `number` episodes made to return exactly the whole way, before their end."""
    returns = (trajectories.reward * trajectories.mask).sum(axis=1)
    missing = jnp.where(jnp.arange(len(returns)) < number, WHOLE - returns, 0.0)
    return trajectories._replace(reward=trajectories.reward.at[:, 0].add(missing))


def behaving(trajectories: Trajectory, number: int) -> Trajectory:
    """The first `number` episodes made to violate only after their end."""
    ended = jnp.where(jnp.arange(len(trajectories.mask))[:, None] < number, 1.0 - trajectories.mask, trajectories.cost)
    return trajectories._replace(cost=ended)


@cache
def setting(row: str) -> tuple[Networks, Params, Any, dict[str, Trajectory]]:
    env = tiny_grid(slip=0.2)
    config = replace(TINY, num_evaluation=NUMBER, temperature=TEMPERATURE, coefficients=COEFFICIENTS)
    nets, params = tiny_networks(env, row, config)
    random = np.random.default_rng(SEEDS[row])
    params = jax.tree.map(lambda leaf: jnp.asarray(random.normal(size=leaf.shape), jnp.float32), params)
    params = params._replace(thresholds=Thresholds(jnp.float32(LOG_STEP), jnp.float32(LOG_SEQUENCE)))
    sets = {
        "expert": reaching(random_trajectories(env, 0, 5), 2),
        "policy": behaving(reaching(random_trajectories(env, 1, NUMBER), 3), 4),
        "reference": behaving(random_trajectories(env, 10, 12), 6),
    }
    return nets, params, observation_stats(sets["expert"]), sets


@cache
def found(row: str) -> dict[str, float]:
    nets, params, stats, sets = setting(row)
    state = TrainState(params, None, None, stats, sets["policy"], jax.random.key(3), jnp.asarray(7, jnp.int32))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scoring, "rollouts", lambda *_: sets["policy"])
        patch.setitem(SAMPLERS, "resample", worst_first)
        evaluate = jax.jit(partial(evaluation.evaluate, nets), compiler_options=UNOPTIMISED)
        return {name: float(value) for name, value in evaluate(state, sets["expert"], sets["reference"]).items()}


class Episode:
    """One trajectory up to its end, as float64 numpy: what was recorded, and what a row's networks say of it."""

    def __init__(self, recorded: Trajectory, said: Scores, row: str) -> None:
        length = int(recorded.mask.sum())
        self.reward, self.cost, self.log_prob, self.obs = (
            np.asarray(x, np.float64)[:length] for x in (recorded.reward, recorded.cost, recorded.log_prob, recorded.obs)
        )
        self.f, self.log_pi, self.step_logit = (np.asarray(x)[:length] for x in (said.f, said.log_pi, said.step_logit))
        self.sequence_logit, self.row = float(said.sequence_logit), row

    @property
    def delta(self) -> float:
        """δ̄(τ): in the corrected row both factors at their calibrated thresholds, the least step for all of them."""
        if self.row == "aircl_corrected":
            by_step = max(sigmoid(1.5 * (self.step_logit.min() - LOG_STEP)), FLOOR)
            return by_step * max(sigmoid(1.5 * (self.sequence_logit - LOG_SEQUENCE)), FLOOR)
        return 1.0 if self.row in {"bc", "airl"} else float(np.prod(sigmoid(self.step_logit)))

    @property
    def logits(self) -> np.ndarray:
        """What D says before any centring: of the whole trajectory, or of each step."""
        if self.row == "aircl_corrected":
            return self.f - TEMPERATURE * self.log_pi
        return np.array([(self.f - self.log_pi).sum()]) if self.row == "aircl_sa" else self.step_logit


@cache
def episodes(row: str, name: str) -> list[Episode]:
    nets, params, stats, sets = setting(row)
    one = sets[name]
    log_pi = jax.vmap(nets.bind(params, stats).log_pi)(one)
    said = naive(jax.vmap(nets.bind(params, stats).scores)(one, log_pi))

    def number(tree: Any, i: int) -> Any:
        return jax.tree.map(lambda leaf: leaf[i], tree)

    return [Episode(number(one, i), number(said, i), row) for i in range(len(one.mask))]


def mean(values) -> float:
    return float(np.mean(np.asarray(values, np.float64)))


def steps(of: str, many: list[Episode]) -> np.ndarray:
    return np.concatenate([getattr(one, of) for one in many])


def chance_above(positive, negative) -> float:
    return mean([(p > n) + 0.5 * (p == n) for p in positive for n in negative])


def verdicts(row: str, sampled: list[Episode]) -> dict[str, float]:
    if row == "bc":
        return dict.fromkeys(("rc_acc", "balanced_acc", "logit_size"), np.nan)
    expert = episodes(row, "expert")
    means = [mean([mean(one.logits) for one in many]) for many in (expert, sampled)]
    centre = mean(means) if row == "aircl_corrected" else 0.0
    of_expert, of_sampled = ([one.logits - centre for one in many] for many in (expert, sampled))
    taken, spotted = mean([mean(x) > 0 for x in of_expert]), mean([mean(x) < 0 for x in of_sampled])
    assert len({0.0, 1.0, taken, spotted}) == 4  # else this would not tell one from the other
    return {
        "rc_acc": taken,
        "balanced_acc": (taken + spotted) / 2,
        "logit_size": (mean([mean(abs(x)) for x in of_expert]) + mean([mean(abs(x)) for x in of_sampled])) / 2,
    }


def violation_of_the_reward_alone(row: str) -> float:
    """Soft value iteration on f alone, state by state, and the chance to be in an obstacle at each step."""
    nets, params, stats, _ = setting(row)
    if not nets.method.learns_reward:
        return np.nan
    table = table_of(nets.env)
    states, actions, horizon = range(9), range(4), nets.env.horizon
    move = np.asarray(table.transition, np.float64)
    f = np.array([[float(nets.bind(params, stats).reward(jnp.eye(9)[x], jnp.asarray(a))) for a in actions] for x in states])
    temperature = TEMPERATURE if row == "aircl_corrected" else 1.0  # of the paper's rows
    value, policies = np.zeros(9), []
    for _ in range(horizon):
        q = np.array([[f[x, a] + move[x, a] @ value for a in actions] for x in states])
        value = temperature * np.log(np.exp(q / temperature).sum(axis=1))
        policies.insert(0, np.exp((q - value[:, None]) / temperature))
    at, inside = np.asarray(table.start, np.float64), []
    for policy in policies:
        inside.append(at[4])  # the one obstacle, [1, 1]
        at = np.array([at[x] * policy[x, a] * move[x, a] for x in states for a in actions]).sum(axis=0)
    return mean(inside)


@cache
def by_hand(row: str) -> dict[str, float]:
    expert, policy, reference = (episodes(row, name) for name in ("expert", "policy", "reference"))
    worst = sorted(policy, key=lambda one: one.delta)[: NUMBER // 2]
    sampled = [one for one in worst for _ in range(2)] if row in {"aircl_corrected", "aircl_sa"} else policy
    clean, dirty = ([one for one in reference if (one.cost.sum() > 0) == bad] for bad in (False, True))
    judged = row != "bc"  # whether there is a feasibility at all
    learns = row in {"aircl_corrected", "aircl_sa"}
    seen = [steps("obs", many).mean(axis=0) for many in (expert, policy)]
    weight = np.array([one.delta for one in policy])

    def agreement(many: list[Episode]) -> float:
        allowed = steps("cost", many) == 0
        return float(np.corrcoef(steps("f", many)[allowed], steps("reward", many)[allowed])[0, 1]) if learns else np.nan

    return {
        "violation_rate": mean(steps("cost", sampled)),
        "violation_rate_policy": mean(steps("cost", policy)),
        "violation_rate_expert": mean(steps("cost", expert)),
        "infeasible_share": mean([one.cost.any() for one in sampled]),
        "infeasible_share_policy": mean([one.cost.any() for one in policy]),
        "return": mean([one.reward.sum() for one in policy]),
        "return_sampled": mean([one.reward.sum() for one in sampled]),
        "expert_return": mean([one.reward.sum() for one in expert]),
        "feasible_return": mean([one.reward[: [*one.cost, 1].index(1)].sum() for one in policy]),
        "goal_rate": 3 / 8,
        "expert_goal_rate": 2 / 5,
        "effective_sample_size": weight.sum() ** 2 / (NUMBER * (weight**2).sum()),
        "feasibility_expert": mean([one.delta for one in expert]),
        "feasibility_policy": mean(weight),
        "entropy": -mean(steps("log_prob", policy)),
        **verdicts(row, sampled),
        "feasibility_auroc": chance_above(*([one.delta for one in many] for many in (clean, dirty))) if judged else np.nan,
        "feasibility_gap": mean([one.delta for one in clean]) - mean([one.delta for one in dirty]) if judged else np.nan,
        "step_feasibility_auroc": chance_above(
            *(steps("step_logit", reference)[steps("cost", reference) == bad] for bad in (0, 1))
        )
        if judged
        else np.nan,
        "reward_correlation": agreement(policy),
        "reward_correlation_reference": agreement(reference),
        "violation_reward_only": violation_of_the_reward_alone(row),
        "occupancy_tv": 0.5 * np.abs(seen[0] - seen[1]).sum(),
        "log_std_at_bound": np.nan,  # actions are discrete
    }


@pytest.mark.parametrize("row", SEEDS)
def test_an_evaluation_has_all_numbers_that_a_report_explains_and_no_other(row):
    assert set(found(row)) == set(MEANINGS)


@pytest.mark.parametrize("name", MEANINGS)
@pytest.mark.parametrize("row", SEEDS)
def test_the_number_of_an_evaluation_is_that_of_its_episodes_one_by_one(row, name):
    np.testing.assert_allclose(found(row)[name], by_hand(row)[name], rtol=2e-4, atol=1e-5)
