"""Write the card of a run: what it wants, what it does not do, and what these demonstrations cannot tell."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from aircl_jax.analysis.episodes import gather_grid
from aircl_jax.analysis.recovered import AVOIDED_BELOW, avoided, expected, recover
from aircl_jax.analysis.recovered_limits import recovered_limits
from aircl_jax.reports import markdown
from aircl_jax.reports.card_of_activities import beside_counting, of_activities
from aircl_jax.reports.card_of_entries import SEEDS_AGREE, of_entries
from aircl_jax.reports.card_of_limits import of_limits
from aircl_jax.runs.metrics_log import is_number
from aircl_jax.runs.result import Result
from envs import Codes, Grid

Card = Mapping[str, Any]  # {"wants": [..], "never": [..], "cannot_tell": [..], "separable": bool}

SHOWN = 3  # entries of each list in a run's closing lines
MOST = 12  # entries of each list in card.md

_LOG_POLICY = (
    "Reward and constraint are not separable here: f = log π_E. A discriminator is at rest where f equals the logarithm of "
    "the demonstrators' policy and a constant, so f repeats what they do, constraint included, and not why."
)
_OF_VISITS = (
    "Reward and constraint are not separable here: a discriminator's reward of states says where the demonstrations are and "
    "the policy was not, whatever the reason."
)
_LIKELIHOOD = (
    "The reward is the smallest one of states that explains the demonstrations; whether it holds a part of the constraint "
    "was not tested."
)
_NO_REWARD = "No reward was learned: cloning copies what was done."
_NO_WANTS = {True: "Nothing stands out.", False: "Nothing that can be told apart from what it does; see below."}
_KNOWN_REWARD = "The reward was given, not inferred; what is not done may depend on it."
_OF_TASKS = (
    "One constraint from {number} tasks ({names}). The counts are sums over all of them; what it wants is this task's own."
)
_OF_LEARNER = {"twins": of_limits, "likelihood": of_activities}


def card_of(result: Result) -> dict[str, Any]:
    """Make the card of a finished run: each entry with its spread over seeds.

    Where several tasks learned one constraint, "tasks" names them, and `tempted` and `done` are sums over all of them.

    `wants` has {"what", "weight", "spread"}; `never` has {"what", "limit", "spread", "tempted", "done", "how"}: how often
    the demonstrations would have done it were it ordinary (None where the method does not measure that), and how often
    they did.
    """
    card, tasks = _card_of(result), list(result.spec.tasks)
    return {**card, "tasks": tasks} if tasks else card


def _card_of(result: Result) -> dict[str, Any]:
    method, view = result.spec.method, result.spec.env.view
    if method.tests_entries and isinstance(view, Grid) and result.spec.env.tabular is not None:
        return of_entries(result, view, result.spec.env.tabular)
    if method.learner in _OF_LEARNER:
        return _OF_LEARNER[method.learner](result)
    never: list[dict[str, Any]] = []
    cannot: list[str] = []
    if not method.learns_reward:
        cannot.append(_NO_REWARD if method.clones else _KNOWN_REWARD)
    else:
        of_states = _OF_VISITS if method.discriminates else _LIKELIHOOD
        cannot.append(of_states if method.state_reward else _LOG_POLICY)
    if not method.learns_feasibility:
        cannot.append("No constraint was learned: what is not done may be disliked or forbidden.")
    elif not method.tests_steps:
        cannot.append("The constraint is of whole trajectories alone: no single place or limit can be named.")
    elif isinstance(view, Grid):
        never, unseen = _cells(result)
        cannot += unseen
    elif isinstance(view, Codes):
        never = _changes(result, view)
    else:
        never, unseen = _limits(result)
        cannot += unseen
    if isinstance(view, Codes):
        cannot.append(beside_counting(result))
    if never:
        cannot.append("Of what is not done, this method cannot tell the forbidden from what was merely never wanted.")
    return {"wants": [], "never": never, "cannot_tell": cannot, "separable": False}


def is_card(found: Mapping[str, Any]) -> bool:
    """Say whether what was read from a file is a card."""
    lists = [found.get(name) for name in ("wants", "never", "cannot_tell")]
    entries = [entry for each in lists[:2] if isinstance(each, list) for entry in each]
    named = all(isinstance(entry, dict) and isinstance(entry.get("what"), str) for entry in entries)
    limits = named and all(_is_limit(entry) for entry in entries)
    return all(isinstance(each, list) for each in lists) and limits and isinstance(found.get("separable"), bool)


def as_json(card: Card) -> str:
    """Write card.json."""
    return json.dumps(card, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def as_markdown(card: Card, title: str) -> str:
    """Write card.md."""
    wants = [(entry["what"], _weight(entry)) for entry in card["wants"][:MOST]]
    never = [
        (entry["what"], _limit(entry), _times(entry["tempted"]), _times(entry["done"]), entry["how"])
        for entry in card["never"][:MOST]
    ]
    more = len(card["never"]) - len(never)
    return markdown.paragraphs(
        f"# {title}",
        "## What it wants",
        markdown.table(("what", "weight"), wants) if wants else _NO_WANTS[bool(card["separable"])],
        "## What it does not do",
        *([_OF_TASKS.format(number=len(tasks), names=", ".join(tasks))] if (tasks := card.get("tasks")) else []),
        markdown.table(("what", "limit", "would have, were it ordinary", "did", "how it is known"), never)
        if never
        else "Nothing was found that it does not do.",
        *([f"{more} more are in card.json."] if more > 0 else []),
        "## What these demonstrations cannot tell",
        markdown.bullets(card["cannot_tell"]) or "Nothing is missing.",
    )


def closing(card: Card) -> str:
    """Write the few lines of the card that a run ends with."""
    nothing = "nothing stands out" if card["separable"] else "not separable from what it does (f = log π_E)"
    wants = ", ".join(f"{entry['what']} ({entry['weight']:+.2g})" for entry in card["wants"][:SHOWN]) or nothing
    if not card["separable"] and any(line in (_NO_REWARD, _KNOWN_REWARD) for line in card["cannot_tell"]):
        wants = "no reward was learned"
    never = "; ".join(f"{entry['what']} {_limit(entry)}".strip() for entry in card["never"][:SHOWN]) or "nothing was found"
    more = len(card["never"]) - SHOWN
    return f"What it wants: {wants}.\nWhat it does not do: {never}" + (f"; and {more} more." if more > 0 else ".")


def _cells(result: Result) -> tuple[list[dict[str, Any]], list[str]]:
    """List the cells that δ₁ forbids, most agreed first, and what is said of the cells that nobody enters."""
    table = result.spec.env.tabular
    grid = result.spec.env.view
    assert table is not None  # noqa: S101
    assert isinstance(grid, Grid)  # noqa: S101
    maps = gather_grid(result, table)
    delta = maps.step_delta.max(axis=-1)  # a cell is forbidden where every action in it is
    forbids = (delta < AVOIDED_BELOW).mean(axis=0)
    obs, mask = np.asarray(result.expert.obs), np.asarray(result.expert.mask)
    visits = np.einsum("snto,snt->o", obs, mask) / len(obs)
    entries = [
        {
            "what": f"entering cell {[int(part) for part in np.divmod(cell, grid.size)]}",
            "limit": None,
            "spread": float(delta[:, cell].std()),
            "tempted": None,
            "done": float(visits[cell]),
            "how": f"δ₁ {delta[:, cell].mean():.2f}, below ½ in {forbids[cell]:.0%} of seeds",
        }
        for cell in np.argsort(delta.mean(axis=0), kind="stable")
        if forbids[cell] > SEEDS_AGREE
    ]
    empty = int(((visits == 0) & (forbids <= SEEDS_AGREE)).sum())
    unknown = f"{empty} cells are in no demonstration and not forbidden either: nothing is known of them."
    return entries, [unknown] if empty else []


def _changes(result: Result, codes: Codes) -> list[dict[str, Any]]:
    """List the changes of activity that δ₁ forbids, with how often chance would have shown them."""
    table = result.spec.env.tabular
    assert table is not None  # noqa: S101
    recovered = recover(result, table)
    chance = expected(recovered.seen, codes.impossible)
    return [
        {
            "what": f"{codes.names[source]}, then {codes.names[target]}",
            "limit": None,
            "spread": float(recovered.delta[:, source, target].std()),
            "tempted": float(chance[source, target]),
            "done": float(recovered.seen[source, target]),
            "how": f"δ₁ {recovered.delta[:, source, target].mean():.2f}; the temptation is what chance would give",
        }
        for source, target in avoided(recovered, codes)
    ]


def _limits(result: Result) -> tuple[list[dict[str, Any]], list[str]]:
    """List the limits that most seeds draw, and the coordinates that nothing bounds."""
    limits = recovered_limits(result)
    if limits is None:
        return [], []
    unmasked = np.asarray(result.expert.mask[0]) > 0
    entries, free = [], []
    for index, name in enumerate(limits.names):
        found = False
        for side, values, end in (
            ("above", limits.upper[:, index], limits.greatest[index]),
            ("below", limits.lower[:, index], limits.least[index]),
        ):
            drawn = values[np.isfinite(values)]
            if len(drawn) <= SEEDS_AGREE * len(values):
                continue
            found = True
            entries.append(
                {
                    "what": f"{name} {side}",
                    "limit": float(drawn.mean()),
                    "spread": float(drawn.std()),
                    "tempted": None,
                    "done": _beyond(result, limits.names, index, float(drawn.mean()), side, unmasked),
                    "how": f"δ₁ below ½ in {len(drawn)} of {len(values)} seeds; demonstrations reach {end:.3g}",
                }
            )
        if not found:
            free.append(name)
    unseen = f"No limit was found of {', '.join(free)}: further out than the demonstrations go, nothing is known."
    return entries, [unseen] if free else []


def _beyond(result: Result, names: Sequence[str], index: int, limit: float, side: str, unmasked: np.ndarray) -> float:
    """Count the demonstrated steps beyond a limit."""
    env = result.spec.env
    name = names[index]
    if name in env.motor_names:
        values = np.asarray(result.expert.action[0])[unmasked][:, env.motor_names.index(name)]
    else:
        values = np.asarray(result.expert.obs[0])[unmasked][:, env.coordinate_names.index(name)]
    return float((values > limit).sum() if side == "above" else (values < limit).sum())


def _is_limit(entry: Mapping[str, Any]) -> bool:
    whole = all(is_number(entry.get(name, "")) for name in ("tempted", "done", "limit", "spread") if name in entry)
    return whole and (entry.get("limit") is None or entry.get("spread") is not None)


def _weight(entry: Mapping[str, Any]) -> str:
    return f"{entry['weight']:.2f}" + ("" if entry["spread"] is None else f" ± {entry['spread']:.2f}")


def _limit(entry: Mapping[str, Any]) -> str:
    return "" if entry["limit"] is None else f"{entry['limit']:.3g} ± {entry['spread']:.2g}"


def _times(count: float | None) -> str:
    return "not measured" if count is None else f"{count:.0f} times"
