"""What must be settled before jax is imported: devices and the compilation cache. Imports nothing heavy."""

import glob
import importlib.metadata
import os
import re
import warnings
from pathlib import Path
from typing import Any

_DAMAGED = re.compile(r"Error reading persistent compilation cache entry for '([^']+)'")  # JAX warns so
_FORCED_DEVICES = "--xla_force_host_platform_device_count"
_CORRECTIONS = {"0.10.2": "--xla_cpu_experimental_ynn_fusion_type="}  # by version of jaxlib: none of XLA's fusions into YNN


def prepare(devices: int | None = None, cache: Path | None = None) -> None:
    """One virtual CPU device per core and a persistent compilation cache; what the environment already sets is kept.

    Call it before the first import of jax: later it has no effect.
    """
    correct_products()
    if _FORCED_DEVICES not in os.environ.get("XLA_FLAGS", ""):
        os.environ.setdefault("JAX_NUM_CPU_DEVICES", str(devices or cores()))
    if kept := cache or user_cache():
        os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(kept))
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")
    if not getattr(warnings.showwarning, "mends", False):
        warnings.showwarning = _mending(warnings.showwarning)


def correct_products() -> None:
    """Add to XLA_FLAGS what makes this version of jaxlib multiply rightly on a CPU; `import aircl_jax` does it.

    Version 0.10.2 gives wrong numbers where a matrix that is one number throughout is multiplied from the left and the
    product reduced over rows (docs/robustness.md). XLA reads the flags at the first computation. Other versions do not
    know every flag and would end the process, so they get none; a flag that is set already is kept.
    """
    correction = _CORRECTIONS.get(importlib.metadata.version("jaxlib"), "")
    flags = os.environ.get("XLA_FLAGS", "")
    if correction not in flags:
        os.environ["XLA_FLAGS"] = f"{flags} {correction}".strip()


def _mending(show: Any) -> Any:
    """Show warnings, but remove entries of the compilation cache that JAX cannot read; it then writes them anew.

    JAX itself compiles what it cannot read and keeps the damaged entry for ever.
    """

    def shown(message: Any, *rest: Any, **names: Any) -> None:
        damaged = _DAMAGED.match(str(message))
        if not damaged:
            show(message, *rest, **names)
            return
        for entry in Path(os.environ["JAX_COMPILATION_CACHE_DIR"]).glob(f"{glob.escape(damaged[1])}*-cache"):
            entry.unlink(missing_ok=True)

    shown.mends = True  # pyright: ignore[reportFunctionMemberAccess]
    return shown


def cores() -> int:
    """The cores this process may use, which in a container or under a scheduler are fewer than the machine's."""
    available = getattr(os, "sched_getaffinity", None)
    return len(available(0)) if available else os.cpu_count() or 1


def user_cache() -> Path | None:
    """Our folder in the user's cache directory, as the XDG convention has it; None where it cannot be, as without a home."""
    try:
        folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "aircl_jax"
    except RuntimeError:
        return None
    nearest = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
    return folder if os.access(nearest, os.W_OK) else None
