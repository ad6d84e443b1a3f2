"""What the page of animals says of the published recordings holds; skipped where they are not there."""

import os
from pathlib import Path

import pytest

from aircl_jax.animals.behaviour import design
from aircl_jax.animals.changes import avoided_changes
from aircl_jax.animals.going import ORDINARY, choices_of
from envs.animals.full.reading import read_recordings
from envs.animals.meerkat import load
from envs.options import MeerkatOptions
from experiments.behaviour.tables import compare

DATA = os.environ.get("AIRCL_DATA", "")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not (Path(DATA or "absent") / "meerkat").is_dir(), reason="AIRCL_DATA names no folder with meerkat/"),
]


@pytest.fixture(scope="module")
def recordings():
    return read_recordings(DATA)


def test_the_steps_of_the_windows_are_those_of_figure_4(recordings):
    steps, windows = recordings.steps, load(MeerkatOptions(data=DATA)).windows
    assert steps.in_window.sum() == windows.code[:, 1:].size == 38_670
    assert recordings.lacks == ()
    assert (steps.code != steps.following).sum() == 5389


def test_the_model_beats_the_chain_on_every_fold_and_every_recording(recordings):
    found, _ = compare("windows", design(recordings), recordings.steps.in_window)
    assert found.chain == pytest.approx(-0.3337, abs=1e-4)  # the chain of Figure 4
    assert found.per_step.mean > 0.035
    assert found.per_step.won == found.per_step.of == 9
    assert found.by_recording.won == found.by_recording.of == 18
    assert found.where.mean > 0.35


def test_a_sentinel_does_not_go_to_forage_at_once(recordings):
    choices = choices_of(recordings, ORDINARY)
    found = avoided_changes(choices, recordings, choices.times)
    pair = recordings.names.index("Raised Guarding (Vigilant)"), recordings.names.index("Foraging")
    assert found.flagged[pair]
    assert found.made[pair] == 0
    assert found.expected[pair] > 8
    assert found.p[pair] < found.bonferroni
