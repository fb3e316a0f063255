"""How the documentation is built: `sphinx-build -W --keep-going docs docs/_build/html`."""

from __future__ import annotations

import os
import re
import sys
import tomllib
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))
os.environ["NUMBA_DISABLE_JIT"] = "1"  # compiled functions are shown as the functions that they are

_about = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]

project = _about["name"]
author = "The loopsight developers"
release = version = _about["version"]

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
]
templates_path = ["_templates"]
exclude_patterns = ["_build", "_templates"]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
default_role = "py:obj"  # `name` in a docstring: a link where there is one, else code
suppress_warnings = ["ref.python"]  # a type's short name in a signature may be that of two classes

myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3
copybutton_prompt_text = r"\$ |>>> |\.\.\. "
copybutton_prompt_is_regexp = True

autosummary_generate = True
autodoc_member_order = "bysource"
autodoc_type_aliases = {"Array": "Array", "ComplexArray": "ComplexArray", "FloatOrArray": "FloatOrArray"}
autodoc_default_options = {"members": True, "undoc-members": True}
napoleon_google_docstring = False
napoleon_use_rtype = False

html_theme = "furo"
html_title = f"loopsight {release}"
html_show_copyright = False
# every object of every module in every page's tree costs minutes
toc_object_entries = False


def _forget_what_is_gone() -> None:
    """Remove generated pages of modules that there are no more: they would be warned about for ever."""
    for page in (Path(__file__).parent / "api").glob("*.rst"):
        path = ROOT.joinpath(*page.stem.split("."))
        if not (path.is_dir() or path.with_suffix(".py").exists()):
            page.unlink()


def _bars(_app: Any, _what: str, _name: str, _object: Any, _options: Any, lines: list[str]) -> None:
    """Show the bars of `|gain|` as they are, except in literal text, where nothing has a meaning."""
    for i, line in enumerate(lines):
        parts = re.split(r"(``.*?``)", line)
        lines[i] = "".join(part if part.startswith("``") else part.replace("|", r"\|") for part in parts)


def _aliases(
    _app: Any,
    _what: str,
    _name: str,
    _object: Any,
    _options: Any,
    signature: str | None,
    returned: str | None,
) -> tuple[str | None, str | None]:
    """Show an alias of a type by its name, where Sphinx shows its own wrapping of it."""

    def plain(text: str | None) -> str | None:
        return None if text is None else re.sub(r"TypeAliasForwardRef\('(\w+)'\)", r"\1", text)

    return plain(signature), plain(returned)


def setup(app: Any) -> None:
    """Register what is ours; Sphinx calls this."""
    _forget_what_is_gone()
    app.connect("autodoc-process-docstring", _bars)
    app.connect("autodoc-process-signature", _aliases)
