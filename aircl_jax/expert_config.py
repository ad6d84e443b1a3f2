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
    chunk: int = 20  # iterations between two checkpoints
    ppo: PPOConfig = field(
        default_factory=lambda: PPOConfig(learning_rate=1e-3, clip_eps=0.2, num_epochs=5, minibatch_size=1000, discount=0.99)
    )


_DEFAULT = LagrangianConfig()
# Swimming pays late: at γ = 0.99 it stays with a gait that earns a third (docs/experts.md).
_SWIMMER = replace(
    _DEFAULT,
    reward_scale=1.0,
    centred=True,
    ppo=replace(_DEFAULT.ppo, discount=0.9999, gae_lambda=0.98),
)

EXPERTS: dict[str, LagrangianConfig] = {"swimmer_torque": _SWIMMER}


def expert_config(env: str, constraint: str) -> LagrangianConfig:
    """The row of this task; the defaults where it has none."""
    return EXPERTS.get(f"{env}_{constraint}", _DEFAULT)
