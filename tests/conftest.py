"""Two virtual devices, a compilation cache, and every shape annotation of the library enforced."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from jaxtyping import install_import_hook

from aircl_jax import runtime

runtime.prepare(devices=2, cache=Path(__file__).parent.parent / ".pytest_cache" / "jax")
install_import_hook(["aircl_jax", "envs"], "beartype.beartype")  # what it loads imports jax: after `prepare`


def pytest_configure(config: pytest.Config) -> None:
    """Compile the fast tests with few optimisations, in two thirds of the time; the slow ones compile as a run does."""
    import jax

    if config.option.markexpr == "not slow":
        os.environ["JAX_DISABLE_MOST_OPTIMIZATIONS"] = "1"  # of the processes that tests start: their bytes are compared
        jax.config.update("jax_disable_most_optimizations", True)


@pytest.fixture(scope="module")
def no_figures() -> Iterator[None]:
    """Draw nothing in the runs of a module, which takes half of a small run's time: `usefixtures("no_figures")`."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("aircl_jax.figures.of_a_run._parts", lambda result: [])
        yield
