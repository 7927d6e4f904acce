"""The site: it builds without a warning, asks nothing of other machines, fits a phone, and is searched without a server."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import urllib.parse
from pathlib import Path

import chromium
import pytest
import readable
import uncut
from once import made_once

pytest.importorskip("sphinx")
pytestmark = pytest.mark.slow
page = pytest.fixture(scope="module")(chromium.lend_page)
ROOT = Path(__file__).resolve().parent.parent
PARTS = ("flexinv", "crosscheck", "docs", "models", "reports/baseline")
FILES = ("pyproject.toml", "NOTATION.md", "CHANGELOG.md", "README.md", "LICENSE")
WEIGHT = 2_000_000  # [bytes] of a page with what it shows, without the script of views in space
VIEW = "02_ur5_flexible_forearm"  # the example with a view in space
WIDE = "document.documentElement.scrollWidth <= innerWidth + 1"
# Where the answers are, and words of them; how new users ask for each, in whole sentences and in words of their own.
ANSWERS = {
    "howto/payload": "entry of the link's table payload",
    "howto/noisy-torque": "A torque that rings or jumps has one of these reasons",
    "explanation/verdicts": "the error bars of both engines cover it",
    "howto/static-start": "flexinv finds the equilibrium under gravity first",
    "howto/compare": "crosscheck compare arm.urdf arm.xml",
    "howto/identify": "A bag is a log like any other",
    "howto/outside": "One command puts all of them beside ours",
}
ASKED = {
    "howto/payload": (
        *("How do I add a payload?", "attach a tool", "end effector mass", "gripper mass", "carry a weight"),
        *("mass at the flange", "tool mass", "payload URDF"),
    ),
    "howto/noisy-torque": (
        *("Why is my torque noisy?", "torque oscillates", "spikes in torque", "torque chatter", "vibration in torque"),
        *("high frequency oscillation", "torque not smooth", "jitter"),
    ),
    "explanation/verdicts": ('What does "explained" mean?', "matrix colours", "unjudged", "skipped", "deviation"),
    "howto/static-start": (
        *(
            "How do I start in equilibrium?",
            "initial conditions",
            "initial static",
            "steady state",
            "initial transient",
        ),
        *("initial deflection", "start from rest under gravity", "gravity sag"),
    ),
    "howto/compare": (
        *("How do I compare my URDF with my MJCF?", "URDF vs MJCF", "check URDF conversion", "mujoco xml urdf"),
        *("same robot", "compare --readers", "which reader drops mimic"),
    ),
    "howto/identify": ("rosbag", "ROS bag", "accelerometer", "motion capture markers", "system identification"),
    "howto/outside": ("make outside", "Drake", "DART", "Simbody"),
}
QUESTIONS = [(where, words) for where, all_words in ASKED.items() for words in all_words]
FIRST = 3  # results: what a reader sees of them without scrolling


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built once for all workers."""
    return made_once(tmp_path_factory, "site", build) / "html"


