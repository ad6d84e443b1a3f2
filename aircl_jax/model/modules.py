"""The modules that the four networks are made of: layers, sums over coordinates, and encoders of a whole trajectory."""

from collections.abc import Sequence

import distrax
import flax.linen as nn
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from envs import Box, Discrete

# Not orthogonal: its QR calls block the CPU's thread pool when several devices initialise at once.
HIDDEN_INIT = nn.initializers.variance_scaling(2.0, "fan_in", "truncated_normal")
ADDITIVE_INIT = nn.initializers.variance_scaling(2.0, "fan_in", "truncated_normal", in_axis=1, out_axis=2, batch_axis=0)
ADDITIVE_SCALE = 3.0  # walls are sharper than the spread of the demonstrations
KEY_BOUND = 8.0  # of the attention's log weights: e^8 outweighs 500 steps, and its sums stay exact in float32
SUM_BLOCK = 20  # steps; longer blocks add more zeros, shorter ones leave more blocks to sum
SEQUENCE_BIAS = 1.0  # initial logit of both factors: what is done is feasible until something speaks against it


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
    """π_ω(·|s): a categorical, or a Gaussian, in half-widths of the box that clips it, with a state-independent log σ."""

    action_space: Discrete | Box
    hidden: Sequence[int]
    log_std_init: float

    @nn.compact
    def __call__(self, x: Float[Array, " I"]) -> Float[Array, "..."]:
        head = MLP(self.hidden, self.action_space.feature_size, final_scale=0.01)(x)
        if isinstance(self.action_space, Box):
            self.param("log_std", nn.initializers.constant(self.log_std_init), (self.action_space.size,))
        return head


class BoxGaussian(distrax.Distribution):
    """A Gaussian over actions in the box's unit, whose density is per half-width: no unit of the action changes it.

    What is drawn is clipped to [lower, upper], in half-widths; the density is that before it is clipped.
    """

    def __init__(
        self,
        in_half_widths: distrax.MultivariateNormalDiag,
        box: Box,
        lower: Float[Array, "*A"] | float = -jnp.inf,
        upper: Float[Array, "*A"] | float = jnp.inf,
    ) -> None:
        super().__init__()
        self.in_half_widths, self.box = in_half_widths, box
        self.lower, self.upper = lower, upper

    @property
    def event_shape(self) -> tuple[int, ...]:
        return self.box.shape

    def _sample_n(self, key: PRNGKeyArray, n: int) -> Float[Array, "K A"]:
        return self._clipped(jnp.asarray(self.in_half_widths._sample_n(key, n)))

    def log_prob(self, value: Float[Array, "*N A"]) -> Float[Array, "*N"]:
        return jnp.asarray(self.in_half_widths.log_prob(self.box.in_half_widths(value)))

    def entropy(self) -> Float[Array, ""]:
        return jnp.asarray(self.in_half_widths.entropy())

    def mean(self) -> Float[Array, " A"]:
        """The Gaussian's mean, clipped: what is done without noise."""
        return self._clipped(jnp.asarray(self.in_half_widths.mean()))

    def mode(self) -> Float[Array, " A"]:
        return self.mean()

    def stddev(self) -> Float[Array, " A"]:
        return self.box.half_width * jnp.asarray(self.in_half_widths.stddev())

    def _clipped(self, in_half_widths: Float[Array, "*N A"]) -> Float[Array, "*N A"]:
        return self.box.from_half_widths(jnp.clip(in_half_widths, self.lower, self.upper))


class Table(nn.Module):
    """A number or several for every step and state, of a one-hot state beside a one-hot step; 0 at the start."""

    steps: int
    states: int
    size: int

    @nn.compact
    def __call__(self, x: Float[Array, " I"]) -> Float[Array, " O"]:
        table = self.param("table", nn.initializers.zeros, (self.steps, self.states, self.size))
        state, step = x[: self.states], x[self.states :]
        return jnp.einsum("t,x,txo->o", step, state, table)


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
        above, below = jnp.split(running_sum(jnp.concatenate([weight * h, weight], axis=-1)), 2, axis=-1)
        context = above / (below + 1e-6)
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


def running_sum(x: Float[Array, "T C"]) -> Float[Array, "T C"]:
    """Σ_{u≤t} x_u by products with triangles of ones: on a CPU faster than `jnp.cumsum`, whose scan reads x log T times."""
    length, channels = x.shape
    blocks = jnp.pad(x, ((0, -length % SUM_BLOCK), (0, 0))).reshape(-1, SUM_BLOCK, channels)
    within = jnp.einsum("ts,bsc->btc", jnp.tri(SUM_BLOCK), blocks, precision="highest")
    before = jnp.einsum("bd,dc->bc", jnp.tri(len(blocks), k=-1), within[:, -1], precision="highest")
    return (within + before[:, None]).reshape(-1, channels)[:length]


def smooth_minimum(score: Float[Array, " T"], mask: Float[Array, " T"]) -> Float[Array, ""]:
    """−log mean_t e^{−x_t} over unmasked steps: one infeasible step is enough, and every step has a gradient."""
    return -jax.nn.logsumexp(-score, b=mask) + jnp.log(jnp.maximum(mask.sum(), 1.0))
