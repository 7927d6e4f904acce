"""The report in a real, headless Chromium: plots are drawn, nothing complains, nothing leaves the machine."""

from __future__ import annotations

import json
import re
import shutil
import urllib.parse
from dataclasses import replace
from pathlib import Path

import chromium
import pytest
import readable
import uncut
from arm_texts import arm
from click.testing import CliRunner
from crosscheck_examples import Night, night_run

from crosscheck.cli import main
from crosscheck.report.write_report import render
from crosscheck.verdicts.certificates import judge_by_certificate

pytestmark = chromium.MARKS
page = pytest.fixture(scope="module")(chromium.lend_page)
DRAWN = "document.getElementById('plots').dataset.drawn"
TRACES = "Array.from(document.querySelectorAll('.plot'), p => (p.data || []).filter(t => t.y && t.y.length).length)"
WIDE = "document.documentElement.scrollWidth <= innerWidth"


@pytest.fixture(scope="session")
def night(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Night:
    return night_run(root, tmp_path_factory.getbasetemp())


def address(file: Path) -> str:
    return "file://" + urllib.parse.quote(str(file))


def case_file(night: Night) -> Path:
    return night.out / "cases" / f"{night.results.cases[-1].slug}.html"


def quiet(page: chromium.Browser) -> None:
    """Nothing was complained about, and nothing asked for that is not a file or in the page itself."""
    assert page.complaints() == []
    foreign = [r for r in page.requests() if not r.startswith(("file://", "data:", "blob:"))]
    assert foreign == []
    assert not [e for e in page.events if e["method"] == "Page.javascriptDialogOpening"]


@pytest.mark.parametrize(("width", "dark"), [(1400, False), (400, False), (400, True)])
def test_every_page_fits_and_is_quiet(page: chromium.Browser, night: Night, width: int, dark: bool) -> None:
    for file in sorted(night.out.rglob("*.html")):
        page.open(address(file), width, 900, dark)
        if page.evaluate("!!document.querySelector('.plot')"):
            page.wait("!!document.querySelector('[data-drawn]')")
        assert page.evaluate(WIDE), file
        assert page.evaluate("document.documentElement.dataset.theme") == ("dark" if dark else "light")
        quiet(page)
        page.evaluate(OPEN)
        assert uncut.list_cut(page, MORE) == [], file


OPEN = "document.querySelectorAll('details').forEach(d => d.open = true)"
MORE = ".scroll.more"  # a box that fades at its side, where there is more: the matrix, which keeps its columns
WEIGHT = (
    2_000_000  # [bytes] of a page with what it loads, without the plotting script and without the data of its plots
)


@pytest.mark.parametrize("dark", [False, True])
def test_every_text_has_contrast_and_everything_that_acts_is_reached_by_keyboard(
    page: chromium.Browser, night: Night, dark: bool
) -> None:
    for file in sorted(night.out.rglob("*.html")):
        page.open(address(file), 1400, 900, dark)
        if page.evaluate("!!document.querySelector('.plot')"):
            page.wait("!!document.querySelector('[data-drawn]')")
        page.evaluate(OPEN)
        assert readable.faint(page) == [], file
        assert readable.unreachable(page) == [], file
        loaded = [
            Path(urllib.parse.unquote(r.removeprefix("file://"))) for r in page.requests() if r.startswith("file")
        ]
        assert sum(f.stat().st_size for f in loaded if f.name != "plotly.min.js" and "data" not in f.parts) < WEIGHT, (
            file
        )


def test_a_faint_text_and_a_thing_for_mice_alone_would_be_seen(page: chromium.Browser, tmp_path: Path) -> None:
    file = tmp_path / "faint.html"
    file.write_text(
        "<!doctype html><p style='color: #999'>pale</p><p style='opacity: .5'>half</p><p style='color: #888; font-size: 30px'>"
        "large enough</p><p style='color: #bbb; font-size: 30px'>large</p><p>plain</p><div onclick='1'>mouse</div>"
        "<button></button><a href='#' tabindex='3'>first</a><a href='#' style='outline: none'>blind</a>"
    )
    page.open(address(file))
    assert [line.rpartition(": ")[2] for line in readable.faint(page)] == ["pale", "half", "large"]
    said = [line.partition(":")[0] for line in readable.unreachable(page)]
    assert said == ["cannot be reached", "without a name", "before its turn", "focus is not seen"]


def test_what_is_cut_or_empty_would_be_seen(page: chromium.Browser, tmp_path: Path) -> None:
    """Each kind by itself; a box that scrolls is a cut, unless the page marks it as one of which there is more."""
    box = "<div class='{}' style='width: 300px; overflow-x: auto'>{}</div>"
    table = "<table style='width: 400px'><tr><td>numbers</td></tr></table>"
    svg = "<svg viewBox='0 0 100 100' width='{}'><path d='M50 50L{} 50' stroke='red'/></svg>"
    wrong = {
        "cut by 100 px: table : numbers": box.format("", table),
        "cut by": box.format("", f"<pre>{'0123456789' * 9}</pre>"),
        "not loaded: img : none.png": "<img src='none.png' width='50' height='50'>",
        "empty: svg": svg.format(0, 60),
        "reaches out of its frame: svg": svg.format(200, 150),
        "not drawn: div plot": "<div class='plot' style='height: 90px'></div>",
    }
    right = [box.format("more", table), box.format("", "<pre>0123</pre>"), svg.format(200, 60)]
    file = tmp_path / "cut.html"
    for said, text in wrong.items():
        file.write_text(f"<!doctype html>{text}{''.join(right)}")
        page.open(address(file))
        found = uncut.list_cut(page, ".more")
        assert len(found) == 1, said
        assert found[0].startswith(said)


@pytest.mark.parametrize(("width", "dark"), [(1400, True), (500, False)])
def test_nothing_is_cut_on_the_page_of_a_comparison(
    page: chromium.Browser, tmp_path: Path, width: int, dark: bool
) -> None:
    """Nor where names are long: a table that has no room shows its rows as cards with the titles of the columns."""
    name = "a_name_of_a_link_that_is_as_long_as_those_of_large_robots"
    edits = [(f'{tag} {key}="lower"', f'{tag} {key}="{name}"') for tag, key in TAGS]
    files = [str(arm(tmp_path, *edits)), str(arm(tmp_path, *edits, ('value="2.375"', 'value="2.625"'), name="b.urdf"))]
    out = tmp_path / "out"
    CliRunner().invoke(main, ["compare", *files, "--out", str(out)])
    page.open(address(out / "index.html"), width, dark=dark)
    assert uncut.list_cut(page) == []
    assert page.evaluate("document.querySelectorAll('.stacked').length") == (0 if width == 1400 else 2)
    quiet(page)
    if width == 500:
        titles = page.evaluate(
            "Array.from(document.querySelectorAll('.stacked tbody tr:first-child > *'), c => c.dataset.title)"
        )
        assert titles[:5] == ["what", "where", "A", "B", "size"]
        page.resize(1400)
        page.wait("!document.querySelector('.stacked')")  # with room again it is a table again


TAGS = (("link", "name"), ("child", "link"), ("parent", "link"))
LOST = "Array.from(document.querySelectorAll('.comparisons'), t => t.parentElement.scrollWidth - t.parentElement.clientWidth)"


def test_no_column_of_a_case_is_lost_also_where_a_certificate_fails(
    page: chromium.Browser, night: Night, tmp_path: Path
) -> None:
    out = shutil.copytree(night.out, tmp_path / "out")
    lines = tuple(
        replace(x, holds=x.what != "total mass") if x.engine == "pinocchio" else x for x in night.results.certificates
    )
    assert lines != night.results.certificates
    render(
        replace(
            night.results, certificates=lines, comparisons=tuple(judge_by_certificate(night.results.comparisons, lines))
        ),
        out,
    )
    for folder in (night.out, out):
        page.open(address(folder / "cases" / case_file(night).name), 1400)
        page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
        assert page.evaluate(LOST) == [0, 0]  # certificates, comparisons
    assert "certificate does not hold" in page.evaluate("document.querySelector('main').innerText")
    page.open(address(out / "cases" / case_file(night).name), 400)
    assert page.evaluate(WIDE)
    page.open(address(out / "index.html"), 1400)
    assert "1 certificate does not hold" in page.evaluate("document.querySelector('h1').innerText")
    assert "another mechanism: total mass" in page.evaluate("document.querySelector('.troubles').innerText")
    assert "another total mass" in page.evaluate("document.querySelector('.matrix').innerText")
    quiet(page)


def test_the_matrix_scrolls_in_its_own_box(page: chromium.Browser, night: Night) -> None:
    page.open(address(night.out / "index.html"), 400)
    assert page.evaluate("(b => b.scrollWidth > b.clientWidth)(document.querySelector('.matrix').parentElement)")
    page.evaluate("document.querySelector('.matrix').parentElement.scrollLeft = 200")
    assert page.evaluate("document.querySelector('.matrix .sticky').getBoundingClientRect().left") >= 0


def test_from_the_matrix_to_a_drawn_case_and_through_all_its_series(page: chromium.Browser, night: Night) -> None:
    page.open(address(night.out / "index.html"))
    page.evaluate("document.querySelector('.matrix td.within a').click()")
    page.wait("document.getElementById('plots') && " + DRAWN)
    assert page.evaluate(TRACES) == [3, 2, 2]  # three engines, two differences from flexinv, one spectrum and its marks
    assert page.evaluate("document.querySelector('#overlay svg .scatterlayer path.js-line').getTotalLength()") > 100
    seen = []
    for quantity in page.evaluate("Array.from(document.querySelector('#quantity').options, o => o.value)"):
        choose(page, "quantity", quantity)
        for series in page.evaluate("Array.from(document.querySelector('#series').options, o => o.value)"):
            choose(page, "series", series)
            page.wait(f"{DRAWN} === {json.dumps(series)}")
            engines = 3 if quantity == "torque" else 2
            assert page.evaluate(TRACES)[:2] == [engines, engines - 1]
            assert page.evaluate("document.querySelector('#spectrum').closest('figure').hidden") == (
                quantity != "torque"
            )
            seen.append(series)
    assert len(seen) == 2 + 2 * 3 + 2 * 6
    quiet(page)


LABELS = "Array.from(document.querySelectorAll('#spectrum .annotation-text'), a => a.getBoundingClientRect().toJSON())"
OVER = f"""(boxes => boxes.some((a, k) => boxes.slice(k + 1).some(
  b => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom)))({LABELS})"""
MOVED = """(p => Plotly.relayout(p, {'annotations[1].yshift': p.layout.annotations[0].yshift}).then(() => true))(
  document.getElementById('spectrum'))"""


@pytest.mark.parametrize("width", [1400, 400])
def test_frequencies_that_lie_close_do_not_lie_over_one_another(
    page: chromium.Browser, night: Night, tmp_path: Path, width: int
) -> None:
    """Four peaks within a tenth of the axis, in a copy of the report."""
    out = shutil.copytree(night.out, tmp_path / "out")
    file = out / "data" / case_file(night).stem / "torque.js"
    before, data, after = re.split(r"(\{.*\})", file.read_text(), flags=re.S)
    series = json.loads(data)
    for one in series["series"].values():
        for engine in one["spectrum"]["peaks"]:
            one["spectrum"]["peaks"][engine] = [[3.0 + 0.4 * k, 0.1] for k in range(4)]
    file.write_text(before + json.dumps(series) + after)
    page.open(address(out / "cases" / case_file(night).name), width)
    page.wait(DRAWN)
    page.wait(f"{LABELS}.length === 4")
    assert not page.evaluate(OVER)
    page.evaluate(MOVED)
    page.wait(OVER)  # labels that lie over one another would be seen
    quiet(page)


def choose(page: chromium.Browser, name: str, value: str) -> None:
    page.evaluate(
        f"(s => {{ s.value = {json.dumps(value)}; s.dispatchEvent(new Event('change')); }})(document.getElementById('{name}'))"
    )


def test_engines_are_hidden_shown_and_zoomed(page: chromium.Browser, night: Night) -> None:
    page.open(address(case_file(night)))
    page.wait(DRAWN)
    page.evaluate("document.querySelector('.engines input[value=fine]').click()")
    page.wait(f"{DRAWN} && JSON.stringify({TRACES}.slice(0, 2)) === '[2,1]'")
    page.evaluate("document.getElementById('log').click()")
    page.wait(f"{DRAWN} && document.getElementById('difference').layout.yaxis.type === 'log'")
    before = page.evaluate("document.getElementById('overlay').layout.xaxis.range")
    drag(page, "#overlay .nsewdrag", 0.3, 0.6)
    page.wait(
        f"JSON.stringify(document.getElementById('overlay').layout.xaxis.range) !== {json.dumps(json.dumps(before))}"
    )
    low, high = page.evaluate("document.getElementById('overlay').layout.xaxis.range")
    assert before[0] < low < high < before[1]
    hover(page, "#overlay .nsewdrag", 0.5)
    page.wait("document.querySelector('#overlay .hoverlayer').textContent.includes('pinocchio')")
    quiet(page)


MOMENT = "Number(document.getElementById('animation').dataset.drawn)"
INK = """(c => {
  const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
  let n = 0;
  for (let k = 3; k < d.length; k += 4) n += d[k] > 0;
  return n / (c.width * c.height);
})(document.getElementById('animation'))"""


@pytest.mark.parametrize(("width", "dark"), [(1400, False), (400, True)])
def test_the_mechanism_moves_by_mouse_and_by_keyboard(
    page: chromium.Browser, night: Night, width: int, dark: bool
) -> None:
    page.open(address(night.out / "index.html"), width, 900, dark)
    page.evaluate("document.querySelector('.matrix td.within a').click()")
    page.wait("document.getElementById('animation') && document.getElementById('animation').dataset.drawn")
    assert page.evaluate(MOMENT) == 0.0
    assert 1e-3 < page.evaluate(INK) < 0.5  # something is drawn, and not everything
    page.evaluate("document.getElementById('play').click()")
    page.wait(f"{MOMENT} > 0.02")
    page.evaluate("document.getElementById('play').click()")
    stopped = page.evaluate(MOMENT)
    page.evaluate("document.getElementById('animation').focus()")
    for key, code in ((" ", 32), ("ArrowLeft", 37), ("ArrowUp", 38)):
        page.press(key, code)
    page.wait(f"{MOMENT} !== {stopped}")
    page.press(" ", 32)
    assert page.evaluate("document.getElementById('play').getAttribute('aria-pressed')") == "false"
    page.evaluate("(s => { s.value = s.max; s.dispatchEvent(new Event('input')); })(document.getElementById('moment'))")
    assert page.evaluate(MOMENT) == 0.75
    assert page.evaluate("Array.from(document.getElementById('other').options, o => o.value)") == ["pinocchio"]
    before = page.evaluate("document.getElementById('animation').toDataURL()")
    choose(page, "enlarged", "10000")
    page.press("Home", 36)
    assert "its difference × 10000" in page.evaluate("document.getElementById('caption-animation').textContent")
    page.evaluate("document.getElementById('theme').click()")
    assert page.evaluate("document.getElementById('animation').toDataURL()") != before  # drawn in the other colours
    page.evaluate("document.getElementById('theme').click()")
    page.evaluate("localStorage.clear()")  # else the next page has the theme that was chosen here
    quiet(page)


def test_no_button_sends_data_away(page: chromium.Browser, night: Night) -> None:
    page.open(address(case_file(night)))
    page.wait(DRAWN)
    titles = page.evaluate("Array.from(document.querySelectorAll('.modebar-btn'), b => b.dataset.title)")
    assert {"Download plot", "Zoom", "Reset axes"} <= set(titles)
    assert not [t for t in titles if any(word in t.lower() for word in ("share", "cloud", "edit", "studio"))]
    assert page.evaluate("document.getElementById('overlay')._context.plotlyServerURL") == ""


def point(page: chromium.Browser, selector: str, share: float) -> dict[str, float]:
    box = page.evaluate(f"document.querySelector({json.dumps(selector)}).getBoundingClientRect().toJSON()")
    return {"x": box["left"] + share * box["width"], "y": box["top"] + 0.5 * box["height"]}


def drag(page: chromium.Browser, selector: str, start: float, end: float) -> None:
    a, b = point(page, selector, start), point(page, selector, end)
    page.call("Input.dispatchMouseEvent", type="mousePressed", button="left", clickCount=1, **a)
    page.call("Input.dispatchMouseEvent", type="mouseMoved", button="left", **b)
    page.call("Input.dispatchMouseEvent", type="mouseReleased", button="left", clickCount=1, **b)


def hover(page: chromium.Browser, selector: str, share: float) -> None:
    page.call("Input.dispatchMouseEvent", type="mouseMoved", **point(page, selector, share))


def test_the_theme_changes_and_redraws(page: chromium.Browser, night: Night) -> None:
    page.open(address(case_file(night)))
    page.wait(DRAWN)
    light = page.evaluate("document.getElementById('overlay').layout.font.color")
    page.evaluate("document.getElementById('theme').click()")
    page.wait(f"{DRAWN} && document.getElementById('overlay').layout.font.color !== {json.dumps(light)}")
    assert page.evaluate("document.documentElement.dataset.theme") == "dark"
    page.evaluate("document.getElementById('theme').click()")
    page.evaluate("localStorage.clear()")
    quiet(page)


def test_the_keyboard_reaches_the_content_the_matrix_and_a_case(page: chromium.Browser, night: Night) -> None:
    page.open(address(night.out / "index.html"))
    reached = []
    for _ in range(60):
        page.press("Tab", 9)
        here = page.evaluate("document.activeElement.outerHTML.slice(0, 300)")
        reached.append(here)
        if page.evaluate("!!document.activeElement.closest('.matrix td.within')"):
            break
    assert "skip" in reached[0]
    assert any('id="theme"' in r for r in reached)
    assert any('role="region"' in r for r in reached)
    page.press("Enter", 13)
    page.wait("document.getElementById('plots') && " + DRAWN)


def test_a_study_draws_its_curves(page: chromium.Browser, night: Night) -> None:
    page.open(address(night.out / "studies" / "rogue.html"))
    page.wait("document.getElementById('study').dataset.drawn")
    assert page.evaluate("document.querySelector('#study .legend').textContent") == "<b>bold</b>crooked"
    quiet(page)


def test_a_plot_that_cannot_be_drawn_says_so(page: chromium.Browser, night: Night, tmp_path: Path) -> None:
    copy = tmp_path / "torn"
    shutil.copytree(night.out, copy)
    shutil.rmtree(copy / "data")
    page.open(address(copy / "cases" / case_file(night).name))
    page.wait("document.getElementById('note').textContent.includes('could not be drawn')")
    assert not page.evaluate(DRAWN)
    assert page.complaints()  # so the other tests would have heard it


def test_a_request_that_leaves_the_machine_would_be_seen(page: chromium.Browser, tmp_path: Path) -> None:
    file = tmp_path / "leaky.html"
    file.write_text("<!doctype html><img src='http://127.0.0.1:9/x.png'>")
    page.open(address(file))
    page.wait("true")
    with pytest.raises(AssertionError):
        quiet(page)
