"""Configuration of the documentation site: ``make docs`` builds it into docs/_build/html.

``POSEFUSE_GALLERY=off`` builds the gallery's pages without running its examples.
"""

import os
import sys
from importlib.metadata import version as installed_version
from pathlib import Path

from sphinx_gallery.sorting import ExplicitOrder, FileNameSortKey

HERE = Path(__file__).parent
ROOT = HERE.parent
sys.path.insert(0, str(HERE / "_ext"))
# Examples run in this process, beside a theme that knows nothing of them: no window, one thread for linear algebra.
os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

project = "posefuse"
author = "The posefuse developers"
copyright = "The posefuse developers, BSD-3-Clause"
release = installed_version("posefuse")
version = release

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx.ext.mathjax",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    "api_pages",
    "command_pages",
    "site_pages",
]
exclude_patterns = ["_build", "_ext", "gallery/**/*.ipynb", "gallery/**/*.py"]
root_doc = "index"
default_role = "code"
nitpicky = True
# Types of other packages; the site needs no network, so that their inventories are not read.
nitpick_ignore_regex = [
    (r"py:.*", r"(?!posefuse)[\w.]*"),
    (r"py:.*", r"posefuse\.(?!\w+$).*"),  # a type that no public call returns is named, but has no page
]
show_warning_types = True
suppress_warnings = ["config.cache", "toc.empty_glob"]

myst_enable_extensions = ["colon_fence", "dollarmath", "deflist", "attrs_inline"]
myst_heading_anchors = 4
# The pages are written for GitHub too, where a page may begin below a heading of its own.
myst_dmath_double_inline = True

autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
autodoc_class_signature = "separated"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
add_module_names = False
toc_object_entries = False

sphinx_gallery_conf = {
    "examples_dirs": "../examples/gallery",
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "plot_gallery": os.environ.get("POSEFUSE_GALLERY", "on") != "off",
    "subsection_order": ExplicitOrder(
        [f"../examples/gallery/{name}" for name in ("basics", "input", "methods", "people", "results")]
    ),
    "within_subsection_order": FileNameSortKey,
    "remove_config_comments": True,
    "min_reported_time": 5,
    "abort_on_example_error": False,
    "only_warn_on_example_error": False,
    "show_memory": False,
    "write_computation_times": False,
    "thumbnail_size": (400, 280),
    "image_scrapers": ("matplotlib",),
    "reset_modules": ("matplotlib", "site_pages.reset_figures"),
}

copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

html_theme = "pydata_sphinx_theme"
html_title = "posefuse"
html_static_path = ["_static"]
html_favicon = "_static/favicon.svg"
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "logo": {"text": "posefuse"},
    "header_links_before_dropdown": 8,
    "navbar_align": "left",
    "navbar_end": ["version-switcher", "theme-switcher"],
    "navbar_persistent": ["search-button"],
    "switcher": {"json_url": "_static/switcher.json", "version_match": "dev"},
    "check_switcher": True,
    "show_toc_level": 2,
    "collapse_navigation": True,
    "navigation_with_keys": False,
    "back_to_top_button": False,
    "footer_start": ["copyright"],
    "footer_end": ["sphinx-version"],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
# The home page needs no second column.
html_sidebars = {"index": []}

linkcheck_ignore = [r"tcp://.*", r"http://localhost.*"]
linkcheck_anchors = False
