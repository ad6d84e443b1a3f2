"""Settings of the experts' training, and the table of what each shipped expert was trained with."""

from dataclasses import dataclass, field, replace

from aircl_jax.config import PPOConfig


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
    fall_cost: float = 1.0  # what an early end counts in training: a body that rises again for 1 falls for its convenience
    motor_limit: float = 0.0  # in training, constrained seeds' motors stop there while what was asked of them costs; 0: no stop
    chunk: int = 20  # iterations between two checkpoints
    ppo: PPOConfig = field(
        default_factory=lambda: PPOConfig(learning_rate=1e-3, clip_eps=0.2, num_epochs=5, minibatch_size=1000, discount=0.99)
    )


_DEFAULT = LagrangianConfig()
# Swimming pays late: at γ = 0.998 it stays with a gait that earns half. The weaker torques of the constraint are also
# the easier way into the fast gait, so that the unconstrained seeds begin under it (docs/experts.md).
_SWIMMER_TORQUE = replace(
    _DEFAULT,
    reward_scale=1.0,
    centred=True,
    release=0.3,
    ppo=replace(_DEFAULT.ppo, discount=0.9999, gae_lambda=0.98),
)
_SWIMMER_POSITION = replace(_DEFAULT, centred=True)
# At the fixed horizon it would rather fall than balance in the narrow band; where a fall costs 1 it falls and rises again in
# the band. A multiplier that begins low and stays moderate lets it come to the wall from both sides (docs/experts.md).
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
# With a penalty from the start σ vanishes before it can walk, and at γ = 0.99 it leaps, falls and rises again. So it learns to
# walk with motors that stop at the limit, looks 500 steps ahead, and only later must ask for no more than they give.
_WALKER = replace(
    _DEFAULT,
    iterations=700,
    reward_scale=0.01,
    restart=True,
    multiplier_init=0.02,
    multiplier_max=100.0,
    chunk=40,
    ppo=replace(_DEFAULT.ppo, learning_rate=7e-4, minibatch_size=500, discount=0.998),
)
_WALKER_TORQUE = replace(_WALKER, motor_limit=0.5)
_WALKER_POSITION = replace(_WALKER, iterations=1500)  # nothing limits its torques: it goes on getting faster

EXPERTS: dict[str, LagrangianConfig] = {
    "swimmer_torque": _SWIMMER_TORQUE,
    "swimmer_position": _SWIMMER_POSITION,
    "walker_torque": _WALKER_TORQUE,
    "walker_position": _WALKER_POSITION,
    "pendulum_position": _PENDULUM_POSITION,
}


def expert_config(env: str, constraint: str) -> LagrangianConfig:
    """The row of this task; the defaults where it has none."""
    return EXPERTS.get(f"{env}_{constraint}", _DEFAULT)
