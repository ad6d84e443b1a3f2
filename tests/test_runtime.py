"""What is settled before jax: the compilation cache, whose damaged entries are written anew."""

import os
import subprocess
import sys
from pathlib import Path

from aircl_jax import runtime

ROOT = Path(__file__).parents[1]
COMPILING = """
from aircl_jax import runtime
runtime.prepare(devices=1)
import jax
print(jax.jit(lambda x: 3 * x + 1)(2.0))
"""

MULTIPLYING = """
import aircl_jax
import jax, jax.numpy as jnp, numpy as np
x, y = np.eye(36, dtype="float32")[np.arange(4096) % 36], np.ones((4096, 4), "float32")
for _ in range(4):
    best = jax.jit(lambda x, y: jnp.max(x @ jnp.zeros((36, 4)) + y, axis=1))(x, y)
    print(int((best != 1).sum()))
"""


def test_a_product_with_a_table_of_one_number_is_right_however_often_it_is_compiled():
    environment = {name: value for name, value in os.environ.items() if name not in ("XLA_FLAGS", "JAX_COMPILATION_CACHE_DIR")}
    variables = environment | {"JAX_ENABLE_COMPILATION_CACHE": "false"}
    done = subprocess.run(
        [sys.executable, "-c", MULTIPLYING], cwd=ROOT, env=variables, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["0"] * 4


def test_flags_of_xla_that_are_set_are_kept(monkeypatch):
    monkeypatch.setenv("XLA_FLAGS", "--xla_backend_optimization_level=0")
    runtime.prepare(devices=1)
    once = os.environ["XLA_FLAGS"]
    assert once.split() == ["--xla_backend_optimization_level=0", "--xla_cpu_experimental_ynn_fusion_type="]
    runtime.prepare(devices=1)
    assert os.environ["XLA_FLAGS"] == once
    monkeypatch.setenv("XLA_FLAGS", "--xla_cpu_experimental_ynn_fusion_type=LIBRARY_FUSION_TYPE_REDUCE")
    runtime.prepare(devices=1)
    assert os.environ["XLA_FLAGS"] == "--xla_cpu_experimental_ynn_fusion_type=LIBRARY_FUSION_TYPE_REDUCE"


def test_another_version_of_jaxlib_gets_no_flag_that_it_may_not_know(monkeypatch):
    monkeypatch.setenv("XLA_FLAGS", "")
    monkeypatch.setattr("importlib.metadata.version", lambda name: "0.11.0")
    runtime.correct_products()
    assert os.environ["XLA_FLAGS"] == ""


def test_a_damaged_entry_of_the_compilation_cache_is_written_anew(tmp_path):
    environment = {name: value for name, value in os.environ.items() if not name.startswith("JAX_")}

    def compiled() -> subprocess.CompletedProcess:
        variables = environment | {"JAX_COMPILATION_CACHE_DIR": str(tmp_path)}
        return subprocess.run(
            [sys.executable, "-c", COMPILING], cwd=ROOT, env=variables, capture_output=True, text=True, check=True
        )

    assert compiled().stdout == "7.0\n"
    whole = {entry: entry.stat().st_size for entry in tmp_path.glob("*-cache")}
    for entry in whole:
        entry.write_bytes(entry.read_bytes()[: entry.stat().st_size // 2])
    again = compiled()
    assert (again.stdout, again.stderr) == ("7.0\n", "")
    assert {entry: entry.stat().st_size for entry in whole} == whole


def test_without_a_home_directory_there_is_no_cache(monkeypatch):
    def homeless():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", homeless)
    assert runtime.user_cache() is None
