"""A report as data, and its rendering as one HTML file that needs nothing else.

A `Page` is made of sections, a section of blocks. Whatever has something to report builds these;
the look is decided here alone.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path

from .. import __version__
from ..files import write_text
from .style import STYLE


@dataclass(frozen=True)
class Text:
    """A paragraph; `kind` may set it apart as a `note` or a `warning`."""

    text: str
    kind: str = "plain"


@dataclass(frozen=True)
class Bullets:
    """A list of sentences."""

    items: Sequence[str]


@dataclass(frozen=True)
class Table:
    """Rows under a header. Cells that are numbers or start like one stand to the right.

    Attributes:
        header: one text per column.
        rows: cells as text.
        caption: a sentence above it.
        strong: indices of rows to set off.
        folded: shown on demand only, with the caption as the handle.
    """

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    strong: Sequence[int] = ()
    folded: bool = False


@dataclass(frozen=True)
class Picture:
    """An SVG element with a caption, which is also what a screen reader tells."""

    svg: str
    caption: str


@dataclass(frozen=True)
class Formula:
    """A transfer function, set as a fraction."""

    symbol: str
    numerator: str
    denominator: str
    after: str = ""


@dataclass(frozen=True)
class Tiles:
    """The few numbers to read first: (label, value, remark)."""

    items: Sequence[tuple[str, str, str]]


Block = Text | Bullets | Table | Picture | Formula | Tiles


@dataclass(frozen=True)
class Section:
    """A heading and what stands under it."""

    title: str
    blocks: Sequence[Block]


@dataclass(frozen=True)
class Page:
    """A whole report."""

    title: str
    lead: str
    sections: Sequence[Section] = field(default_factory=tuple)


def render(page: Page) -> str:
    """The page as HTML with everything inline: no script, no request to anywhere."""
    links = "".join(
        f'<a href="#s{i}">{escape(section.title)}</a>' for i, section in enumerate(page.sections)
    )
    body = "\n".join(
        f'<section id="s{i}"><h2>{escape(section.title)}</h2>\n'
        + "\n".join(_block(block) for block in section.blocks)
        + "</section>"
        for i, section in enumerate(page.sections)
    )
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(page.title)}</title><style>{STYLE}</style></head>\n<body><main>"
        f"<header><h1>{escape(page.title)}</h1><p>{escape(page.lead)}</p><nav>{links}</nav></header>"
        f"\n{body}\n<footer>vdmsi_jax {__version__}</footer></main></body></html>\n"
    )


def write_page(folder: Path, page: Page) -> Path:
    """Write the page as `report.html`."""
    return write_text(folder / "report.html", render(page))


def _block(block: Block) -> str:
    return _RENDER[type(block)](block)


def _text(block: Text) -> str:
    return f'<p class="{escape(block.kind)}">{escape(block.text)}</p>'


def _bullets(block: Bullets) -> str:
    return "<ul>" + "".join(f"<li>{escape(item)}</li>" for item in block.items) + "</ul>"


def _table(block: Table) -> str:
    head = "".join(f"<th>{escape(cell)}</th>" for cell in block.header)
    rows = ""
    for i, row in enumerate(block.rows):
        cells = "".join(
            f"<td{' class=number' if _looks_numeric(cell) else ''}>{escape(cell)}</td>"
            for cell in row
        )
        rows += f"<tr{' class=strong' if i in block.strong else ''}>{cells}</tr>"
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
    table = f'<div class="wide">{table}</div>'
    caption = escape(block.caption)
    if block.folded:
        return f"<details><summary>{caption}</summary>{table}</details>"
    return (f'<p class="caption">{caption}</p>' if caption else "") + table


def _looks_numeric(cell: str) -> bool:
    return cell[:1].isdigit() or cell[:1] in "+−-–" or cell[:1] == "("


def _picture(block: Picture) -> str:
    svg = block.svg.replace("<svg ", f'<svg role="img" aria-label="{escape(block.caption)}" ', 1)
    return f"<figure>{svg}<figcaption>{escape(block.caption)}</figcaption></figure>"


def _formula(block: Formula) -> str:
    return (
        f'<p class="formula"><i>{escape(block.symbol)}</i>&nbsp;=&nbsp;<span class="fraction">'
        f"<span>{block.numerator}</span><span>{block.denominator}</span></span>{block.after}</p>"
    )


def _tiles(block: Tiles) -> str:
    tiles = "".join(
        f"<div><span>{escape(label)}</span><b>{escape(value)}</b><span>{escape(remark)}</span></div>"
        for label, value, remark in block.items
    )
    return f'<div class="tiles">{tiles}</div>'


_RENDER: dict[type, Callable] = {
    Text: _text,
    Bullets: _bullets,
    Table: _table,
    Picture: _picture,
    Formula: _formula,
    Tiles: _tiles,
}
