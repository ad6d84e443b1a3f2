"""Frozen settings of the learner of oracles and swaps, and the one row of settings that all robots share."""

from dataclasses import dataclass, field, replace

from aircl_jax.settings.train_config import PPOConfig


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
    stray_cost: float = 0.0  # of a step after which the world starts anew, in standard deviations of the reward
    most_strays: float = 1e9  # in practice: where a rollout starts anew more often, λ falls
    strays_bootstrap: bool = False  # whether V of where such a step leads counts, as at a time limit; else nothing follows it
    restart: bool = False  # practise with Gymnasium's early end, getting up within the rollout; judged at the fixed horizon
    fall_cost: float = 1.0  # cost of a fall in practice
    motor_limit: float = 0.0  # constrained seeds practise with motors that stop there; asking for more costs; 0: no stop
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


LEARNERS: dict[str, LearnerConfig] = {"swimmer": LearnerConfig()}


def learner_config(env: str, *, constrained: bool = True) -> LearnerConfig:
    """Return the settings of this robot; without a constraint the seeds practise longer, and keep it mildly at first."""
    config = LEARNERS.get(env, LearnerConfig())
    if constrained:
        return config
    return replace(config, iterations=int(2.5 * config.iterations), release=0.3, multiplier_init=1.0, multiplier_rate=0.03)
