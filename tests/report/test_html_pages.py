"""Pages: valid, and alone: nothing is fetched or run that is not the page's own."""

import json
import re
import shutil
import subprocess
import threading
from dataclasses import fields, replace
from http.server import BaseHTTPRequestHandler, HTTPServer

import html5lib
import numpy as np
import pytest
from lxml.html import fromstring

import loopid
from closure_robots import body, urdf
from loopid.identification import FitSamples
from loopid.identification.saved import FitFile
from loopid.logs import Recording
from loopid.paper.page import paper_report
from loopid.plots import Chart, Mark, Panel
from loopid.report import (
    Card,
    Page,
    Section,
    base_report,
    check_report,
    excitation_report,
    identification_report,
    payload_report,
    prediction_report,
)
from loopid.report.compare import comparison_report
from loopid.report.look import plain_table
from made_runs import HINGE, quietly, record, wander, with_answers

HOSTILE = (
    "<script>alert(1)</script>",
    '"><img src=http://127.0.0.1:1/x onerror=alert(1)>',
    "</title></style></script>",
    "$\\nope$ \x1b[31m \x00 \u2028 {{ 1 + 1 }}",
)


PAGES = {
    "identification": lambda get: identification_report(get("study"), "loopid excite"),
    "check": lambda get: check_report(get("knee")),
    "base": lambda get: base_report(get("knee"), "gravity", get("study").force_model.base),
    "prediction": lambda get: prediction_report(get("knee"), [prediction_of(get("study"))]),
    "comparison": lambda get: comparison_report(saved(get("study"))),
    "payload": lambda get: payload_report(get("knee"), quietly(payload, get("study"))),
    "excitation": lambda get: excitation_report(get("designed")),
    "paper": lambda get: paper_report(get("paper")),
}


@pytest.fixture
def page_of(request, once):
    """A page by its name."""

    def made(name):
        if name == "hostile":
            return hostile()
        report = PAGES[name](request.getfixturevalue)
        return report.page("loopid identify 3ups_rpu run.csv").html()

    return lambda name: once(f"page of {name}", lambda: made(name))


@pytest.fixture
def pages(page_of):
    """Pages of all kinds of parts."""
    return {name: page_of(name) for name in (*PAGES, "hostile")}


def saved(study):
    return {name: FitFile.of(study[name].fit) for name in ("all parameters", "robot file")}


def payload(study, mass=6.0):
    """Of what the platform carries in the second of two runs."""
    model, run = study.force_model, study.training[0].between(0.0, 20.0)
    motion = run.motion
    columns = model.standard_regressor(
        motion.configurations, motion.velocities, motion.accelerations
    )
    weight = mass * columns[..., model.base.parameters.labels.index("platform.m")]
    loaded = Recording.of_motion(motion, run.force + weight, run.actuators)
    return loopid.identify_payload(model, link="platform", unloaded=[run], loaded=[loaded])


def prediction_of(study):
    found = study
    return found.fit.predict(found.training[0])


def hostile():
    """A page whose every text is one of the hostile names."""
    marks = tuple(Mark(name, np.arange(3.0), np.arange(3.0)) for name in HOSTILE)
    sections = tuple(
        Section(
            name,
            (
                name,
                plain_table(name, (name, ">x"), [(name, 1.0)]),
                Chart("c", name, name, (Panel(name, marks, labels=HOSTILE),)),
            ),
        )
        for name in HOSTILE
    )
    data = {name: name for name in HOSTILE}
    card = Card(word=HOSTILE[0], use=HOSTILE[1], next=HOSTILE[2], command=HOSTILE[3])
    return Page(HOSTILE[2], sections, HOSTILE[0], card, data=data).html()


@pytest.mark.parametrize("name", ["identification", "check", "payload", "hostile"])
def test_pages_are_valid(page_of, name):
    html5lib.HTMLParser(strict=True).parse(page_of(name))  # or a ParseError
    page = fromstring(page_of(name))
    ids = page.xpath("//@id")
    assert len(ids) == len(set(ids))
    for link in page.xpath("//a/@href"):
        assert link.removeprefix("#") in ids