def build(home: Path) -> None:
    """Build the site into ``home``/html from a copy of the project: a build writes pages beside their sources."""
    leave = shutil.ignore_patterns("__pycache__", "_build", "examples", "mechanisms", "generated", "views", "sg_*")
    for part in PARTS:
        shutil.copytree(
            ROOT / part, home / part, ignore=leave if part == "docs" else shutil.ignore_patterns("__pycache__")
        )
    for name in FILES:
        shutil.copy(ROOT / name, home / name)
    # Examples run in test_docs; here their pages are made without running them, but for the one with a view in space.  Entries of
    # every function in the sidebar are Sphinx's own, and a fifth of the time.
    command = [sys.executable, "-m", "sphinx", "--fail-on-warning", "--keep-going", "-q", "-b", "html"]
    command += [
        "-D",
        f"sphinx_gallery_conf.filename_pattern=/{VIEW}",
        "-D",
        "toc_object_entries=0",
        str(home / "docs"),
        str(home / "html"),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stderr[-4000:]


def pages(site: Path) -> list[Path]:
    return sorted(path for path in site.rglob("*.html") if "_static" not in path.parts and "_modules" not in path.parts)


def visited(site: Path) -> list[Path]:
    """Pages that a browser looks at: all, but of mechanisms, which one template makes, every fourth and their list."""
    mechanisms = sorted((site / "mechanisms").glob("*.html"))
    left = {page for k, page in enumerate(mechanisms) if k % 4 and page.stem != "index"}
    return [page for page in pages(site) if page not in left]


def test_links_within_the_site_lead_somewhere(site: Path) -> None:
    broken = []
    for page in pages(site):
        for target in re.findall(r'(?:href|src)="([^"#?]+)', page.read_text(encoding="utf-8")):
            if "://" in target or target.startswith(("data:", "mailto:")):
                continue
            if not (page.parent / urllib.parse.unquote(target)).exists():
                broken.append(f"{page.relative_to(site)}: {target}")
    assert broken == []


def test_nothing_is_loaded_from_other_machines(site: Path) -> None:
    loaded = [
        f"{page.relative_to(site)}: {address}"
        for page in pages(site)
        for address in re.findall(r'<(?:script|img|link|iframe)[^>]+(?:src|href)="(https?://[^"]+)', page.read_text())
    ]
    assert loaded == []


def test_every_mechanism_has_its_page(site: Path) -> None:
    for folder in sorted((ROOT / "models").glob("*/mechanism.toml")):
        assert (site / "mechanisms" / f"{folder.parent.name}.html").is_file(), folder.parent.name


def test_every_example_can_be_taken_along_as_a_script_and_as_a_notebook(site: Path) -> None:
    for example in sorted((ROOT / "docs" / "gallery").glob("0*.py")):
        shown = (site / "examples" / f"{example.stem}.html").read_text(encoding="utf-8")
        for suffix in (".py", ".ipynb"):
            links = re.findall(rf'href="([^"]+/{example.stem}\{suffix})"', shown)
            assert links, f"{example.stem}{suffix}"
            assert all((site / "examples" / link).is_file() for link in links)
        cells = json.loads(next((site / "_downloads").rglob(f"{example.stem}.ipynb")).read_text())["cells"]
        assert {cell["cell_type"] for cell in cells} == {"code", "markdown"}


def test_options_of_commands_stand_as_they_are_typed(site: Path) -> None:
    """Typography makes of two hyphens a dash, which no shell understands; lines that a help lays out by hand are code."""
    shown = "".join((site / "reference" / f"{name}-command.html").read_text() for name in ("flexinv", "crosscheck"))
    assert re.findall(r"[–—]\w+", shown) == []
    assert re.findall(r"<p>\|.*|<cite>.*", shown) == []
    assert "crosscheck corpus --out corpus" in shown


def address(file: Path, query: str = "") -> str:
    return "file://" + urllib.parse.quote(str(file)) + query


@pytest.mark.browser
@pytest.mark.parametrize("dark", [False, True])
def test_pages_fit_are_quiet_have_contrast_and_are_reached_by_keyboard(
    page: chromium.Browser, site: Path, dark: bool
) -> None:
    """One visit of each page: at 1400 px all of it, and that it fits 400 px, too.

    In the dark every third page is seen, for what depends on it, contrast: all take their colours from one sheet.  The list of
    pages beside each of them is the same on all, and is gone through by keyboard once.
    """
    result: dict[str, list[str]] = {}
    for k, file in enumerate(visited(site)[:: 3 if dark else 1]):
        page.open(address(file), 1400, 900, dark)
        wrong = page.complaints() + readable.faint(page)
        wrong += [] if dark else readable.unreachable(page, ".main" if k else "body")
        asked = [r for r in page.requests() if not r.startswith("data:")]
        wrong += [f"asks another machine: {r}" for r in asked if not r.startswith("file://")]
        local = (Path(urllib.parse.unquote(r.removeprefix("file://").partition("?")[0])) for r in asked)
        weight = sum(one.stat().st_size for one in local)
        wrong += [f"weighs {weight} bytes"] if weight > WEIGHT else []
        for width in () if dark else (1400, 400):
            page.resize(width)
            wrong += [] if page.evaluate(WIDE) else [f"wider than {width} px"]
            page.evaluate(OPEN)
            wrong += [f"at {width} px {what}" for what in uncut.list_cut(page)]
        if wrong:
            result[str(file.relative_to(site))] = wrong
    assert result == {}


OPEN = (
    "document.querySelectorAll('details:not(.view)').forEach(one => one.open = true)"  # views load scripts of their own
)


@pytest.mark.browser
@pytest.mark.parametrize("dark", [False, True])
def test_pictures_are_as_light_or_dark_as_their_page(page: chromium.Browser, site: Path, dark: bool) -> None:
    """A picture on white in the dark dazzles; one of a single colour is empty.  All take their colours from one sheet."""
    seen: dict[str, tuple[float, float]] = {}
    for name in ("index", f"examples/{VIEW}", "mechanisms/walker", "explanation/speed"):
        page.open(address(site / f"{name}.html"), 1400, 900, dark)
        found = uncut.measure_pictures(page)
        assert found, name
        seen |= found
    assert {name: mean for name, (mean, _) in seen.items() if (mean < 0.3) != dark or (mean > 0.7) == dark} == {}
    assert min(spread for _, spread in seen.values()) > 0.5


@pytest.mark.browser
def test_a_picture_that_is_white_or_empty_would_be_seen(page: chromium.Browser, tmp_path: Path) -> None:
    drawn = "<svg xmlns='http://www.w3.org/2000/svg' width='90' height='90'><rect width='90' height='90' fill='white'/>{}</svg>"
    for name, inside in (("full", "<path d='M9 9L80 80' stroke='black'/>"), ("empty", "")):
        (tmp_path / f"{name}.svg").write_text(drawn.format(inside))
    file = tmp_path / "page.html"
    file.write_text("<!doctype html><article><img src='full.svg'><img src='empty.svg'></article>")
    page.open(address(file), dark=True)
    found = uncut.measure_pictures(page)
    assert found["full.svg"][0] > 0.7
    assert (found["full.svg"][1] > 0.5, found["empty.svg"][1] > 0.5) == (True, False)


@pytest.mark.browser
@pytest.mark.parametrize("width", [1400, 500])
def test_the_list_of_mechanisms_shows_its_pictures(page: chromium.Browser, site: Path, width: int) -> None:
    page.open(address(site / "mechanisms" / "index.html"), width)
    shown = page.evaluate(
        "Array.from(document.querySelectorAll('td img'), one => [one.src, one.clientWidth, one.clientHeight])"
    )
    assert len(shown) == len(list((ROOT / "models").glob("*/mechanism.toml")))
    assert [one for one in shown if one[1] < 100 or one[2] < 75] == []


@pytest.mark.browser
def test_a_view_in_space_loads_its_script_when_it_is_opened(page: chromium.Browser, site: Path) -> None:
    scripts = [file for file in site.rglob("*.js") if "plotly" in file.name]
    assert len(scripts) == 1  # one for all views
    page.open(address(site / "examples" / f"{VIEW}.html"))
    assert not [r for r in page.requests() if "plotly" in r]
    page.evaluate("document.querySelector('details.view summary').click()")
    for _ in range(600):  # a minute at most
        asked_for = page.requests()
        if address(scripts[0]) in asked_for:
            break
        page.evaluate("new Promise(then => setTimeout(then, 100))")
    assert address(scripts[0]) in asked_for
    assert [r for r in asked_for if not r.startswith(("file://", "data:", "blob:", "about:"))] == []


ROOM = 1400  # [px] in which every page shows the field
RESULTS = "Array.from(document.querySelectorAll('#search-results li a'), a => a.href)"


def asked(page: chromium.Browser, site: Path, question: str) -> list[str]:
    """Type a question into the field of the page at hand, at first that of the index, and return the addresses, best first."""
    if not page.evaluate(f"location.href.startsWith({json.dumps(address(site))}) && innerWidth === {ROOM}"):
        page.open(address(site / "index.html"), ROOM)
    page.evaluate("document.querySelector('.sidebar-search').focus()")
    page.call("Input.insertText", text=question)
    page.press("Enter", 13)
    words = json.dumps(urllib.parse.quote_plus(question))
    page.wait(f"location.search.includes({words}) && /found|did not match/.test(document.body.innerText)")
    result: list[str] = page.evaluate(RESULTS)
    return result


@pytest.mark.browser
@pytest.mark.parametrize(("where", "question"), QUESTIONS)
def test_a_question_is_answered_by_search_alone_in_two_clicks(
    page: chromium.Browser, site: Path, where: str, question: str
) -> None:
    """The first click sends the question, the second opens a result."""
    result = asked(page, site, question)
    places = [k for k, link in enumerate(result[:FIRST]) if where in link]
    assert places, f"{question}: {result[:5]}"
    page.evaluate(f"document.querySelectorAll('#search-results li a')[{places[0]}].click()")
    page.wait(f"location.href.includes({json.dumps(where)}) && document.readyState === 'complete'")
    assert ANSWERS[where] in " ".join(page.evaluate("document.querySelector('article').innerText").split())


@pytest.mark.browser
def test_a_question_without_an_answer_finds_nothing(page: chromium.Browser, site: Path) -> None:
    assert asked(page, site, "How do I paint an elephant?") == []
