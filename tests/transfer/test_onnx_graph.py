"""ONNX files give what was learned in a process that has neither jax nor this library, for any batch."""

import subprocess
import sys
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from aircl_jax.transfer.export import check_onnx, difference
from aircl_jax.transfer.exported import Exportable, Slot, exportables, fresh_inputs
from aircl_jax.transfer.onnx_graph import onnx_model
from tests.finished_runs import untrained, untrained_robot

pytest.importorskip("onnx", reason="the extra `export` is not installed")
onnxruntime = pytest.importorskip("onnxruntime", reason="the extra `export` is not installed")
RUNS = [
    (untrained_robot, "aircl_corrected"),
    (untrained_robot, "aircl_contrast"),
    (untrained, "aircl_contrast"),
    (untrained, "gacl"),
]


@cache
def functions(make, method):
    result = make(method)
    return result, {one.name: one for one in exportables(result, 1)}


def run(content: bytes, *inputs: np.ndarray) -> list[np.ndarray]:
    session = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])
    names = [one.name for one in session.get_inputs()]
    return session.run(None, dict(zip(names, inputs, strict=True)))


@pytest.mark.parametrize(("make", "method"), RUNS, ids=lambda of: getattr(of, "__name__", of))
def test_policy_and_step_feasibility_are_ours_in_any_batch(make, method):
    result, found = functions(make, method)
    for name in ("policy", "step_feasibility"):
        content = onnx_model(found[name])
        assert check_onnx(result, found[name], content) <= 1e-5
        inputs = fresh_inputs(result, found[name], 5, 1)
        assert [one.shape for one in run(content, *inputs)] == [(5, *slot.shape) for slot in found[name].outputs]


def of_one(call, *shapes) -> Exportable:
    """A function of float32 vectors, named x and y."""
    inputs = tuple(Slot(name, shape, "float32", "") for name, shape in zip("xy", shapes, strict=False))
    return Exportable("probe", jax.vmap(call), "", inputs, (Slot("out", (), "float32", ""),))


PROBES = {
    "a table by one-hot vectors": of_one(lambda x, y: jnp.einsum("t,x,tx->", x, y, jnp.arange(6.0).reshape(2, 3)), (2,), (3,)),
    "a product over both": of_one(lambda x, y: x @ jnp.ones((3, 3)) @ y, (3,), (3,)),
    "slices and powers": of_one(lambda x: (x[1:] ** 3 * jnp.square(x[:-1])).sum(), (4,)),
    "choice and bounds": of_one(lambda x: jnp.where(x > 0, x, jnp.clip(-x, 0.5, 0.7)).max(), (4,)),
    "soft": of_one(lambda x: jax.nn.log_softmax(x)[1] + jnp.log1p(jnp.exp(-jnp.abs(x))).min() + jax.nn.sigmoid(x[0]), (4,)),
    "what depends on nothing": of_one(lambda x: jnp.float32(2.5) + 0 * x[0], (4,)),
}


@pytest.mark.parametrize("name", PROBES)
def test_what_a_graph_is_made_of_does_as_jax(name):
    function = PROBES[name]
    random = np.random.default_rng(0)
    inputs = [random.normal(size=(7, *slot.shape)).astype(np.float32) for slot in function.inputs]
    [got] = run(onnx_model(function), *inputs)
    assert difference(got, function.call(*inputs)) <= 1e-6


def running_sum(x):
    return jax.lax.scan(lambda carry, one: (carry + one, carry * one), 0.0, x)[0]


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda x: jnp.sort(x)[0], "probe uses sort, which is not written as ONNX"),
        (running_sum, "probe uses scan, which is not written as ONNX"),  # whose body is no function called once
    ],
)
def test_what_is_not_written_is_named(call, said):
    with pytest.raises(ValueError, match=said):
        onnx_model(of_one(call, (4,)))


def test_an_axis_of_twice_the_batch_is_named():
    twice = of_one(lambda x: x.sum(), (4,))._replace(call=lambda x: jnp.concatenate([x, x]).reshape(-1, 2).sum(axis=1))
    with pytest.raises(ValueError, match=r"probe has an axis of 4\*b, which is not written as ONNX"):
        onnx_model(twice)


def test_a_wrong_graph_is_refused():
    result, found = functions(untrained_robot, "aircl_corrected")
    other = found["policy"]._replace(call=lambda obs: jax.tree.map(lambda leaf: leaf + 1e-3, found["policy"].call(obs)))
    with pytest.raises(ValueError, match="policy as exported differs by 1"):
        check_onnx(result, other, onnx_model(found["policy"]))


ALONE = """
import sys
import numpy as np
import onnxruntime
session = onnxruntime.InferenceSession(sys.argv[1], providers=["CPUExecutionProvider"])
mean, std = session.run(None, {"obs": np.load(sys.argv[2])})
np.save(sys.argv[3], mean)
assert not {"jax", "aircl_jax", "envs", "flax"} & set(sys.modules)
"""


def test_a_process_without_jax_gets_the_same_policy(tmp_path):
    result, found = functions(untrained_robot, "aircl_contrast")
    (tmp_path / "policy.onnx").write_bytes(onnx_model(found["policy"]))
    [obs] = fresh_inputs(result, found["policy"], 11, 3)
    np.save(tmp_path / "obs.npy", obs)
    words = [str(tmp_path / name) for name in ("policy.onnx", "obs.npy", "mean.npy")]
    subprocess.run([sys.executable, "-c", ALONE, *words], check=True, timeout=120, cwd=tmp_path)
    assert difference(np.load(tmp_path / "mean.npy"), found["policy"].call(obs)[0]) <= 1e-5