@pytest.mark.parametrize("name", ["identification", "check", "hostile"])
def test_nothing_on_a_page_is_from_elsewhere(page_of, name):
    page = fromstring(page_of(name))
    assert not page.xpath("//@src | //link | //iframe | //object | //img | //form | //base")
    assert all(link.startswith("#") for link in page.xpath("//@href"))
    assert len(page.xpath("//script")) == 2
    style, script = page.findtext(".//style"), page.xpath("//script")[-1].text
    for text in (style, script):
        assert not re.search(r"url\(|@import|//\w|fetch|XMLHttp|import\(", text.replace("// ", ""))
    policy = page.xpath("//meta[@http-equiv]/@content")
    assert "default-src 'none'" in policy[0]


def test_names_of_any_kind_stay_text(page_of):
    page = fromstring(page_of("hostile"))
    assert not page.xpath("//img")
    shown = page.find("body").text_content()
    assert HOSTILE[0] in shown
    assert "\\x1b[31m" in shown
    assert "{{ 1 + 1 }}" in shown
    (data,) = page.xpath("//script[@id='data']/text()")
    assert json.loads(data) == {name: name for name in HOSTILE}


def test_a_page_tells_how_it_came_about(page_of):
    text = fromstring(page_of("identification")).text_content()
    for word in ("loopid identify 3ups_rpu run.csv", "numpy", "Python"):
        assert word in text


def test_sections_can_be_put_together_anew(study):
    sections = identification_report(study).sections()
    page = fromstring(Page("mine", (Section("Notes", ("It ran.",)), sections[0])).html())
    assert page.xpath("//h2/text()") == ["Notes", sections[0].title]
    assert len(page.xpath("//figure")) == 1


def eight_motors():
    """An arm with eight hinges."""
    links = ["ground", *(f"link{k}" for k in range(8))]
    bodies = (body(link, (0.05, 0.02, 0.1), 2.0) for link in links[1:])
    axes = ("0 0 1", "0 1 0", "1 0 0") * 3
    hinges = (
        HINGE.format(f"motor{k}", *links[k : k + 2], 0.2, axes[k]) for k in range(len(links) - 1)
    )
    return urdf(*bodies, *hinges)


def longer(study, count):
    """The study with this many samples, the same over and over."""

    def repeated(array):
        return np.resize(array, (count, *array.shape[1:]))

    found = study
    motion, data = found.training[0].motion, found.data
    columns = {field.name: repeated(getattr(motion, field.name)) for field in fields(motion)}
    motion = replace(motion, **columns | {"time": 0.001 * np.arange(count)})
    force = repeated(data.force)
    runs = (Recording.of_motion(motion, force, data.actuators),)
    samples = FitSamples.of(data.parameters, data.actuators, repeated(data.regressor), force)
    candidates = {
        name: replace(each, predicted=repeated(each.predicted))
        for name, each in found.candidates.items()
    }
    more = {"training": runs, "data": samples, "new": samples, "candidates": candidates}
    return with_answers(replace(found, **more), study)


@pytest.mark.parametrize("robot", ["knee", pytest.param("arm", marks=pytest.mark.validate)])
def test_the_page_of_a_long_log_is_small(robot, request, tmp_path):
    """40,000 rows, of eight motors when all are tried."""
    if robot == "knee":
        study = request.getfixturevalue("study")
    else:
        (tmp_path / "arm.urdf").write_text(eight_motors())
        arm = loopid.load(tmp_path / "arm.urdf")
        terms, values = loopid.JointTerms.with_values(arm, "Fc=2,Fv=3")
        run = record(arm, wander(arm, 0, size=8 * (0.5,)), (terms, values))
        model = loopid.force_model(arm, "gravity", terms)
        study = quietly(loopid.identify, model, [run])
    study = longer(study, 40_000)
    files = identification_report(study).files()
    assert len(files["report.html"].encode()) < 3_000_000  # 1.2 MB


# In a browser.

BROWSER = next(filter(None, map(shutil.which, ("chromium", "google-chrome", "chrome"))), None)
QUIET = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-sync"),
    *(
        "--disable-background-networking",
        "--disable-component-update",
        "--virtual-time-budget=2000",
    ),
)


