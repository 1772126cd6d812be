"""The report: what it says, in which order, and that nobody's text becomes markup."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from html.parser import HTMLParser

import pytest

from granular_id.evaluation import accuracy_table, comparison_tables, fold_table, headline, recall_table
from granular_id.plotting import INK, new_figure
from granular_id.recording import Finding
from granular_id.report import write
from granular_id.report.page import html, split_notes
from granular_id.report.pictures import inline_svg
from granular_id.synthetic import synthesize
from report_cases import HOSTILE, page_of, result_of, small_result

VOID = {"meta", "link", "br", "img", "hr", "line"}


class Page(HTMLParser):
    """Elements, ids, references and visible text of a page; tags must close in order."""

    def __init__(self, text):
        super().__init__()
        self.ids, self.references, self.tags, self.words, self.open = [], [], [], [], []
        self.feed(text)
        self.close()
        assert self.open == []
        self.text = " ".join(" ".join(self.words).split())
        self.sections = [attrs["id"] for tag, attrs in self.tags if tag == "section"]

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        for name, value in attrs:
            if name == "id":
                self.ids.append(value)
            if name in {"href", "xlink:href"} and value.startswith("#"):
                self.references.append(value[1:])
            self.references += re.findall(r"url\(#([^)]+)\)", value or "")
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "style" not in self.open:
            self.words.append(data)


@pytest.fixture(scope="module")
def result():
    return result_of("four classes")


@pytest.fixture(scope="module")
def page():
    return Page(page_of("four classes"))


@pytest.fixture
def no_pictures(monkeypatch):
    """Drawing takes most of the time, and words do not depend on it."""
    monkeypatch.setattr("granular_id.report.page.pictures", lambda *_: [])


def test_every_number_is_there_the_headline_and_the_gap_on_top(result, page):
    assert " ".join(page.sections) == "accuracy confusions means high data warnings repeat"
    top = page.text[: page.text.index("Accuracy of each feature space")]
    assert headline(result) in top
    assert str(result.gap) in top
    for table in (
        accuracy_table(result),
        fold_table(result),
        recall_table(result),
        *comparison_tables(result),
    ):
        for row in table.rows:
            assert all(" ".join(cell.split()) in page.text for cell in row)
        assert all(note in page.text for note in table.notes)
    for words in ("Seed 0", result.command, result.versions["numpy"]):
        assert words in page.text


def test_every_figure_says_what_it_shows(result, page):
    plots = [attrs for tag, attrs in page.tags if tag == "svg" and attrs.get("class") == "plot"]
    # accuracy, confusion, recall; forces by material; histogram by axis
    assert len(plots) == 3 + len(result.labels) + 6
    assert all(plot["role"] == "img" and len(plot["aria-label"]) > 15 for plot in plots)


@pytest.mark.parametrize("case", ["four classes", "hostile names"])
def test_names_stay_text_nothing_is_fetched_and_nothing_runs(case):
    text = page_of(case)
    page = Page(text)
    assert len(text.encode()) < 3_000_000
    assert len(set(page.ids)) == len(page.ids)
    assert set(page.references) <= set(page.ids)
    assert not any(tag in {"script", "iframe", "object", "embed", "img"} for tag, _ in page.tags)
    assert not any(name.startswith("on") for _, attrs in page.tags for name in attrs)
    names = ("src", "href", "xlink:href")
    links = [attrs[name] for _, attrs in page.tags for name in names if name in attrs]
    assert all(link.startswith(("#", "data:")) for link in links)
    assert "http" not in re.sub(r"data:image/png;base64,[^\"]+", "", text)
    assert "@import" not in text
    assert text.count("</style>") == 1
    if case == "hostile names":
        assert all(" ".join(label.split()) in page.text for label in HOSTILE.values())


def test_a_figure_is_drawn_the_same_twice_with_ids_of_its_own():
    def draw(key):
        figure = new_figure(2, 2)
        figure.subplots().plot([0, 1], color=INK)
        return inline_svg(figure, key, 'a "line"')

    one, again, other = map(draw, ("a-1", "a-1", "a-2"))
    assert one == again
    ids = [re.findall(r' id="([^"]+)"', svg) for svg in (one, other)]
    assert len(ids[0]) > 1
    assert not set(ids[0]) & set(ids[1])
    assert "stroke: var(--ink)" in one
    assert 'aria-label="a &quot;line&quot;"' in one


def test_synthetic_recordings_are_called_so_first_of_all(no_pictures):
    data = synthesize(["rice", "fine sugar"], n_per_class=10, duration_s=0.5)
    page = Page(html(small_result(data, ["hfmh"])))
    assert page.text.startswith("SYNTHETIC: hfmh names")  # the title
    assert page.text.index("SYNTHETIC recordings.") < page.text.index("granular_id ")


@pytest.mark.parametrize("accept", [(), ("leak-clock",)])
def test_what_spoils_the_figures_stands_before_them(result, no_pictures, accept):
    finding = Finding("warning", "leak-clock", "the clock alone names 100 % of the labels")
    page = Page(html(replace(result, findings=(finding,), settings={**result.settings, "accept": accept})))
    assert finding.message in page.text
    assert (page.sections[0] == "findings") is not bool(accept)
    assert ("SPOILED by leak-clock" in page.text) is not bool(accept)
    assert ("leak-clock, accepted" in page.text) is bool(accept)


def test_warnings_and_notes_are_listed_apart(result, no_pictures):
    noted = replace(result, notes=("warning: beware", "5 random folds", "error: broken"))
    assert split_notes(noted) == (("beware", "broken"), ("5 random folds",))
    assert "Warnings (2)" in Page(html(noted)).text


def test_a_page_that_fails_leaves_the_old_file(result, tmp_path, monkeypatch, no_pictures):
    path = tmp_path / "report.html"
    write(result, path)
    before = path.read_text(encoding="utf-8")
    assert before.startswith("<!DOCTYPE html>")
    monkeypatch.setattr("granular_id.report.page.html", lambda result: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        write(result, path)
    assert [one.read_text(encoding="utf-8") for one in tmp_path.iterdir()] == [before]


def test_without_its_libraries_the_extra_is_named(result, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "jinja2", None)
    with pytest.raises(ImportError, match=r"pip install 'typer"):
        write(result, tmp_path / "report.html")
    assert list(tmp_path.iterdir()) == []
