"""The settings that experts are trained with: rows and defaults of PPO-Lagrangian, and one rule for every other robot."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from aircl_jax.settings.lagrangian_config import LagrangianConfig
from aircl_jax.settings.learner_config import LearnerConfig, learner_config
from envs import Env
from envs.robots.tasks import ROBOTS
from envs.settings import updated

_DEFAULT = LagrangianConfig()
# Swimming pays late: at γ = 0.998 the swimmer stays with a gait that earns half. The fast gait is easier to find with the
# weaker torques of the constraint, so the unconstrained seeds begin under the constraint (docs/experts.md).
_SWIMMER_TORQUE = replace(
    _DEFAULT,
    reward_scale=1.0,
    centred=True,
    release=0.3,
    ppo=replace(_DEFAULT.ppo, discount=0.9999, gae_lambda=0.98),
)
_SWIMMER_POSITION = replace(_DEFAULT, centred=True)
# At the fixed horizon the policy falls instead of balancing in the narrow band. Where a fall costs 1, it falls and rises again
# in the band. With a multiplier that begins low and stays moderate it comes to the wall from both sides (docs/experts.md).
_PENDULUM_POSITION = replace(
    _DEFAULT,
    iterations=1000,
    num_trajectories=64,
    restart=True,
    fall_cost=20.0,
    cost_budget=1.0,
    multiplier_init=0.1,
    multiplier_rate=0.05,
    multiplier_max=15.0,
)
# With a penalty from the start σ vanishes before the walker can walk, and at γ = 0.99 it leaps, falls and rises again. So it
# learns with motors that stop at the limit and looks 500 steps ahead. The penalty on larger torques begins near 0.
_WALKER = replace(
    _DEFAULT,
    iterations=700,
    reward_scale=0.01,
    restart=True,
    multiplier_init=0.02,
    multiplier_max=100.0,
    checkpoint_every=40,
    ppo=replace(_DEFAULT.ppo, learning_rate=7e-4, minibatch_size=500, discount=0.998),
)
_WALKER_TORQUE = replace(_WALKER, motor_limit=0.5)
_WALKER_POSITION = replace(_WALKER, iterations=1500)  # with free torques it goes on getting faster

EXPERTS: dict[str, LagrangianConfig] = {
    "swimmer_torque": _SWIMMER_TORQUE,
    "swimmer_position": _SWIMMER_POSITION,
    "walker_torque": _WALKER_TORQUE,
    "walker_position": _WALKER_POSITION,
    "pendulum_position": _PENDULUM_POSITION,
}


# Every other task: the learner of the swap tests; its settings for bodies that can fall where this one can, and for others
# these. With its multiplier of 10 at the start σ vanishes before the body can run, so λ begins near 0; where actions are bound,
# motors stop at the limit meanwhile (docs/experts.md). Draws are demonstrated as they are, so λ is not bounded as in swaps. The
# seeds are its candidates.
RULE = replace(LearnerConfig(), iterations=320, candidates=1, stops=True, multiplier_init=0.1, multiplier_rate=0.03)
GROUP = 20  # episodes of each group of a reference set, where no other number is asked for
Config = LagrangianConfig | LearnerConfig


def expert_config(env: Env, constraint: str) -> Config:
    """Return the row of this task, or the rule: early ends where the body can fall, motors that stop at a torque limit.

    Worlds of other libraries have the defaults of PPO-Lagrangian: nobody says whether their bodies can fall.
    """
    if env.name not in ROBOTS:
        return _DEFAULT
    name = f"{env.name}_{constraint}"
    if name in EXPERTS:
        return EXPERTS[name]
    return RULE if env.fallen is None else replace(learner_config(env), multiplier_max=RULE.multiplier_max)


def read_config(values: Mapping[str, Any]) -> Config:
    """Read the settings that a run kept, of either learner."""
    return updated(LearnerConfig() if "candidates" in values else LagrangianConfig(), values)
