"""Make a world of another library: what that raises is one line, and what MuJoCo says of its model is dropped."""

import importlib
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from typing import Any


@contextmanager
def tried(task: str, library: str) -> Iterator[None]:
    """Raise ValueError, in one line, where the task does not run with the versions that are installed.

    MuJoCo would print its warnings, and write them into MUJOCO_LOG.TXT.
    """
    mujoco: Any = importlib.import_module("mujoco")
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda message: None)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of what the library itself imports
            yield
    except ValueError:
        raise
    except Exception as error:
        why = f"{type(error).__name__}: {(str(error) or 'no reason given').splitlines()[0]}"
        versions = f"{library} {version(library)}, jax {version('jax')}"
        raise ValueError(f"env.task={task} of {library} does not run here ({why}; {versions}); choose another") from error
    finally:
        mujoco.set_mju_user_warning(before)
