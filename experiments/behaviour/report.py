"""Write report.md of a study of tables: when they leave, where they go, what they avoid, and what is not told."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from aircl_jax.animals.behaviour import Behaviour
from aircl_jax.animals.going import Choices
from aircl_jax.animals.held_out import AgeClass, Gain
from aircl_jax.reports import markdown
from aircl_jax.reports.behaviour_card import ranked, survives
from envs.animals.full.steps import Recordings
from experiments.behaviour.tables import Comparison, Study

Table = tuple[Sequence[str], Sequence[Sequence[str]]]  # a head and its rows

BOOTSTRAP = "[ ]: 95 %, of folds by t, of recordings by bootstrap."
SHOWN = 25  # coefficients of leaving


def report(
    study: Study,
    title: str,
    command: str,
    commit: str,
    captions: dict[str, str],
    account: Sequence[str] = (),
    extra: Sequence[str] = (),
) -> str:
    """Write the whole page; `account` says what was read and left out, `extra` goes below the comparisons."""
    recordings = study.columns.recordings
    return markdown.paragraphs(
        f"# {title}",
        f"`{command}`, commit {commit}. {_time(study)}",
        *_tables(recordings, account),
        "## Does it beat counting?",
        markdown.table(*comparison_table(study.comparisons)),
        BOOTSTRAP
        + " Nats; the chain is first-order, smoothed, fitted to the same steps. Whether: to leave or not, per step; where: "
        "to which activity, per change.",
        markdown.table(*_counted_table(study)),
        "The pseudo-counts of these chains are those that are best on the test itself.",
        *extra,
        "## When does it leave?",
        markdown.table(*age_table(study.ages)),
        *_figure(captions, "leaving_by_age"),
        markdown.table(("what raises the chance of leaving", "log odds", "± standard error"), _leaving_rows(study)),
        "Log odds for each unit of the column; standard errors by a jackknife over recordings. Shown are those beyond 1.96 "
        "standard errors, the largest first.",
        "## Where does it go?",
        *_figure(captions, "reward_by_place"),
        markdown.table(("what else draws it", "nats", "± standard error"), _going_rows(study)),
        *_trips(study),
        "## What does it never do, though one would expect it?",
        *_changes(study),
        *_figure(captions, "expected_changes"),
        "## What these recordings cannot tell",
        "See card.md beside this page.",
    )


def _time(study: Study) -> str:
    own = study.seconds["folds"] + study.seconds["changes"]
    rest = ", ".join(f"{name} {seconds:.0f} s" for name, seconds in study.seconds.items())
    return f"Fits, folds and changes took {own:.0f} s ({rest})."


def _tables(recordings: Recordings, account: Sequence[str]) -> Iterator[str]:
    steps = recordings.steps
    changes = int((steps.code != steps.following).sum())
    tracks = f"{len(np.unique(steps.track)):,} tracks in {len(recordings.recordings)} recordings"
    yield (
        f"{len(steps.code):,} steps of {tracks}, every gap-free segment whole; {changes:,} changes among "
        f"{len(recordings.names)} activities."
    )
    if account:
        yield "## What was read"
        yield markdown.bullets(f"{line[0].upper()}{line[1:]}" for line in account)


def comparison_table(comparisons: Sequence[Comparison]) -> Table:
    """Set the gains over the chain side by side: a row for each way to read the rows."""
    head = ("steps judged", "chain", "model", "gain a step, folds", "recordings", "gain a change", "whether", "where")
    rows = [
        (
            f"{one.name} ({one.steps:,}; {one.changes:,} changes)",
            f"{one.chain:.4f}",
            f"{one.model:.4f}",
            gain(one.per_step),
            gain(one.by_recording),
            gain(one.per_change, 3),
            gain(one.whether),
            gain(one.where, 3),
        )
        for one in comparisons
    ]
    return head, rows


def gain(value: Gain, digits: int = 4) -> str:
    """Write a gain with its interval and how many parts it is above 0 in."""
    number = f"+.{digits}f"
    return f"{value.mean:{number}} [{value.low:{number}}, {value.high:{number}}], {value.won} of {value.of}"


def _counted_table(study: Study) -> Table:
    rows = [(one.context, f"{one.strength:g}", f"{one.nats:.4f}", gain(one.behind)) for one in study.counted]
    return ("counting, back-off", "pseudo-count", "nats", "the model's gain over it"), rows


def age_table(ages: Sequence[AgeClass]) -> Table:
    """Compare the chance of leaving by age: observed, chain, model."""
    rows = [(age_label(one), f"{one.steps:,}", f"{one.observed:.3f}", f"{one.chain:.3f}", f"{one.model:.3f}") for one in ages]
    return ("age of the bout, rows", "steps", "left", "chain", "model"), rows


def age_label(one: AgeClass) -> str:
    if one.last is None:
        return f"> {one.first - 1}"
    return str(one.first) if one.last == one.first else f"{one.first}–{one.last}"


def _figure(captions: dict[str, str], name: str) -> Iterator[str]:
    if name in captions:
        yield f"![{name}]({name}.png)"
        yield captions[name]


def _leaving_rows(study: Study) -> Sequence[Sequence[str]]:
    whole, spread = study.fitted.behaviour, study.fitted.spread
    return _rows(whole.leaving_names, whole.leaving, spread.leaving, SHOWN, sure=True)


def _rows(names: Sequence[str], values: np.ndarray, errors: np.ndarray, most: int, *, sure: bool) -> Sequence[Sequence[str]]:
    shown = [int(k) for k in np.argsort(-np.abs(values)) if not sure or abs(values[k]) > 1.96 * errors[k]]
    return [(names[k], f"{values[k]:+.2f}", f"{errors[k]:.2f}") for k in shown[:most] if names[k] != "always"]


def going_coefficients(
    choices: Choices, behaviour: Behaviour, spread: Behaviour, names: Sequence[str]
) -> tuple[list[str], np.ndarray, np.ndarray]:
    """List the coefficients of where to go beside r(place, activity), with their standard errors."""
    labels = list(choices.fields)
    values, errors = [*behaviour.going.shared], [*spread.going.shared]
    for word, part in (("back again after", "back"), ("somebody shows it:", "join")):
        for code, name in enumerate(names):
            if getattr(behaviour.going, part)[code]:
                labels.append(f"{word} {name}")
                values.append(getattr(behaviour.going, part)[code])
                errors.append(getattr(spread.going, part)[code])
    for row in range(1, len(choices.situations)):
        if choices.situations[row] in ("log number close", "one of another group close"):
            labels += [f"{name}, by {choices.situations[row]}" for name in names]
            values += [*behaviour.going.table[row]]
            errors += [*spread.going.table[row]]
    return labels, np.array(values), np.array(errors)


def _going_rows(study: Study) -> Sequence[Sequence[str]]:
    columns, fitted = study.columns, study.fitted
    names, values, errors = going_coefficients(columns.choices, fitted.behaviour, fitted.spread, columns.recordings.names)
    shared = len(columns.choices.fields)
    always = _rows(names[:shared], values[:shared], errors[:shared], shared, sure=False)
    return [*always, *_rows(names[shared:], values[shared:], errors[shared:], SHOWN - shared, sure=True)]


def _trips(study: Study) -> Iterator[str]:
    trips = study.trips
    if trips is not None:
        alone = f"{trips.appeal_alone:.3f} nats a trip on held-out recordings"
        cost = f"{trips.cost:+.3f} ± {trips.spread:.3f} for each unit of the ground ({trips.unit})"
        yield (
            f"**Trips.** Over {trips.number} moves to another named place, the appeal of places alone gives {alone}; a cost of "
            f"distance adds {gain(trips.gain, 3)}. The cost is {cost}."
        )


def _changes(study: Study) -> Iterator[str]:
    found, names = study.changes, study.columns.recordings.names
    number = int(found.testable.sum())
    made = int(((found.made > 0) & found.possible).sum())
    yield (
        f"{int(found.possible.sum())} changes are possible, {made} were made, {number} were expected three times or more. "
        f"Flagged: {int(found.flagged.sum())}."
    )
    rows: list[Sequence[Any]] = [
        (
            names[pair[0]],
            names[pair[1]],
            f"{found.made[pair]:.0f}",
            f"{found.expected[pair]:.1f}",
            f"{found.p[pair]:.1g}",
            "yes" if survives(found, pair) else "no",
            f"{np.exp(found.log_bayes[pair]):.0f}",
            str(found.recordings[pair]),
            str(found.animals[pair]),
        )
        for pair in ranked(found)
    ]
    if rows:
        head = (
            "after",
            "hardly ever comes",
            "made",
            "expected",
            "p",
            "survives Bonferroni",
            "Bayes factor",
            "recordings",
            "animals",
        )
        yield markdown.table(head, rows)
        yield f"Bonferroni's line is {found.bonferroni:.1g}; the p are optimistic, because changes cluster by bout and day."
    if study.halves:
        rows = [
            (name, f"{one.pairs:.1f}", f"{one.made:.1f}", f"{one.expected:.1f}", f"{one.rate:.2f}")
            for name, one in study.halves.items()
        ]
        head = ("chosen on one half of the recordings", "pairs", "made on the other half", "expected there", "rate")
        yield markdown.table(head, rows)
        yield "Means over random halves. A rate of 1 is ordinary, 0 is never."
