"""The behaviour model's functions of one observation: π of a hazard and a reward of where to go, r(place, activity), and δ₁."""

from typing import Any

import flax.linen as nn
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from aircl_jax.animals.features import LEAVING, available, joined, leaving_features, one_hot, tempo_column
from aircl_jax.animals.going import MODEL, Weights, alternatives, utility
from envs import Activities, Env
from envs.animals.full.observation import read

IMPOSSIBLE = -1e4  # log-probability of what cameras and coding rule out; finite, so that means are
CERTAIN = 14.0  # logit of the feasibility of going on: 1 − σ is below one in a million


class BehaviourPolicy(nn.Module):
    """log π(c' | x): log(1 − h) where c' = c, else log h + log softmax over possible c'' of u(x, c'') + offset(c, c'')."""

    recordings: Any

    @nn.compact
    def __call__(self, obs: Float[Array, " O"]) -> Float[Array, " C"]:
        here, tempo = read(obs[None], self.recordings)
        size, code = len(here.names), here.steps.code[0]
        columns = joined([leaving_features(here, available(LEAVING, here)), tempo_column(tempo)]).values[0]
        choices = alternatives(here, MODEL)
        shapes = ((choices.situation.shape[1], size), (choices.field.shape[2],), (size,), (size,))
        named = zip(Weights._fields, shapes, strict=True)
        weights = Weights(*(self.param(name, nn.initializers.zeros, shape) for name, shape in named))
        leaves = columns @ self.param("leaving", nn.initializers.zeros, columns.shape)
        draw = utility(choices, weights)[0] + self.param("offset", nn.initializers.zeros, (size, size))[code]
        going = jax.nn.log_softmax(jnp.where(choices.possible[0], draw, IMPOSSIBLE))
        return jnp.where(jnp.arange(size) == code, jax.nn.log_sigmoid(-leaves), jax.nn.log_sigmoid(leaves) + going)


class NoValue(nn.Module):
    """0: nothing is planned."""

    @nn.compact
    def __call__(self, obs: Float[Array, " O"]) -> Float[Array, " 1"]:
        return jnp.zeros(1)


class PlaceReward(nn.Module):
    """r(place, c') of beginning c'; 0 of going on, which begins nothing. The last row is of no known place."""

    recordings: Any

    @nn.compact
    def __call__(self, seen: Float[Array, " I"]) -> Float[Array, " 1"]:
        size, places = len(self.recordings.names), reward_rows(self.recordings)
        obs, taken = seen[:-size], seen[-size:]
        here = read(obs[None], self.recordings)[0].steps
        table = self.param("reward", nn.initializers.zeros, (places, size))
        at = one_hot(jnp.where(here.place < 0, places - 1, here.place), places)[0]
        begins = taken * (1.0 - one_hot(here.code, size)[0])
        return (at @ table @ begins)[None]


class ChangeTest(nn.Module):
    """The logit of 1 − P(c → c' is forbidden | n, M); going on is always feasible. It keeps n and M."""

    recordings: Any

    @nn.compact
    def __call__(self, seen: Float[Array, " I"]) -> Float[Array, " 1"]:
        size = len(self.recordings.names)
        code, taken = read(seen[None, :-size], self.recordings)[0].steps.code, seen[-size:]
        logit, _, _ = (self.param(name, nn.initializers.zeros, (size, size)) for name in ("logit", "made", "expected"))
        own = one_hot(code, size)[0]
        return (own @ logit @ taken + (own @ taken) * CERTAIN)[None]


def reward_rows(recordings: Any) -> int:
    """The rows of r(place, c'): the places that the tables name, and one of no known place."""
    return (0 if "places" in recordings.lacks else len(recordings.places)) + 1


def behaviour_modules(env: Env) -> dict[str, Any]:
    """The networks of the row that is fitted by likelihood. Raises TypeError where the world is none of whole recordings."""
    if not isinstance(env.view, Activities):
        raise TypeError(f"{env.name} has no whole recordings")
    of = env.view.recordings
    return {
        "policy_net": BehaviourPolicy(of),
        "value_net": NoValue(),
        "reward_net": PlaceReward(of),
        "step_net": ChangeTest(of),
    }
