"""Choose features and ridges for each fold from the other folds alone, and judge the choice.

Each fit begins where the last of its variant ended (`last`); the problems are convex, so that moves no result.
"""

from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from aircl_jax.animals.behaviour import TEMPO, Design, design, leaving_groups
from aircl_jax.animals.counting import counts_by_recording, smoothed_chain
from aircl_jax.animals.going import MODEL, Weights, fit_going, log_going
from aircl_jax.animals.held_out import folds_of, over_folds, over_recordings
from aircl_jax.animals.leaving import fit_leaving, log_leaving
from aircl_jax.animals.nested import nested_selection
from aircl_jax.reports import markdown
from envs.animals.full.steps import Recordings
from experiments.behaviour.report import gain

STRENGTHS = {"ridges × ⅓": 1 / 3, "ridges × 3": 3.0}
WITHOUT_WHETHER = ("age by activity", "previous activity", "place", "neighbours' behaviour", TEMPO)
WITHOUT_WHERE = ("place", "neighbours' behaviour", "return")


def nested(recordings: Recordings) -> tuple[list[str], dict[str, Any]]:
    """Choose among the full model, the model without a group of features, and other ridges.

    Return the report's lines, and the numbers.
    """
    whether, where = _variants(recordings)
    steps, folds = recordings.steps, folds_of(recordings)
    of_whether = nested_selection(whether, partial(_leaving, recordings, {}), folds, steps.recording)
    of_where = nested_selection(where, partial(_going, recordings, {}), folds, steps.recording)
    counts = counts_by_recording(recordings, steps.in_window.astype(np.float64))
    chain = np.zeros(len(steps.code))
    for fold in range(int(folds.max()) + 1):
        here = folds[steps.recording] == fold
        chain[here] = smoothed_chain(counts, folds != fold)[0][steps.code, steps.following][here]
    here = steps.in_window
    difference = (of_whether.nats + of_where.nats - chain)[here]
    every = np.ones(len(difference))
    folds_gain = over_folds(difference, every, folds[steps.recording][here])
    recordings_gain = over_recordings(difference, every, steps.recording[here])
    rows = [(str(fold), one, other) for fold, (one, other) in enumerate(zip(of_whether.chosen, of_where.chosen, strict=True))]
    gains = f"{gain(folds_gain)} folds; {gain(recordings_gain)} recordings"
    how = "Features and ridges of each fold are chosen on the other folds, each of these fitted without either."
    table = markdown.table(("fold", "whether", "where"), rows)
    lines = [f"**Nested selection.** {how} Gain a step over the smoothed chain, windows: {gains}.", table]
    numbers = {
        "per_step": folds_gain._asdict(),
        "by_recording": recordings_gain._asdict(),
        "whether": of_whether.chosen,
        "where": of_where.chosen,
    }
    return lines, numbers


def _variants(recordings: Recordings) -> tuple[dict[str, Design], dict[str, Design]]:
    groups = leaving_groups(recordings)
    whether = {"all": design(recordings)} | {name: design(recordings, strength=by) for name, by in STRENGTHS.items()}
    where = dict(whether)
    for name in WITHOUT_WHETHER:
        if name in groups:
            whether[f"without {name}"] = design(recordings, leaving=tuple(one for one in groups if one != name))
    for name in WITHOUT_WHERE:
        where[f"without {name}"] = design(recordings, going=tuple(one for one in MODEL if one != name))
    return whether, where


def _leaving(
    recordings: Recordings, last: dict[int, Float[np.ndarray, " K"]], variant: Design, trained: Bool[np.ndarray, " R"]
) -> Float[np.ndarray, " N"]:
    steps, columns = recordings.steps, variant.leaving(trained)
    use = trained[steps.recording] * steps.in_window.astype(np.float64)
    weights = last[id(variant)] = fit_leaving(columns, variant.left, use, last.get(id(variant)))
    return log_leaving(columns, weights, variant.left)[0]


def _going(
    recordings: Recordings, last: dict[int, Weights], variant: Design, trained: Bool[np.ndarray, " R"]
) -> Float[np.ndarray, " N"]:
    steps, choices = recordings.steps, variant.choices
    use = trained[steps.recording] * steps.in_window.astype(np.float64)
    nats = np.zeros(len(steps.code))
    weights = last[id(variant)] = fit_going(choices, choices.weighed(use[choices.change]), last.get(id(variant)))
    nats[choices.change] = log_going(choices, weights)[choices.row]
    return nats