def browse(page, folder, *options):
    """Standard output of a browser that opens a page."""
    if BROWSER is None:
        pytest.skip("needs Chromium")
    (folder / "page.html").write_text(page)
    command = [BROWSER, *QUIET, f"--user-data-dir={folder / 'user'}", *options]
    command.append((folder / "page.html").as_uri())
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    if done.returncode:
        pytest.skip(f"the browser does not run here: {done.stderr[-200:]}")
    return done.stdout


@pytest.fixture
def proxy():
    """A proxy of the browser that counts what it is asked for."""
    asked = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            asked.append(self.path)
            self.send_error(404)

        do_CONNECT = do_POST = do_HEAD = do_GET

        def log_message(self, *_):
            pass

    server = HTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"127.0.0.1:{server.server_port}", asked
    server.shutdown()
    server.server_close()


CALL = '<body><script>new Image().src = "http://{}.invalid/x"</script>'


def framed(*pages, looks=((800, "light"),)):
    """A page with these in frames, as a window of Chromium's is no narrower than 500 pixels."""
    sources = [page.replace("&", "&amp;").replace('"', "&quot;") for page in pages]
    frames = [
        f"<iframe style='border:0;width:{width}px;color-scheme:{scheme}' srcdoc=\"{source}\">"
        "</iframe>"
        for source in sources
        for width, scheme in looks
    ]
    return "<!DOCTYPE html><body>" + "".join(frames)


@pytest.mark.pages
def test_no_request_leaves_a_page(pages, tmp_path, proxy):
    """The policy stops a script that got into a page nevertheless; one outside of them is seen."""
    address, asked = proxy
    shown = framed(*pages.values(), pages["check"].replace("<body>", CALL.format("inside")))
    shown = shown.replace("<body>", CALL.format("outside"), 1)
    options = f"--proxy-server=http://{address}", "--proxy-bypass-list=<-loopback>", "--dump-dom"
    browse(shown, tmp_path, *options)
    own = {path for path in asked if ".invalid" in path or "127.0.0.1:1/" in path}
    assert own == {"http://outside.invalid/x"}


ZOOM = """
const plot = document.querySelector("[data-zoom] .plot"), box = plot.getBoundingClientRect();
const at = (kind, part) => plot.dispatchEvent(new PointerEvent(kind, {
  clientX: box.left + part * box.width, clientY: box.top + 5, pointerId: 1, bubbles: true}));
plot.setPointerCapture = () => {};
at("pointerdown", 0.25); at("pointermove", 0.5); at("pointerup", 0.5);
const drawn = [...document.querySelectorAll("[data-zoom] svg")];
const views = drawn.map(svg => svg.getAttribute("viewBox"));
at("pointermove", 0.5);
const opened = [true, false].map(printing => {
  dispatchEvent(new Event(printing ? "beforeprint" : "afterprint"));
  return document.querySelector("details").open;
});
document.body.dataset.told = JSON.stringify([opened, views,
  document.querySelector("[data-zoom] output").textContent,
  [...document.querySelector("[data-zoom] .across").children].map(tick => tick.textContent)]);
"""


@pytest.mark.pages
def test_a_chart_zooms_in_all_its_panels_and_tells_its_values_and_a_print_unfolds(tmp_path):
    time = np.linspace(0.0, 8.0, 801)
    panels = tuple(Panel(f"p{k}", (Mark("twice", time, 2 * time),)) for k in range(2))
    chart = Chart("c", "caption", "time (s)", panels, lanes=2, zoom="run")
    table = plain_table("values", ("a",), [["b"]])
    page = Page("zoom", (Section("Chart", (chart, table), folded=True),)).html()
    page = page.replace("</body>", f"<script>{ZOOM}</script></body>")
    shown = fromstring(browse(page, tmp_path, "--dump-dom"))
    folds, views, output, ticks = json.loads(shown.find("body").get("data-told"))
    assert folds == [True, False]
    assert views == ["2500 0 2500 1000"] * 2
    (low, high), _ = panels[0].limits()
    middle = low + (high - low) * 3 / 8
    at, told = re.fullmatch(r"([-\d.]+) · twice ([-\d.]+)", output).groups()
    assert float(at) == pytest.approx(middle, abs=0.1)
    assert float(told) == pytest.approx(2 * middle, abs=0.2)
    ends = low + (high - low) / 4, low + (high - low) / 2
    assert all(ends[0] <= float(tick) <= ends[1] for tick in ticks)


