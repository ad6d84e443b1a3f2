"""`experiments.figure4`: the smoothed chain, cells that are kept, and a whole pass on the simulated mob."""

import json

import numpy as np
import pytest

from aircl_jax.analysis.causal import markov_chain
from aircl_jax.analysis.recovered import Recovered
from envs.animals.meerkat import load
from envs.options import MeerkatOptions
from experiments.figure4 import cells, held_out
from experiments.figure4.__main__ import main


@pytest.fixture(scope="module")
def study():
    herd = load(MeerkatOptions(data="simulated"))
    return cells.Study(herd, herd.windows.code[:, :-1], {}, None, "")  # pyright: ignore[reportArgumentType]


def test_the_chain_of_the_training_recordings_is_smoothed_by_cross_validation(study):
    recordings = ["simulated_C2_00", "simulated_C3_00"]
    smoothing, chain = held_out.smoothed_chain(study, recordings)
    assert smoothing in held_out.SMOOTHINGS
    assert (chain > 0).all()
    windows = study.herd.windows
    fitted = windows.code[~np.isin(windows.recording, recordings)]
    np.testing.assert_allclose(chain, markov_chain(fitted, 25, smoothing)[1])


def test_a_cell_is_made_once(tmp_path):
    made = []

    def make():
        made.append(1)
        return {"value": len(made)}

    path = tmp_path / "folder" / "cell.json"
    assert cells.kept(path, {}, make) == cells.kept(path, {"value": 1}, make) == {"value": 1}
    with pytest.raises(ValueError, match=r"cell\.json has value=1, asked for is 2; give out=DIR"):
        cells.kept(path, {"value": 2}, make)


def test_what_was_recovered_is_read_back_from_a_cell_undefined_included():
    written = Recovered(np.full((1, 2, 2), np.nan), np.full((1, 2, 2), 0.25), np.zeros((1, 2, 2)), np.array([[1, 2], [3, 4]]))
    read = cells.from_json(json.loads(json.dumps(cells.as_json(written))))
    for one, other in zip(written, read, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["colour=red"], "unknown setting colour; choose from data"),
        (["methods=airl,gail", "data=simulated"], "unknown method 'gail'; choose from airl, airl_centred"),
        (["data=simulated", "seeds=0"], "seeds=0 is not an integer of at least 1"),
        (["tau_max=3"], "tau_max=3 is not one of 1, 5"),
        (["data=nowhere"], "env.data=nowhere: no such folder"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(arguments, words, capsys):
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1


@pytest.mark.slow
def test_a_smoke_pass_makes_every_cell_a_report_and_figures_and_then_makes_nothing_twice(tmp_path, capsys):
    words = ["data=simulated", "scale=smoke", "seeds=2", "folds=1", f"out={tmp_path}"]
    assert main(words) == 0
    folder = tmp_path / "simulated"
    report = (folder / "report.md").read_text()
    assert "SIMULATED" in report.splitlines()[0]
    assert all(f"| {method} |" in report for method in cells.ROWS)
    figures = {"figure4_links_tau1", "figure4_differences_tau1", "held_out", "activities", "reward_by_change"}
    assert figures <= {path.stem for path in folder.glob("*.png")}
    capsys.readouterr()
    assert main([*words, "tau_max=5"]) == 0
    assert "making" not in capsys.readouterr().out
    assert (folder / "figure4_links_tau5.png").exists()
