"""The four networks as functions of one step or one trajectory: π_ω, V, f_θ and δ̄_φ."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, cast

import distrax
import flax.linen as nn
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray, Shaped

from aircl_jax.methods import Method
from aircl_jax.model.behaviour import behaviour_modules
from aircl_jax.model.features import FeatureReward, Limits
from aircl_jax.model.modules import ENCODERS, MLP, SEQUENCE_BIAS, AdditiveNet, BoxGaussian, LinearEncoder, Policy, Table
from aircl_jax.model.moves import expected_moves
from aircl_jax.settings.train_config import TrainConfig
from aircl_jax.types import FeasibilityScores, ObsStats, Params, Scores, Thresholds, Trajectory
from envs import Discrete, Env

OBS_CLIP = 8.0  # bound of the normalised observation, in standard deviations
STD_FLOOR = 1e-18  # below it the square is none in single precision


@dataclass(frozen=True, eq=False)
class Networks:
    """The networks of one run, without parameters; `bind` gives them some."""

    env: Env
    method: Method
    config: TrainConfig
    policy_net: nn.Module
    value_net: nn.Module
    reward_net: nn.Module
    step_net: nn.Module
    sequence_net: nn.Module
    moves: Float[Array, "O A P"] | None = None  # E[position of s'] − position of s, in rows with a reward of states

    def init(self, key: PRNGKeyArray) -> Params:
        key_policy, key_value, key_reward, key_step, key_sequence = jax.random.split(key, 5)
        acting = jnp.zeros(self.env.obs_size + (self.env.horizon if self.plans else self.env.finite_horizon))
        seen = jnp.zeros(
            self.feasibility_sees_state * self.env.obs_size + self.feasibility_sees_action * self.env.action_space.feature_size
        )
        feasibility = {}
        if self.method.tests_steps:
            feasibility["step"] = self.step_net.init(key_step, seen)
        if self.method.tests_trajectories:
            feasibility["sequence"] = self.sequence_net.init(key_sequence, seen[None], jnp.ones(1))
        of_entries = (self.env.obs_size, self.env.action_space.feature_size)
        return Params(
            policy=self.policy_net.init(key_policy, acting),
            value=self.value_net.init(key_value, acting),
            reward=self._init_reward(key_reward),
            feasibility=feasibility,
            # Never weakly typed: a state that `step` returns with another type would compile the whole chunk a second time.
            thresholds=Thresholds(*[jnp.log(jnp.asarray(self.config.coefficients.threshold, jnp.float32))] * 2),
            entry_price=jnp.zeros(of_entries) if self.method.tests_entries else None,
        )

    def _init_reward(self, key: PRNGKeyArray) -> Any:
        if self.moves is None:
            return self.reward_net.init(key, jnp.zeros(self.reward_size))
        size = self.reward_size - self.env.action_space.feature_size
        return {"state": self.reward_net.init(key, jnp.zeros(size)), "potential": jnp.zeros(self.moves.shape[-1])}

    @property
    def plans(self) -> bool:
        """Whether policy and value are tables of steps and states, which are planned and not trained."""
        return self.config.learner == "exact"

    @property
    def constraint_input(self) -> str:
        """What the feasibility is a function of, "state", "action" or "state_action": the last in all of the paper's rows.

        A row of boxes tests one of the two: states where the constraint is known to be of states alone, else actions.
        """
        told = self.env.constraint_input if self.config.constraint_input == "env" else self.config.constraint_input
        if self.method.is_of_boxes:
            return "state" if told == "state" else "action"
        return told if self.config.constraint_input != "env" or self.method.is_ratio_test else "state_action"

    @property
    def entropy_weight(self) -> float:
        """β of the entropy that π is paid for; the paper's rows with a learned f take 1."""
        return self.config.temperature if self.method.needs_true_reward or self.method.centred else 1.0

    @property
    def feasibility_sees_state(self) -> bool:
        return self.constraint_input in ("state", "state_action")

    @property
    def feasibility_sees_action(self) -> bool:
        return self.constraint_input in ("action", "state_action")

    @property
    def reward_size(self) -> int:
        if self.method.rewards_observations:
            return self.env.obs_size
        seen = (self.config.reward_input == "view" and self.env.reward_view_size) or self.env.obs_size
        return seen + self.env.action_space.feature_size

    def bind(self, params: Params, stats: ObsStats) -> "BoundNetworks":
        """The networks with their parameters and the statistics by which they see observations."""
        return BoundNetworks(self, params, stats)


