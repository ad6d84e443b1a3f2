"""What several tests of the equations need."""

from collections.abc import Iterator

import jax
import pytest


@pytest.fixture
def double_precision() -> Iterator[None]:
    """Compute in float64: `pytestmark = pytest.mark.usefixtures("double_precision")`."""
    with jax.enable_x64(True):
        yield
