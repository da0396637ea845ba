"""Text from users' files as plain text: in figures, in plotly.js, in HTML and in Markdown, where it is never markup."""

from __future__ import annotations

import html
import re
import unicodedata
from functools import cache

FONT_FAMILY = "DejaVu Sans"
# What stands for a character that the figures' font does not have.
MISSING_GLYPH = "\N{WHITE SQUARE}"
SHORT = 48
LONG = 400
_ELLIPSIS = "\N{HORIZONTAL ELLIPSIS}"
_UNREADABLE = "\N{REPLACEMENT CHARACTER}"
# Marks that turn the direction of the text around them (Unicode Standard Annex 9, section 2), and the byte order mark.
_DIRECTION_MARKS = re.compile("[\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069\ufeff]")
# Characters of no width: joiners, variation selectors, tags. A figure's font would draw each as a missing glyph.
_NO_WIDTH = re.compile("[\u00ad\u034f\u180b-\u180f\u200b-\u200d\u2060-\u206f\ufe00-\ufe0f\U000e0000-\U000e0fff]")
_MARKDOWN = re.compile(r"[\\`<>|\[\]$&]")


def plain_text(text: str, most: int = LONG) -> str:
    """Returns a text as one line of printable characters.

    White space becomes single spaces; control characters and marks of writing direction are left out; what is no
    character (half a surrogate pair, as undecodable file names have) becomes U+FFFD.

    Args:
        text: Any text.
        most: Largest number of characters; a longer text loses its middle, which keeps the ending of a file's name.
    """
    readable = []
    for character in _DIRECTION_MARKS.sub("", text):
        kind = unicodedata.category(character)
        if character.isspace():
            readable.append(" ")
        elif kind != "Cc":
            readable.append(_UNREADABLE if kind == "Cs" else character)
    text = " ".join("".join(readable).split())
    return shorten(text, most)


def shorten(text: str, most: int) -> str:
    """Returns a text of at most so many characters (1 or more), with an ellipsis in place of its middle."""
    if len(text) <= most:
        return text
    kept = most - 1
    tail = kept // 3
    return text[: kept - tail] + _ELLIPSIS + text[len(text) - tail :]


def figure_text(text: str, most: int = LONG) -> str:
    """Returns a text for a matplotlib figure made inside `plots.plot_style`, which does not look for formulas in it.

    A character without a glyph in the figures' font becomes a white square. A space goes before an underscore at the
    beginning, with which matplotlib marks what a legend leaves out.
    """
    glyphs = _glyphs()
    text = _NO_WIDTH.sub("", plain_text(text, most))
    text = "".join(character if ord(character) in glyphs else MISSING_GLYPH for character in text)
    return f" {text}" if text.startswith("_") else text


@cache
def _glyphs() -> frozenset[int]:
    """The characters that the figures' font has, regular and bold."""
    from matplotlib import font_manager

    faces = [font_manager.FontProperties(family=FONT_FAMILY, weight=weight) for weight in ("normal", "bold")]
    tables = [font_manager.get_font(font_manager.findfont(face)).get_charmap() for face in faces]
    return frozenset(tables[0]) & frozenset(tables[1])


def plotly_text(text: str, most: int = SHORT) -> str:
    """Returns a text for plotly.js, which reads tags and entities everywhere and %{...} in templates.

    It reads formulas between dollars only where MathJax is loaded, and the page loads none.
    """
    return html.escape(plain_text(text, most), quote=False).replace("%{", "%&#123;")


def page_text(text: str, most: int = LONG) -> str:
    """Returns a text for HTML: for an element's content, or for an attribute in quotes."""
    return html.escape(plain_text(text, most))


def markdown_text(text: str, most: int = LONG) -> str:
    """Returns a text for Markdown: a cell of a table, a heading or a sentence, never a tag, link, code or formula."""

    def escape(found: re.Match[str]) -> str:
        return html.escape(found[0]) if found[0] in "<>&" else f"\\{found[0]}"

    return _MARKDOWN.sub(escape, plain_text(text, most))
