"""A recorder of one's own: told of every chunk, in order, after the run's directory, and free to end the run."""

import jax
import numpy as np
import pytest

from aircl_jax import read_metrics, train
from aircl_jax.runs.directory import METRICS, STATE, TIMING
from tests.tiny_runs import FAST

pytestmark = pytest.mark.usefixtures("no_figures")
SETTINGS = {**FAST, "iterations": 5}


class Noting:
    def __init__(self, name, told, run_dir=None):
        self.name, self.told, self.run_dir = name, told, run_dir

    def on_chunk(self, iteration, states, rows, timing):
        kept = sorted(path.name for path in (self.run_dir / STATE).iterdir()) if self.run_dir else []
        self.told.append((self.name, iteration, jax.device_get(states.step), rows, timing, kept))


class Starting(Noting):
    def on_start(self, iteration, iterations):
        self.told.append((self.name, iteration, iterations))


def test_recorders_are_told_of_every_chunk_in_their_order_and_after_the_directory(tmp_path):
    told = []
    result = train(
        **SETTINGS, run_dir=tmp_path, recorders=[Starting("first", told, tmp_path), Noting("second", told, tmp_path)]
    )
    assert told[0] == ("first", 0, 5)
    chunks = told[1:]
    assert [(name, iteration) for name, iteration, *_ in chunks] == [(n, i) for i in (2, 4, 5) for n in ("first", "second")]
    for _, iteration, step, rows, timing, kept in chunks:
        assert list(step) == [iteration] * 2
        assert timing["iteration"] == iteration and timing["first"] == (iteration == 2)
        assert len(rows) == (1 if iteration == 5 else 2)
        assert kept[-1] == f"{iteration:08d}"
    rates = [row["violation_rate_policy"] for name, *_, rows, _, _ in chunks if name == "first" for row in rows]
    np.testing.assert_allclose(rates, result.history["violation_rate_policy"], rtol=1e-6)
    assert len((tmp_path / TIMING).read_text().splitlines()) == 3


@pytest.mark.parametrize("error", [ValueError("enough"), KeyError("enough")])
def test_what_a_recorder_raises_passes_through_once_the_chunk_is_kept(error, tmp_path):
    class Refusing:
        def on_chunk(self, iteration, states, rows, timing):
            raise error

    with pytest.raises(type(error)) as caught:
        train(**SETTINGS, run_dir=tmp_path, recorders=[Refusing()])
    assert caught.value is error
    assert len((tmp_path / METRICS).read_text().splitlines()) == 2
    assert len(read_metrics(tmp_path)["violation_rate_policy"]) == 2
    assert (tmp_path / STATE / "00000002").is_dir()
