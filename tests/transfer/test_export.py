"""What is exported is what was learned: the same numbers for any batch, and a manifest that says what is what."""

import hashlib
import json
import subprocess
import sys
from dataclasses import replace
from functools import cache

import jax
import numpy as np
import pytest
from jax import export as jax_export

from aircl_jax.methods import METHODS
from aircl_jax.runs.result import Result
from aircl_jax.transfer import export
from aircl_jax.transfer.export import difference, export_run, exported
from aircl_jax.transfer.exported import Exportable, exportables, fresh_inputs
from aircl_jax.types import Trajectory
from experiments.export import main
from tests.finished_runs import untrained, untrained_robot

NAMES = ["policy", "reward", "step_feasibility", "feasibility"]


@cache
def functions(robot: bool) -> tuple[Result, dict[str, Exportable]]:
    result = untrained_robot("aircl_corrected") if robot else untrained("aircl_corrected")
    return result, {function.name: function for function in exportables(result, 1)}


def test_a_run_exports_what_its_method_learns():
    result, found = functions(True)
    assert list(found) == NAMES
    of = {name: replace(result, networks=replace(result.networks, method=METHODS[name])) for name in ("bc", "gacl", "airl")}
    assert [one.name for one in exportables(of["bc"], 0)] == ["policy"]
    assert [one.name for one in exportables(of["gacl"], 0)] == ["policy", "step_feasibility", "feasibility"]
    assert [one.name for one in exportables(of["airl"], 0)] == ["policy", "reward"]


@pytest.mark.parametrize("robot", [True, False])
def test_exported_functions_are_the_results_own_of_that_seed_in_any_batch(robot):
    result, found = functions(robot)
    for name, function in found.items():
        whole = exported(function, ("cpu", "cuda"))
        assert whole.platforms == ("cpu", "cuda")
        inputs = fresh_inputs(result, function, 3, 0)
        got = [np.asarray(leaf) for leaf in jax.tree.leaves(jax.jit(whole.call)(*inputs))]
        assert [leaf.shape for leaf in got] == [(3, *slot.shape) for slot in function.outputs]
        expected = of_result(result, name, *(jax.numpy.asarray(given[2]) for given in inputs))
        for one, other in zip(got, expected, strict=True):
            np.testing.assert_allclose(one[2], other, rtol=2e-5, atol=1e-6)


def of_result(result: Result, name: str, obs, *rest) -> list:
    if name == "policy":
        policy = result.policy(obs, *map(int, rest), index=1)
        return [policy.mean(), policy.stddev()] if not rest else [policy.logits]
    if name == "reward":
        return [result.reward(obs, rest[0], index=1)]
    if name == "step_feasibility":
        obs, rest = obs[None], (rest[0][None], jax.numpy.ones(1))
    nothing = jax.numpy.zeros_like(rest[1])
    zeros = (nothing, nothing, nothing, nothing)
    trajectory = Trajectory(obs, rest[0], *zeros, rest[1], nothing[0])
    return [result.step_feasibility(trajectory, 1)[0] if name == "step_feasibility" else result.feasibility(trajectory, 1)]


def test_a_policy_with_learned_limits_says_to_what_a_draw_is_clipped():
    free = untrained_robot("aircl_contrast")
    policy = free.states.params.policy["params"]
    number = len(free.summary["seeds"])
    drawn = {"lower": np.tile([-0.25, -100.0], (number, 1)), "upper": np.tile([0.5, 0.125], (number, 1))}
    limited = {"params": policy | {side: jax.numpy.asarray(end) for side, end in drawn.items()}}
    held = replace(free, states=free.states._replace(params=free.states.params._replace(policy=limited)))
    (found,) = [function for function in exportables(held, 1) if function.name == "policy"]
    assert "clip what is drawn to the learned limits, from [-0.25, -1.0] to [0.5, 0.125]" in found.about
    assert functions(True)[1]["policy"].about.endswith("the world clips what is drawn")
    obs = jax.numpy.asarray(held.expert.obs[0, 0], jax.numpy.float32)
    mean = np.asarray(jax.jit(found.call)(obs)[0])
    assert (mean >= [-0.25, -np.inf]).all() and (mean <= [0.5, 0.125]).all()  # without a limit the world clips


