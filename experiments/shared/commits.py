"""Find the commit that a number was made at, and whether the code has changed since."""

import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[2]
CODE = ("aircl_jax", "envs")  # the folders that a cell's numbers depend on


def current_commit() -> str:
    """Return this project's commit, with `-dirty` where the code differs from it, or `unknown` without Git."""
    head = _git("rev-parse", "--short", "HEAD")
    if head.returncode or not (ROOT / "pyproject.toml").exists():  # installed, perhaps within another project's repository
        return "unknown"
    changed = _git("diff", "--quiet", "HEAD", "--", *CODE, "experiments").returncode
    return head.stdout.strip() + ("-dirty" if changed else "")


def changed_since(commit: str) -> bool | None:
    """Return whether the library's code differs from a commit's; None where that cannot be found out."""
    if commit.endswith("-dirty"):
        return None
    return {0: False, 1: True}.get(_git("diff", "--quiet", commit, "--", *CODE).returncode)


def _git(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=False)
