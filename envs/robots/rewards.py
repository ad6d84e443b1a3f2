"""What a robot can be rewarded for beside its task: the names of `env.reward`, and `env.action_cost`."""

from collections.abc import Callable
from dataclasses import replace

import jax.numpy as jnp
from jaxtyping import Array, Float

from envs.options import RobotOptions
from envs.robots.tasks import RobotState, Task, balanced, upright

Action = Float[Array, " A"]
Scalar = Float[Array, ""]
Aimed = Callable[[RobotState, RobotState, Action, float, float], Scalar]


def swim_back(before: RobotState, after: RobotState, action: Action, dt: float, target: float) -> Scalar:
    """−Δx/dt − 1e-4‖a‖²."""
    return -_gained(before, after) / dt - 1e-4 * (action**2).sum()


def walk_back(before: RobotState, after: RobotState, action: Action, dt: float, target: float) -> Scalar:
    """−Δx/dt + 1 while upright − 1e-3‖a‖²."""
    return -_gained(before, after) / dt + upright(after) - 1e-3 * (action**2).sum()


def float_still(before: RobotState, after: RobotState, action: Action, dt: float, target: float) -> Scalar:
    """−|Δx|/dt."""
    return -jnp.abs(_gained(before, after)) / dt


def stand(before: RobotState, after: RobotState, action: Action, dt: float, target: float) -> Scalar:
    """1 while upright − 1e-3‖a‖²."""
    return upright(after) - 1e-3 * (action**2).sum()


def balance(before: RobotState, after: RobotState, action: Action, dt: float, target: float) -> Scalar:
    """1 while balanced."""
    return balanced(after).astype(jnp.float32)


def swim_to(before: RobotState, after: RobotState, action: Action, dt: float, target: float) -> Scalar:
    """(|x − target| − |x′ − target|)/dt − 1e-4‖a‖²."""
    return _nearer(before, after, target) / dt - 1e-4 * (action**2).sum()


def walk_to(before: RobotState, after: RobotState, action: Action, dt: float, target: float) -> Scalar:
    """(|x − target| − |x′ − target|)/dt + 1 while upright − 1e-3‖a‖²."""
    return _nearer(before, after, target) / dt + upright(after) - 1e-3 * (action**2).sum()


def balance_at(before: RobotState, after: RobotState, action: Action, dt: float, target: float) -> Scalar:
    """1 at the target, 0 a metre away and beyond, linear between; 0 once fallen."""
    return balanced(after) * jnp.maximum(1 - jnp.abs(after.qpos[0] - target), 0.0)


def _gained(before: RobotState, after: RobotState) -> Scalar:
    return after.qpos[0] - before.qpos[0]


def _nearer(before: RobotState, after: RobotState, target: float) -> Scalar:
    return jnp.abs(before.qpos[0] - target) - jnp.abs(after.qpos[0] - target)


REWARDS: dict[str, dict[str, Aimed]] = {
    "backwards": {"swimmer": swim_back, "walker": walk_back},
    "stand": {"swimmer": float_still, "walker": stand, "pendulum": balance},
    "target": {"swimmer": swim_to, "walker": walk_to, "pendulum": balance_at},
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
