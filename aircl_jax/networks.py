"""The four networks as functions of one step or one trajectory: π_ω, V, f_θ and δ̄_φ."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import distrax
import flax.linen as nn
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray, Shaped

from aircl_jax.config import PPOConfig, TrainConfig
from aircl_jax.methods import Method
from aircl_jax.types import ObsStats, Params, Scores, Thresholds, Trajectory
from envs import Box, Discrete, Env

OBS_CLIP = 8.0  # bound of the normalised observation, in standard deviations
STD_FLOOR = 1e-3  # of a coordinate that the demonstrations never move
# Not orthogonal: its QR calls block the CPU's thread pool when several devices initialise at once.
HIDDEN_INIT = nn.initializers.variance_scaling(2.0, "fan_in", "truncated_normal")
ADDITIVE_INIT = nn.initializers.variance_scaling(2.0, "fan_in", "truncated_normal", in_axis=1, out_axis=2, batch_axis=0)
ADDITIVE_SCALE = 3.0  # walls are sharper than the spread of the demonstrations
KEY_BOUND = 8.0  # of the attention's log weights: e^8 outweighs 500 steps, and its sums stay exact in float32
SEQUENCE_BIAS = 1.0  # initial logit of δ_seq: a trajectory is feasible until something speaks against it


class MLP(nn.Module):
    """Dense layers with an activation between them; `hidden=()` is the linear function of the input."""

    hidden: Sequence[int]
    size: int
    final_scale: float = 1.0
    bias: float = 0.0
    activation: str = "tanh"

    @nn.compact
    def __call__(self, x: Float[Array, " I"]) -> Float[Array, " O"]:
        for width in self.hidden:
            x = nn.Dense(width, kernel_init=HIDDEN_INIT)(x)
            x = getattr(nn, self.activation)(x)
        final = nn.initializers.variance_scaling(self.final_scale**2, "fan_in", "truncated_normal")
        return nn.Dense(self.size, kernel_init=final, bias_init=nn.initializers.constant(self.bias))(x)


class AdditiveNet(nn.Module):
    """Σ_i g_i(x_i), an own network for each coordinate: a generalised additive model (Hastie & Tibshirani 1986).

    As a log density ratio it is that of independent coordinates: which of them a constraint speaks of, and from where on,
    can be read from one curve each, and what was never seen together is no evidence.
    """

    hidden: Sequence[int]
    bias: float = 0.0

    @nn.compact
    def __call__(self, x: Float[Array, " I"]) -> Float[Array, " 1"]:
        h = ADDITIVE_SCALE * x[:, None]
        for layer, width in enumerate(self.hidden):
            shape = (x.shape[0], h.shape[1], width)
            kernel = self.param(f"kernel_{layer}", ADDITIVE_INIT, shape)
            bias = self.param(f"bias_{layer}", nn.initializers.normal(0.5), (x.shape[0], width))
            h = nn.tanh(jnp.einsum("ij,ijk->ik", h, kernel) + bias)
        final = self.param("final", nn.initializers.normal(0.1), h.shape)
        return (h * final).sum() + self.param("bias", nn.initializers.constant(self.bias), (1,))


class Policy(nn.Module):
    """π_ω(·|s): a categorical, or a Gaussian with a state-independent log σ that the environment's box clips."""

    action_space: Discrete | Box
    hidden: Sequence[int]
    log_std_init: float

    @nn.compact
    def __call__(self, x: Float[Array, " I"]) -> Float[Array, "..."]:
        head = MLP(self.hidden, self.action_space.feature_size, final_scale=0.01)(x)
        if isinstance(self.action_space, Box):
            self.param("log_std", nn.initializers.constant(self.log_std_init), (self.action_space.size,))
        return head


class AttentionEncoder(nn.Module):
    """Causal attention with one learned query a channel: c_t = Σ_{u≤t} e^{k_u} h_u / Σ_{u≤t} e^{k_u}, a layer on (h_t, c_t).

    Linear in T (the query does not depend on t), so it sees what came before each step at H = 500 for the price of two sums.
    """

    hidden: Sequence[int]

    @nn.compact
    def __call__(self, x: Float[Array, "T I"], mask: Float[Array, " T"]) -> Float[Array, ""]:
        first, *rest = self.hidden
        h = nn.relu(nn.Dense(first, kernel_init=HIDDEN_INIT)(x))
        key = KEY_BOUND * nn.tanh(nn.Dense(first)(h) / KEY_BOUND)
        weight = jnp.exp(key) * mask[:, None]
        context = jnp.cumsum(weight * h, axis=0) / (jnp.cumsum(weight, axis=0) + 1e-6)
        y = jnp.concatenate([h, context], axis=-1)
        for width in rest or (first,):
            y = nn.relu(nn.Dense(width, kernel_init=HIDDEN_INIT)(y))
        score = nn.Dense(1, bias_init=nn.initializers.constant(SEQUENCE_BIAS))(y)[:, 0]
        return smooth_minimum(score, mask)


