import html
import warnings
from html.parser import HTMLParser

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from matplotlib.text import Text

from tdcr_planner.report import plots
from tdcr_planner.report.text import (
    MISSING_GLYPH,
    figure_text,
    markdown_text,
    page_text,
    plain_text,
    plotly_text,
    shorten,
)

# Half surrogates stand for bytes of file names that are no UTF-8.
any_text = st.text(st.characters(exclude_categories=()), max_size=120)
awkward = st.one_of(any_text, st.text("$\\{}_^<>&\"'%`|[]#*\n\t\r\0\u202e\u2066אبéß😀👩‍🔬日本", max_size=60))


def examples(test):
    for text in (
        "part_$REV_$DATE",
        "$\\frac{1}{0}$",
        "<script>alert(1)</script>",
        "<b>bold</b> & <br> &lt;",
        "a\nb\r\nc",
        "mesh \u202egnp.stl",
        "\udcff.stl",
        "שלום عالم 😀👩‍🔬 日本語",
        "%{x} ${title} $title",
        "x" * 5000,
        "",
    ):
        test = example(text)(test)
    return test


@examples
@given(awkward)
def test_plain_text_is_one_line_of_characters_that_can_be_written(text):
    shown = plain_text(text, 40)
    shown.encode("utf-8")
    assert len(shown) <= 40
    assert shown == " ".join(shown.split())
    assert not set(shown) & set(map(chr, [*range(32), 127, *range(0x202A, 0x202F), *range(0x2066, 0x206A), 0xFEFF]))


@given(st.text(min_size=1, max_size=200), st.integers(1, 60))
def test_shortened_text_keeps_its_ends(text, most):
    shown = shorten(text, most)
    assert len(shown) <= most
    if len(text) <= most:
        assert shown == text
    elif most > 4:
        assert text.startswith(shown.split("…")[0][:1])
        assert shown[-1] == text[-1]


@settings(deadline=None, max_examples=60)
@examples
@given(awkward)
def test_a_figure_draws_any_text_as_it_is_and_misses_no_glyph(text):
    with warnings.catch_warnings(), plots.plot_style():
        warnings.simplefilter("error")
        figure = plots.new_figure(200, 60)
        shown = figure_text(text)
        note = figure.text(0.0, 0.5, shown)
        axes = figure.add_axes((0.2, 0.2, 0.7, 0.7))
        axes.plot([0.0, 1.0], label=shown or "-")
        axes.set_yticks([0.0], [shown])
        axes.legend()
        figure.canvas.draw()
        # a formula would be drawn as one
        assert not any(text.get_parse_math() or text.get_usetex() for text in figure.findobj(Text))
        assert note.get_text().count("$") == plain_text(text).count("$")


def test_a_character_without_a_glyph_is_a_square():
    assert figure_text("a日b") == f"a{MISSING_GLYPH}b"
    assert figure_text("0.5 mm² ± 3° é Ω") == "0.5 mm² ± 3° é Ω"


def test_a_text_is_cut_to_a_width():
    with plots.plot_style():
        figure = plots.new_figure(400, 60)
        note = figure.text(0.0, 0.5, "W" * 300)
        plots.fit_text(note, 200.0)
        assert 150.0 < note.get_window_extent().width <= 200.0
        short = figure.text(0.0, 0.5, "short")
        plots.fit_text(short, 200.0)
        assert short.get_text() == "short"


@examples
@given(awkward)
def test_plotly_reads_no_tag_entity_or_template_in_it(text):
    shown = plotly_text(text, 400)
    assert not set(shown) & set("<>")
    assert "%{" not in shown
    assert html.unescape(shown) == plain_text(text, 400)


@examples
@given(awkward)
def test_a_page_shows_the_text_and_nothing_else(text):
    tags, parts = [], []

    class Reader(HTMLParser):
        def handle_starttag(self, tag, attrs):
            tags.append((tag, attrs))

        def handle_data(self, data):
            parts.append(data)

    reader = Reader()
    reader.feed(f'<p title="{page_text(text)}">{page_text(text)}</p>')
    reader.close()
    assert tags == [("p", [("title", plain_text(text))])]
    assert "".join(parts) == plain_text(text)


@examples
@given(awkward)
def test_markdown_has_one_cell_and_no_markup(text):
    shown = markdown_text(text)
    assert "\n" not in shown
    assert not set(shown) & set("<>")
    for sign in "|`[]$":
        before = [shown[:place] for place, character in enumerate(shown) if character == sign]
        assert all((len(head) - len(head.rstrip("\\"))) % 2 == 1 for head in before)


@pytest.mark.parametrize("span", [(1e-3, 1.0), (0.2, 0.9)])
def test_ticks_of_logarithmic_axes_are_plain_numbers(span, tmp_path):
    with plots.plot_style():
        figure = plots.new_figure(300, 300)
        axes = figure.subplots()
        axes.loglog(span, span)
        plots.save_figure(figure, tmp_path / "log.png")
        shown = [label.get_text() for axis in (axes.xaxis, axes.yaxis) for label in axis.get_ticklabels(which="both")]
    assert not any("$" in label for label in shown)
    if span[0] < 0.01:
        assert {"0.001", "0.01", "1"} <= set(shown)
