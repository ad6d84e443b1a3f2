"""Two virtual devices, a compilation cache, and every shape annotation of the library enforced."""

from pathlib import Path

from jaxtyping import install_import_hook

install_import_hook(["aircl_jax", "envs"], "beartype.beartype")

from aircl_jax import runtime  # noqa: E402

runtime.prepare(devices=2, cache=Path(__file__).parent.parent / ".pytest_cache" / "jax")
