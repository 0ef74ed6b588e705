"""The documentation site, as ``make docs`` builds it: without warnings, and without a network."""

import importlib.util
import re
import shutil
import warnings
from copy import deepcopy
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from lxml import html

ROOT = Path(__file__).parents[1]
NEEDED = ("mkdocs", "material", "mkdocstrings", "latex2mathml")
MISSING = [name for name in NEEDED if importlib.util.find_spec(name) is None]
pytestmark = [
    pytest.mark.pages,
    pytest.mark.skipif(bool(MISSING), reason=f"needs {', '.join(MISSING)}: loopid[docs]"),
]


@pytest.fixture(
    scope="module", params=["names", pytest.param("docstrings", marks=pytest.mark.validate)]
)
def site(request, tmp_path_factory, once):
    """Pages of the site, by their paths; those of the API with docstrings take half of the time."""

    def built():
        from mkdocs.commands.build import build
        from mkdocs.config import load_config

        folder = tmp_path_factory.mktemp("site")
        with warnings.catch_warnings(action="ignore"):
            config = load_config(str(ROOT / "mkdocs.yml"), site_dir=str(folder))
            config.plugins["material/search"].config.enabled = False  # a quarter of the time
            config.plugins["mkdocstrings"].config.enabled = request.param == "docstrings"
            build(config)  # warnings abort it
        return folder

    pages = once(f"site of {request.param}", built).rglob("*.html")
    return {path: html.parse(path).getroot() for path in pages}


def test_every_page_and_public_name_is_there(site):
    import loopid

    found = {path.stem for path in site}
    assert {page.stem for page in ROOT.glob("docs/*.md")} <= found
    anchors = {anchor for page in site.values() for anchor in page.xpath("//@id")}
    for page in site.values():  # where docstrings are not asked for, what asks for them is left
        anchors |= {*re.findall(r"^::: (\S+)$", page.text_content(), re.M)}
    names = {anchor.rpartition(".")[2] for anchor in anchors}
    public = {name for name in loopid.__all__ if callable(getattr(loopid, name))}
    assert public - names == set()


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


BROWSER = next(filter(None, map(shutil.which, ("chromium", "google-chrome", "chrome"))), None)


@pytest.mark.validate
@pytest.mark.skipif(BROWSER is None, reason="needs Chromium")
def test_no_page_is_wider_than_a_phone(site):
    """Long formulas, blocks and tables scroll in boxes of their own; all pages in one."""
    api = pytest.importorskip("playwright.sync_api")
    first = next(path for path in site if path.name == "index.html")
    whole = html.parse(first).getroot()
    (own,) = whole.xpath("//article")
    for path, page in site.items():
        for article in page.xpath("//article"):
            article.set("title", path.name)
            own.addnext(deepcopy(article))
    together = first.with_name("together.htm")
    together.write_bytes(html.tostring(whole, doctype="<!doctype html>", encoding="utf-8"))
    width, script = 390, "all => all.map(each => [each.title, each.scrollWidth])"
    with api.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        screen = {"width": width, "height": 844}
        phone = browser.new_page(viewport=screen, is_mobile=True, java_script_enabled=False)
        phone.goto(together.as_uri())  # with its style
        needed = dict(phone.eval_on_selector_all("article", script))
        browser.close()
    assert needed.keys() >= {path.name for path in site if path.name != "404.html"}
    assert not {name for name, wide in needed.items() if wide > width}
