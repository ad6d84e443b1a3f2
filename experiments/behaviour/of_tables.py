"""Run the study of tables and write its page, figures, arrays and card."""

import json
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from aircl_jax.figures.animals import behaviour
from aircl_jax.figures.style import DPI, STYLE, Drawing
from aircl_jax.reports import card
from aircl_jax.reports.behaviour_card import behaviour_card
from aircl_jax.storage import write_whole
from envs.animals.data_folder import command_prefix
from envs.animals.full.reading import read_with_account
from envs.animals.full.steps import NONE, Recordings
from experiments.behaviour import choose, report
from experiments.behaviour.settings import Settings
from experiments.behaviour.tables import Study, study
from experiments.shared.commits import current_commit

FEASIBILITY = Path("results/figure4/recorded/aircl_corrected.json")  # δ₁ to compare with, of the published recordings


CHOSEN_HERE = (
    "Features and ridges were chosen while looking at these nine folds, so the gain on another herd may be smaller. "
    "`nested=true` chooses them for each fold on the others."
)


def run(settings: Settings, words: Sequence[str]) -> dict[str, Any]:
    """Study the tables and write everything; return the numbers."""
    commit = current_commit()
    recordings, account = read_with_account(settings.data, settings.mapping, settings.coding)
    others = {}
    if settings.reported:
        others = {"windows, coding=step": read_with_account(settings.data, settings.mapping, "step")[0]}
    found = study(recordings, settings.halves, others)
    command = command_prefix(settings.data, settings.simulated) + shlex.join(["python", "-m", "experiments.behaviour", *words])
    extra, nested = choose.nested(recordings) if settings.nested else ([], None)
    if settings.reported:
        extra = [CHOSEN_HERE, *extra]
    folder = settings.folder
    folder.mkdir(parents=True, exist_ok=True)
    captions = draw(found, folder, _feasibility(recordings) if settings.reported else None)
    fitted = found.fitted
    entries = behaviour_card(recordings, fitted.reward, fitted.reward_spread, fitted.begun, found.changes, found.halves)
    title = f"What {_animals(settings)} want, avoid, and cannot be asked"
    write_whole(folder / "card.json", card.as_json(entries))
    write_whole(folder / "card.md", card.as_markdown(entries, title))
    write_whole(folder / "report.md", report.report(found, title, command, commit, captions, account, extra))
    numbers = numbers_of(found, command, commit) | {"nested": nested}
    write_whole(folder / "numbers.json", json.dumps(without_nan(numbers), indent=1, allow_nan=False) + "\n")
    np.savez_compressed(folder / "recovered.npz", allow_pickle=False, **arrays(found))
    print(card.closing(entries))
    print(folder / "report.md")
    return numbers


def _animals(settings: Settings) -> str:
    if settings.mapping != "meerkat":
        return f"the animals of {Path(settings.mapping).stem}"
    return "the simulated mob" if settings.simulated else "the meerkats"


def draw(found: Study, folder: Path, feasibility: np.ndarray | None) -> dict[str, str]:
    """Save the figures; return their captions by name."""
    recordings, fitted, changes = found.columns.recordings, found.fitted, found.changes
    behaviours, ages = recordings.num_behaviours, found.ages
    places = recordings.places if "places" not in recordings.lacks else ("anywhere",)
    with mpl.rc_context(STYLE):
        drawings: list[Drawing] = [
            behaviour.reward_map(
                fitted.reward[:, :behaviours], fitted.begun[:, :behaviours], places, recordings.names[:behaviours]
            ),
            behaviour.expected_changes(
                changes.expected, changes.made, changes.flagged, changes.possible, recordings.names, feasibility
            ),
        ]
        if ages:
            observed, chain, model = ([getattr(one, name) for one in ages] for name in ("observed", "chain", "model"))
            unit = "rows" if recordings.seconds != 1 else "s"
            labels = [report.age_label(one) for one in ages]
            drawings.append(behaviour.leaving_by_age(labels, observed, chain, model, unit))
        for drawing in drawings:
            drawing.figure.savefig(folder / f"{drawing.name}.png", dpi=DPI)
    return {drawing.name: drawing.caption for drawing in drawings}


def _feasibility(recordings: Recordings) -> np.ndarray | None:
    """Read mean δ₁ of the adversarial row on the same codes, where its cell is kept."""
    if not FEASIBILITY.is_file():
        return None
    delta = np.array(json.loads(FEASIBILITY.read_text(encoding="utf-8"))["recovered"]["delta"], float).mean(axis=0)
    return delta if delta.shape == (len(recordings.names),) * 2 else None


def arrays(found: Study) -> dict[str, np.ndarray]:
    """Collect what was recovered, under the names of recovered.npz."""
    fitted, changes, recordings = found.fitted, found.changes, found.columns.recordings
    return {
        "activities": np.array(recordings.names),
        "places": np.array(recordings.places),
        "reward": fitted.reward,
        "reward_spread": fitted.reward_spread,
        "begun": fitted.begun,
        "leaving": fitted.behaviour.leaving,
        "leaving_spread": fitted.spread.leaving,
        "leaving_names": np.array(fitted.behaviour.leaving_names),
        "made": changes.made,
        "expected": changes.expected,
        "log_bayes": changes.log_bayes,
        "posterior": changes.posterior,
        "p": changes.p,
        "possible": changes.possible,
        "flagged": changes.flagged,
    }


def without_nan(value: Any) -> Any:
    """Replace what is undefined by None, which JSON has."""
    if isinstance(value, dict):
        return {name: without_nan(item) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [without_nan(item) for item in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def numbers_of(found: Study, command: str, commit: str) -> dict[str, Any]:
    """Collect the numbers of the page."""
    trips = found.trips
    steps = found.columns.recordings.steps
    return {
        "command": command,
        "commit": commit,
        "steps": len(steps.code),
        "changes": int((steps.code != steps.following).sum()),
        "without_place": int((steps.place == NONE).sum()),
        "comparisons": {
            one.name: {key: value._asdict() if hasattr(value, "_asdict") else value for key, value in one._asdict().items()}
            for one in found.comparisons
        },
        "counting": [{**one._asdict(), "behind": one.behind._asdict()} for one in found.counted],
        "leaving_by_age": [one._asdict() for one in found.ages],
        "halves": {name: {**one._asdict(), "rate": one.rate if one.expected else None} for name, one in found.halves.items()},
        "trips": None if trips is None else {**trips._asdict(), "gain": trips.gain._asdict()},
        "seconds": {name: round(value, 1) for name, value in found.seconds.items()},
    }