class GRUEncoder(nn.Module):
    """A masked gated recurrent encoder; a layer on each hidden state, and the smooth minimum over t."""

    hidden: Sequence[int]

    @nn.compact
    def __call__(self, x: Float[Array, "T I"], mask: Float[Array, " T"]) -> Float[Array, ""]:
        first, *rest = self.hidden
        y = nn.RNN(nn.GRUCell(first))(x)
        for width in rest or (first,):
            y = nn.relu(nn.Dense(width, kernel_init=HIDDEN_INIT)(y))
        score = nn.Dense(1, bias_init=nn.initializers.constant(SEQUENCE_BIAS))(y)[:, 0]
        return smooth_minimum(score, mask)


class LinearEncoder(nn.Module):
    """A linear logit of the trajectory's mean features: blind to order, for the linear rows."""

    @nn.compact
    def __call__(self, x: Float[Array, "T I"], mask: Float[Array, " T"]) -> Float[Array, ""]:
        mean = (x * mask[:, None]).sum(axis=0) / jnp.maximum(mask.sum(), 1.0)
        return nn.Dense(1, bias_init=nn.initializers.constant(SEQUENCE_BIAS))(mean)[0]


ENCODERS = {"attention": AttentionEncoder, "gru": GRUEncoder}


def smooth_minimum(score: Float[Array, " T"], mask: Float[Array, " T"]) -> Float[Array, ""]:
    """−log mean_t e^{−x_t} over unmasked steps: one infeasible step is enough, and every step has a gradient."""
    return -jax.nn.logsumexp(-score, b=mask) + jnp.log(jnp.maximum(mask.sum(), 1.0))


