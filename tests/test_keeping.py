"""What a run keeps at its end: the summary first, and whatever else fails is a line, a trace and exit code 1."""

import json

import pytest

from aircl_jax import load, train
from experiments.run import main
from tests.tiny_runs import CHUNK, FAST, WORDS

PARTS = {
    "aircl_jax.figures.curves.losses": "a figure",
    "aircl_jax.analysis.episodes.gather": "a figure",
    "aircl_jax.reports.card.card_of": "the card",
    "aircl_jax.reports.recovered_words.reading": "the reading in plain words",
    "aircl_jax.outcome.maps_of_learned": "the maps",
}
QUICK = ("aircl_jax.figures.curves.losses",)


def fail(*_):
    raise ValueError("cannot convert\nfloat NaN to integer")


@pytest.mark.parametrize("part", [pytest.param(part, marks=[pytest.mark.slow] * (part not in QUICK)) for part in PARTS])
def test_what_fails_after_the_training_costs_nothing_else(part, tmp_path, monkeypatch, capsys):
    run = tmp_path / "run"
    with monkeypatch.context() as patched:
        patched.setattr(part, fail)
        assert main([*WORDS, f"run_dir={run}"]) == 1
    line = f"{PARTS[part]} failed (ValueError: cannot convert float NaN to integer); the trace is in {run}/trace.txt"
    said = capsys.readouterr()
    assert set(said.err.splitlines()) == {f"warning: {line}"}
    assert "What to try next" in said.out
    assert line[1:] in (run / "report.md").read_text(encoding="utf-8")
    assert "in fail" in (run / "trace.txt").read_text(encoding="utf-8")
    assert json.loads((run / "summary.json").read_text())["metrics"]
    assert {path.stem for path in (run / "figures").iterdir()} >= {"learning_curves"}
    assert main([*WORDS, f"run_dir={run}", "resume=true"]) == 0
    (run / "report.md").unlink()
    assert main([*WORDS, f"run_dir={run}", "resume=true"]) == 0
    assert not (run / "trace.txt").exists()


@pytest.fixture
def undrawn(monkeypatch):
    monkeypatch.setattr("aircl_jax.figures.of_a_run._parts", lambda result: [])


@pytest.mark.usefixtures("undrawn")
def test_a_run_killed_between_summary_and_report_is_finished_by_the_next_command(tmp_path):
    train(**FAST, iterations=CHUNK, run_dir=tmp_path)
    before = (tmp_path / "summary.json").read_bytes()
    (tmp_path / "report.md").unlink()
    (tmp_path / "card.json").unlink()
    assert load(tmp_path).summary == json.loads(before)
    train(**FAST, iterations=CHUNK, run_dir=tmp_path, resume=True)
    assert (tmp_path / "summary.json").read_bytes() == before
    assert (tmp_path / "report.md").exists() and (tmp_path / "card.json").exists()


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    "card",
    [
        '{"wants": [], "never": [{"what": 1}], "cannot_tell": [], "separable": false}',
        *(pytest.param(card, marks=pytest.mark.slow) for card in ("", "[]", "{}")),
    ],
)
def test_a_damaged_card_is_made_again_for_the_closing_lines(card, tmp_path, capsys):
    words = [*WORDS, f"run_dir={tmp_path}", f"iterations={CHUNK}"]
    assert main(words) == 0
    closing = capsys.readouterr().out.partition("What it wants")[2]
    (tmp_path / "card.json").write_text(card)
    assert main([*words, "resume=true"]) == 0
    assert capsys.readouterr().out.partition("What it wants")[2] == closing
