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
    calibration,
    evaluate,
    folds_of,
    jackknife,
    over_folds,
    over_recordings,
)
from aircl_jax.animals.trips import Trips, study_trips
from envs.animals.full.steps import Recordings


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
    held, _ = evaluate(columns, rows)
    steps, here = columns.recordings.steps, held.rows
    whether, where = held.model.whether - held.chain.whether, held.model.where - held.chain.where
    every, left = np.ones(int(here.sum())), columns.left[here].astype(np.float64)
    gain, fold, recording = (whether + where)[here], held.fold[here], steps.recording[here]
    total = (held.model.whether + held.model.where)[here]
    chain = (held.chain.whether + held.chain.where)[here]
    comparison = Comparison(
        name,
        len(every),
        int(left.sum()),
        over_folds(chain, every, fold).mean,
        over_folds(total, every, fold).mean,
        over_folds(gain, every, fold),
        over_recordings(gain, every, recording),
        over_folds(gain, left, fold),
        over_recordings(whether[here], every, recording),
        over_recordings(where[here], left, recording),
    )
    return comparison, held


def count_contexts(recordings: Recordings, held: HeldOut) -> list[Counted]:
    """Judge counting on richer contexts, each with the pseudo-count that is best on the test."""
    steps, folds = recordings.steps, folds_of(recordings)
    contexts = {"activity > place": [[], [steps.place]], "activity > previous": [[], [steps.previous]]}
    contexts["activity > place > previous"] = [[], [steps.place], [steps.place, steps.previous]]
    if "places" in recordings.lacks:
        contexts = {"activity > previous": contexts["activity > previous"]}
    here, weight = held.rows, held.rows.astype(np.float64)
    model = (held.model.whether + held.model.where)[here]
    every, found = np.ones(int(here.sum())), []
    for name, context in contexts.items():
        best: tuple[float, float, Any] | None = None
        for strength in BACK_OFF:
            nats = np.zeros(len(steps.code))
            for fold in range(int(folds.max()) + 1):
                judged = held.fold == fold
                nats[judged] = back_off(recordings, context, folds != fold, weight, strength)[judged]
            mean = over_folds(nats[here], every, held.fold[here]).mean
            if best is None or mean > best[0]:
                best = (mean, strength, nats[here])
        assert best is not None  # noqa: S101
        found.append(Counted(name, best[1], best[0], over_folds(model - best[2], every, held.fold[here])))
    return found


def fit_all(columns: Design, flagged: Bool[np.ndarray, "C C"]) -> Fitted:
    """Fit to all recordings, then without each in turn; flagged changes are ruled out, so that the reward need not say them."""
    columns = columns._replace(choices=ruled_out(columns.choices, flagged))
    number = len(columns.recordings.recordings)
    every = np.ones(number, dtype=bool)
    whole = fit(columns, every)
    parts = [fit(columns, every & (np.arange(number) != one), start=whole) for one in range(number)]
    going = type(whole.going)(*(jackknife(np.stack(values)) for values in zip(*(part.going for part in parts), strict=True)))
    spread = Behaviour(jackknife(np.stack([part.leaving for part in parts])), whole.leaving_names, going)
    rewards = np.stack([reward_by_place(columns.recordings, part.going) for part in parts])
    return Fitted(
        whole, spread, reward_by_place(columns.recordings, whole.going), jackknife(rewards), begun_at(columns.recordings)
    )


def _apart(recordings: Recordings) -> bool:
    """Return whether the windows hold some of the steps, in two folds or more, and leave some out."""
    steps = recordings.steps
    held = np.unique(folds_of(recordings)[steps.recording[steps.in_window]])
    return len(held) > 1 and not steps.in_window.all()


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
    comparisons = [whole]
    counted_on = held
    if _apart(recordings):
        windows, counted_on = compare("windows", columns, recordings.steps.in_window)
        comparisons = [windows, whole]
    lap("folds")
    changes = avoided_changes(choices_of(recordings, ORDINARY), recordings, np.ones(len(columns.choices.step)))
    lap("changes")
    counted = count_contexts(recordings, counted_on)
    for name, other in others.items():
        comparisons.append(compare(name, design(other), other.steps.in_window)[0])
    lap("counting and other codings")
    fitted = fit_all(columns, changes.flagged)
    lap("jackknife")
    judged = judge_on_halves(choices_of(recordings, ORDINARY), recordings, halves) if halves else {}
    lap("halves")
    trips = study_trips(recordings)
    lap("trips")
    return Study(columns, comparisons, counted, calibration(columns, held), fitted, changes, judged, trips, seconds)
