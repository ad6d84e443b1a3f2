"""Hold the result of a training: the summary, the history and the learned functions of each seed."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Shaped

from aircl_jax.model.feasibility import log_feasibility, log_step_feasibility
from aircl_jax.model.networks import BoundNetworks, Networks
from aircl_jax.runs.spec import RunSpec
from aircl_jax.types import TrainState, Trajectory


@dataclass(frozen=True, eq=False)
class Result:
    """The result of a training: the summary, every iteration's metrics, and the learned functions of each seed."""

    summary: Mapping[str, Any]  # as in summary.json
    alarms: list[str]  # sentences on degenerate results
    history: Mapping[str, np.ndarray]  # {metric: [iterations, S]}, NaN where undefined
    spec: RunSpec
    networks: Networks
    states: TrainState  # [S, …]
    expert: Trajectory  # D_E, [S, N, T, …]
    reference: Trajectory  # the environment's reference set, [M, T, …]
    run_dir: Path | None
    defects: tuple[str, ...] = ()  # what could not be drawn or written, a line each: faults of this program

    def state(self, index: int = 0) -> TrainState:
        """Return the final state of the seed at this place of `summary["seeds"]`."""
        return jax.tree.map(lambda leaf: leaf[index], self.states)

    def bound(self, index: int = 0) -> BoundNetworks:
        """Return the networks with the parameters of the seed at this place."""
        state = self.state(index)
        return self.networks.bind(state.params, state.obs_stats)

    def reward(self, obs: Float[Array, " O"], action: Shaped[Array, "*A"], index: int = 0) -> Float[Array, ""]:
        """Compute the learned f_θ(s, a). Raises ValueError where the method learns none."""
        if not self.networks.method.learns_reward:
            raise ValueError(f"method={self.spec.method_name} learns no reward; choose one that does")
        return self.bound(index).reward(obs, action)

    def feasibility(self, trajectory: Trajectory, index: int = 0) -> Float[Array, ""]:
        """Compute the learned δ̄_φ(τ) of one trajectory, between 0 and 1."""
        scores = self.bound(index).feasibility_scores(trajectory)
        return jnp.exp(log_feasibility(self.networks.method, self.networks.config.coefficients, scores))

    def step_feasibility(self, trajectory: Trajectory, index: int = 0) -> Float[Array, " T"]:
        """Compute the learned δ₁ of each step of one trajectory; 1 where the method has no such factor."""
        scores = self.bound(index).feasibility_scores(trajectory)
        return jnp.exp(log_step_feasibility(self.networks.method, self.networks.config.coefficients, scores))

    def policy(self, obs: Float[Array, " O"], t: int = 0, index: int = 0) -> Any:
        """Return the learned π_ω(·|s_t), a distrax distribution over actions."""
        return self.bound(index).policy(obs, jnp.asarray(t))
