"""What MkDocs does beside its own work: pages of the API, pages from outside docs/, formulas.

Formulas become MathML when the site is built, so that no page asks for a script.
"""

import html
import re
from importlib import import_module
from inspect import ismodule
from pathlib import Path

from latex2mathml.converter import convert
from mkdocs.structure.files import File

import loopid

ROOT = Path(__file__).parents[1]
# Files from outside docs/, by their places in the site.
OTHERS = {"README.md": "index.md"} | {
    name: name for name in ("ARCHITECTURE.md", "CONTRIBUTING.md", "CHANGELOG.md", "urdf/bank.yaml")
}
FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.S)
LINK = re.compile(r"\]\((?:\.\./|docs/)?(README\.md|examples(?:/[^)]*)?(?=\))|[^)]*)")


def subpackages():
    """Full names of what is public, by the subpackage that it is from."""
    found = {}
    packages = [thing for name in loopid.__all__ if ismodule(thing := getattr(loopid, name))]
    for package in (loopid, *packages):
        for name in getattr(package, "__all__", dir(package)):
            thing = getattr(package, name)
            module = getattr(thing, "__module__", None) or ""
            if module.startswith("loopid.") and callable(thing):
                subpackage = module.split(".")[1]
                found.setdefault(subpackage, set()).add(f"{module}.{thing.__qualname__}")
    return sorted(found.items())


def on_config(config):
    """A page of the API a subpackage."""
    config.nav.append(
        {"Reference": [f"reference/{subpackage}.md" for subpackage, _ in subpackages()]}
    )
    return config


def on_files(files, config):
    """Pages that are not in docs/."""
    for name, place in OTHERS.items():
        files.append(File.generated(config, place, content=(ROOT / name).read_text()))
    for subpackage, names in subpackages():
        shown = sorted(names, key=lambda name: name.rpartition(".")[2])
        said = import_module(f"loopid.{subpackage}").__doc__
        text = "\n\n".join([f"# loopid.{subpackage}", said, *(f"::: {name}" for name in shown)])
        files.append(File.generated(config, f"reference/{subpackage}.md", content=text))
    return files


def on_page_markdown(markdown, page, **_):
    """Links of files in the repository as links of the site."""
    if page.file.src_uri.startswith("reference/"):
        return markdown

    def placed(found):
        target = found[1]
        name = target.partition("#")[0]
        if name.partition("/")[0] == "examples":
            return "](examples.md"
        return f"]({OTHERS.get(name, name)}{target[len(name) :]}"

    return LINK.sub(placed, markdown)


def on_page_content(content, **_):
    """Formulas as MathML; one of its own line scrolls where the screen is narrower."""

    def formula(found):
        own_line = found[1] == "div"
        math = convert(html.unescape(found[2]), display="block" if own_line else "inline")
        return f'<div style="overflow-x: auto">{math}</div>' if own_line else math

    return FORMULA.sub(formula, content)