def test_a_difference_is_relative_to_what_is_large_and_infinite_between_shapes():
    assert difference(np.array([1e3 + 1e-3, 0.5]), np.array([1e3, 0.5])) == pytest.approx(1e-6, rel=1e-3)
    assert difference(np.array([0.5 + 1e-3]), np.array([0.5])) == pytest.approx(1e-3)
    assert difference(np.zeros(2), np.zeros(3)) == float("inf")


def test_without_flatbuffers_one_line_names_the_extra(monkeypatch, tmp_path):
    def absent(*_):
        raise ImportError("flatbuffers")

    monkeypatch.setattr(jax_export.Exported, "serialize", absent)
    with pytest.raises(ValueError, match=r"install aircl-jax\[export\]"):
        export_run(functions(True)[0], 0, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_files_have_the_hashes_of_the_manifest_and_a_wrong_function_is_refused(monkeypatch, tmp_path):
    for package in ("flatbuffers", "onnx", "onnxruntime"):
        pytest.importorskip(package, reason="the extra `export` is not installed")
    result, found = functions(True)
    monkeypatch.setattr(export, "exportables", lambda *_: [found["policy"], found["step_feasibility"]])
    manifest = export_run(result, 1, tmp_path)
    assert json.loads((tmp_path / "manifest.json").read_text()) == manifest
    for entry in manifest["functions"].values():
        assert hashlib.sha256((tmp_path / entry["file"]).read_bytes()).hexdigest() == entry["sha256"]
        assert entry["greatest_difference"] <= 1e-6
        assert hashlib.sha256((tmp_path / entry["onnx"]["file"]).read_bytes()).hexdigest() == entry["onnx"]["sha256"]
    assert manifest["functions"]["policy"]["inputs"][0]["shape"] == ["b", 8]
    assert "velocity of x, m/s" in manifest["functions"]["policy"]["inputs"][0]["unit"]
    other = found["policy"]._replace(call=lambda obs: jax.tree.map(lambda leaf: leaf + 1e-4, found["policy"].call(obs)))
    with pytest.raises(ValueError, match="policy as exported differs by"):
        export.check(result, other, (tmp_path / "policy.stablehlo").read_bytes())


ALONE = """
import pathlib, sys
import numpy as np
from jax import export
function = export.deserialize(bytearray(pathlib.Path(sys.argv[1]).read_bytes()))
mean, std = function.call(np.load(sys.argv[2]))
np.save(sys.argv[3], mean)
assert not {"aircl_jax", "envs", "flax", "distrax"} & set(sys.modules)
"""


@pytest.mark.slow
def test_a_process_with_jax_alone_gets_the_same_policy(tmp_path):
    for package in ("flatbuffers", "onnx", "onnxruntime"):
        pytest.importorskip(package, reason="the extra `export` is not installed")
    result, found = functions(True)
    export_run(result, 1, tmp_path)
    [obs] = fresh_inputs(result, found["policy"], 11, 3)
    np.save(tmp_path / "obs.npy", obs)
    words = (tmp_path / "policy.stablehlo", tmp_path / "obs.npy", tmp_path / "mean.npy")
    subprocess.run([sys.executable, "-c", ALONE, *map(str, words)], check=True, timeout=120)
    np.testing.assert_allclose(np.load(tmp_path / "mean.npy"), found["policy"].call(obs)[0], atol=1e-6)


@pytest.mark.parametrize(("words", "says"), [([], "run_dir is missing"), (["run_dir=nowhere"], "nowhere")])
def test_what_does_not_fit_is_one_line(words, says, capsys):
    assert main(words) == 2
    assert says in capsys.readouterr().err
