"""Sphinx, offline: no font, script or picture from elsewhere, equations as MathML, search without a server."""

from __future__ import annotations

import sys
from importlib import metadata
from pathlib import Path
from typing import Any

from docutils.utils.math.latex2mathml import tex2mathml

sys.path.insert(0, str(Path(__file__).parents[2]))

project = "tippath"
copyright = "tippath contributors, MIT licence"
release = metadata.version("tippath")

extensions = ["myst_parser", "sphinx.ext.autodoc"]
myst_enable_extensions = ["deflist", "dollarmath"]
myst_fence_as_directive = ["math"]
myst_heading_anchors = 3
nitpicky = False
default_role = "literal"  # docstrings write code in single backticks
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_class_signature = "separated"  # a class shows its fields, not sixteen arguments
autodoc_type_aliases = {name: name for name in ("ArrayLike", "FloatArray", "ComplexArray", "AnyArray")}
python_maximum_signature_line_length = 80
smartquotes = False  # two hyphens begin an option
highlight_language = "none"

html_theme = "furo"
html_title = f"tippath {release}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
html_math_renderer = "mathml"
html_theme_options = {
    "light_css_variables": {"font-stack": "system-ui, sans-serif", "color-brand-primary": "#0060a0"},
    "dark_css_variables": {"color-brand-primary": "#56b4e9", "color-brand-content": "#56b4e9"},
    "footer_icons": [],
}


def inline_math(translator: Any, node: Any) -> None:
    translator.body.append(str(tex2mathml(node.astext())))


def block_math(translator: Any, node: Any) -> None:
    translator.body.append(f'<div class="equation">{tex2mathml(node.astext(), as_block=True)}</div>')


def skip(translator: Any, node: Any) -> None:
    from docutils.nodes import SkipNode

    raise SkipNode


def written(renderer: Any) -> Any:
    def visit(translator: Any, node: Any) -> None:
        renderer(translator, node)
        skip(translator, node)

    return visit


def setup(app: Any) -> None:
    app.add_html_math_renderer("mathml", (written(inline_math), None), (written(block_math), None))
