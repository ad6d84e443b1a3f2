"""Settings of the documentation site, which `make docs` builds: the project's pages where they are, notebooks as they were run.

The sources' root is that of the project, so that a link means the same here and on a page read in the repository.
"""

import os
import re
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))
os.environ.setdefault("JAX_PLATFORMS", "cpu")

project = "AIRCL in JAX"
author = "the contributors of aircl-jax"
root_doc = "docs/index"
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx-mathjax-offline"]
include_patterns = ["README.md", "CONTRIBUTING.md", "CHANGELOG.md", "docs/**", "notebooks/*.ipynb", "results/**.md"]
exclude_patterns = [".*", "build", "runs", "tests", "dist", "**/__pycache__"]
html_theme = "furo"
html_title = project
html_copy_source = False
nb_execution_mode = "off"  # a test runs the notebooks; here are the outputs that they were committed with
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3  # links to headings, as GitHub names them
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
python_use_unqualified_type_hints = True
default_role = None

CODE = re.compile(r"(?<!`)`([^`\n]+)`(?!`)")
MARKUP = re.compile(r"([*|\\])|(?<=\w)_(?=\W|$)")  # what reStructuredText would take for markup; docstrings are plain words


def plain(_app: Any, _what: str, _name: str, _object: object, _options: object, lines: list[str]) -> None:
    """Show a docstring as it reads: `names` as code, equations as they stand."""
    for number, line in enumerate(lines):
        pieces = CODE.split(line)
        words = [re.sub(MARKUP, r"\\\g<0>", piece) if even % 2 == 0 else f"``{piece}``" for even, piece in enumerate(pieces)]
        lines[number] = "".join(words)


def short(_app: Any, _what: str, _name: str, _object: object, _options: object, arguments: str, result: str) -> tuple[str, str]:
    """Name jax's arrays in a signature as one imports them."""
    arguments, result = (text and text.replace("jaxlib._jax.Array", "Array") for text in (arguments, result))
    return arguments, result


def setup(app: Any) -> None:
    app.connect("autodoc-process-docstring", plain, priority=900)  # after napoleon, which reads sections
    app.connect("autodoc-process-signature", short)
