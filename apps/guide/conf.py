"""Sphinx builds the guide as a site: `make docs` copies this folder to build/docs-source and calls it there.

The program prints the reference of its options, pairs and commands; its lines become the page reference.md.
DIMPLE_PROGRAM names the program.
"""

import os
import pathlib
import re
import shutil
import subprocess

project = "Dimple"
copyright = "The Dimple authors"
extensions = ["myst_parser"]
highlight_language = "none"  # of blocks without a language: commands and their output
html_theme = "furo"
html_title = "Dimple: user's guide"
html_copy_source = False
smartquotes = False  # two hyphens are a flag
myst_heading_anchors = 3  # as on a code-hosting site: cuts.md#cut-a-deformed-body
exclude_patterns = ["conf.py"]

HERE = pathlib.Path(__file__).resolve().parent
PROGRAM = os.environ.get("DIMPLE_PROGRAM", str(HERE.parent / "release" / "whole" / "dimple"))

CONTENTS = """
```{toctree}
:hidden:

getting-started
```

```{toctree}
:hidden:
:caption: Tutorials

tutorials/figure
tutorials/craniotomy
tutorials/instrument
```

```{toctree}
:hidden:
:caption: How to
:glob:

how-to/*
```

```{toctree}
:hidden:
:caption: Reference

method
validation
performance
files
reference
glossary
```
"""

# Pages that are kept with their tests: name here, file in the repository.
ELSEWHERE = {"validation": "tests/verification/README.md", "performance": "tests/bench/README.md"}


def printed(*words):
    """Output of the program, with each entry on one line."""
    run = subprocess.run([PROGRAM, *words], env={**os.environ, "COLUMNS": "100000"}, capture_output=True, text=True, check=True)
    return run.stdout


def options():
    """Heading for each section, and a paragraph with an anchor for each option."""
    lines, section = [], ""
    for key, default, meaning in re.findall(r"^  (\S+) += (\S.*?)  +(\S.*)$", printed("options"), re.M):
        if key.rsplit(".", 1)[0] != section:
            section = key.rsplit(".", 1)[0]
            lines += [f"### {section}", ""]
        lines += [f"({key.lower().replace('.', '-').replace('_', '-')})=", f"`{key}` (default `{default}`)", f": {meaning}", ""]
    return lines


def commands():
    """Help of each command, as printed."""
    lines = []
    for name in re.findall(r"^  ([a-z]+)  +\S", printed("--help").split("Subcommands:")[1].split("Examples:")[0], re.M):
        lines += [f"### dimple {name}", "", "```text", printed(name, "--help-all").rstrip(), "```", ""]
    return lines


def write_reference(app):
    lines = ["# Reference", "", "Printed by the program: `dimple options`, `dimple COMMAND --help-all`, `dimple options --pairs`.", ""]
    lines += ["## Options", "", *options(), "## Commands", "", *commands()]
    lines += ["## What cannot be combined", "", "```text", printed("options", "--pairs").rstrip(), "```", ""]
    (HERE / "reference.md").write_text("\n".join(lines))


def copy_pages(app):
    root = HERE.parent.parent
    for page, file in ELSEWHERE.items():
        shutil.copy(root / file, HERE / f"{page}.md")
        for picture in (root / file).parent.glob("results/*.svg"):
            (HERE / "results").mkdir(exist_ok=True)
            shutil.copy(picture, HERE / "results")


def for_the_site(app, page, source):
    """Adds the contents to the first page, and replaces links that leave the guide by paths."""
    if page == "index":
        source[0] += CONTENTS
    if page in ELSEWHERE:
        source[0] = re.sub(r"(?<!!)\[([^\]]*)\]\((?!https?:|#)([^)]*)\)", r"\1", source[0])
    source[0] = re.sub(r"(?<!!)\[([^\]]*)\]\((?:\.\./)*\.\./\.\./([^)#]*)(#[^)]*)?\)", r"\1 (`\2`)", source[0])


def setup(app):
    app.connect("builder-inited", write_reference)
    app.connect("builder-inited", copy_pages)
    app.connect("source-read", for_the_site)


myst_enable_extensions = ["deflist"]
