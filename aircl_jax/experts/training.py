"""The two learners that experts are trained by, behind one shape: PPO-Lagrangian, and the learner of the swap tests."""

from jaxtyping import Array, Float

from aircl_jax.algorithm.learners.lagrangian import Lagrangian, LagrangianState, make_lagrangian
from aircl_jax.algorithm.learners.scale_free import TRUE, LearnerState, Task, make_learner, true_motors
from aircl_jax.settings.lagrangian_config import LagrangianConfig
from aircl_jax.settings.learner_config import LearnerConfig
from aircl_jax.types import Metrics
from envs import Env

State = LagrangianState | LearnerState


def make_training(env: Env, config: LagrangianConfig | LearnerConfig) -> Lagrangian:
    """Make the two functions of the learner that these settings are of, on the world's own reward and cost."""
    if isinstance(config, LagrangianConfig):
        return make_lagrangian(env, config)
    learner, motors = make_learner(env, config), true_motors(env) if config.stops else None

    def step(state: LearnerState, constrained: Float[Array, ""]) -> tuple[LearnerState, Metrics]:
        return learner.step(state, Task(TRUE, constrained, motors))

    return Lagrangian(learner.init, step, learner.nets)  # pyright: ignore[reportArgumentType]


def settled(state: State) -> LagrangianState:
    """The state by the names of PPO-Lagrangian's, from which experts are drawn."""
    if isinstance(state, LagrangianState):
        return state
    return LagrangianState(*state.trained, state.opt, state.multiplier, state.moments, state.key, state.step)
