"""Frozen settings of the learner of oracles and swaps: one row for all robots, and one for those that can fall."""

from dataclasses import dataclass, field, replace

from aircl_jax.settings.train_config import PPOConfig, Scalar
from envs import Env


@dataclass(frozen=True)
class LearnerConfig:
    """Settings of the scale-free learner; the learning rate falls linearly to 0 at the last iteration."""

    iterations: int = 240
    num_trajectories: int = 16  # rollouts of `horizon` steps an iteration
    hidden: tuple[int, ...] = (32, 32)
    temperature: float = 0.0  # β of the entropy, in the reward's unit
    reward_spread: float = 0.1  # standard deviation that the normalised reward is given, so that V is of order 1 to 10
    alive_bonus: float = 0.0  # added to every step's reward, in its standard deviations, where a fall ends the episode
    candidates: int = 2  # policies that train side by side for the first `trial` of the iterations; the best one goes on
    trial: float = 0.5
    continued: float = 0.125  # probability that a rollout goes on from where one of the last iteration ended
    cost_discount: float = 0.99
    cost_budget: float = 0.01  # d: violating steps a rollout
    multiplier_init: float = 10.0
    multiplier_rate: float = 0.02
    multiplier_max: float = 1000.0
    release: float = 0.0  # share of the iterations for which unconstrained seeds keep the constraint
    released_log_std_max: float = -1.2  # upper bound of log σ of unconstrained seeds: σ ≤ .3
    stray_cost: Scalar = 0.0  # of a step after which the world starts anew, in standard deviations of the reward
    most_strays: float = 1e9  # in practice: where a rollout starts anew more often, λ falls
    strays_bootstrap: bool = False  # whether V of where such a step leads counts, as at a time limit; else nothing follows it
    restart: bool = False  # a body that falls gets up within the rollout, which costs a step; judged at the fixed horizon
    stops: bool = False  # motors stop at the limits of actions, and for good where these count; asking for more costs
    ppo: PPOConfig = field(
        default_factory=lambda: PPOConfig(
            learning_rate=3e-3,
            clip_eps=0.2,
            num_epochs=5,
            minibatch_size=1000,
            discount=0.9999,
            gae_lambda=0.98,
            log_std_min=-3.5,
        )
    )


STEPS = 8_000  # in an iteration of a body that can fall, whatever its horizon
NOISY_SHARE = 0.01  # of the steps that may violate a limit of states: one of actions can always be kept, noise or not


# Toppling forward moves x faster than walking does at first, and practice puts the body back on its feet. So a body that can
# fall is paid for every step that it stands, five standard deviations of the reward, and looks 200 steps ahead. λ begins near 0
# and motors stop meanwhile, for σ would vanish before it can walk (docs/learner.md).
FALLING = replace(
    LearnerConfig(),
    iterations=600,
    candidates=1,
    stops=True,
    restart=True,
    alive_bonus=5.0,
    reward_spread=0.03,
    multiplier_init=0.02,
    ppo=replace(LearnerConfig().ppo, discount=0.995),
)


def learner_config(env: Env, *, constrained: bool = True) -> LearnerConfig:
    """Return this world's settings; without a constraint one is kept at first, and bodies that cannot fall practise longer."""
    if env.fallen is not None:
        config = replace(FALLING, num_trajectories=max(1, STEPS // env.horizon), release=0.0 if constrained else 0.3)
        if env.limit is not None and env.limit.bounds == "actions":
            return replace(config, cost_discount=0.0, multiplier_max=0.3)  # charged later, it is no fault of this action
        return replace(
            config,
            iterations=800,
            stops=False,
            cost_budget=NOISY_SHARE * env.horizon,  # so that λ falls as readily as it rises
            multiplier_init=0.1,
            multiplier_rate=0.05,
            multiplier_max=15.0,
        )
    if constrained:
        return LearnerConfig()
    longer = int(2.5 * LearnerConfig().iterations)
    return replace(LearnerConfig(), iterations=longer, release=0.3, multiplier_init=1.0, multiplier_rate=0.03)
