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
