"""Study one data set of tables: held-out folds, coefficients, avoided changes, trips."""

import time
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from aircl_jax.animals.behaviour import Behaviour, Design, begun_at, design, fit, reward_by_place
from aircl_jax.animals.changes import Changes, Halves, avoided_changes, judge_on_halves, ruled_out
from aircl_jax.animals.counting import BACK_OFF, back_off
from aircl_jax.animals.going import ORDINARY, choices_of
from aircl_jax.animals.held_out import (
    AgeClass,
    Gain,
    HeldOut,
    evaluate,
    folds_of,
    jackknife,
    over_folds,
    over_recordings,
)
from aircl_jax.animals.trips import Trips, study_trips
from envs.animals.full.steps import Recordings
from envs.animals.rows.cells import cells_of


class Comparison(NamedTuple):
    """One way to read the rows, judged on held-out folds; nats, gains over the smoothed chain."""

    name: str
    steps: int
    changes: int
    chain: float
    model: float
    per_step: Gain  # over folds
    by_recording: Gain
    per_change: Gain  # all of the gain, over folds
    whether: Gain  # per step, over recordings
    where: Gain  # per change, over recordings


class Counted(NamedTuple):
    """A chain that backs off from a richer context, with the pseudo-count that is best on the held-out steps themselves."""

    context: str
    strength: float
    nats: float
    behind: Gain  # the model's gain over it, over folds


class Fitted(NamedTuple):
    """The model of all recordings, and standard errors by leaving out one recording at a time."""

    behaviour: Behaviour
    spread: Behaviour  # its arrays are standard errors
    reward: Float[np.ndarray, "P C"]  # r(c') + r(place, c') less its mean over the behaviours at that place
    reward_spread: Float[np.ndarray, "P C"]
    begun: Float[np.ndarray, "P C"]  # changes to c' at that place


class Study(NamedTuple):
    columns: Design
    comparisons: list[Comparison]
    counted: list[Counted]
    ages: list[AgeClass]
    fitted: Fitted
    changes: Changes
    halves: dict[str, Halves]
    trips: Trips | None
    seconds: dict[str, float]


def compare(name: str, columns: Design, rows: Bool[np.ndarray, " N"] | None = None) -> tuple[Comparison, HeldOut]:
    """Judge the model beside the smoothed chain on held-out folds of these rows."""
    held = evaluate(columns, rows)
    recording, gain = np.arange(len(held.fold)), held.model.both - held.chain.both
    whether, where = held.model.whether - held.chain.whether, held.model.where - held.chain.where
    comparison = Comparison(
        name,
        int(held.steps.sum()),
        int(held.changes.sum()),
        over_folds(held.chain.both, held.steps, held.fold).mean,
        over_folds(held.model.both, held.steps, held.fold).mean,
        over_folds(gain, held.steps, held.fold),
        over_recordings(gain, held.steps, recording),
        over_folds(gain, held.changes, held.fold),
        over_recordings(whether, held.steps, recording),
        over_recordings(where, held.changes, recording),
    )
    return comparison, held


def count_contexts(recordings: Recordings, held: HeldOut, rows: Bool[np.ndarray, " N"] | None = None) -> list[Counted]:
    """Judge counting on richer contexts, each with the pseudo-count that is best on the test."""
    cells = cells_of(recordings.steps.columns(("recording", "code", "following", "place", "previous")))
    times = np.bincount(cells.of if rows is None else cells.of[rows], minlength=len(cells.first)).astype(np.float64)
    recordings = recordings._replace(steps=recordings.steps.take(cells.first))
    steps, number = recordings.steps, len(held.fold)
    contexts = {"activity > place": [[], [steps.place]], "activity > previous": [[], [steps.previous]]}
    contexts["activity > place > previous"] = [[], [steps.place], [steps.place, steps.previous]]
    if "places" in recordings.lacks:
        contexts = {"activity > previous": contexts["activity > previous"]}
    found = []
    for name, context in contexts.items():
        best: tuple[float, float, Any] | None = None
        for strength in BACK_OFF:
            nats = np.zeros(number)
            for fold in range(int(held.fold.max()) + 1):
                judged = held.fold == fold
                each = times * back_off(recordings, context, ~judged, times, strength)
                nats[judged] = np.bincount(steps.recording, each, minlength=number)[judged]
            mean = over_folds(nats, held.steps, held.fold).mean
            if best is None or mean > best[0]:
                best = (mean, strength, nats)
        assert best is not None  # noqa: S101
        found.append(Counted(name, best[1], best[0], over_folds(held.model.both - best[2], held.steps, held.fold)))
    return found


def fit_all(columns: Design, flagged: Bool[np.ndarray, "C C"]) -> Fitted:
    """Fit to all recordings, then without each in turn; flagged changes are ruled out, so that the reward need not say them."""
    columns = columns._replace(choices=ruled_out(columns.choices, flagged))
    number = len(columns.recordings.recordings)
    every = np.ones(number, dtype=bool)
    whole = fit(columns, columns.leaving(every), every)
    parts = []
    for one in range(number):
        others = np.arange(number) != one
        parts.append(fit(columns, columns.leaving(others), others, start=whole))
    going = type(whole.going)(*(jackknife(np.stack(values)) for values in zip(*(part.going for part in parts), strict=True)))
    spread = Behaviour(jackknife(np.stack([part.leaving for part in parts])), whole.leaving_names, going)
    rewards = np.stack([reward_by_place(columns.recordings, part.going) for part in parts])
    return Fitted(
        whole, spread, reward_by_place(columns.recordings, whole.going), jackknife(rewards), begun_at(columns.recordings)
    )


def _apart(recordings: Recordings) -> bool:
    """Return whether the windows hold some of the steps, in two folds or more, and leave some out."""
    steps = recordings.steps
    used = np.bincount(steps.recording[steps.in_window], minlength=len(recordings.recordings)) > 0
    return len(set(folds_of(recordings)[used])) > 1 and not steps.in_window.all()


def study(recordings: Recordings, halves: int, others: dict[str, Recordings]) -> Study:
    """Do all of it. `others` are the same recordings read in another way, whose gain is reported too."""
    seconds: dict[str, float] = {}
    clock = time.perf_counter()

    def lap(name: str) -> None:
        nonlocal clock
        seconds[name] = time.perf_counter() - clock
        clock = time.perf_counter()

    columns = design(recordings)
    whole, held = compare("every step of every segment", columns)
    comparisons, counted_on = [whole], (held, None)
    if _apart(recordings):
        in_window = recordings.steps.in_window
        windows, of_windows = compare("windows", columns, in_window)
        comparisons, counted_on = [windows, whole], (of_windows, in_window)
    lap("folds")
    ordinary = choices_of(recordings, ORDINARY)
    changes = avoided_changes(ordinary, recordings, ordinary.times)
    lap("changes")
    counted = count_contexts(recordings, *counted_on)
    for name, other in others.items():
        comparisons.append(compare(name, design(other), other.steps.in_window)[0])
    lap("counting and other codings")
    fitted = fit_all(columns, changes.flagged)
    lap("jackknife")
    judged = judge_on_halves(ordinary, recordings, halves) if halves else {}
    lap("halves")
    trips = study_trips(recordings)
    lap("trips")
    return Study(columns, comparisons, counted, held.ages, fitted, changes, judged, trips, seconds)
