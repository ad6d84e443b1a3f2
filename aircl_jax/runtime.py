"""What must be settled before jax is imported: devices and the compilation cache. Imports nothing heavy."""

import os
from pathlib import Path

_FORCED_DEVICES = "--xla_force_host_platform_device_count"


def prepare(devices: int | None = None, cache: Path | None = None) -> None:
    """One virtual CPU device per core and a persistent compilation cache; what the environment already sets is kept.

    Call it before the first import of jax: later it has no effect.
    """
    if _FORCED_DEVICES not in os.environ.get("XLA_FLAGS", ""):
        os.environ.setdefault("JAX_NUM_CPU_DEVICES", str(devices or cores()))
    if kept := cache or user_cache():
        os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(kept))
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")


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
