"""Fit the hazard: the chance at each row that an animal leaves its activity, as a logistic function of what is known."""

from collections.abc import Mapping
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Bool, Float
from scipy.linalg import solve_triangular
from scipy.special import log_expit

from aircl_jax.animals.features import Features
from aircl_jax.animals.minimise import minimise


def leaving_loss(weights: Float[Array, " K"], data: Mapping[str, Any]) -> Float[Array, ""]:
    """−Σ_n v_n [y_n log h_n + (1 − y_n) log(1 − h_n)] + ½ Σ_k λ_k w_k², with logit h_n = w · x_n.

    `data` has x [N, K], y (left: 1), v (weight of the step) and λ.
    """
    logit = data["x"] @ weights
    nats = jax.nn.softplus(logit) - data["left"] * logit
    return data["weight"] @ nats + 0.5 * data["ridge"] @ weights**2


def _of_basis(point: Float[Array, " K"], data: Mapping[str, Any]) -> Float[Array, ""]:
    return leaving_loss(data["basis"] @ point, data)


def fit_leaving(
    features: Features,
    left: Bool[np.ndarray, " N"],
    weight: Float[np.ndarray, " N"],
    start: Float[np.ndarray, " K"] | None = None,
) -> Float[np.ndarray, " K"]:
    """Find the weights w of least loss.

    The search is for v, w = L⁻ᵀ v with L Lᵀ the Hessian where every step has the mean chance of leaving; so every
    direction is about as steep, and some 30 steps suffice.
    """
    x, chance = features.values, float(weight @ left / weight.sum())
    hessian = (x * (weight * chance * (1 - chance))[:, None]).T @ x + np.diag(features.ridge)
    lower = np.linalg.cholesky(hessian)
    basis = solve_triangular(lower, np.eye(len(lower)), lower=True).T
    data = {"x": x, "left": left.astype(np.float64), "weight": weight, "ridge": features.ridge, "basis": basis}
    first = np.zeros(len(lower)) if start is None else lower.T @ start
    return basis @ np.asarray(minimise(_of_basis, first, data)[0])


def log_leaving(
    features: Features, weights: Float[np.ndarray, " K"], left: Bool[np.ndarray, " N"]
) -> tuple[Float[np.ndarray, " N"], Float[np.ndarray, " N"]]:
    """Compute the log-probability of what each animal did (left or stayed), and the chance h of leaving."""
    logit = features.values @ weights
    return np.where(left, log_expit(logit), log_expit(-logit)), 1.0 / (1.0 + np.exp(-logit))
