"""Make a world of another library without what MuJoCo would print, and write into MUJOCO_LOG.TXT, of its model."""

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def mujoco_quiet() -> Iterator[None]:
    """Drop MuJoCo's own warnings, as of an attribute that a library's model should no longer use."""
    mujoco: Any = importlib.import_module("mujoco")
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda message: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)
