"""Fit the hazard: the chance at each row that an animal leaves its activity, as a logistic function of what is known."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Shaped
from scipy.linalg import solve_triangular
from scipy.special import log_expit

from aircl_jax.animals.features import Features
from aircl_jax.animals.minimise import minimise
from aircl_jax.animals.shards import sharded, summed


class Known(NamedTuple):
    """What is known at every row, x = (cells' columns, own columns): rows of one cell share the first."""

    cells: Features  # [G, K] columns
    cell: Int[np.ndarray, " N"]
    own: Features  # [N, L] columns

    @property
    def names(self) -> tuple[str, ...]:
        return self.cells.names + self.own.names

    @property
    def ridge(self) -> Float[np.ndarray, " KL"]:
        return np.concatenate([self.cells.ridge, self.own.ridge])


def leaving_loss(weights: Float[Array, " K"], data: Mapping[str, Any]) -> Float[Array, ""]:
    """−Σ_n v_n [y_n log h_n + (1 − y_n) log(1 − h_n)] + ½ Σ_k λ_k w_k², with logit h_n = w · x_n.

    `data` has the columns of cells [G, K], λ, and the rows' cell, own columns [L], y (left: 1) and v (weight of the step).
    """
    shared = data["cells"].shape[1]
    parts = (data["cells"] @ weights[:shared], weights[shared:])
    return summed(_nats, parts, data["rows"]) + 0.5 * data["ridge"] @ weights**2


def _nats(parts: tuple[Float[Array, " G"], Float[Array, " L"]], rows: Mapping[str, Any]) -> Float[Array, ""]:
    of_cell, slopes = parts
    logit = of_cell[rows["cell"]] + rows["own"] @ slopes
    return rows["weight"] @ (jax.nn.softplus(logit) - rows["left"] * logit)


def _of_basis(point: Float[Array, " K"], data: Mapping[str, Any]) -> Float[Array, ""]:
    return leaving_loss(data["basis"] @ point, data)


def fit_leaving(
    known: Known,
    left: Bool[np.ndarray, " N"],
    weight: Float[np.ndarray, " N"],
    start: Float[np.ndarray, " K"] | None = None,
) -> Float[np.ndarray, " K"]:
    """Find the weights w of least loss.

    The search is for v, w = L⁻ᵀ v with L Lᵀ the Hessian where every step has the mean chance of leaving; so every
    direction is about as steep, and some 30 steps suffice.
    """
    chance = float(weight @ left / weight.sum())
    hessian = chance * (1 - chance) * _second_moment(known, weight) + np.diag(known.ridge)
    lower = np.linalg.cholesky(hessian)
    basis = solve_triangular(lower, np.eye(len(lower)), lower=True).T
    rows = sharded({"cell": known.cell, "own": np.asarray(known.own.values), "left": left}, weight)
    data = {"cells": known.cells.values, "ridge": known.ridge, "basis": basis, "rows": rows}
    first = np.zeros(len(lower)) if start is None else lower.T @ start
    return basis @ np.asarray(minimise(_of_basis, first, data)[0])


def _second_moment(known: Known, weight: Float[np.ndarray, " N"]) -> Float[np.ndarray, "K K"]:
    """Σ_n v_n x_n x_nᵀ, by sums over the rows of each cell."""
    cells, own = np.asarray(known.cells.values), np.asarray(known.own.values)
    of_cell = _sums(known.cell, weight, len(cells))
    mixed = np.stack([_sums(known.cell, weight * column, len(cells)) for column in own.T], axis=1) if own.size else own[:0]
    across = cells.T @ mixed if own.size else np.zeros((cells.shape[1], own.shape[1]))
    return np.block([[(cells * of_cell[:, None]).T @ cells, across], [across.T, (own * weight[:, None]).T @ own]])


def _sums(cell: Int[np.ndarray, " N"], values: Float[np.ndarray, " N"], number: int) -> Float[np.ndarray, " G"]:
    return np.bincount(cell, values, minlength=number)


def log_leaving(
    known: Known, weights: Float[np.ndarray, " K"], left: Bool[np.ndarray, " N"], rows: Shaped[np.ndarray, " Q"] | None = None
) -> tuple[Float[np.ndarray, " Q"], Float[np.ndarray, " Q"]]:
    """Compute the log-probability of what each animal did (left or stayed), and the chance h of leaving, at these rows."""
    rows = np.ones(len(left), dtype=bool) if rows is None else rows
    shared = len(known.cells.names)
    of_cell = np.asarray(known.cells.values) @ weights[:shared]
    logit = of_cell[known.cell[rows]] + np.asarray(known.own.values)[rows] @ weights[shared:]
    return log_expit(np.where(left[rows], logit, -logit)), 1.0 / (1.0 + np.exp(-logit))