# What is wider than its room, what covers what, and text that is hard to read, with all unfolded.
MEASURE = """<script>
function luminance(colour) {
  const parts = colour.match(/[\\d.]+/g).slice(0, 3).map(part => part / 255);
  const linear = parts.map(c => c <= 0.03928 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
  return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
}

function measure(view) {
  const page = view.document, found = [], wide = page.documentElement.scrollWidth;
  page.querySelectorAll("details").forEach(each => { each.open = true; });
  if (wide > view.innerWidth) found.push(`the page is ${wide} wide`);
  const all = [...page.querySelectorAll("body *")];
  const text = node => node.nodeType === 3 && node.data.trim();
  const seen = all.filter(each => !each.closest("svg, script, math")
    && [...each.childNodes].some(text) && each.getClientRects().length);
  const lines = element => { // of its own text
    const range = page.createRange(), own = [...element.childNodes];
    return own.filter(node => node.nodeType === 3).flatMap(node => {
      range.selectNode(node);
      return [...range.getClientRects()];
    });
  };
  const name = element =>
    `${element.className || element.localName} "${element.textContent.slice(0, 40)}"`;
  for (const each of seen) {
    const style = view.getComputedStyle(each);
    const cut = lines(each).some(line => line.right > view.innerWidth + 0.5 || line.left < -0.5);
    if (cut && !each.closest("nav, .table"))
      found.push(`${name(each)} is cut at ${view.innerWidth}`);
    let ground = each;
    const behind = element => view.getComputedStyle(element).backgroundColor;
    while (ground.parentElement && behind(ground) === "rgba(0, 0, 0, 0)")
      ground = ground.parentElement;
    const pair = [style.color, behind(ground)].map(luminance);
    const ratio = (Math.max(...pair) + 0.05) / (Math.min(...pair) + 0.05);
    if (ratio < 4.8) found.push(`${name(each)} has a contrast of ${ratio.toFixed(2)}`);
  }
  for (const room of page.querySelectorAll(".lanes, .card, .forest tr, .checks, .legend, header")) {
    const inside = seen.filter(each => room.contains(each));
    const texts = inside.flatMap(each => lines(each).map(line => [each, line]));
    texts.forEach(([one, a], k) => texts.slice(0, k).forEach(([other, b]) => {
      const across = Math.min(a.right, b.right) - Math.max(a.left, b.left);
      const high = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
      if (one !== other && across > 1 && high > 3)
        found.push(`${name(one)} covers ${name(other)} at ${view.innerWidth}`);
    }));
  }
  return found;
}

onload = () => {
  const views = [...document.querySelectorAll("iframe")].map(frame => frame.contentWindow);
  document.body.dataset.told = JSON.stringify(views.map(view =>
    [view.matchMedia("(prefers-color-scheme: dark)").matches, ...new Set(measure(view))]));
};
</script>"""


WRONG = """<!DOCTYPE html><style>body { background: #fff; } b { position: absolute; }</style>
<body><p style="width:2000px;color:#999">faint</p><p class="card"><b>one</b><b>two</b></p>"""


@pytest.mark.pages
def test_nothing_on_a_page_is_cut_covered_or_faint(pages, tmp_path):
    """At three widths, light and dark; what is wrong on another page is seen."""
    own = [page for name, page in pages.items() if name != "hostile"]
    shown = framed(*own, WRONG, looks=((390, "light"), (760, "dark"), (1300, "light")))
    shown = fromstring(browse(shown + MEASURE, tmp_path, "--dump-dom"))
    found = json.loads(shown.find("body").get("data-told"))
    assert found[: 3 * len(own)] == [[False], [True], [False]] * len(own)
    _, *wrong = found[-3]
    assert 'p "faint" has a contrast of 2.85' in wrong
    assert 'b "two" covers b "one" at 390' in wrong
    assert any(each.startswith("the page is 20") for each in wrong)
