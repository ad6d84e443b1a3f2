"""Write the card of a row with a reward of states: what it wants, which cells it does not enter, what was never tested."""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from aircl_jax.analysis.entries import Entries, entries_of, slopes, tempted_share
from aircl_jax.analysis.episodes import LearnedTables, learned_tables
from aircl_jax.model.feasibility import FORBIDDEN_BELOW
from aircl_jax.runs.result import Result
from envs import Grid, Tabular

LEAST_WEIGHT = 0.25  # of β: a reward about which nothing is said
SEEDS_AGREE = 0.5  # share of the seeds that must draw a limit or forbid a cell for it to be listed
LEAST_TEMPTED = 0.01  # share of steps that the plan of f alone must spend in forbidden cells for f to be without them
_AXES = ("one row further down", "one column further right")


def of_entries(result: Result, grid: Grid, table: Tabular) -> dict[str, Any]:
    """Make the card of a grid whose entries were counted."""
    tables = learned_tables(result.networks, result.states, table)
    entries = entries_of(result.networks, result.states, result.expert, table)
    forbids = np.asarray((tables.step_delta < FORBIDDEN_BELOW).all(axis=-1))  # [S, X]
    shares = [
        tempted_share(reward, table, result.spec.env.horizon, barred)
        for reward, barred in zip(tables.reward.astype(float), forbids, strict=True)
    ]
    separable = bool(np.mean(shares) > LEAST_TEMPTED) or not forbids.any()
    return {
        "wants": wants(tables, slopes(result), grid),
        "never": _never(tables, entries, forbids, grid),
        "cannot_tell": _cannot_tell(entries, forbids, grid, separable, result.spec.config.coefficients.threshold),
        "separable": separable,
    }


def wants(tables: LearnedTables, slope: Float[np.ndarray, "S P"], grid: Grid) -> list[dict[str, Any]]:
    """List what one step is worth, greatest size first, in units of the demonstrators' temperature.

    These are the potential's slopes and g(s) less its mean, of places of which the mean over seeds is at least ¼.
    """
    if tables.state_reward is None:
        raise TypeError("the row has no reward of states")
    state = tables.state_reward - tables.state_reward.mean(axis=-1, keepdims=True)
    places = [(f"a step in cell {_cell(place, grid)}", values) for place, values in enumerate(state.T)]
    entries = [
        {"what": what, "weight": float(values.mean()), "spread": float(values.std())}
        for what, values in (*zip(_AXES, slope.T, strict=True), *places)
        if abs(values.mean()) >= LEAST_WEIGHT
    ]
    return sorted(entries, key=lambda entry: -abs(entry["weight"]))


def _never(tables: LearnedTables, entries: Entries, forbids: Bool[np.ndarray, "S X"], grid: Grid) -> list[dict[str, Any]]:
    """List the cells that most seeds forbid, the most tempted first."""
    delta, agreed = tables.step_delta.max(axis=-1), forbids.mean(axis=0)
    return [
        {
            "what": f"entering cell {_cell(int(place), grid)}",
            "limit": None,
            "spread": float(entries.expected[:, place].std()),
            "tempted": float(entries.expected[:, place].mean()),
            "done": float(entries.made[:, place].mean()),
            "how": f"δ₁ {delta[:, place].mean():.2f}, below ½ in {agreed[place]:.0%} of seeds",
        }
        for place in np.argsort(-entries.expected.mean(axis=0), kind="stable")
        if agreed[place] > SEEDS_AGREE
    ]


def _cannot_tell(entries: Entries, forbids: Bool[np.ndarray, "S X"], grid: Grid, separable: bool, threshold: Any) -> list[str]:
    """Say what was never tested, what a lapse may be, and whether the reward alone wants what is forbidden."""
    lines = []
    never = (entries.made.sum(axis=0) == 0) & (forbids.mean(axis=0) <= SEEDS_AGREE)
    if never.any():
        tempted = entries.expected.mean(axis=0)
        cells = ", ".join(f"{_cell(int(place), grid)} ({tempted[place]:.1f})" for place in np.flatnonzero(never))
        lines.append(f"Not tested: {cells}. In brackets, how often it would have been entered were it ordinary; too rarely.")
    share = float(threshold)
    lines.append(
        f"A cell counts as forbidden where it is entered less than {share:.0%} as often as it would be were it ordinary. "
        "A demonstrator who errs more often than that hides a constraint, and a place disliked more than that looks forbidden."
    )
    if not separable:
        lines.append(
            "Reward and constraint are not separable here: a plan on the reward alone keeps clear of what is forbidden."
        )
    return lines


def _cell(place: int, grid: Grid) -> list[int]:
    return [int(part) for part in np.divmod(place, grid.size)]