@dataclass(frozen=True, eq=False)
class BoundNetworks:
    """π_ω, V, f_θ and δ̄_φ with their parameters, as functions of one step or one trajectory: `vmap` for many."""

    networks: Networks
    params: Params
    stats: ObsStats

    @property
    def env(self) -> Env:
        return self.networks.env

    @property
    def method(self) -> Method:
        return self.networks.method

    @property
    def config(self) -> TrainConfig:
        return self.networks.config

    def with_params(self, **changed: Any) -> "BoundNetworks":
        """The same networks with other parameters of those names, such as `policy` and `value`."""
        return replace(self, params=self.params._replace(**changed))

    def normalise(self, obs: Float[Array, " O"]) -> Float[Array, " O"]:
        """s̃ = (s − mean_E) / std_E, clipped to ±8."""
        return jnp.clip((obs - self.stats.mean) / jnp.maximum(self.stats.std, STD_FLOOR), -OBS_CLIP, OBS_CLIP)

    def acting_input(self, obs: Float[Array, " O"], t: Int[Array, ""]) -> Float[Array, " I"]:
        """What policy and value see: s̃, and t/T where the task ends at the horizon. As tables they see s and t as they are."""
        if self.networks.plans:
            return jnp.concatenate([obs, jax.nn.one_hot(t, self.env.horizon)])
        seen = self.normalise(obs)
        return jnp.append(seen, t / self.env.horizon) if self.env.finite_horizon else seen

    def policy(self, obs: Float[Array, " O"], t: Int[Array, ""]) -> distrax.Distribution:
        """π_ω(·|s_t)."""
        head = cast(Array, self.networks.policy_net.apply(self.params.policy, self.acting_input(obs, t)))
        if self.params.entry_price is not None and not self.networks.plans:  # a plan has it in Q
            head = head + obs @ self.params.entry_price
        if isinstance(self.env.action_space, Discrete):
            return distrax.Categorical(logits=head)
        gaussian = distrax.MultivariateNormalDiag(head, jnp.exp(self.params.policy["params"]["log_std"]))
        return gaussian if self.env.action_space.is_unit else BoxGaussian(gaussian, self.env.action_space)

    def value(self, obs: Float[Array, " O"], t: Int[Array, ""]) -> Float[Array, ""]:
        """V(s_t)."""
        return self.networks.value_net.apply(self.params.value, self.acting_input(obs, t))[0]

    def reward(self, obs: Float[Array, " O"], action: Shaped[Array, "*A"]) -> Float[Array, ""]:
        """f_θ(s, a), on the environment's smooth coordinates or on s̃; of a reward of states g(s) + E[h(s')] − h(s)."""
        if self.method.rewards_observations:
            return self.networks.reward_net.apply(self.params.reward, self.normalise(obs))[0]
        taken = self.env.action_space.features(action)
        if self.networks.moves is not None:
            moved = taken @ jnp.einsum("o,oap->ap", obs, self.networks.moves)
            return self.state_reward(obs) + moved @ self.params.reward["potential"]
        f = self.networks.reward_net.apply(self.params.reward, jnp.concatenate([self._reward_input(obs), taken]))[0]
        bound = self.config.reward_bound
        return bound * jnp.tanh(f / bound) if bound else f

    def state_reward(self, obs: Float[Array, " O"]) -> Float[Array, ""]:
        """g(s), in rows with a reward of states."""
        return self.networks.reward_net.apply(self.params.reward["state"], self._reward_input(obs))[0]

    def potential(self, obs: Float[Array, " O"]) -> Float[Array, ""]:
        """h(s), linear in the position, in rows with a reward of states."""
        if self.env.position is None:
            raise TypeError(f"{self.env.name} has no position")
        return self.env.position(obs) @ self.params.reward["potential"]

    def _reward_input(self, obs: Float[Array, " O"]) -> Float[Array, " R"]:
        viewed = self.config.reward_input == "view" and self.env.reward_view_size
        return self.env.reward_view(obs) if viewed else self.normalise(obs)

    def feasibility_input(self, obs: Float[Array, " O"], action: Shaped[Array, "*A"]) -> Float[Array, " I"]:
        """What both factors of the feasibility see of a step: s̃, the action, or both, as constraints may speak of them."""
        state, taken = self.normalise(obs), self.env.action_space.features(action)
        return jnp.concatenate([state] * self.networks.feasibility_sees_state + [taken] * self.networks.feasibility_sees_action)

    def step_logit(self, obs: Float[Array, " O"], action: Shaped[Array, "*A"]) -> Float[Array, ""]:
        """Logit of the per-step feasibility; 0 where the method has none. On a limit it is log ϑ."""
        if not self.method.tests_steps:
            return jnp.zeros(())
        logit = self.networks.step_net.apply(self.params.feasibility["step"], self.feasibility_input(obs, action))[0]
        return logit + jnp.log(jnp.asarray(self.config.coefficients.threshold)) if self.method.has_twin else logit

    def sequence_logit(
        self, obs: Float[Array, "T O"], action: Shaped[Array, "T *A"], mask: Float[Array, " T"]
    ) -> Float[Array, ""]:
        """Logit of the trajectory-level feasibility network, which sees order; 0 where the method has none."""
        if not self.method.tests_trajectories:
            return jnp.zeros(())
        features = jax.vmap(self.feasibility_input)(obs, action)
        return cast(Array, self.networks.sequence_net.apply(self.params.feasibility["sequence"], features, mask))

    def along(
        self, of: Callable[[Array, Array], Array], obs: Float[Array, "T O"], action: Shaped[Array, "T *A"]
    ) -> Float[Array, " T"]:
        """of(s_t, a_t) of each step; sᵀ F a with F the table of all pairs where both are one-hot of few codes or nodes."""
        if not self.env.enumerated:
            return jax.vmap(of)(obs, action)
        pairs = jax.vmap(jax.vmap(of, (None, 0)), (0, None))
        table = pairs(jnp.eye(self.env.obs_size), jnp.arange(self.env.action_space.feature_size))
        return ((obs @ table) * jax.vmap(self.env.action_space.features)(action)).sum(axis=-1)

    def log_pi(self, trajectory: Trajectory) -> Float[Array, " T"]:
        """log π_ω(a_t|s_t) along one trajectory."""

        def one(obs: Array, action: Array, t: Array) -> Array:
            return cast(Array, self.policy(obs, t).log_prob(action))

        if self.env.enumerated:
            return self.along(lambda obs, action: one(obs, action, jnp.asarray(0)), trajectory.obs, trajectory.action)
        return jax.vmap(one)(trajectory.obs, trajectory.action, jnp.arange(trajectory.obs.shape[0]))

    def f(self, trajectory: Trajectory) -> Float[Array, " T"]:
        """f_θ(s_t, a_t) along one trajectory."""
        return self.along(self.reward, trajectory.obs, trajectory.action)

    def values(self, trajectory: Trajectory) -> Float[Array, " T"]:
        """V(s_t) along one trajectory."""
        if self.env.enumerated:
            table = jax.vmap(lambda obs: self.value(obs, jnp.asarray(0)))(jnp.eye(self.env.obs_size))
            return trajectory.obs @ table
        steps = jnp.arange(trajectory.obs.shape[0])
        return jax.vmap(self.value)(trajectory.obs, steps)

    def feasibility_scores(self, trajectory: Trajectory) -> FeasibilityScores:
        """The logits of both factors of δ̄ along one trajectory; whose actions they are does not matter."""
        obs, action, mask = trajectory.obs, trajectory.action, trajectory.mask
        return FeasibilityScores(
            step_logit=self.along(self.step_logit, obs, action),
            sequence_logit=self.sequence_logit(obs, action, mask),
            mask=mask,
            thresholds=self.params.thresholds,
        )

    def scores(self, trajectory: Trajectory, log_pi: Float[Array, " T"]) -> Scores:
        """All that the adversary's terms need of one trajectory; log π is given, since ω stands still in lines 5 and 6."""
        f = trajectory.reward if self.method.needs_true_reward else self.f(trajectory)
        return Scores(f, log_pi, *self.feasibility_scores(trajectory))


def make_networks(env: Env, method: Method, config: TrainConfig) -> Networks:
    """The networks of a method's row on an environment: the linear rows have no hidden layer in f and δ̄."""
    linear, hidden = method.is_linear, () if method.is_linear else config.hidden
    reward_net, step_net = MLP(hidden, 1, activation="relu"), MLP(hidden, 1, activation="relu", bias=SEQUENCE_BIAS)
    if config.step_network == "additive" and not linear:
        step_net = AdditiveNet(config.additive_hidden, bias=SEQUENCE_BIAS)
    if method.has_twin:
        reward_net, step_net = FeatureReward(), Limits()
    policy_net, value_net = Policy(env.action_space, config.hidden, config.ppo.log_std_init), MLP(config.hidden, 1)
    if config.learner == "exact":
        size = env.horizon, env.obs_size
        policy_net, value_net = Table(*size, env.action_space.feature_size), Table(*size, 1)
    sequence_net = LinearEncoder() if linear else ENCODERS[config.encoder](config.hidden)
    moves = expected_moves(env) if method.state_reward and not method.is_of_boxes else None
    made = Networks(env, method, config, policy_net, value_net, reward_net, step_net, sequence_net, moves)
    return replace(made, **behaviour_modules(env)) if method.is_fitted else made
