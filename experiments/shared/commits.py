"""The commit that a number was made at, and whether the code has changed since."""

import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[2]
CODE = ("aircl_jax", "envs")  # what a cell's numbers depend on


def current_commit() -> str:
    """Of this project; `-dirty` where the code differs from it."""
    found = _git("rev-parse", "--short", "HEAD")
    if found.returncode:
        return "unknown"
    changed = _git("diff", "--quiet", "HEAD", "--", *CODE, "experiments").returncode
    return found.stdout.strip() + ("-dirty" if changed else "")


def changed_since(commit: str) -> bool | None:
    """Whether the library's code differs from that of a commit; None where nobody can tell."""
    if commit.endswith("-dirty"):
        return None
    return {0: False, 1: True}.get(_git("diff", "--quiet", commit, "--", *CODE).returncode)


def _git(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=False)
