# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure causal links of code sequences by tigramite's PCMCI with partial correlation, and the yardsticks beside them.

This file alone is under the GPL, because `CachedParCorr` subclasses tigramite's `CondIndTest`; nothing else in the
library imports it.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int, Shaped
from scipy.special import stdtr

try:
    from tigramite.data_processing import DataFrame
    from tigramite.independence_tests.independence_tests_base import CondIndTest
    from tigramite.pcmci import PCMCI
except ImportError as error:
    raise ImportError("causal links need the package tigramite, which is not installed; install aircl-jax[animals]") from error

PC_ALPHA = 0.05  # significance of the parent selection; Gendron et al. 2024
RESIDUAL_FLOOR = 1e-10  # of the variance: below it the conditions determine the variable (one-hots sum to one)

Node = tuple[int, int]  # (variable, −lag)


class Links(NamedTuple):
    """`value[i, j, τ]`: MCI partial correlation of code i at t − τ with code j at t (row = cause); lag 0 stays 0."""

    value: Float[np.ndarray, "C C L"]
    p: Float[np.ndarray, "C C L"]


class CachedParCorr(CondIndTest):
    """Partial correlation from one lagged correlation matrix, on the samples that tigramite's ParCorr takes.

    ρ(x, y | Z) = (C_xy − C_xZ C_ZZ⁺ C_Zy) / √(s_x s_y), s_x = C_xx − C_xZ C_ZZ⁺ C_Zx, by least squares; the analytic
    t-test has `samples − 2 − |Z|` degrees of freedom. Constant columns: value 0, p 1, no degree of freedom.
    """

    def __init__(self, **settings: Any) -> None:
        self._measure = "par_corr"
        self.two_sided = True
        self.residual_based = True
        super().__init__(**settings)
        self.correlation = np.empty((0, 0))
        self.lags = -1

    @property
    def measure(self) -> str:  # pyright: ignore[reportIncompatibleMethodOverride]
        return self._measure

    def get_dependence_measure(self, array: Any, xyz: Any, data_type: Any = None) -> None:
        raise NotImplementedError("CachedParCorr answers run_test from its correlation matrix")

    def _correlate(self, tau_max: int) -> None:
        """Fill `correlation` over the nodes (variable, lag 0 … 2 τ_max), each lag a block of variables."""
        self.lags = 2 * tau_max
        values: dict[int, Shaped[np.ndarray, "T C"]] = self.dataframe.values  # pyright: ignore[reportOptionalMemberAccess]
        rows = [
            np.concatenate([series[self.lags - lag : len(series) - lag] for lag in range(self.lags + 1)], axis=1)
            for series in values.values()
        ]
        stacked = np.concatenate(rows).astype(np.float64)
        stacked -= stacked.mean(axis=0)
        deviation = stacked.std(axis=0)
        deviation[np.ptp(stacked, axis=0) == 0] = 0.0
        stacked /= np.where(deviation > 0, deviation, 1.0)
        self.samples, self.variables = len(stacked), stacked.shape[1] // (self.lags + 1)
        self.correlation = stacked.T @ stacked / self.samples
        self.constant = deviation == 0

    def run_test(
        self,
        X: list[Node],  # noqa: N803 - tigramite's names
        Y: list[Node],  # noqa: N803
        Z: Sequence[Node] | None = None,  # noqa: N803
        tau_max: int = 0,
        cut_off: str = "2xtau_max",
        alpha_or_thres: float | None = None,
    ) -> tuple[float, float] | tuple[float, float, bool]:
        """Test X ⟂ Y | Z: value and p, and the decision p ≤ α if one is given. Raises ValueError for another cut-off."""
        if cut_off != "2xtau_max":
            raise ValueError(f"unknown cut_off {cut_off!r}; CachedParCorr has only '2xtau_max'")
        if self.lags != 2 * tau_max:
            self._correlate(tau_max)
        x, y = self._index(X[0]), self._index(Y[0])
        given = [self._index(node) for node in dict.fromkeys(Z or []) if node not in (X[0], Y[0])]
        value, p = self._partial_correlation(x, y, [z for z in given if not self.constant[z]])
        return (value, p) if alpha_or_thres is None else (value, p, p <= alpha_or_thres)

    def _index(self, node: Node) -> int:
        variable, negative_lag = node
        return -negative_lag * self.variables + variable

    def _partial_correlation(self, x: int, y: int, given: list[int]) -> tuple[float, float]:
        if self.constant[x] or self.constant[y]:
            return 0.0, 1.0
        pair = self.correlation[np.ix_([x, y], [x, y])]
        if given:
            cross = self.correlation[np.ix_(given, [x, y])]
            solution = np.linalg.lstsq(self.correlation[np.ix_(given, given)], cross, rcond=None)[0]
            pair = pair - cross.T @ solution
        if min(pair[0, 0], pair[1, 1]) < RESIDUAL_FLOOR:
            return 0.0, 1.0
        value = float(np.clip(pair[0, 1] / np.sqrt(pair[0, 0] * pair[1, 1]), -1.0, 1.0))
        freedom = self.samples - 2 - len(given)
        if freedom < 1:
            return value, float("nan")
        if abs(value) == 1.0:
            return value, 0.0
        return value, float(2 * stdtr(freedom, -abs(value) * np.sqrt(freedom / (1 - value * value))))


