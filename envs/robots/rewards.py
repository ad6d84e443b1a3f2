"""What a robot can be rewarded for beside its task: the names of `env.reward`, and `env.action_cost`."""

from collections.abc import Callable
from dataclasses import replace

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from envs.options import RobotOptions
from envs.robots.tasks import RobotState, Task, balanced, gained, hop, hopping, run, swim, upright, walk

Action = Float[Array, " A"]
Scalar = Float[Array, ""]
Aimed = Callable[[RobotState, RobotState, Action, float, float], Scalar]


def backwards(forward: Callable[..., Scalar]) -> Aimed:
    """Pay the task's reward as if x ran the other way: −Δx/dt, the rest as it is."""

    def reward(before: RobotState, after: RobotState, action: Action, dt: float, target: float) -> Scalar:
        return forward(_at(-before.qpos[0], before), _at(-after.qpos[0], after), action, dt)

    return reward


def nearer(forward: Callable[..., Scalar]) -> Aimed:
    """Pay the task's reward for coming nearer to the target: (|x − target| − |x′ − target|)/dt, the rest as it is."""

    def reward(before: RobotState, after: RobotState, action: Action, dt: float, target: float) -> Scalar:
        distances = (jnp.abs(state.qpos[0] - target) for state in (before, after))
        return forward(*(_at(-distance, state) for distance, state in zip(distances, (before, after), strict=True)), action, dt)

    return reward


def stay(before: RobotState, after: RobotState, action: Action, dt: float, target: float) -> Scalar:
    """−|Δx|/dt."""
    return -jnp.abs(gained(before, after)) / dt


def stand(healthy: Callable[[RobotState], Bool[Array, ""]]) -> Aimed:
    """Pay 1 while healthy, less 1e-3‖a‖²."""

    def reward(before: RobotState, after: RobotState, action: Action, dt: float, target: float) -> Scalar:
        return healthy(after) - 1e-3 * (action**2).sum()

    return reward


def balance(before: RobotState, after: RobotState, action: Action, dt: float, target: float) -> Scalar:
    """1 while balanced."""
    return balanced(after).astype(jnp.float32)


def balance_at(before: RobotState, after: RobotState, action: Action, dt: float, target: float) -> Scalar:
    """1 at the target, 0 a metre away and beyond, linear between; 0 once fallen."""
    return balanced(after) * jnp.maximum(1 - jnp.abs(after.qpos[0] - target), 0.0)


def _at(x: Scalar, state: RobotState) -> RobotState:
    return state._replace(qpos=state.qpos.at[0].set(x))


_FORWARD: dict[str, Callable[..., Scalar]] = {"swimmer": swim, "walker": walk, "halfcheetah": run, "hopper": hop}

REWARDS: dict[str, dict[str, Aimed]] = {
    "backwards": {body: backwards(forward) for body, forward in _FORWARD.items()},
    "stand": {
        "swimmer": stay,
        "walker": stand(upright),
        "halfcheetah": stay,
        "hopper": stand(hopping),
        "pendulum": balance,
    },
    "target": {body: nearer(forward) for body, forward in _FORWARD.items()} | {"pendulum": balance_at},
}


def rewarded(task: Task, body: str, options: RobotOptions) -> Task:
    """Give the task the reward of the settings, less w‖a‖². Raises ValueError where the body has no such reward."""
    choices = ["task", *(name for name, bodies in REWARDS.items() if body in bodies)]
    if options.reward not in choices:
        raise ValueError(f"unknown reward {options.reward!r} of {body}; choose from {', '.join(choices)}")
    reward = task.reward if options.reward == "task" else _aimed(REWARDS[options.reward][body], options.target)
    return replace(task, reward=_costly(reward, options.action_cost) if options.action_cost else reward)


def _aimed(reward: Aimed, target: float) -> Callable[..., Scalar]:
    return lambda before, after, action, dt: reward(before, after, action, dt, target)


def _costly(reward: Callable[..., Scalar], weight: float) -> Callable[..., Scalar]:
    def less(before: RobotState, after: RobotState, action: Action, dt: float) -> Scalar:
        return reward(before, after, action, dt) - weight * (action**2).sum()

    return less
