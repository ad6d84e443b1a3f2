"""Build the wheel: there `envs` and `experiments` lie within `aircl_jax`, where they are in no one else's way.

The repository keeps them at its top; an editable install finds them there. Everything else is in pyproject.toml.
"""

import re
import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

WITHIN = "aircl_jax"
MOVED = ("envs", "experiments")
NAMES = "|".join(MOVED)
# In this order: what people are shown, then what is imported, and what is named in a text.
REWRITTEN = (
    (re.compile(r"python -m experiments\."), "aircl "),
    (re.compile(r"""(["'])python\1, \1-m\1, \1experiments\."""), r"\1aircl\1, \1"),
    (re.compile(rf"^(\s*)(from|import) ({NAMES})\b", re.MULTILINE), rf"\1\2 {WITHIN}.\3"),
    (re.compile(rf"""(["'])({NAMES})(?=\1|[.:])"""), rf"\1{WITHIN}.\2"),
    (re.compile(rf"pkg://({NAMES})\b"), rf"pkg://{WITHIN}.\1"),
)


def rewritten(text: str) -> str:
    """Give the moved packages their names of within, in a file's text; a second time changes nothing."""
    for pattern, new in REWRITTEN:
        text = pattern.sub(new, text)
    return text


class BuildWithin(build_py):
    """Build as usual, then move the packages and rewrite what names them."""

    def run(self) -> None:
        super().run()
        if self.editable_mode:
            return
        built = Path(self.build_lib)
        for name in MOVED:
            shutil.rmtree(built / WITHIN / name, ignore_errors=True)
            shutil.move(built / name, built / WITHIN / name)
        for path in (built / WITHIN).rglob("*.py"):
            path.write_text(rewritten(path.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    setup(cmdclass={"build_py": BuildWithin})