def link_strengths(windows: Int[np.ndarray, "N T"], num_codes: int, tau_max: int = 1, test: CondIndTest | None = None) -> Links:
    """Run PCMCI over one-hot codes, each window its own sample (tigramite's `analysis_mode="multiple"`).

    Runge et al. 2019; settings of Gendron et al. 2024. Raises ValueError for codes outside 0 … num_codes − 1 and
    for windows of at most 2 τ_max steps.
    """
    if windows.min() < 0 or windows.max() >= num_codes:
        raise ValueError(f"codes run from {windows.min()} to {windows.max()}; choose num_codes above {windows.max()}")
    if windows.shape[1] <= 2 * tau_max:
        raise ValueError(f"windows of {windows.shape[1]} steps are too short for tau_max {tau_max}")
    one_hot = np.eye(num_codes)[windows]
    frame = DataFrame(dict(enumerate(one_hot)), analysis_mode="multiple")
    pcmci = PCMCI(frame, cond_ind_test=test or CachedParCorr(), verbosity=0)
    result = pcmci.run_pcmci(tau_min=1, tau_max=tau_max, pc_alpha=PC_ALPHA, alpha_level=PC_ALPHA)
    return Links(result["val_matrix"], result["p_matrix"])


def strongest(links: Links) -> Float[np.ndarray, "C C"]:
    """Take V, the value of the lag with the largest |value| over τ = 1 … τ_max, for each pair of codes."""
    lagged = links.value[:, :, 1:]
    return np.take_along_axis(lagged, np.abs(lagged).argmax(axis=2)[:, :, None], axis=2)[:, :, 0]


def difference(ours: Links, real: Links) -> Float[np.ndarray, "C C"]:
    """Compute |ΔV| of two analyses, as drawn in the paper's Figure 4."""
    return np.abs(strongest(ours) - strongest(real))


def mean_difference(ours: Links, real: Links) -> float:
    """Average |ΔV| over all pairs of codes."""
    return float(difference(ours, real).mean())


def halves(windows: Int[np.ndarray, "N T"], seed: int) -> tuple[Int[np.ndarray, "A T"], Int[np.ndarray, "B T"]]:
    """Split the windows into two random halves, which differ by sampling alone."""
    order = np.random.default_rng(seed).permutation(len(windows))
    return windows[order[: len(order) // 2]], windows[order[len(order) // 2 :]]


def markov_chain(
    windows: Int[np.ndarray, "N T"], num_codes: int, smoothing: float = 0.0
) -> tuple[Float[np.ndarray, " C"], Float[np.ndarray, "C C"]]:
    """Fit the start and P(c'|c) = (n_cc' + s) / Σ_k (n_ck + s) of a first-order chain; a code never left stays."""
    start = np.bincount(windows[:, 0], minlength=num_codes) / len(windows)
    counts = np.zeros((num_codes, num_codes))
    np.add.at(counts, (windows[:, :-1].ravel(), windows[:, 1:].ravel()), 1.0)
    counts += smoothing
    never_left = counts.sum(axis=1) == 0
    counts[never_left, never_left] = 1.0
    return start, counts / counts.sum(axis=1, keepdims=True)


def sample_chain(
    start: Float[np.ndarray, " C"], transition: Float[np.ndarray, "C C"], num_windows: int, length: int, seed: int
) -> Int[np.ndarray, "N T"]:
    """Draw N windows of a Markov chain at once, by inversion of its cumulative distribution."""
    generator = np.random.default_rng(seed)
    cumulative = np.cumsum(transition, axis=1)
    codes = np.empty((num_windows, length), dtype=np.int64)
    codes[:, 0] = generator.choice(len(start), size=num_windows, p=start)
    for t in range(1, length):
        above = cumulative[codes[:, t - 1]] > generator.random((num_windows, 1))
        codes[:, t] = above.argmax(axis=1)
    return codes


def uniform_windows(num_windows: int, length: int, num_codes: int, seed: int) -> Int[np.ndarray, "N T"]:
    """Draw codes uniformly and independently: the worst yardstick."""
    return np.random.default_rng(seed).integers(num_codes, size=(num_windows, length))


def yardsticks(windows: Int[np.ndarray, "N T"], num_codes: int, tau_max: int, seed: int) -> dict[str, float]:
    """Compute the mean |ΔV| to read a method's beside, on as many windows as the real ones.

    `halves` compares two halves; `noise_floor` = halves / √2 is the same at full size against a perfect model: the
    halves differ with variance 2 · 2σ², a full-size sample differs from the real one with 2σ².
    """
    size, length = windows.shape
    real = link_strengths(windows, num_codes, tau_max)
    first, second = (link_strengths(half, num_codes, tau_max) for half in halves(windows, seed))
    chain = sample_chain(*markov_chain(windows, num_codes), size, length, seed)
    uniform = uniform_windows(size, length, num_codes, seed)
    split = mean_difference(first, second)
    return {
        "real_strength": float(np.abs(strongest(real)).mean()),
        "halves": split,
        "noise_floor": split / 2.0**0.5,
        "markov_chain": mean_difference(link_strengths(chain, num_codes, tau_max), real),
        "uniform": mean_difference(link_strengths(uniform, num_codes, tau_max), real),
    }
