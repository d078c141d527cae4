"""Configuration of Sphinx: builds the site from README.md and the pages of this folder.

.venv/bin/sphinx-build -W -c docs . build/site
"""

import importlib
import inspect
import re
import shutil
from pathlib import Path

from docutils import nodes
from latex2mathml.converter import convert
from pygments.lexers.special import TextLexer

import drake_pregrasp

ROOT = Path(__file__).parent.parent

project = "drake_pregrasp"
version = release = drake_pregrasp.__version__
copyright = "The drake_pregrasp authors"

root_doc = "README"
include_patterns = ["*.md", "docs/**"]
exclude_patterns = [".*", "build", "dist", "runs"]
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.viewcode"]

html_theme = "furo"
html_title = f"drake_pregrasp {version}"
html_show_sphinx = False
html_math_renderer = "mathml"  # MathJax would come from the network.
smartquotes = False

myst_heading_anchors = 4
myst_enable_extensions = ["dollarmath"]
myst_fence_as_directive = ["math"]
nb_execution_mode = "off"  # A test runs the notebooks.

default_role = "code"
autodoc_typehints = "description"
autodoc_member_order = "bysource"
napoleon_use_ivar = True


def _navigation() -> str:
    """Returns the contents of the site: the sections and links of docs/index.md."""
    text = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    trees = ["```{toctree}\n:hidden:\n\n/docs/index\n```\n"]
    for section in text.split("\n## ")[1:]:
        caption, _, body = section.partition("\n")
        pages = re.findall(r"^- \[[^]]+\]\(([^)#]+)\)", body, flags=re.MULTILINE)
        targets = [(ROOT / "docs" / page).resolve().relative_to(ROOT) for page in pages]
        lines = "\n".join(f"/{target.with_suffix('')}" for target in targets)
        trees.append(f"```{{toctree}}\n:hidden:\n:caption: {caption}\n\n{lines}\n```\n")
    return "\n" + "\n".join(trees)


def _complete(app, name, source):
    """Adds to the Markdown of a page what only the site has: navigation, and docstrings."""
    if name == root_doc:
        app.env.note_dependency(str(ROOT / "docs" / "index.md"), docname=name)
        source[0] += _navigation()
    if name == "docs/reference/api":
        entry = re.compile(r"^- \[`(\w+)`\]\(../../(.*)\.py\).*$", flags=re.MULTILINE)
        source[0] = entry.sub(_documented, source[0])


def _documented(entry: re.Match[str]) -> str:
    name, module = entry[1], drake_pregrasp
    if not hasattr(module, name):
        module = importlib.import_module(entry[2].replace("/", "."))
    item = getattr(module, name)
    kind = "function" if inspect.isfunction(item) else "class" if inspect.isclass(item) else "data"
    members = "\n   :members:" if kind == "class" and name != "GraspQualityView" else ""
    return f"\n```{{eval-rst}}\n.. auto{kind}:: {module.__name__}.{name}{members}\n```\n"


def _without_ports(app, what, name, item, options, lines):
    """Removes the ports of systems, which have a page, and keeps |x| from being a reference."""
    parts = "\n".join(lines).split("\n\n")
    kept = [
        part for part in parts if not re.match(r"\.\. pydrake_system::|    name: |Ports? `", part)
    ]
    lines[:] = "\n\n".join(kept).replace("|", r"\|").splitlines()


def _copy_home(app, error):
    if error is None:
        shutil.copyfile(Path(app.outdir, "README.html"), Path(app.outdir, "index.html"))


def _visit_inline_math(writer, node):
    writer.body.append(convert(node.astext()))
    raise nodes.SkipNode


def _visit_math_block(writer, node):
    writer.body.append(f"<p>{convert(node.astext(), display='block')}</p>")
    raise nodes.SkipNode


def setup(app) -> None:
    """Connects the functions above to the build."""
    app.add_html_math_renderer("mathml", (_visit_inline_math, None), (_visit_math_block, None))
    app.add_lexer("csv", TextLexer)
    app.connect("source-read", _complete)
    app.connect("autodoc-process-docstring", _without_ports, priority=400)
    app.connect("build-finished", _copy_home)
