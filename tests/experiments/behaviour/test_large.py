"""A made-up herd as a large table: it is what it says, and a million rows are fitted in little memory."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from envs.animals.columns import load_mapping
from envs.animals.tracks import read_folder
from experiments import herd

pytest.importorskip("pyarrow")
ROOT = Path(__file__).parents[3]
MEASURED = """import sys
from experiments.behaviour.__main__ import main
from experiments.shared.memory import most_memory
code = main(sys.argv[1:])
print(most_memory())
sys.exit(code)
"""


def test_the_herd_has_its_rows_and_never_does_what_it_never_does(tmp_path, capsys):
    assert herd.main(["rows=6000", "recordings=3", "animals=5", f"out={tmp_path}"]) == 0
    assert f"mapping={tmp_path}/herd.yaml data={tmp_path}" in capsys.readouterr().out
    tracks = read_folder(tmp_path, load_mapping(str(tmp_path / "herd.yaml"))).tracks
    assert tracks.recording.counts() == dict.fromkeys(("day000", "day001", "day002"), 2000)
    act = tracks.behaviour.texts()
    same = ~tracks.individual.differ() & ~tracks.recording.differ()
    never = (act[:-1] == herd.NEVER[0]) & (act[1:] == herd.NEVER[1])
    assert (never & ~same).any() or not never.any()
    assert not (never & same).any()
    leaves = (act[1:] != act[:-1])[same].mean()
    assert leaves == pytest.approx(0.14, abs=0.02)
    assert herd.main(["rows=10"]) == 2


@pytest.mark.slow
def test_a_million_rows_are_fitted_in_flat_memory(tmp_path):
    assert herd.main(["rows=1000000", f"out={tmp_path}"]) == 0
    words = [f"mapping={tmp_path}/herd.yaml", f"data={tmp_path}", f"out={tmp_path}/out", "halves=1"]
    child = [sys.executable, "-c", MEASURED, *words]
    said = subprocess.run(child, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=True)
    assert int(said.stdout.split()[-1]) < 1.6e9
    card = json.loads((tmp_path / "out" / "card.json").read_text())
    assert [entry["what"] for entry in card["never"]] == [", then ".join(herd.NEVER)]
    numbers = json.loads((tmp_path / "out" / "numbers.json").read_text())
    assert numbers["steps"] == 1_000_000 - 400
    with np.load(tmp_path / "out" / "recovered.npz") as arrays:
        reward, names, places = arrays["reward"], arrays["activities"].tolist(), arrays["places"].tolist()
    found = reward[[places.index(place) for place in herd.PLACES]][:, [names.index(one) for one in herd.ACTIVITIES]]
    np.testing.assert_allclose(found, herd.REWARD - herd.REWARD.mean(axis=1, keepdims=True), atol=0.05)