@dataclass(frozen=True, eq=False)
class Networks:
    """The networks of one run. Every function takes one step (or one trajectory) and the parameters it needs."""

    env: Env
    method: Method
    config: TrainConfig
    policy_net: Policy
    value_net: MLP
    reward_net: MLP
    step_net: MLP | AdditiveNet
    sequence_net: nn.Module

    def init(self, key: PRNGKeyArray) -> Params:
        key_policy, key_value, key_reward, key_step, key_sequence = jax.random.split(key, 5)
        acting = jnp.zeros(self.env.obs_size + self.env.finite_horizon)
        judged = jnp.zeros(
            self.feasibility_sees_state * self.env.obs_size + self.feasibility_sees_action * self.env.action_space.feature_size
        )
        feasibility = {}
        if "step" in self.method.feasibility:
            feasibility["step"] = self.step_net.init(key_step, judged)
        if "sequence" in self.method.feasibility:
            feasibility["sequence"] = self.sequence_net.init(key_sequence, judged[None], jnp.ones(1))
        return Params(
            policy=self.policy_net.init(key_policy, acting),
            value=self.value_net.init(key_value, acting),
            reward=self.reward_net.init(key_reward, jnp.zeros(self.reward_size)),
            feasibility=feasibility,
            # Never weakly typed: a state that `step` returns with another type would compile the whole chunk a second time.
            thresholds=Thresholds(*[jnp.log(jnp.asarray(self.config.coefficients.threshold, jnp.float32))] * 2),
        )

    @property
    def constraint_input(self) -> str:
        """What the feasibility is a function of, "state", "action" or "state_action": the last in all of the paper's rows."""
        if self.config.constraint_input != "env":
            return self.config.constraint_input
        return "state_action" if self.method.test == "sigmoid" else self.env.constraint_input

    @property
    def feasibility_sees_state(self) -> bool:
        return self.constraint_input in ("state", "state_action")

    @property
    def feasibility_sees_action(self) -> bool:
        return self.constraint_input in ("action", "state_action")

    @property
    def reward_size(self) -> int:
        seen = self.env.reward_view_size or self.env.obs_size
        return (seen if self.config.reward_input == "view" else self.env.obs_size) + self.env.action_space.feature_size

    def normalise(self, stats: ObsStats, obs: Float[Array, " O"]) -> Float[Array, " O"]:
        """s̃ = (s − mean_E) / std_E, clipped to ±8."""
        return jnp.clip((obs - stats.mean) / jnp.maximum(stats.std, STD_FLOOR), -OBS_CLIP, OBS_CLIP)

    def acting_input(self, stats: ObsStats, obs: Float[Array, " O"], t: Int[Array, ""]) -> Float[Array, " I"]:
        """What policy and value see: s̃, and t/T where the task ends at the horizon."""
        seen = self.normalise(stats, obs)
        return jnp.append(seen, t / self.env.horizon) if self.env.finite_horizon else seen

    def policy(self, params: Any, stats: ObsStats, obs: Float[Array, " O"], t: Int[Array, ""]) -> distrax.Distribution:
        """π_ω(·|s_t)."""
        head = cast(Array, self.policy_net.apply(params, self.acting_input(stats, obs, t)))
        if isinstance(self.env.action_space, Discrete):
            return distrax.Categorical(logits=head)
        return distrax.MultivariateNormalDiag(head, jnp.exp(params["params"]["log_std"]))

    def value(self, params: Any, stats: ObsStats, obs: Float[Array, " O"], t: Int[Array, ""]) -> Float[Array, ""]:
        """V(s_t)."""
        return self.value_net.apply(params, self.acting_input(stats, obs, t))[0]

    def reward(self, params: Any, stats: ObsStats, obs: Float[Array, " O"], action: Shaped[Array, "*A"]) -> Float[Array, ""]:
        """f_θ(s, a), on the environment's smooth coordinates or on s̃."""
        viewed = self.config.reward_input == "view" and self.env.reward_view_size
        seen = self.env.reward_view(obs) if viewed else self.normalise(stats, obs)
        f = self.reward_net.apply(params, jnp.concatenate([seen, self.env.action_space.features(action)]))[0]
        bound = self.config.reward_bound
        return bound * jnp.tanh(f / bound) if bound else f

    def feasibility_input(self, stats: ObsStats, obs: Float[Array, " O"], action: Shaped[Array, "*A"]) -> Float[Array, " I"]:
        """What both factors of the feasibility see of a step: s̃, the action, or both, as constraints may speak of them."""
        state, taken = self.normalise(stats, obs), self.env.action_space.features(action)
        return jnp.concatenate([state] * self.feasibility_sees_state + [taken] * self.feasibility_sees_action)

    def step_logit(
        self, params: Any, stats: ObsStats, obs: Float[Array, " O"], action: Shaped[Array, "*A"]
    ) -> Float[Array, ""]:
        """Logit of the per-step feasibility network; 0 where the method has none."""
        if "step" not in params:
            return jnp.zeros(())
        return self.step_net.apply(params["step"], self.feasibility_input(stats, obs, action))[0]

    def sequence_logit(
        self, params: Any, stats: ObsStats, obs: Float[Array, "T O"], action: Shaped[Array, "T *A"], mask: Float[Array, " T"]
    ) -> Float[Array, ""]:
        """Logit of the trajectory-level feasibility network, which sees order; 0 where the method has none."""
        if "sequence" not in params:
            return jnp.zeros(())
        features = jax.vmap(self.feasibility_input, (None, 0, 0))(stats, obs, action)
        return cast(Array, self.sequence_net.apply(params["sequence"], features, mask))

    def log_pi(self, params: Params, stats: ObsStats, trajectory: Trajectory) -> Float[Array, " T"]:
        """log π_ω(a_t|s_t) along one trajectory."""

        def one(obs: Array, action: Array, t: Array) -> Array:
            return cast(Array, self.policy(params.policy, stats, obs, t).log_prob(action))

        return jax.vmap(one)(trajectory.obs, trajectory.action, jnp.arange(trajectory.obs.shape[0]))

    def scores(self, params: Params, stats: ObsStats, trajectory: Trajectory, log_pi: Float[Array, " T"]) -> Scores:
        """All that the adversary's terms need of one trajectory; log π is given, since ω stands still in lines 5 and 6."""
        along = (trajectory.obs, trajectory.action)
        return Scores(
            f=trajectory.reward
            if self.method.needs_true_reward
            else jax.vmap(self.reward, (None, None, 0, 0))(params.reward, stats, *along),
            log_pi=log_pi,
            step_logit=jax.vmap(self.step_logit, (None, None, 0, 0))(params.feasibility, stats, *along),
            sequence_logit=self.sequence_logit(params.feasibility, stats, *along, trajectory.mask),
            mask=trajectory.mask,
            thresholds=params.thresholds,
        )


def make_networks(env: Env, method: Method, config: TrainConfig) -> Networks:
    """The networks of a method's row on an environment: the linear rows have no hidden layer in f and δ̄."""
    linear = method.network == "linear"
    judged = () if linear else config.hidden
    step_net = MLP(judged, 1, activation="relu", bias=SEQUENCE_BIAS)
    if config.step_network == "additive" and not linear:
        step_net = AdditiveNet(config.additive_hidden, bias=SEQUENCE_BIAS)
    return Networks(
        env=env,
        method=method,
        config=config,
        policy_net=Policy(env.action_space, config.hidden, config.ppo.log_std_init),
        value_net=MLP(config.hidden, 1),
        reward_net=MLP(judged, 1, activation="relu"),
        step_net=step_net,
        sequence_net=LinearEncoder() if linear else ENCODERS[config.encoder](config.hidden),
    )


def project_log_std(params: Any, config: PPOConfig) -> Any:
    """log σ moved back into its bounds after an update; clipped inside the network it would lose its gradient there."""
    if "log_std" not in params["params"]:
        return params
    bounded = jnp.clip(params["params"]["log_std"], config.log_std_min, config.log_std_max)
    return {"params": {**params["params"], "log_std": bounded}}
