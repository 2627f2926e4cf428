"""The documentation site: `make docs` builds it into out/docs.

The pages of docs/ are its sources as they are; README, CHANGELOG and CONTRIBUTING are included from where they lie.
Nothing is fetched: no links into other projects' documentation, no fonts, no scripts from elsewhere.
"""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "docs")]

import hpop  # noqa: E402  (of this clone)

if TYPE_CHECKING:
    from sphinx.application import Sphinx

project = "hpop"
author = "the hpop authors"
copyright = author
version = release = hpop.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "myst_parser",
    "extensions.commands",
    "extensions.docstrings",
    "extensions.examples",
    "extensions.references",
    "extensions.repository",
    "extensions.signatures",
]
nitpicky = True
exclude_patterns = ["extensions", "__pycache__"]

# Pages
myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence", "attrs_inline", "attrs_block"]
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True
default_role = "code"  # `x` in a docstring
pygments_style, pygments_dark_style = "friendly", "native"

# The API
add_module_names = False
autodoc_default_options = {"members": True}
autodoc_member_order = "bysource"
autodoc_class_signature = "mixed"
autodoc_typehints_format = "short"
python_use_unqualified_type_names = True
python_display_short_literal_types = True
maximum_signature_line_length = 88

# Looks
html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_title = f"hpop {release}"
html_copy_source = html_show_sourcelink = False


def setup(app: Sphinx) -> None:
    """Read all pages anew where what reads them has changed."""
    code = b"".join(path.read_bytes() for path in sorted((ROOT / "docs" / "extensions").glob("*.py")))
    app.add_config_value("extensions_digest", hashlib.sha256(code).hexdigest(), "env")
