"""Write a run's learned functions as StableHLO, some as ONNX too, with a manifest, and check what was written."""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import export

from aircl_jax.model.feasibility import FORBIDDEN_BELOW
from aircl_jax.runs.result import Result
from aircl_jax.storage import replacing, write_whole
from aircl_jax.transfer import onnx_graph
from aircl_jax.transfer.exported import BATCH, Exportable, Slot, exportables, fresh_inputs

PLATFORMS = ("cpu", "cuda")
MANIFEST = "manifest.json"
SUFFIX = ".stablehlo"
SEED = 20_261_128  # of the inputs that the check draws
BATCHES = (1, 64)  # that it calls with
TOLERANCE = 1e-6  # of each output, times its size where that is above 1
# Of ONNX, whose arithmetic is another: on δ₁ of a trained swimmer each of the two is 1.6e-6 from the same in double precision.
TOLERANCE_ONNX = 1e-5
AS_ONNX = ("policy", "step_feasibility")  # what a controller needs
SUFFIX_ONNX = ".onnx"
READING = "jax.export.deserialize(open(FILE, 'rb').read()).call(…), arrays in the order of `inputs`; needs jax and flatbuffers"


def export_run(result: Result, index: int, out: Path, platforms: Sequence[str] = PLATFORMS) -> dict[str, Any]:
    """Write every function of one seed, and manifest.json last; return the manifest.

    Raises:
        ValueError: in one line, where a package of the extra `export` is missing, or a written function does not give what
            ours does.
    """
    functions = exportables(result, index)
    written = {function.name: _serialised(function, platforms) for function in functions}
    checks = {function.name: check(result, function, written[function.name]) for function in functions}
    graphs = {function.name: onnx_graph.onnx_model(function) for function in functions if function.name in AS_ONNX}
    checks_onnx = {
        function.name: check_onnx(result, function, graphs[function.name]) for function in functions if function.name in graphs
    }
    out.mkdir(parents=True, exist_ok=True)
    entries = {}
    for function in functions:
        entries[function.name] = {
            **_written(out / f"{function.name}{SUFFIX}", written[function.name], checks[function.name]),
            "what": function.about,
            "inputs": [_described(slot) for slot in function.inputs],
            "outputs": [_described(slot) for slot in function.outputs],
        }
        if function.name in graphs:
            file = out / f"{function.name}{SUFFIX_ONNX}"
            entries[function.name]["onnx"] = _written(file, graphs[function.name], checks_onnx[function.name])
    manifest = {
        "env": result.spec.env.title,
        "method": result.spec.method_name,
        "seed": result.spec.seeds[index],
        "iterations": result.spec.config.iterations,
        "platforms": list(platforms),
        "jax": jax.__version__,
        "read_by": READING,
        "onnx_opset": onnx_graph.OPSET,
        "batch": f"{BATCH}, any number",
        "observations": "as the world shows them; the functions normalise them",
        "forbidden_below": FORBIDDEN_BELOW,
        "functions": entries,
    }
    write_whole(out / MANIFEST, json.dumps(manifest, indent=1, ensure_ascii=False) + "\n")
    return manifest


def exported(function: Exportable, platforms: Sequence[str]) -> export.Exported:
    """Lower a function for a batch of any size on these platforms."""
    (size,) = export.symbolic_shape(BATCH)
    shapes = [jax.ShapeDtypeStruct((size, *slot.shape), jnp.dtype(slot.dtype)) for slot in function.inputs]
    return export.export(jax.jit(function.call), platforms=tuple(platforms))(*shapes)


def check(result: Result, function: Exportable, content: bytes) -> float:
    """Call what was written on fresh inputs, and ours; return the greatest difference. Raises ValueError above 1e-6."""
    return _compared(result, function, export.deserialize(bytearray(content)).call, TOLERANCE)


def check_onnx(result: Result, function: Exportable, content: bytes) -> float:
    """Run a graph by onnxruntime on fresh inputs, and ours; return the greatest difference. Raises ValueError above 1e-5."""
    try:
        import onnxruntime
    except ImportError as error:
        raise ValueError(onnx_graph.MISSING) from error
    session = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])
    names = [slot.name for slot in function.inputs]
    return _compared(result, function, lambda *inputs: session.run(None, dict(zip(names, inputs, strict=True))), TOLERANCE_ONNX)


def _compared(result: Result, function: Exportable, call: Callable[..., Any], tolerance: float) -> float:
    worst = 0.0
    for number in BATCHES:
        inputs = fresh_inputs(result, function, number, SEED + number)
        theirs, ours = jax.tree.leaves(call(*inputs)), jax.tree.leaves(jax.jit(function.call)(*inputs))
        worst = max(worst, *(difference(*pair) for pair in zip(theirs, ours, strict=True)))
    if not worst <= tolerance:
        raise ValueError(f"{function.name} as exported differs by {worst:.1e} from ours, more than {tolerance:g}")
    return worst


def difference(theirs: Any, ours: Any) -> float:
    """The greatest |x − y| / max(1, |y|)."""
    theirs, ours = (np.asarray(values, np.float64) for values in (theirs, ours))
    if theirs.shape != ours.shape:
        return float("inf")
    return float((np.abs(theirs - ours) / np.maximum(1.0, np.abs(ours))).max(initial=0.0))


def _serialised(function: Exportable, platforms: Sequence[str]) -> bytes:
    try:
        return bytes(exported(function, platforms).serialize())
    except ImportError as error:
        raise ValueError("this needs the package flatbuffers, which is not installed; install aircl-jax[export]") from error


def _written(path: Path, content: bytes, worst: float) -> dict[str, Any]:
    """Write a file whole, and state it."""
    with replacing(path) as beside:
        beside.write_bytes(content)
    return {"file": path.name, "sha256": hashlib.sha256(content).hexdigest(), "greatest_difference": worst}


def _described(slot: Slot) -> Mapping[str, Any]:
    return {"name": slot.name, "shape": [BATCH, *slot.shape], "dtype": slot.dtype, "unit": slot.unit}
