"""Two virtual devices, a compilation cache, and every shape annotation of the library enforced."""

from pathlib import Path

from jaxtyping import install_import_hook

from aircl_jax import runtime

runtime.prepare(devices=2, cache=Path(__file__).parent.parent / ".pytest_cache" / "jax")
install_import_hook(["aircl_jax", "envs"], "beartype.beartype")  # what it loads imports jax: after `prepare`
