"""Frozen settings of PPO-Lagrangian, by which experts are trained."""

from dataclasses import dataclass, field

from aircl_jax.settings.train_config import PPOConfig


@dataclass(frozen=True)
class LagrangianConfig:
    """PPO-Lagrangian's settings; the learning rate falls linearly to 0 at the last iteration."""

    iterations: int = 320
    num_trajectories: int = 16  # rollouts of `horizon` steps an iteration
    hidden: tuple[int, ...] = (32, 32)  # as wide as the policies that will imitate
    reward_scale: float = 0.1  # multiplies the reward, so that the critic's targets are of order 1 to 10
    centred: bool = False  # subtract the mean reward, so that V stays small at discounts near 1 (only where nothing ends)
    cost_discount: float = 0.99
    cost_budget: float = 0.01  # d: violating steps an episode
    multiplier_init: float = 1.0
    multiplier_rate: float = 0.02
    multiplier_max: float = 200.0  # with a budget near 0 the multiplier only rises
    release: float = 0.0  # share of the iterations after which the unconstrained seeds lose the constraint
    restart: bool = False  # train with Gymnasium's early end, getting up within the rollout; judged at the fixed horizon
    fall_cost: float = 1.0  # cost of a fall during training; at 1, falling and resetting is cheaper than balancing
    motor_limit: float = 0.0  # in training, constrained seeds' motors stop there while what was asked of them costs; 0: no stop
    checkpoint_every: int = 20  # iterations between two checkpoints
    ppo: PPOConfig = field(
        default_factory=lambda: PPOConfig(learning_rate=1e-3, clip_eps=0.2, num_epochs=5, minibatch_size=1000, discount=0.99)
    )
