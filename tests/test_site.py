"""The documentation site, as ``make docs`` builds it: without warnings, and without a network."""

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from lxml import html

ROOT = Path(__file__).parents[1]
NEEDED = ("mkdocs", "material", "mkdocstrings", "latex2mathml")
MISSING = [name for name in NEEDED if importlib.util.find_spec(name) is None]
pytestmark = pytest.mark.skipif(bool(MISSING), reason=f"needs {', '.join(MISSING)}: loopid[docs]")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Pages of the site, by their paths."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", folder]
    environment = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "WARNING" not in done.stderr
    return {path: html.parse(path).getroot() for path in folder.rglob("*.html")}


def test_every_page_and_public_name_is_there(site):
    import loopid

    found = {path.stem for path in site}
    assert {page.stem for page in ROOT.glob("docs/*.md")} <= found
    anchors = {
        anchor.rpartition(".")[2] for page in site.values() for anchor in page.xpath("//@id")
    }
    public = {name for name in loopid.__all__ if callable(getattr(loopid, name))}
    assert public - anchors == set()


def test_pages_ask_for_nothing_from_elsewhere(site):
    for path, page in site.items():
        loaded = page.xpath(
            "//script/@src | //img/@src | //iframe/@src | //link[@rel!='canonical']/@href"
        )
        assert not [url for url in loaded if urlsplit(url).netloc], path


def test_links_lead_to_pages_and_headings(site):
    pages = {path: {*page.xpath("//@id"), ""} for path, page in site.items()}
    for path, page in site.items():
        for link in page.xpath("//article//a/@href"):
            parts = urlsplit(link)
            if not (parts.scheme or parts.netloc):
                target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
                assert target.exists(), (path.name, link)
                if target in pages:
                    assert unquote(parts.fragment) in pages[target], (path.name, link)


def test_formulas_are_mathml_and_all_of_them_are_known(site):
    formulas = [one for page in site.values() for one in page.xpath("//*[local-name()='math']")]
    assert len(formulas) > 300
    said = ["".join(one.itertext()) for one in formulas]
    assert not [text for text in said if "\\" in text]
    assert not [path for path, page in site.items() if re.search(r"\\[(\[]", page.text_content())]
