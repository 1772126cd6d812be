"""The documentation site: `make docs` builds it into docs/_build/html."""

import importlib
import sys
from enum import Enum
from pathlib import Path

from numpydoc.xref import DEFAULT_LINKS
from sphinx.addnodes import pending_xref
from sphinx.util.nodes import make_refnode

import granular_id

project = "granular_id"
author = "The granular_id developers"
project_copyright = "the granular_id developers"
release = version = granular_id.__version__

sys.path.insert(0, str(Path(__file__).parent))
extensions = [
    "commands",
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["_build"]
templates_path = ["_templates"]
nitpicky = True

myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3

autodoc_typehints = "none"  # numpydoc's sections say them in words
autosummary_generate = True
autosummary_imported_members = False
numpydoc_show_class_members = False
default_role = "py:obj"
python_maximum_signature_line_length = 88
toc_object_entries_show_parents = "hide"
smartquotes_action = "qe"  # no dashes: options begin with two hyphens

# Types are linked where they are ours; the names of others stay words, as no inventory of theirs is at hand offline.
PACKAGES = (
    *("archive", "confidence", "evaluation", "explanation", "identifier"),
    *("live", "recording", "spaces", "synthetic"),
)
NAMES = {
    name: f"granular_id.{package}.{name}"
    for package in PACKAGES
    for name in importlib.import_module(f"granular_id.{package}").__all__
} | {name: f"granular_id.{name}" for name in granular_id.__all__}
numpydoc_xref_param_type = True
numpydoc_xref_ignore = "all"
numpydoc_xref_aliases = {name: name for name in DEFAULT_LINKS} | {
    name: path for name, path in NAMES.items() if name[0].isupper()
}

copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"/\d_",
    "within_subsection_order": "FileNameSortKey",
    "ignore_pattern": r"(first_lines|rerun_log)\.py",
    "abort_on_example_error": True,
    "download_all_examples": False,
    "capture_repr": (),
    "image_scrapers": ("figures.scrape",),
    "first_notebook_cell": "%matplotlib inline",
    "remove_config_comments": True,
    "show_memory": False,
    "show_signature": False,
    "write_computation_times": False,
}

html_theme = "pydata_sphinx_theme"
html_title = "granular_id"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_sidebars = {
    page: [] for page in ("index", "install", "tutorial")
}  # they have no pages below
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "github_url": "https://github.com/granular-id/granular-id",
    "header_links_before_dropdown": 6,
    "navigation_with_keys": False,
    "secondary_sidebar_items": ["page-toc"],
    "show_toc_level": 2,
    "footer_start": ["copyright"],
    "footer_end": [],
}


def short_name(app, env, node, contnode):
    """Link `Dataset.check` as it stands in a docstring; what is no public name (a parameter, say) stays literal."""
    if node.get("refdomain") != "py":
        return None
    objects = env.domains.python_domain.objects
    target = node["reftarget"]
    head, dot, tail = target.partition(".")
    entry = objects.get(NAMES.get(head, head) + dot + tail)
    if entry is not None and entry.objtype != "module":
        return make_refnode(
            app.builder, node["refdoc"], entry.docname, entry.node_id, contnode
        )
    return (
        contnode
        if node["reftype"] == "obj" and not target.startswith("granular_id")
        else None
    )


def prefer_own(app, doctree):
    """In the text of a class `load` is its method; Sphinx would take the function of that name first."""
    objects = app.env.domains.python_domain.objects
    for node in doctree.findall(pending_xref):
        own = f"{node.get('py:module')}.{node.get('py:class')}.{node['reftarget']}"
        if node.get("refdomain") == "py" and own in objects:
            node["reftarget"] = own


def of_others(_app, what, name, member, _skip, _options):
    """Leave out what scikit-learn, enum, abc or tuples bring along: their own pages say what it does."""
    if type(member).__module__ == "_collections":
        return True
    member = getattr(member, "fget", None) or getattr(member, "func", None) or member
    of = (
        member
        if hasattr(member, "__module__")
        else getattr(member, "__objclass__", None)
    )
    home = getattr(of, "__module__", None) or (
        "builtins" if hasattr(int, name) else "granular_id"
    )
    return True if what == "class" and not home.startswith("granular_id") else None


def no_constructor(_app, what, _name, member, _options, signature, returns):
    """A protocol is not made, and an enumeration has its members."""
    made = what != "class" or not (
        issubclass(member, Enum) or getattr(member, "_is_protocol", False)
    )
    return (signature, returns) if made else ("", None)


def setup(app):
    app.connect("doctree-read", prefer_own)
    app.connect("missing-reference", short_name)
    app.connect("autodoc-skip-member", of_others)
    app.connect("autodoc-process-signature", no_constructor)
